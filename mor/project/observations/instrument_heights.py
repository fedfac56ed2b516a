"""Heights of instrument and target: those a row gives, and those of stations that are not named."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.errors import Problem
from mor.observations import ObservationType
from mor.project.network.reading import Reading
from mor.project.observations.names import Resolved
from mor.project.tables.tables import Rows


def with_own_height(reading: Reading, rows: Rows, of: str, heights: IntArray, number: int) -> IntArray:
    """Height blocks, where a row says its own: one fixed block for every different value."""
    given = rows.number(f"{of}_height")
    result = heights.copy()
    known = np.flatnonzero(np.isfinite(given))
    if len(known) == 0:
        return result
    values, inverse = np.unique(given[known], return_inverse=True)
    names = [f"observations {number + 1} {of} {value:g}" for value in values]
    blocks = reading.shop.store("height").add(
        names, values[:, None], np.zeros((len(values), 1), dtype=bool), np.full((len(values), 1), np.nan)
    )
    result[known] = blocks[inverse]
    _note_other_heights(reading, rows, of, heights, given)
    return result


def _note_other_heights(reading: Reading, rows: Rows, of: str, heights: IntArray, given: FloatArray) -> None:
    """Note rows whose own height replaces another one of the station that they name."""
    of_station = reading.shop.store("height").all_values()[heights, 0]
    with np.errstate(invalid="ignore"):
        other = np.flatnonzero((heights != 0) & np.isfinite(given) & (np.abs(given - of_station) > _SAME))
    if not len(other):
        return
    row = int(other[0])
    name, unit = rows.text(of)[row], reading.edge.units.length
    own = "another one" if np.isnan(of_station[row]) else f"{of_station[row]:.6g} {unit}"
    words = (
        f"{of}_height {given[row]:.6g} {unit} of this row counts, and not the height of station {name!r}, which is "
        f"{own}; both are heights above the point and are not added. Rows of this kind: {len(other)}"
    )
    reading.notes.append(Problem(words, rows.file, int(rows.lines[row])))


_SAME = 1e-9
"""Heights that differ by less, in units of length, are the same."""


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
        reading.notes.append(Problem(words, rows.file, int(rows.lines[row])))
