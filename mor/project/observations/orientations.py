"""Orientations of theodolite stations: sets of their own, and stations at which no direction was observed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.arrays import BoolArray
from mor.observations import ObservationGroup
from mor.project.network.reading import Reading


def set_name(station: str, set_: str) -> str:
    """Name of a set of directions; a station without sets is its own."""
    return f"{station}/{set_}" if set_ else station


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
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
        if slot.kind == "rotation"
        for number in np.unique(blocks)
    }
    stations = reading.shop.things["station"]
    for name, number in zip(stations.ids, stations.parts["rotation"], strict=True):
        if int(number) not in used:
            reading.unoriented.add(name)
            values = np.nan_to_num(store.all_values()[number])
            for component, value in enumerate(values):
                store.hold(int(number), component, float(value))
