"""Names in observation tables: what they stand for, and what is wrong with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.errors import Problem
from mor.geometry.arrays import IntArray
from mor.observations import ObservationType, Reference
from mor.project.entities import unknown_name
from mor.project.model import Observations
from mor.project.orientations import add_set, freedom_of_set, set_name
from mor.project.reading import Reading
from mor.project.tables import Place, Rows


def instrument_blocks(reading: Reading, entry: Observations, place: Place) -> dict[str, int]:
    """Blocks of the instrument of a group, the neutral ones where it names none; nothing where it is unknown."""
    instruments = reading.shop.things["instrument"]
    if entry.instrument is None:
        return {"distance meter": 0, "refraction": 0}
    if entry.instrument not in instruments.numbers:
        if "instrument" not in reading.broken:
            words = unknown_name("instrument", entry.instrument, instruments.ids)
            reading.problems.append(place.problem(words, "instrument"))
        return {}
    return {part: instruments.part(entry.instrument, part) for part in instruments.parts}


def resolve(reading: Reading, reference: Reference, rows: Rows) -> dict[str, IntArray]:
    """Blocks behind the names of one column, by part; nothing where a name is unknown."""
    names = rows.text(reference.name)
    if reference.among[0] == "station":
        names = _stations_on_points(reading, names, rows)
    distinct = dict.fromkeys(names)
    found: dict[str, dict[str, int]] = {}
    for name in distinct:
        parts = _look_up(reading, reference, name)
        if parts is not None:
            found[name] = parts
        elif not reading.broken.intersection(reference.among):
            line = int(rows.lines[names.index(name)])
            known = [n for space in reference.among for n in reading.shop.things[space].ids]
            reading.problems.append(Problem(unknown_name(reference.name, name, known), rows.file, line))
    if len(found) < len(distinct):
        return {}
    parts_known = found[names[0]].keys()
    return {part: np.array([found[name][part] for name in names], dtype=np.int64) for part in parts_known}


def _look_up(reading: Reading, reference: Reference, name: str) -> dict[str, int] | None:
    for space in reference.among:
        things = reading.shop.things[space]
        bare = name.removeprefix(f"{space}:")
        if bare in things.numbers:
            return {part: things.part(bare, part) for part in things.parts}
    return None


def _stations_on_points(reading: Reading, names: list[str], rows: Rows) -> list[str]:
    """Names of stations; a point becomes a levelled station, another set on a station one levelled like that."""
    shop = reading.shop
    sets = rows.text("set")
    full = [set_name(name, set_) for name, set_ in zip(names, sets, strict=True)]
    stations = shop.things["station"]
    for name, set_ in dict.fromkeys(zip(names, sets, strict=True)):
        complete = set_name(name, set_)
        if complete in stations.numbers:
            continue
        source = stations if name in stations.numbers else shop.things["point"]
        if name not in source.numbers:
            continue
        label = f"station {complete}"
        kappa = np.array([[0.0, 0.0, np.nan]])
        free = freedom_of_set(reading, name)
        rotation = shop.store("rotation").add([label], kappa, free, np.full((1, 3), np.nan))
        add_set(reading, name, set_)
        parts = {
            "position": np.append(stations.parts["position"], source.part(name, "position")),
            "height": np.append(stations.parts["height"], source.part(name, "height")),
            "rotation": np.append(stations.parts["rotation"], rotation),
        }
        stations = replace(
            stations,
            ids=(*stations.ids, complete),
            parts=parts,
            numbers={**stations.numbers, complete: len(stations.ids)},
        )
    shop.things["station"] = stations
    return full


def check_different(type_: ObservationType, rows: Rows, problems: list[Problem]) -> bool:
    """False where an observation lies between a place and itself, or an angle has two equal targets."""
    names = [reference.name for reference in type_.references if reference.name not in ("system", "frame")]
    good = True
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            for one, other, line in zip(rows.text(a), rows.text(b), rows.lines, strict=True):
                if one == other:
                    words = f"{a} and {b} are the same: {one!r}; {type_.key} needs two different ones"
                    problems.append(Problem(words, rows.file, int(line)))
                    good = False
    return good


def numbers(reading: Reading, space: str, names: list[str], rows: Rows) -> IntArray:
    """Numbers (n,) of the things of one namespace, −1 where there is none; each unknown name is told once."""
    table = reading.shop.things[space].numbers
    result = np.fromiter((table.get(name, -1) for name in names), dtype=np.int64, count=len(names))
    if space in reading.broken:
        return result
    for name in dict.fromkeys(names[i] for i in np.flatnonzero(result < 0)):
        line = int(rows.lines[names.index(name)])
        reading.problems.append(Problem(unknown_name(space, name, table), rows.file, line))
    return result
