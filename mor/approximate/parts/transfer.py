"""Between the network's blocks and a part: what is given goes in, what was found comes out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mor.approximate.parts.frames import Frame, given_pose
from mor.approximate.parts.local_systems import fill_systems
from mor.approximate.parts.part import Part, empty_part
from mor.approximate.parts.rule import Rule
from mor.approximate.terrestrial.sights import Terrestrial
from mor.arrays import FloatArray, IntArray
from mor.errors import CONTRADICTED, Undeterminable
from mor.geometry.rotations import angles_from_rotation, rotation_from_angles
from mor.observations import target_slot
from mor.project.network.build import Network
from mor.project.network.entities import thing_of


def with_observed(network: Network) -> dict[str, FloatArray]:
    """Start values, those not given taken from observed parameters."""
    start = {kind: values.copy() for kind, values in network.start.items()}
    for group in network.groups:
        prefix, _, kind = group.type.key.partition("/")
        kind = "point" if prefix == "coordinates" else kind
        if prefix not in ("observed", "coordinates") or kind == "rotation":
            continue
        rows, components = np.nonzero(group.mask)
        blocks = group.blocks[0][rows]
        missing = np.isnan(start[kind][blocks, components])
        start[kind][blocks[missing], components[missing]] = group.observed[rows, components][missing]
    return start


def starting_part(network: Network, frames: Sequence[Frame]) -> Part:
    """The object system with everything that is given."""
    start = network.start
    part = empty_part(len(network.blocks["point"].ids))
    part.points[:] = start["point"]
    part.fixed = np.asarray(np.isfinite(start["point"]).all(axis=1))
    part.sigma = network.sigma["point"]
    part.levelled = part.oriented = part.scaled = part.given = True
    for number, frame in enumerate(frames):
        if frame.relative is not None:
            follower = _follower_pose(network, frame)
            if follower is not None:
                part.poses[number] = follower
        else:
            given = given_pose(network, frame)
            if given is not None:
                part.poses[number] = given
    return part


def _follower_pose(network: Network, frame: Frame) -> tuple[FloatArray, FloatArray] | None:
    assert frame.relative is not None
    turn, base = network.start["rotation"][frame.relative[0]], network.start["base"][frame.relative[1]]
    leader = given_pose(network, frame)
    if leader is None or not (np.isfinite(turn).all() and np.isfinite(base).all()):
        return None
    centre, D = leader
    return centre + D.T @ base, turn @ D


def fill_in(
    network: Network, part: Part, frames: Sequence[Frame], measured: Terrestrial
) -> tuple[dict[str, FloatArray], dict[str, Rule], tuple[Undeterminable, ...]]:
    """Start values of all blocks, how they were obtained, and what is missing."""
    start = {kind: values.copy() for kind, values in network.start.items()}
    points = start["point"]
    unknown = np.isnan(points)
    points[unknown] = part.points[unknown]
    rotations = start.get("rotation", np.zeros((0, 3, 3)))
    for number, (centre, D) in part.poses.items():
        frame = frames[number]
        if frame.relative is None:
            put_rotation(network, rotations, frame.rotation, D)
            _put_position(network, points, frame, centre, D)
    for number, kappa in part.kappas.items():
        block = measured.sights[number].rotation
        if block >= 0:
            put_rotation(network, rotations, block, rotation_from_angles(np.array([[0.0, 0.0, kappa]]))[0])
    _fill_pairs(network, start, part, frames)
    fill_systems(network, start)
    how = _named(network, part)
    return start, how, missing_start_values(network, start)


def put_rotation(network: Network, rotations: FloatArray, block: int, D: FloatArray) -> None:
    """An attitude where there is none; angles that are fixed or observed stay as they are."""
    if np.isfinite(rotations[block]).all():
        return
    given = network.observed["rotation"][block]
    held = np.isfinite(given) & (
        ~network.blocks["rotation"].free[block] | np.isfinite(network.sigma["rotation"][block])
    )
    rotations[block] = D
    if held.any():
        rotations[block] = rotation_from_angles(
            np.where(held, given, angles_from_rotation(D[None])[0])[None]
        )[0]


def _put_position(
    network: Network, points: FloatArray, frame: Frame, centre: FloatArray, D: FloatArray
) -> None:
    missing = np.isnan(points[frame.position])
    if missing.any():
        height = float(np.nan_to_num(network.start["height"][frame.height, 0]))
        eccentricity = np.nan_to_num(network.start["eccentricity"][frame.eccentricity])
        place = centre - np.array([0.0, 0.0, height]) + D.T @ eccentricity
        points[frame.position, missing] = place[missing]


def _fill_pairs(network: Network, start: dict[str, FloatArray], part: Part, frames: Sequence[Frame]) -> None:
    """Relative orientations from the poses of both images; leaders from their followers."""
    leaders = {frame.rotation: n for n, frame in enumerate(frames) if frame.relative is None}
    for number, frame in enumerate(frames):
        if frame.relative is None or number not in part.poses:
            continue
        leader = part.poses.get(leaders.get(frame.rotation, -1)) or given_pose(network, frame)
        if leader is None:
            continue
        (O_a, D_a), (O_b, D_b) = leader, part.poses[number]
        turn, base = frame.relative
        put_rotation(network, start["rotation"], turn, D_b @ D_a.T)
        if np.isnan(start["base"][base]).any():
            start["base"][base] = D_a @ (O_b - O_a)


def _named(network: Network, part: Part) -> dict[str, Rule]:
    """How things were obtained, by the names the project gives them."""
    ids = network.blocks["point"].ids
    named = {}
    for name, how in part.how.items():
        kind, _, rest = name.partition(" ")
        named[f"point {ids[int(rest)]}" if kind == "point" and rest.isdigit() else name] = how
    return named


_REASONS = {
    "point": "seen from too few known places: it needs two rays, or a direction and a distance",
    "image": "it shares too few points with others whose place is known",
    "station": "too few points whose place is known are sighted from it",
    "system": "too few points whose place is known have coordinates in it",
    "pair": "one of its two images could not be oriented",
}
"""Why things stay without start values."""
_ENOUGH = {"image": 4, "station": 2}
"""Points of known place that an image or a set needs to see for its attitude."""


def missing_start_values(network: Network, start: Mapping[str, FloatArray]) -> tuple[Undeterminable, ...]:
    """What still has no value, each thing once, and the likely reason."""
    found: dict[tuple[str, str], Undeterminable] = {}
    contradicted = _contradicted(network, start)
    for kind, values in start.items():
        lost = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        if not lost.any():
            continue
        rows = _rows_of(network, kind)
        for number in np.flatnonzero(lost).tolist():
            thing = thing_of(kind, network.blocks[kind].ids[number])
            reason = _REASONS.get(thing[0], "no start value is given")
            reason = CONTRADICTED if thing in contradicted else reason
            reason = reason if rows[number] else "no observation refers to it"
            found.setdefault(thing, Undeterminable(*thing, reason, "", int(rows[number])))
    return tuple(found.values())


def _contradicted(network: Network, start: Mapping[str, FloatArray]) -> set[tuple[str, str]]:
    """Images and sets without attitude that see points enough whose place is known, in plan at least."""
    if "rotation" not in start or "point" not in start:
        return set()
    known = np.asarray(np.isfinite(start["point"][:, :2]).all(axis=1))
    lost = np.asarray(~np.isfinite(start["rotation"]).all(axis=(1, 2)))
    seen = [np.zeros((0, 2), dtype=np.int64)]
    for group in network.groups:
        rotations = [
            numbers
            for slot, numbers in zip(group.type.slots, group.blocks, strict=True)
            if slot.kind == "rotation"
        ]
        positions = [slot.kind == "point" for slot in group.type.slots]
        if len(rotations) == 1 and sum(positions) > 1:
            target = group.blocks[target_slot(group.type)]
            chosen = lost[rotations[0]] & known[target]
            seen.append(np.stack([rotations[0][chosen], target[chosen]], axis=1))
    pairs = np.unique(np.concatenate(seen), axis=0)
    things: set[tuple[str, str]] = set()
    for number, count in zip(*np.unique(pairs[:, 0], return_counts=True), strict=True):
        thing = thing_of("rotation", network.blocks["rotation"].ids[number])
        if thing[0] in _ENOUGH and count >= _ENOUGH[thing[0]]:
            things.add(thing)
    return things


def _rows_of(network: Network, kind: str) -> IntArray:
    """(n,) rows of observations that refer to each block of a kind."""
    rows = np.zeros(len(network.blocks[kind].ids), dtype=np.int64)
    for group in network.groups:
        for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind == kind:
                rows += np.bincount(numbers, minlength=len(rows))
    return rows
