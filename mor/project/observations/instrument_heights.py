"""Heights of instrument and target: those a row gives, and those of stations that are not named."""

from __future__ import annotations

import numpy as np

from mor.arrays import IntArray
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
    return result


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
