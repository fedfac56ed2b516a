"""Start values of what nothing simpler tells, in small networks: at random, until two adjustments end alike.

Where single closed solutions find no hold the observations of all together may still have one solution, and its basin
is wide: of random places of two tilted instruments and a local system one in five leads to it. Frames look at what they
see, from anywhere around what is known; points lie where their rays pass by each other. What is given or was found
stays. An end counts where all groups of observations agree with it, and is taken where it is the lowest and was
reached twice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from mor.approximate.approximation import Approximation
from mor.approximate.choices import SMALLER, SOUND, disagreement
from mor.approximate.parts.frames import Frame
from mor.approximate.parts.rule import Rule, rule
from mor.approximate.parts.scene import Scene
from mor.approximate.parts.transfer import put_rotation
from mor.approximate.points_at_infinity import nearly_parallel
from mor.approximate.vectors import unit
from mor.arrays import FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import exponential
from mor.project.network.build import Network

Settle = Callable[[Mapping[str, FloatArray]], tuple[Mapping[str, FloatArray], float] | None]
LARGEST = 1_000
"""Observations of a network up to which it is tried."""
TRIES = 20
"""Random starts: if one in five leads to the solution, two of 20 do with a probability of 93 %."""
_DRAWN = frozenset(("point", "rotation", "scale"))
"""Kinds of blocks that have random start values."""
_AIMED = 0.3
"""Length of the mean of all unit rays from which on a frame looks one way."""
_ANYWHERE = 0.05
"""Weight of a random place against that of a ray."""


class _End(NamedTuple):
    values: Mapping[str, FloatArray]
    squares: float


def from_random_places(
    network: Network, scene: Scene, found: Approximation, settle: Settle
) -> Approximation | None:
    """Start values by the solution that two tries lead to and none lies below; ``None`` where there is none.

    The same network has the same tries.
    """
    kinds = {kind for kind, values in found.start.items() if not np.isfinite(values).all()}
    if (
        network.observations > LARGEST
        or not kinds <= _DRAWN
        or _has_lines(network)
        or not _asks(network, found)
    ):
        return None
    random = np.random.default_rng(network.observations)
    ends: list[_End] = []
    with np.errstate(all="ignore"):  # from some places numbers grow beyond all bounds
        for tries in range(1, TRIES + 1):
            settled = settle(_drawn(network, scene, found.start, random))
            if settled is None:
                continue
            if np.isinf(settled[1]):  # what is singular anywhere is so everywhere
                return None
            end = _End(*settled)
            if disagreement(network.groups, end.values)[1] > SOUND:
                continue
            if any(_same(end, other) for other in ends) and not any(_below(other, end) for other in ends):
                return _with(network, found, end, rule(_WORDS, ends=len(ends) + 1, tries=tries))
            ends.append(end)
    return None


_WORDS = "random places: {ends} of {tries} adjustments from such led to a solution, two of them to this one"


def _has_lines(network: Network) -> bool:
    """True with lines, whose attitude counts from an axis that is chosen when all else has its place."""
    return any(feature.type == "line" for feature in network.project.features)


def _asks(network: Network, found: Approximation) -> bool:
    """False where all that is missing are points whose rays are nearly parallel: these have places of their own."""
    apart = nearly_parallel(network, found.start).points
    names = {network.blocks["point"].ids[p] for p in apart.tolist()}
    return any(thing.kind != "point" or thing.name not in names for thing in found.missing)


def _same(one: _End, other: _End) -> bool:
    return abs(one.squares - other.squares) <= SMALLER * max(one.squares, other.squares)


def _below(one: _End, other: _End) -> bool:
    return one.squares < other.squares and not _same(one, other)


def _with(network: Network, found: Approximation, end: _End, how: Rule) -> Approximation:
    """Everything that is not given as the solution has it: what was found may have been rough."""
    given = network.start
    start = {kind: np.where(np.isfinite(given[kind]), given[kind], end.values[kind]) for kind in found.start}
    named = {f"{one.kind} {one.name}": how for one in found.missing}
    return found._replace(start=start, how={**found.how, **named}, missing=(), remarks=())


def _drawn(
    network: Network, scene: Scene, start: Mapping[str, FloatArray], random: np.random.Generator
) -> dict[str, FloatArray]:
    """Start values of all blocks, those that are missing at random."""
    drawn = {kind: values.copy() for kind, values in start.items()}
    points, rotations = drawn["point"], drawn.get("rotation", np.zeros((0, 3, 3)))
    middle, size = _extent(start["point"])
    known = np.asarray(np.isfinite(start["point"]).all(axis=1))
    for frame in scene.frames:
        if np.isnan(rotations[frame.rotation]).any():
            here = points[frame.position]
            anywhere = middle + size * random.normal(size=3)
            here[:] = np.where(np.isfinite(here), here, anywhere)
            seen = start["point"][frame.points[known[frame.points]]]
            towards = (seen.mean(axis=0) if len(seen) else middle) - here
            put_rotation(network, rotations, frame.rotation, _looking(frame, unit(towards), random))
    for block in np.flatnonzero(np.isnan(rotations).any(axis=(1, 2))).tolist():
        put_rotation(network, rotations, block, _any_attitude(random))
    anywhere = middle + 0.5 * size * random.normal(size=points.shape)
    nearest = _nearest_to_rays(scene, points, rotations, anywhere)
    points[:] = np.where(np.isfinite(points), points, nearest)
    if "scale" in drawn:
        drawn["scale"] = np.where(np.isfinite(drawn["scale"]), drawn["scale"], 1.0)
    return drawn


def _extent(points: FloatArray) -> tuple[FloatArray, float]:
    """Middle (3,) of all coordinates that are known, and half of their extent."""
    told = np.isfinite(points)
    low = np.where(told, points, np.inf).min(axis=0, initial=np.inf)
    high = np.where(told, points, -np.inf).max(axis=0, initial=-np.inf)
    low, high = np.where(low <= high, low, 0.0), np.where(low <= high, high, 0.0)
    return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0


def _looking(frame: Frame, towards: FloatArray, random: np.random.Generator) -> FloatArray:
    """A rotation D by which a frame looks somewhere, turned about that at random; any one, if it looks all around."""
    mean = frame.rays.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < _AIMED:
        return _any_attitude(random)
    roll: FloatArray = exponential((random.uniform(-np.pi, np.pi) * towards)[None])[0]
    return (roll @ _turned(mean / length, towards)).T


def _turned(one: FloatArray, other: FloatArray) -> FloatArray:
    """The rotation by the smallest angle that takes one direction to another."""
    axis = np.cross(one, other)
    sine = float(np.linalg.norm(axis))
    across = axis / sine if sine > 0.0 else tolerant.svd(one[None])[2][1]
    turned: FloatArray = exponential((np.arctan2(sine, one @ other) * across)[None])[0]
    return turned


def _any_attitude(random: np.random.Generator) -> FloatArray:
    """A rotation, all of them being as likely (a unit quaternion)."""
    w, *axis = unit(random.normal(size=4))
    half = np.arccos(np.clip(w, -1.0, 1.0))
    attitude: FloatArray = exponential((2.0 * half * unit(np.array(axis)))[None])[0]
    return attitude


def _nearest_to_rays(
    scene: Scene, points: FloatArray, rotations: FloatArray, anywhere: FloatArray
) -> FloatArray:
    """Places (n, 3) nearest to the rays of all frames, and a little to ``anywhere``, where no ray goes altogether."""
    normal = _ANYWHERE * np.tile(np.eye(3), (len(points), 1, 1))
    side = _ANYWHERE * anywhere
    for frame in scene.frames:
        along = frame.rays @ rotations[frame.rotation]
        across = np.eye(3) - along[:, :, None] * along[:, None, :]
        np.add.at(normal, frame.points, across)
        np.add.at(side, frame.points, across @ points[frame.position])
    return np.asarray(tolerant.solve(normal, side[:, :, None])[:, :, 0])


__all__ = ["from_random_places"]
