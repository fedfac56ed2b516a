"""Rows of observation tables: names, instrument heights, atmosphere, fixed quantities."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.errors import MANY_NAMES, Message, counted
from mor.model.contract import POSITIONS, Names, ObservationGroup, ObservationType, Reference, places
from mor.model.observation_types import PLAIN_TYPES
from mor.model.rotations import rotation_from_angles, tangent_of_angles
from mor.project.axes import Edge, UnitError
from mor.project.entities import Reading, entities, set_name, unknown_name
from mor.project.points import add_free_points
from mor.project.schema import Observations
from mor.project.tables import MOST_TOLD, Column, Rows, TableLocation, number_column
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import LENGTH, NUMBER

# ---- Orientations of theodolite stations: sets of their own, and stations at which no direction was observed.


def freedom_of_set(reading: Reading, station: str) -> BoolArray:
    """(1, 3) free angles of a further set at a station: the level of the station, and an orientation of its own."""
    stations = reading.shop.things["station"]
    free = np.array([[False, False, True]])
    if station in stations.numbers:
        free[0, :2] = reading.shop.store("rotation").all_free()[stations.part(station, "rotation"), :2]
    return free


def add_set(reading: Reading, station: str, set_: str) -> None:
    """Let a set be levelled like its declared station is: observed where the level of that is observed."""
    for (section, _), names in reading.table_ids.items():
        if section == "stations" and station in names:
            names.append(set_name(station, set_))
            reading.sets[set_name(station, set_)] = (station, set_)
            return


def drop_unused_orientations(reading: Reading, groups: Sequence[ObservationGroup]) -> None:
    """Stations that only distances, zenith angles or their sets refer to have no orientation: nothing to estimate."""
    store = reading.shop.store("rotation")
    used = {
        int(number)
        for group in groups
        for slot, blocks in group.blocks_by_slot
        if slot.kind == "rotation"
        for number in np.unique(blocks)
    }
    stations = reading.shop.things["station"]
    for name, number in zip(stations.ids, stations.parts["rotation"], strict=True):
        if int(number) not in used:
            reading.unoriented.add(name)
            for component, value in enumerate(np.nan_to_num(store.all_values()[number])):
                store.hold(int(number), component, float(value))


# ---- What the readers of image coordinates and of all other types share: a group as read, names, σ.

CLUSTER = "cluster"
"""Column of the names of rows that are correlated among themselves."""


@dataclass(frozen=True)
class ReadGroup:
    """A group as read, and what its correlations refer to."""

    group: ObservationGroup
    entry: int
    """Number of the observation entry in the project."""
    rows: IntArray
    """Rows of the entry's table."""
    transform: FloatArray
    """(m, m) from the components as given to internal ones."""
    factors: FloatArray
    """(m,) internal units per unit of the σ as given."""
    covariances: FloatArray | None = None
    """(n, m, m) covariances given row by row, internal units but project axes."""
    clusters: Names | None = None
    """Names of the rows that are correlated among themselves; ``None`` if a matrix is over the whole table."""
    epochs: IntArray | None = None
    """(n,) number of the epoch of each row, −1 where it has none."""


def own_or_common(own: FloatArray, common: FloatArray) -> FloatArray:
    """Value of a row for a component, or else for all of them."""
    return np.where(np.isnan(own), common, own)


def sigma_is_good(group: ObservationGroup, rows: Rows, chosen: IntArray) -> bool:
    """False if an observation has no σ > 0; every such row is told, once for all where none has any."""
    bad = group.mask & ~(group.sigma > 0.0)
    if bad.any() and np.isnan(group.sigma[group.mask]).all():
        matrix = "; or covariances" if len(group.type.components) == 3 else ""
        rows.tell(chosen[0], f"no σ: give a column sigma, or values: {{sigma: …}} for all rows{matrix}")
        return False
    wrong = replace(rows, lines=rows.lines[chosen])
    wrong.tell_where(np.asarray(bad.any(axis=1)), lambda row: _wrong_sigma(group.sigma[row][bad[row]][0]))
    return not bad.any()


def _wrong_sigma(value: float) -> str:
    if np.isnan(value):
        return "no σ in this row"
    if value == 0.0:
        return "found σ = 0, expected σ > 0 (fix exact values instead of observing them)"
    return "found a negative σ, expected σ > 0"


def group_name(entry: Observations, number: int) -> str:
    """Name of a group in reports."""
    return entry.name or entry.file or f"{entry.type} {number + 1}"


# ---- Observations that are planned and not measured: tables in which the values are missing, row by row or throughout.


def without_required(columns: Sequence[Column], measured: Sequence[str]) -> list[Column]:
    """The columns of a table, those of what is ``measured`` no longer required."""
    return [column._replace(required=column.required and column.name not in measured) for column in columns]


def planned_rows(rows: Rows, measured: Sequence[str], reading: Reading, name: str) -> Rows:
    """Rows with 0 for missing measured values; ``name`` of a table that misses some is noted.

    Where a row has no value at all, it is planned to observe what other rows of the table have; all components of the
    type where no row has any.
    """
    given = {key: rows.number(key) for key in measured}
    known = [key for key, values in given.items() if np.isfinite(values).any()]
    empty = ~np.any([np.isfinite(values) for values in given.values()], axis=0)
    if not empty.any():
        return rows
    reading.unmeasured.append(name)
    filled = {key: np.where(empty, 0.0, given[key]) for key in known or measured}
    return replace(rows, numbers={**rows.numbers, **filled})


# ---- Points that only observations name: free where a project asks for it; those that may be slips are told.


def declare(reading: Reading, rows: Rows, column: str, spaces: Sequence[str]) -> None:
    """Make free points of the names of a column that no thing of these namespaces has, where the project wants that.

    Not of names with a prefix (``image:B1``): those say what they name.
    """
    wanted = reading.project.settings.undeclared_points == "free"
    if not wanted or reading.section != "observations" or "point" in reading.broken:
        return
    taken = [reading.shop.things[space].numbers for space in spaces]
    names = (name for name in rows.names(column).known if not any(name in there for there in taken))
    new = [name for name in dict.fromkeys(names) if name and ":" not in name]
    if not new:
        return
    first = {name: row for row, name in reversed(list(enumerate(rows.text(column))))}
    for name in new:
        reading.undeclared[name] = (rows.file, int(rows.lines[first[name]]))
    add_free_points(reading, new)


def check_undeclared(reading: Reading, groups: Sequence[ObservationGroup]) -> None:
    """Note how many points only observations name, and each that differs from a declared one by a single character.

    Of those, one that a single row names is a mistake: it says nothing but its own place, and looks like a slip.
    """
    if not reading.undeclared:
        return
    points = reading.shop.things["point"]
    rows = rows_of_points(groups, len(reading.shop.store("point").ids))
    declared = [name for name in points.ids if name not in reading.undeclared]
    notes = []
    for name, near in alike(reading.undeclared, declared).items():
        if rows[points.part(name, "position")] == 1:
            words = (
                f"point {name!r} occurs only in this row and in no table of points; "
                f"did you mean {near!r}? If not, add it to the points"
            )
            reading.problems.append(Message(words, *reading.undeclared[name]))
        else:
            words = f"point {name!r} is in no table of points and is therefore free; {near!r} is"
            notes.append(Message(words, *reading.undeclared[name]))
    if len(notes) > MOST_TOLD:
        notes[MOST_TOLD:] = [Message(f"{len(notes) - MOST_TOLD} more points like these")]
    many = counted(len(reading.undeclared), "point")
    reading.notes += [Message(f"{many} that only observations name: free (undeclared_points: free)"), *notes]


def rows_of_points(groups: Iterable[ObservationGroup], count: int) -> IntArray:
    """(count,) rows of observations that refer to each point block."""
    rows = np.zeros(count, dtype=np.int64)
    for group in groups:
        for blocks in group.blocks_of("point"):
            rows += np.bincount(blocks, minlength=count)
    return rows


def alike(names: Iterable[str], declared: Iterable[str]) -> dict[str, str]:
    """Return for each name a declared one that differs by at most one character, or by the case of letters."""
    known: dict[str, str] = {}
    for name in declared:
        for rest in _without_one(name):
            known.setdefault(rest, name)
    found = ((name, next((known[rest] for rest in _without_one(name) if rest in known), "")) for name in names)
    return {name: near for name, near in found if near}


def _without_one(name: str) -> list[str]:
    """A name without regard to case, and all that is left of it without one character.

    Two names share one of these where one character was changed, left out or put in, or two were swapped.
    """
    plain = name.casefold()
    return [plain, *(plain[:k] + plain[k + 1 :] for k in range(len(plain)) if len(plain) > 1)]


# ---- Names in observation tables: what they stand for, and what is wrong with them.


def instrument_blocks(reading: Reading, entry: Observations, place: TableLocation) -> dict[str, int]:
    """Blocks of the instrument of a group, neutral ones or -1 where it names none; nothing if it is unknown."""
    instruments = reading.shop.things["instrument"]
    if entry.instrument is None:
        # Parts of instruments whose block 0 is that of none; others have none.
        return {part: 0 if part in ("distance meter", "refraction", "gnss frame") else -1 for part in instruments.parts}
    if entry.instrument not in instruments.numbers:
        if "instrument" not in reading.broken:
            place.tell(unknown_name("instrument", entry.instrument, instruments.ids), "instrument")
        return {}
    return {part: instruments.part(entry.instrument, part) for part in instruments.parts}


class Resolved(NamedTuple):
    """Blocks that the names of one column stand for."""

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
    prefix = "centre:"
    for space, things in spaces.items():
        bare = known.str.strip_prefix(f"{space}:")
        if space == "image" and reference.among == POSITIONS:
            centre = open_ & known.str.starts_with(prefix).to_numpy()
            bare = bare.str.strip_prefix(prefix)
        place = places(bare, pl.Series(things.ids, dtype=pl.String))
        here = open_ & (place >= 0)
        open_ &= ~here
        for part, numbers in things.parts.items():
            found.setdefault(part, []).append((here, numbers[place[here]]))
    if open_.any():
        if not reading.broken.intersection(reference.among):
            ids = [name for things in spaces.values() for name in things.ids]
            _tell_unknown(reference.name, rows, names, open_, ids)
            # Unknown names of a table that look like points which were left out on purpose.
            if "point" in reference.among and np.count_nonzero(open_) >= 3:
                words = "points that no table contains are unknowns with settings: {undeclared_points: free}"
                hint = reading.at("settings").problem(words)
                if hint not in reading.problems:
                    reading.problems.append(hint)
        return Resolved(names, {}, centre[names.numbers])
    blocks = {}
    for part, pieces in found.items():
        of_name = np.full(len(known), -1, dtype=np.int64)
        for here, numbers in pieces:
            of_name[here] = numbers
        blocks[part] = of_name[names.numbers]
    resolved = Resolved(names, blocks, centre[names.numbers])
    if "image" in reference.among:
        _refuse_timed(resolved, rows)
    if reference.among == POSITIONS:
        _refuse_followers(resolved, rows)
    return resolved


def _refuse_followers(resolved: Resolved, rows: Rows) -> None:
    if "base" not in resolved.blocks:
        return
    wrong = (resolved.blocks["base"] >= 0) & ~resolved.at_centre
    words = "image {0!r} follows another one and is not a position of its own; centre:{0} is its projection centre"
    rows.tell_where(wrong, lambda row: words.format(resolved.names[row]))


def _refuse_timed(resolved: Resolved, rows: Rows) -> None:
    timed = resolved.blocks.get("trajectory")
    if timed is None or not (timed >= 0).any():
        return
    words = "image {0!r} is on a trajectory: its projection centre cannot be named here (image coordinates can)"
    rows.tell_where(timed >= 0, lambda row: words.format(resolved.names[row]))


def _tell_unknown(what: str, rows: Rows, names: Names, unknown: BoolArray, ids: Sequence[str]) -> None:
    """Tell each unknown name once, where it comes first; of very many the first ones and their number."""
    numbers, first = np.unique(names.numbers, return_index=True)
    wrong = np.zeros(rows.count, dtype=bool)
    wrong[first[unknown[numbers]]] = True
    # Unknown names for which the nearest one is looked for among very many.
    guessed = set(np.flatnonzero(wrong)[:5].tolist())
    few = len(ids) <= MANY_NAMES
    rows.tell_where(wrong, lambda row: unknown_name(what, names[row], ids if few or row in guessed else ()))


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
    return Names(places[numbers], tuple(set_name(*stand) for stand in stands))


def check_different(type_: ObservationType, rows: Rows) -> bool:
    """False if an observation lies between a place and itself, or an angle has two equal targets."""
    names = [reference.name for reference in type_.references if reference.name not in ("system", "frame")]
    good = True
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            cells = rows.series(a)
            same = (cells == rows.series(b)).to_numpy()
            rows.tell_where(same, partial(_same_words, f"{a} and {b}", type_.key, cells))
            good = good and not same.any()
    return good


def _same_words(ends: str, type_: str, cells: pl.Series, row: int) -> str:
    return f"{ends} are the same: {cells[row]!r}; {type_} needs two different ones"


def named_things(reading: Reading, space: str, column: str, rows: Rows) -> Names:
    """The things of one namespace that the rows name, −1 where there is none; each unknown name is told once."""
    if space == "point":
        declare(reading, rows, column, ("point",))
    things = reading.shop.things[space]
    texts, numbers = rows.coded(column)
    found = places(texts, pl.Series(things.ids, dtype=pl.String))[numbers]
    if (found < 0).any() and space not in reading.broken:
        named = rows.names(column)
        known = np.ones(len(named.known), dtype=bool)
        known[named.numbers[found < 0]] = False
        _tell_unknown(space, rows, named, ~known, things.ids)
    return Names(found, things.ids)


# ---- Heights of instrument and target: those a row gives, and those of stations that are not named.


def with_own_height(reading: Reading, rows: Rows, of: str, heights: IntArray, number: int) -> IntArray:
    """Height blocks, where a row says its own: one fixed block for every different value."""
    given = rows.number(f"{of}_height")
    result = heights.copy()
    known = np.flatnonzero(np.isfinite(given))
    if len(known) == 0:
        return result
    values, inverse = np.unique(given[known], return_inverse=True)
    names = [f"observations {number + 1} {of} {value:g}" for value in values]
    result[known] = reading.shop.store("height").add(
        names, values[:, None], np.zeros((len(values), 1), dtype=bool), np.full((len(values), 1), np.nan)
    )[inverse]
    _note_other_heights(reading, rows, of, heights, given)
    return result


def _note_other_heights(reading: Reading, rows: Rows, of: str, heights: IntArray, given: FloatArray) -> None:
    of_station = reading.shop.store("height").all_values()[heights, 0]
    with np.errstate(invalid="ignore"):
        # Heights that differ by less than 1e-9 units of length are the same.
        other = np.flatnonzero((heights != 0) & np.isfinite(given) & (np.abs(given - of_station) > 1e-9))
    if not len(other):
        return
    row = int(other[0])
    name, unit = rows.text(of)[row], reading.edge.units.length
    own = "another one" if np.isnan(of_station[row]) else f"{of_station[row]:.6g} {unit}"
    words = (
        f"{of}_height {given[row]:.6g} {unit} of this row counts, and not the height of station {name!r}, which is "
        f"{own}; both are heights above the point and are not added. Rows of this kind: {len(other)}"
    )
    reading.notes.append(rows.problem(row, words))


def note_points_under_instruments(
    reading: Reading, type_: ObservationType, named: dict[str, Resolved], rows: Rows
) -> None:
    """Note where an observation begins at a point over which a station with an instrument height stands.

    The point is the mark on the ground: the height counts where the station is named, or the row gives it.
    """
    stations = reading.shop.things["station"]
    begin = type_.references[0].name
    if type_.between_marks or not any((s.of, s.part) == (begin, "height") for s in type_.slots):
        return
    raised = np.flatnonzero(stations.parts["height"] != 0)
    over = {int(stations.parts["position"][k]): stations.ids[k] for k in raised}
    found = named[begin]
    low = (found.blocks["height"] == 0) & np.isnan(rows.number(f"{begin}_height"))
    low &= np.isin(found.blocks["position"], list(over))
    if low.any():
        row = int(np.argmax(low))
        station = over[int(found.blocks["position"][row])]
        words = (
            f"{begin}: {found.names[row]!r} is the point itself; the height of the instrument counts where station "
            f"{station!r} over it is named, or {begin}_height is given"
        )
        reading.notes.append(rows.problem(row, words))


# ---- First velocity correction of measured distances, from temperature, pressure and humidity of the air.
#
#     d = d′ + (C − D p/(273.15 + t) + 11.27 e/(273.15 + t)) · 10⁻⁶ d′
#
# with t in °C, p in hPa and the partial pressure e of water vapour in hPa (Rüeger, *Electronic Distance
# Measurement*, 4th ed., 1996, eq. 6.15). C = (n_REF − 1) · 10⁶ belongs to the instrument, D to its carrier
# wavelength λ, µm, through the group refractivity of Barrell and Sears (1939):
#
#     D = 273.15/1013.25 · (287.604 + 4.8864/λ² + 0.068/λ⁴)

AIR = ("temperature", "pressure", "humidity", "vapour_pressure")
"""Columns of the air: °C, hPa, %, hPa."""
_ZERO = 273.15


class Air(NamedTuple):
    """The air along n sights; °C, hPa, hPa."""

    temperature: FloatArray
    pressure: FloatArray
    vapour: FloatArray


def vapour_pressure(temperature: FloatArray, humidity: FloatArray) -> FloatArray:
    """Partial pressure of water vapour, hPa, at t (°C) and the relative humidity (%), by Magnus' formula."""
    saturated = 6.1078 * np.exp(17.269 * temperature / (237.3 + temperature))
    return np.asarray(0.01 * humidity * saturated)


def dispersion_constant(wavelength: float) -> float:
    """D of a carrier wavelength, µm."""
    return _ZERO / 1013.25 * (287.604 + 4.8864 / wavelength**2 + 0.068 / wavelength**4)


def first_velocity_correction(air: Air, C: float, D: float) -> FloatArray:
    """(n,) correction per unit of length."""
    absolute = _ZERO + air.temperature
    return np.asarray(1e-6 * (C - D * air.pressure / absolute + 11.27 * air.vapour / absolute))


def air_columns(edge: Edge) -> list[Column]:
    """Columns of the air at a distance."""
    return [number_column(name, NUMBER, edge) for name in AIR]


def corrected(reading: Reading, entry: Observations, rows: Rows, given: FloatArray, place: TableLocation) -> FloatArray:
    """Distances (n, 1) with their first velocity corrections, where the table has columns of the air."""
    found = {name: rows.number(name) for name in AIR}
    if not any(np.isfinite(values).any() for values in found.values()):
        return given
    constants = _constants(reading, entry, place)
    before = len(reading.problems)
    # What is found on the earth; beyond it the unit is another one.
    for name, (least, most, unit) in {
        "temperature": (-90.0, 60.0, "°C"),
        "pressure": (300.0, 1100.0, "hPa"),
        "humidity": (0.0, 100.0, "%"),
        "vapour_pressure": (0.0, 100.0, "hPa"),
    }.items():
        words = f"{name}: expected a value between {least:g} and {most:g} {unit}"
        rows.tell_where((found[name] < least) | (found[name] > most), words)
    lost = np.isnan(found["temperature"]) | np.isnan(found["pressure"])
    rows.tell_where(lost, "a distance with a column of the air needs both temperature and pressure")
    both = np.isfinite(found["humidity"]) & np.isfinite(found["vapour_pressure"])
    rows.tell_where(both, "give either humidity or vapour_pressure")
    if constants is None or len(reading.problems) > before:
        return given
    vapour = np.where(
        np.isfinite(found["vapour_pressure"]),
        found["vapour_pressure"],
        np.nan_to_num(vapour_pressure(found["temperature"], found["humidity"])),
    )
    correction = first_velocity_correction(Air(found["temperature"], found["pressure"], vapour), *constants)
    return given * (1.0 + correction[:, None])


def _constants(reading: Reading, entry: Observations, place: TableLocation) -> tuple[float, float] | None:
    """C and D of the instrument of a group; told where they are missing."""
    name = entry.instrument
    instrument = reading.project.instruments.get(name) if name is not None else None
    if instrument is None or instrument.atmosphere is None:
        words = "temperature, pressure: the instrument has no atmosphere: {C: 286.34, D: 80.67} or {C, wavelength}"
        place.tell(words, "instrument")
        return None
    said = instrument.atmosphere
    if said.wavelength is None:
        assert said.D is not None  # the model sees to it
        return said.C, said.D
    try:
        length = reading.edge.number(said.wavelength, LENGTH) * reading.edge.metres * 1e6
    except UnitError as error:
        reading.at("instruments", str(name), "atmosphere").tell(f"wavelength: {error}")
        return None
    # Wavelengths, µm, at which Barrell and Sears hold and distances are measured with light.
    shortest, longest = 0.36, 2.0
    if not shortest <= length <= longest:
        words = f"wavelength: found {said.wavelength}, expected one of light, as 0.658 um"
        reading.at("instruments", str(name), "atmosphere").tell(words)
        return None
    return said.C, dispersion_constant(length)


# ---- What is observed of one thing alone, and is fixed there: it would be counted with r = 1, and says nothing.


def refuse_fixed(reading: Reading, groups: Iterable[ObservationGroup]) -> None:
    """Tell observed coordinates and levels that depend on nothing but fixed components.

    Between two things it is another matter: a distance between fixed points checks both.
    """
    for group in groups:
        if group.type.name not in PLAIN_TYPES or len(group.type.references) > 1:
            continue
        # (n, m) true for components that some unknown changes.
        places, tangents, free = [], [], []
        for slot, blocks in group.blocks_by_slot:
            store = reading.shop.store(slot.kind)
            # Stands for a value that is not known yet: what an equation depends on, it depends on at nearly every
            # place.
            values = np.nan_to_num(store.all_values()[blocks], nan=0.5)
            free.append(store.all_free()[blocks])
            if store.kind.is_rotation:
                about_axes = np.isin(blocks, list(store.about_axes))[:, None, None]
                places.append(rotation_from_angles(values))
                tangents.append(np.where(about_axes, np.eye(3), tangent_of_angles(values)))
            else:
                places.append(values)
                tangents.append(np.eye(values.shape[1]))
        depends = np.zeros(group.observed.shape, dtype=bool)
        jacobians = group.type.equation(places, group.constants).jacobians
        for jacobian, tangent, unknown in zip(jacobians, tangents, free, strict=True):
            depends |= ((jacobian @ tangent != 0.0) & unknown[:, None, :]).any(axis=2)
        constant = group.mask & ~depends
        for row in np.flatnonzero(constant.any(axis=1))[:MOST_TOLD].tolist():
            transform = group.external.transform if group.external is not None else np.eye(constant.shape[1])
            said = np.flatnonzero(constant[row] @ np.abs(transform))
            names = ", ".join(group.type.components[k].name for k in said)
            of = f"{group.type.references[0].name} {group.references[0][row]!r}"
            words = (
                f"{names} of {of} {'is' if len(said) == 1 else 'are'} fixed: observing it has no effect; make it "
                "free where it is declared, or give its value and σ there"
            )
            reading.problems.append(Message(words, group.file or reading.document.file, group.line(row)))
