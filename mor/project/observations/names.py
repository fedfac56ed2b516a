"""Names in observation tables: what they stand for, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.arrays import BoolArray, IntArray
from mor.errors import MANY_NAMES, Problem
from mor.observations import ObservationType, Reference
from mor.observations._between import POSITIONS
from mor.observations.names import Names, places
from mor.project.file.model import Observations
from mor.project.network.entities import entities, unknown_name
from mor.project.network.reading import Reading
from mor.project.observations.orientations import add_set, freedom_of_set, set_name
from mor.project.observations.undeclared_points import declare
from mor.project.tables.columns import tell_rows
from mor.project.tables.tables import Place, Rows

_NEUTRAL = ("distance meter", "refraction", "gnss frame")
"""Parts of instruments whose block 0 is that of none; others have none."""


def instrument_blocks(reading: Reading, entry: Observations, place: Place) -> dict[str, int]:
    """Blocks of the instrument of a group, neutral ones or -1 where it names none; nothing if it is unknown."""
    instruments = reading.shop.things["instrument"]
    if entry.instrument is None:
        return {part: 0 if part in _NEUTRAL else -1 for part in instruments.parts}
    if entry.instrument not in instruments.numbers:
        if "instrument" not in reading.broken:
            words = unknown_name("instrument", entry.instrument, instruments.ids)
            reading.problems.append(place.problem(words, "instrument"))
        return {}
    return {part: instruments.part(entry.instrument, part) for part in instruments.parts}


class Resolved(NamedTuple):
    """What the names of one column stand for."""

    names: Names
    blocks: dict[str, IntArray]
    """Blocks (n,) by part, −1 where there is none; nothing if a name is unknown."""
    at_centre: BoolArray
    """(n,) true where the name is that of a projection centre."""


def resolve(reading: Reading, reference: Reference, rows: Rows) -> Resolved:
    """Names of one column and the blocks behind them; each unknown name is told once.

    ``point:P``, ``station:S``, ``image:I`` tell equal names apart; ``centre:I`` is the projection centre of an image.
    """
    names = rows.names(reference.name)
    if reference.among[0] == "station":
        names = _stations_on_points(reading, names, rows)
    elif "point" in reference.among:
        declare(reading, rows, reference.name, reference.among)
    known = pl.Series(names.known, dtype=pl.String)
    spaces = {space: reading.shop.things[space] for space in reference.among}
    open_ = np.ones(len(known), dtype=bool)
    centre = np.zeros(len(known), dtype=bool)
    found: dict[str, list[tuple[BoolArray, IntArray]]] = {}
    for space, things in spaces.items():
        bare = known.str.strip_prefix(f"{space}:")
        if space == "image" and reference.among == POSITIONS:
            centre = open_ & known.str.starts_with(_CENTRE).to_numpy()
            bare = bare.str.strip_prefix(_CENTRE)
        place = places(bare, pl.Series(things.ids, dtype=pl.String))
        here = open_ & (place >= 0)
        open_ &= ~here
        for part, numbers in things.parts.items():
            found.setdefault(part, []).append((here, numbers[place[here]]))
    if open_.any():
        if not reading.broken.intersection(reference.among):
            ids = [name for things in spaces.values() for name in things.ids]
            _tell_unknown(reading, reference.name, rows, names, open_, ids)
        return Resolved(names, {}, centre[names.numbers])
    blocks = {}
    for part, pieces in found.items():
        of_name = np.full(len(known), -1, dtype=np.int64)
        for here, numbers in pieces:
            of_name[here] = numbers
        blocks[part] = of_name[names.numbers]
    resolved = Resolved(names, blocks, centre[names.numbers])
    if "image" in reference.among:
        _refuse_timed(reading, resolved, rows)
    if reference.among == POSITIONS:
        _refuse_followers(reading, resolved, rows)
    return resolved


_CENTRE = "centre:"


def _refuse_followers(reading: Reading, resolved: Resolved, rows: Rows) -> None:
    """Tell stereo followers that are named as positions: they have a projection centre only."""
    if "base" not in resolved.blocks:
        return
    wrong = (resolved.blocks["base"] >= 0) & ~resolved.at_centre
    words = (
        "image {0!r} follows another one and is no position of its own; centre:{0} is its projection centre"
    )
    tell_rows(reading.problems, wrong, rows, lambda row: words.format(resolved.names[row]))


def _refuse_timed(reading: Reading, resolved: Resolved, rows: Rows) -> None:
    """Tell images on a trajectory that are named as positions: theirs is a function of time."""
    timed = resolved.blocks.get("trajectory")
    if timed is None or not (timed >= 0).any():
        return
    words = (
        "image {0!r} is on a trajectory: its projection centre cannot be named here (image coordinates can)"
    )
    tell_rows(reading.problems, timed >= 0, rows, lambda row: words.format(resolved.names[row]))


def _tell_unknown(
    reading: Reading, what: str, rows: Rows, names: Names, unknown: BoolArray, ids: Sequence[str]
) -> None:
    """Tell each unknown name once, where it comes first; of very many the first ones and their number."""
    numbers, first = np.unique(names.numbers, return_index=True)
    wrong = np.zeros(rows.count, dtype=bool)
    wrong[first[unknown[numbers]]] = True
    guessed = set(np.flatnonzero(wrong)[:_GUESSED].tolist())
    few = len(ids) <= MANY_NAMES
    tell_rows(
        reading.problems,
        wrong,
        rows,
        lambda row: unknown_name(what, names[row], ids if few or row in guessed else ()),
    )


_GUESSED = 5
"""Unknown names for which the nearest one is looked for among very many."""


def _stations_on_points(reading: Reading, names: Names, rows: Rows) -> Names:
    """Names of stations; a point becomes a levelled station, another set on a station one levelled like that."""
    sets = rows.names("set")
    pairs = names.numbers.astype(np.int64) * len(sets.known) + sets.numbers
    _, first, numbers = np.unique(pairs, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    places = np.empty(len(order), dtype=np.int32)
    places[order] = np.arange(len(order), dtype=np.int32)
    stands = [(names[row], sets[row]) for row in first[order].tolist()]
    declare(reading, rows, "station", ("station", "point"))
    _add_stations(reading, stands)
    return Names(places[numbers], tuple(set_name(*stand) for stand in stands))


def _add_stations(reading: Reading, stands: list[tuple[str, str]]) -> None:
    """Add those of the stations, with their sets, that are not declared."""
    shop, stations = reading.shop, reading.shop.things["station"]
    ids: list[str] = []
    parts: dict[str, list[int]] = {part: [] for part in stations.parts}
    for name, set_ in stands:
        complete = set_name(name, set_)
        source = stations if name in stations.numbers else shop.things["point"]
        if complete in stations.numbers or name not in source.numbers:
            continue
        free = freedom_of_set(reading, name)
        kappa = np.array([[0.0, 0.0, np.nan]])
        rotation = shop.store("rotation").add([f"station {complete}"], kappa, free, np.full((1, 3), np.nan))
        add_set(reading, name, set_)
        ids.append(complete)
        parts["rotation"].append(int(rotation[0]))
        for part in ("position", "height"):
            parts[part].append(source.part(name, part))
    added = {part: np.array(new, dtype=np.int64) for part, new in parts.items()}
    everything = {part: np.concatenate([old, added[part]]) for part, old in stations.parts.items()}
    shop.things["station"] = entities((*stations.ids, *ids), everything)


def check_different(type_: ObservationType, rows: Rows, problems: list[Problem]) -> bool:
    """False if an observation lies between a place and itself, or an angle has two equal targets."""
    names = [reference.name for reference in type_.references if reference.name not in ("system", "frame")]
    good = True
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            cells = rows.series(a)
            same = (cells == rows.series(b)).to_numpy()
            tell_rows(problems, same, rows, partial(_same_words, f"{a} and {b}", type_.key, cells))
            good = good and not same.any()
    return good


def _same_words(ends: str, type_: str, cells: pl.Series, row: int) -> str:
    return f"{ends} are the same: {cells[row]!r}; {type_} needs two different ones"


def named_things(reading: Reading, space: str, column: str, rows: Rows) -> Names:
    """The things of one namespace that the rows name, −1 where there is none; each unknown name is told once."""
    if space == "point":
        declare(reading, rows, column, ("point",))
    things = reading.shop.things[space]
    cells = rows.series(column)
    found = places(cells, pl.Series(things.ids, dtype=pl.String))
    if (found < 0).any() and space not in reading.broken:
        named = rows.names(column)
        known = np.ones(len(named.known), dtype=bool)
        known[named.numbers[found < 0]] = False
        _tell_unknown(reading, space, rows, named, ~known, things.ids)
    return Names(found, things.ids)
