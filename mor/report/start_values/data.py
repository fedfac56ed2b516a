"""Start values as data: of every unknown whether it was given, found or replaced, by which rule, and how good it is.

σ is that which the observations of the thing itself give it while everything else stays where it starts, times the root
mean square of their misclosures where that exceeds one. It does not contain what the neighbours are wrong by.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from mor.adjustment.local_precision import Local, local_precision
from mor.adjustment.problem import Problem
from mor.approximate.approximation import Approximation
from mor.approximate.parts.rule import Rule, rule
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.rotations import angles_from_rotation
from mor.parameters.index import Values
from mor.parameters.kinds import KINDS
from mor.project.network.build import Network
from mor.project.network.entities import said_thing
from mor.units import ANGLE_UNITS

Status = Literal["given", "found", "replaced", "missing"]
WHAT = {"point": "position", "rotation": "attitude"}
"""What blocks of a kind are called; others are called as their kind."""


class StartValue(NamedTuple):
    """One block of unknowns."""

    kind: str
    """point, image, station, camera …"""
    name: str
    what: str
    """position, attitude, scale …"""
    status: Status
    found: tuple[str, ...]
    """Components that were found or replaced; what is observed or fixed stays."""
    part: int | None
    """The part in which it was known first, 0 for the object system; ``None`` if it has no value."""
    how: Rule | None
    components: tuple[str, ...]
    values: FloatArray
    """(k,) in project axes and units."""
    units: tuple[str, ...]
    sigma: FloatArray
    """(k,) NaN if its own observations do not determine it, or hold it; of an attitude the largest, once."""
    misfit: float
    """Root mean square of the misclosures of its observations in units of their σ."""
    observations: int


def start_values(network: Network, approximation: Approximation, problem: Problem) -> list[StartValue]:
    """All blocks with unknowns, kind by kind. ``problem`` belongs to the network and its start values."""
    local = _local(network, problem, approximation.start)
    homes = _homes(approximation)
    rows = []
    for kind in sorted(network.blocks, key=_order):
        blocks = network.blocks[kind]
        for number in np.flatnonzero(blocks.free.any(axis=1)).tolist():
            rows.append(_row(network, approximation, kind, number, local[kind], homes.get((kind, number), 0)))
    return rows


def _order(kind: str) -> tuple[int, int]:
    return (("point", "rotation").index(kind) if kind in WHAT else 2, list(KINDS).index(kind))


def _local(network: Network, problem: Problem, start: Values) -> dict[str, Local]:
    """Precision of all blocks by themselves, attitudes together with the place that is theirs alone."""
    columns = problem.index.columns
    local = {
        kind: local_precision(problem, start, columns[kind]) for kind in network.blocks if kind != "rotation"
    }
    if "rotation" not in columns:
        return local
    place = _own_place(network)
    theirs = np.where((place >= 0)[:, None], columns["point"][place], -1)
    poses = local_precision(problem, start, np.concatenate([columns["rotation"], theirs], axis=1))
    local["rotation"] = poses._replace(sigma=poses.sigma[:, :3])
    own = np.flatnonzero(place >= 0)
    points = local["point"]
    points.sigma[place[own]], points.misfit[place[own]] = poses.sigma[own, 3:], poses.misfit[own]
    points.observations[place[own]] = poses.observations[own]
    return local


def _own_place(network: Network) -> IntArray:
    """(rotations,) position block that one attitude has for itself, −1 where it shares its place."""
    place = np.full(len(network.blocks["rotation"].ids), -1, dtype=np.int64)
    points = network.things["point"].parts["position"]
    for space in ("image", "station"):
        parts = network.things[space].parts
        if len(network.things[space].ids) == 0:
            continue
        own = ~np.isin(parts["position"], points) & (parts["rotation"] >= 0)
        place[parts["rotation"][own]] = parts["position"][own]
    values, counts = np.unique(place[place >= 0], return_counts=True)
    place[np.isin(place, values[counts > 1])] = -1
    return place


def _homes(approximation: Approximation) -> dict[tuple[str, int], int]:
    """Part of every block that was known in one before it came to the object system."""
    homes: dict[tuple[str, int], int] = {}
    for join in approximation.parts:
        blocks: list[tuple[str, int]] = [("point", int(p)) for p in join.points]
        for number in join.frames:
            frame = approximation.frames[number]
            turn = frame.rotation if frame.relative is None else frame.relative[0]
            blocks += [("rotation", turn), ("point", frame.position)]
        blocks += [("rotation", approximation.sights[number].rotation) for number in join.sights]
        for block in blocks:
            homes.setdefault(block, join.number)
    return homes


def _row(
    network: Network, approximation: Approximation, kind: str, number: int, local: Local, home: int
) -> StartValue:
    before, after = network.start[kind][number], approximation.start[kind][number]
    given, known = np.isfinite(before), np.isfinite(after)
    changed = known & (~given | (before != after))
    status: Status = "given"
    if not known.all():
        status = "missing"
    elif (changed & given).any():
        status = "replaced"
    elif changed.any():
        status = "found"
    block = network.blocks[kind].ids[number]
    space, _, name = said_thing(kind, block).partition(" ")
    if space in ("rotation", "eccentricity") and " " in block:
        # Planes, lines and right angles: what stands there is replaced by what their points tell.
        space, _, name = block.partition(" ")
        status = "found" if status == "replaced" else status
    components, values, units = _outwards(network, kind, number, after)
    how = None
    if status in ("found", "replaced"):
        how = approximation.how.get(f"{space} {name}") or _BY_DEFAULT.get(space, _BY_DEFAULT["system"])
    factor = np.fmax(local.misfit[number], 1.0)
    per_unit = ANGLE_UNITS[_angle(network)] if kind == "rotation" else 1.0
    sigma = factor * local.sigma[number] / per_unit
    return StartValue(
        space, name, WHAT.get(kind, kind.partition("/")[0]), status,
        _changed_names(network, kind, number, changed), None if status == "missing" else home if changed.any() else 0,
        how, components, values, units, _sigma_outwards(network, kind, sigma),
        float(local.misfit[number]), int(local.observations[number]),
    )  # fmt: skip


_BY_DEFAULT = {
    "point": rule("intersection of rays"),
    "station": rule("from the points it sights"),
    "system": rule("from the points measured in it"),
    "pair": rule("from the images that have it"),
}
"""What values come from that have no rule of their own."""


def _changed_names(network: Network, kind: str, number: int, changed: BoolArray) -> tuple[str, ...]:
    if kind == "rotation":
        free = network.blocks[kind].free[number]
        return tuple(np.array(KINDS[kind].names)[free]) if changed.any() else ()
    if kind == "point":
        changed = np.abs(network.edge.matrix.T) @ changed > 0.0
    return tuple(np.array(KINDS[kind].names)[changed].tolist())


def _angle(network: Network) -> str:
    unit = network.project.units.angle
    return "deg" if unit == "dms" else unit


def _outwards(
    network: Network, kind: str, number: int, value: FloatArray
) -> tuple[tuple[str, ...], FloatArray, tuple[str, ...]]:
    """Names, values and units of a block in project axes."""
    edge, names = network.edge, KINDS[kind].names
    if kind == "rotation":
        turned = value @ edge.matrix if edge.right_handed else value
        angles = angles_from_rotation(turned[None])[0] / ANGLE_UNITS[_angle(network)]
        return names, angles, (_angle(network),) * 3
    if kind == "point":
        value = in_project_axes(network, value[None])[0]
    scale = network.scales.get(network.blocks[kind].ids[number].removeprefix("camera "))
    units = tuple(edge.default_unit(component.quantity, scale) for component in KINDS[kind].components)
    return names, value, units


def in_project_axes(network: Network, xyz: FloatArray) -> FloatArray:
    """Coordinates (n, 3) in the axes of the project; what is not known of one does not spread to the others."""
    M = network.edge.matrix
    turned: FloatArray = xyz[:, np.argmax(np.abs(M), axis=0)] * M.sum(axis=0)
    return turned


def _sigma_outwards(network: Network, kind: str, sigma: FloatArray) -> FloatArray:
    if kind == "rotation":
        sigma = np.array([np.nan if np.isnan(sigma).all() else np.nanmax(sigma)])
    elif kind == "point":
        sigma = np.abs(in_project_axes(network, sigma[None])[0])
    return sigma


def counts(rows: Sequence[StartValue]) -> Iterator[tuple[str, str, dict[str, int]]]:
    """Count given, computed, replaced and missing start values by kind."""
    found: dict[tuple[str, str], dict[str, int]] = {}
    for row in rows:
        of = found.setdefault(
            (row.kind, row.what), dict.fromkeys(("given", "found", "replaced", "missing"), 0)
        )
        of[row.status] += 1
    for (kind, what), number in found.items():
        yield kind, what, number
