"""Observation groups of types ``parameter`` and ``difference``: any component of any block, row by row."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.arrays import SmallIntArray
from mor.errors import Problem, nearest
from mor.observations import OBSERVED_DIFFERENCES, OBSERVED_PARAMETERS, ObservationGroup
from mor.observations.names import names_of
from mor.parameters.kinds import INTERIORS, KINDS, MOTIONS, BlockKind
from mor.project.edge import ImageScale, UnitError
from mor.project.file.model import Observations
from mor.project.network.entities import unknown_name
from mor.project.network.equalities import ContradictionError, Equality, settle_equalities
from mor.project.network.reading import Reading
from mor.project.observations.observation_rows import group_name
from mor.project.observations.planned_rows import without_required
from mor.project.tables.tables import Column, Rows, read_table

PARTS = {
    "camera": ("interior", "eccentricity", "readout"),
    "image": (
        "position",
        "rotation",
        "height",
        "interior",
        "eccentricity",
        "image velocity",
        "rotation rate",
    ),
    "station": ("position", "rotation", "height"),
    "system": ("position", "rotation", "scale", "offset"),
    "pair": ("base", "rotation"),
    "knot": ("position", "rotation"),
    "point": ("position", "velocity", "sine", "cosine"),
    "instrument": ("distance meter", "refraction", "gnss frame", "lever arm", "boresight", "time offset"),
}
"""Namespaces a parameter can be named in (``camera C1``), and the parts that have its components."""


_WITH_NEUTRAL = (
    *("height", "eccentricity", "distance meter", "refraction", "gnss frame", "scale"),
    *(kind.key for kind in MOTIONS),
)
"""Kinds whose block number 0 is the neutral one of all that declare none."""


class _Place(NamedTuple):
    """A component of a block: internal axes, and the sign that takes project axes to them."""

    kind: str
    block: int
    component: int
    sign: float
    scale: ImageScale | None


class _Known(NamedTuple):
    """One row: what it is about, its value and σ in internal units."""

    row: int
    blocks: tuple[int, ...]
    component: int
    value: float
    sigma: float


def parameter_groups(reading: Reading) -> list[tuple[int, ObservationGroup]]:
    """Groups of types ``parameter`` and ``difference``, one for every kind of block and image unit of an entry.

    Each with the number of its entry.
    """
    groups: list[tuple[int, ObservationGroup]] = []
    said: list[_Row] = []
    for number, entry in enumerate(reading.project.observations):
        if entry.type not in ("parameter", "difference"):
            continue
        names = ("of",) if entry.type == "parameter" else ("from", "to")
        columns = [
            *(Column(name, required=True) for name in names),
            Column("component", required=True),
            Column("value", required=entry.type == "parameter"),
            Column("sigma", required=True),
        ]
        if reading.planned:
            columns = without_required(columns, ["value"])
        rows = read_table(entry, columns, reading.at("observations", number), reading.problems)
        if rows is not None:
            found = _parameter_rows(reading, entry, rows, names, said)
            groups += [(number, replace(group, name=group_name(entry, number))) for group in found]
    _take_exactly(reading, [row for row in said if row.known.sigma == 0.0])
    for row in said:
        if row.known.sigma > 0.0:
            _refuse_constant(reading, row)
    return groups


def _parameter_rows(
    reading: Reading, entry: Observations, rows: Rows, names: tuple[str, ...], said: list[_Row]
) -> list[ObservationGroup]:
    collected: dict[tuple[str, str], list[_Known]] = {}
    for i in range(rows.count):
        try:
            places = [_find(reading, rows.series(name)[i], rows.series("component")[i]) for name in names]
            known = _known(reading, entry, rows, i, places)
        except _UnknownThingError:
            continue
        except ValueError as error:
            reading.problems.append(Problem(str(error), rows.file, int(rows.lines[i])))
            continue
        said.append(_Row(places[0].kind, known, rows, names))
        if known.sigma == 0.0:
            continue
        unit = places[0].scale.unit if places[0].scale else "mm"
        collected.setdefault((places[0].kind, unit), []).append(known)
    return [_parameter_group(kind, unit, found, rows, names) for (kind, unit), found in collected.items()]


class _UnknownThingError(Exception):
    """A name is missing from a table that has mistakes of its own."""


def _known(reading: Reading, entry: Observations, rows: Rows, i: int, places: list[_Place]) -> _Known:
    """A row in internal units and axes. Raises ``ValueError`` with what is wrong."""
    if len({place.kind for place in places}) > 1:
        raise ValueError("a difference needs two blocks of the same kind")
    if len(places) == 2 and places[0].block == places[1].block:
        raise ValueError("a difference needs two different blocks")
    place = places[0]
    quantity = KINDS[place.kind].components[place.component].quantity
    given = {}
    for name in ("value", "sigma"):
        unit = entry.units if isinstance(entry.units, str) else entry.units.get(name, "")
        text = rows.series(name)[i] or "0"
        try:
            given[name] = reading.edge.number(text, quantity, unit, place.scale)
        except UnitError as error:
            raise ValueError(f"{name}: {error}") from None
    if given["sigma"] < 0.0:
        raise ValueError(f"sigma: found {rows.series('sigma')[i]}, expected a σ ≥ 0")
    blocks = tuple(place.block for place in places)
    sigma = given["sigma"] * entry.factor
    return _Known(i, blocks, place.component, given["value"] * place.sign, sigma)


def _find(reading: Reading, name: str, component: str) -> _Place:
    """The component behind ``camera C1`` and ``c``. Raises ``ValueError`` where there is none."""
    space, _, bare = name.partition(" ")
    if space not in PARTS:
        raise ValueError(
            f"found {name!r}, expected one of {', '.join(f'{s} …' for s in PARTS)}{nearest(space, PARTS)}"
        )
    things = reading.shop.things[space]
    if bare not in things.numbers:
        if space in reading.broken:
            raise _UnknownThingError
        raise ValueError(unknown_name(space, bare, things.ids))
    if space == "image" and bare in reading.image_times:
        raise ValueError(f"{name} is on a trajectory: it has no {component} of its own; name a knot of that")
    known: list[str] = []
    for part in PARTS[space]:
        if part not in things.parts:
            continue  # nothing moves in this project
        camera = _camera(reading, space, bare) if part == "interior" else None
        kind = _kind_of_part(reading, part, camera)
        known += kind.names
        if component in kind.names:
            block, k = things.part(bare, part), kind.names.index(component)
            if block < 0 or (block == 0 and kind.key in _WITH_NEUTRAL) or _is_neutral(reading, kind, block):
                raise ValueError(f"{name} has no {component} of its own: give it one where it is declared")
            scale = reading.scales[camera] if camera is not None else None
            return _Place(kind.key, block, *_internal(reading, space, kind, k), scale)
    words = f"{name} has no component {component!r}{nearest(component, known)} (known: {', '.join(known)})"
    raise ValueError(words)


def _is_neutral(reading: Reading, kind: BlockKind, block: int) -> bool:
    return reading.shop.neutral_blocks.get(kind.key) == block


def _internal(reading: Reading, space: str, kind: BlockKind, component: int) -> tuple[int, float]:
    """Internal component and sign behind a component in project axes."""
    M = reading.edge.matrix
    if kind.in_object_axes:
        source = int(np.argmax(np.abs(M[:, component])))
        return source, float(M[source, component])
    if kind.is_rotation and space != "pair" and not np.array_equal(M, np.eye(3)):
        raise ValueError("observed ω, φ, κ need axes: {xy: en}")
    return component, 1.0


def _camera(reading: Reading, space: str, name: str) -> str:
    cameras = reading.shop.things["camera"]
    return name if space == "camera" else cameras.ids[reading.shop.things["image"].part(name, "camera")]


def _kind_of_part(reading: Reading, part: str, camera: str | None) -> BlockKind:
    if camera is not None:
        return INTERIORS[reading.project.cameras[camera].model]
    plain = {
        "position": "point",
        "relative rotation": "rotation",
        "offset": "eccentricity",
        "lever arm": "eccentricity",
        "boresight": "rotation",
    }
    return KINDS[plain.get(part, part)]


class _Row(NamedTuple):
    """A row of a table, and the columns that say what it is about."""

    kind: str
    known: _Known
    rows: Rows
    names: tuple[str, ...]

    def problem(self, words: str) -> Problem:
        """A problem of this row."""
        return Problem(words, self.rows.file, int(self.rows.lines[self.known.row]))


def _take_exactly(reading: Reading, exact: list[_Row]) -> None:
    """σ = 0: a parameter is fixed at its value; a difference makes one unknown of two components."""
    for row in exact:
        if len(row.known.blocks) == 1:
            reading.shop.store(row.kind).hold(row.known.blocks[0], row.known.component, row.known.value)
    for kind in dict.fromkeys(row.kind for row in exact):
        here = [row for row in exact if row.kind == kind]
        tied = [row for row in here if len(row.known.blocks) == 2]
        ties = [
            Equality(row.known.component, row.known.blocks[0], row.known.blocks[1], row.known.value)
            for row in tied
        ]
        try:
            settle_equalities(reading.shop.store(kind), ties)
        except ContradictionError as error:
            row = tied[error.number] if error.number is not None else (tied or here)[0]
            reading.problems.append(row.problem(f"σ = 0: {error}"))


def _refuse_constant(reading: Reading, row: _Row) -> None:
    """Tell a row in which nothing that is observed is an unknown."""
    free, known = reading.shop.store(row.kind).all_free(), row.known
    if any(free[block, known.component] for block in known.blocks):
        return
    names = " and ".join(row.rows.series(name)[known.row] for name in row.names)
    verb = "is" if len(row.names) == 1 else "are"
    words = (
        f"{row.rows.series('component')[known.row]} of {names} {verb} fixed: to observe it says nothing; make it "
        "free where it is declared, or give it its value and σ there"
    )
    reading.problems.append(row.problem(words))


def _parameter_group(
    kind: str, unit: str, found: list[_Known], rows: Rows, names: tuple[str, ...]
) -> ObservationGroup:
    type_ = (OBSERVED_PARAMETERS if len(names) == 1 else OBSERVED_DIFFERENCES)[kind]
    size = KINDS[kind].size
    observed, sigma = np.full((len(found), size), np.nan), np.full((len(found), size), np.nan)
    for row, known in enumerate(found):
        observed[row, known.component], sigma[row, known.component] = known.value, known.sigma
    lines: SmallIntArray = np.array([rows.lines[known.row] for known in found], dtype=np.int32)
    return ObservationGroup(
        name="",
        type=type_,
        blocks=tuple(np.array([known.blocks[k] for known in found]) for k in range(len(names))),
        observed=observed,
        sigma=sigma,
        constants=np.zeros((len(found), 0)),
        references=tuple(names_of([rows.series(name)[known.row] for known in found]) for name in names),
        image_unit=unit,
        lines=lines,
        file=rows.file,
    )
