"""Which observations belong together: by table, image, camera, station, set, instrument, local system.

Each of these is a partition of the observations, or of some of them. What is wrong with a thing is wrong with all that
was observed with it, so that their residuals are tested together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.arrays import AnyIntArray, BoolArray, IntArray
from mor.observations import ObservationGroup
from mor.project.network.build import Network
from mor.project.network.entities import Entities

NOBODY = -1


class Partition(NamedTuple):
    """Observations by the thing they were made with."""

    of: str
    """``group``, ``image``, ``camera``, ``station``, ``set``, ``instrument`` or ``system``."""
    names: Sequence[str]
    """Names of its classes."""
    numbers: tuple[AnyIntArray | None, ...]
    """For each group of observations what tells of each row (n,) whose it is; ``None`` where none is anybody's."""
    classes: tuple[IntArray, ...]
    """For each group the class that each of these numbers stands for, −1 for none."""

    def of_rows(self, group: int, rows: IntArray | slice) -> IntArray | None:
        """(k,) classes of some rows of a group, −1 where a row is in none; ``None`` where no row is in any."""
        numbers = self.numbers[group]
        return None if numbers is None else self.classes[group][numbers[rows]]

    def members(self, group: int, one: int) -> IntArray:
        """Rows of a group that are in a class."""
        found = self.of_rows(group, slice(None))
        return np.flatnonzero(found == one) if found is not None else np.zeros(0, dtype=np.int64)


def partitions(problem: Problem, network: Network) -> list[Partition]:
    """All partitions that say anything; tables first."""
    things, groups = network.things, problem.groups
    stations = _standpoints(network)
    found = [
        _by_group(groups),
        _partition("image", things["image"].ids, groups, _named("image", things["image"].numbers)),
        _partition("camera", things["camera"].ids, groups, _by_camera(things["image"])),
        _partition("station", tuple(dict.fromkeys(stations)), groups, _from_station(stations)),
        _partition("set", things["station"].ids, groups, _named("station", things["station"].numbers)),
        _partition("instrument", things["instrument"].ids, groups, _by_instrument(things["instrument"])),
        _partition("system", things["system"].ids, groups, _named("system", things["system"].numbers)),
    ]
    return [one for one in found if any(numbers is not None for numbers in one.numbers)]


_Told = tuple[AnyIntArray, IntArray]
"""What tells of each row whose it is, and the class each of these numbers stands for."""
_Teller = Callable[[ObservationGroup], _Told | None]


def _partition(
    of: str, names: Sequence[str], groups: tuple[ObservationGroup, ...], tell: _Teller
) -> Partition:
    told = [tell(group) for group in groups]
    nothing = np.zeros(0, dtype=np.int64)
    numbers = tuple(one[0] if one is not None else None for one in told)
    return Partition(of, names, numbers, tuple(one[1] if one is not None else nothing for one in told))


def _by_group(groups: tuple[ObservationGroup, ...]) -> Partition:
    numbers = tuple(np.broadcast_to(np.int32(0), (group.count,)) for group in groups)
    return Partition(
        "group", [group.name for group in groups], numbers, tuple(np.array([k]) for k in range(len(groups)))
    )


def _named(reference: str, classes: Mapping[str, int]) -> _Teller:
    """Rows by the thing that a reference of their type names."""

    def tell(group: ObservationGroup) -> _Told | None:
        for own, names in zip(group.type.references, group.references, strict=True):
            if own.name == reference:
                known = np.full(len(names.known), NOBODY)
                used = np.unique(names.numbers)
                known[used] = [classes.get(names.known[k], NOBODY) for k in used]
                return names.numbers, known
        return None

    return tell


def _by_camera(images: Entities) -> _Teller:
    of_image = _named("image", images.numbers)

    def tell(group: ObservationGroup) -> _Told | None:
        told = of_image(group)
        if told is None:
            return None
        camera = images.parts["camera"]
        return told[0], np.where(told[1] >= 0, camera[np.maximum(told[1], 0)], NOBODY)

    return tell


def _standpoints(network: Network) -> dict[str, str]:
    """The station behind each name of a station or of a further set of directions at one."""
    sets = network.sets
    return {name: sets[name][0] if name in sets else name for name in network.things["station"].ids}


def sets_beside_others(network: Network) -> set[str]:
    """Names of the sets of directions at stations that have more than one."""
    stations = _standpoints(network)
    count = Counter(stations.values())
    return {name for name, station in stations.items() if count[station] > 1}


def _from_station(stations: dict[str, str]) -> _Teller:
    """Rows by the station whose instrument they were read at; levelled lines and vectors have none."""
    places = {station: k for k, station in enumerate(dict.fromkeys(stations.values()))}
    classes = {name: places[station] for name, station in stations.items()}
    tellers = [_named(name, classes) for name in ("station", "at", "from")]

    def tell(group: ObservationGroup) -> _Told | None:
        if group.type.between_marks:
            return None
        told = next((told for teller in tellers if (told := teller(group)) is not None), None)
        return told if told is not None and (told[1] >= 0).any() else None

    return tell


def _by_instrument(instruments: Entities) -> _Teller:
    """Rows by the instrument whose scale, offset or refraction they refer to."""

    def tell(group: ObservationGroup) -> _Told | None:
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True):
            if slot.of == "instrument" and slot.part in instruments.parts:
                own = instruments.parts[slot.part]
                classes = np.full(max(int(blocks.max(initial=0)), int(own.max(initial=0))) + 1, NOBODY)
                classes[own] = np.arange(len(own))
                classes[0] = NOBODY  # the block of those that refer to no instrument
                return (blocks, classes) if (classes[blocks] >= 0).any() else None
        return None

    return tell


def rows_of(partition: Partition, one: int, groups: tuple[ObservationGroup, ...]) -> list[BoolArray]:
    """(n, m) of each group: the observations of a class that take part in the adjustment."""
    found = []
    for number, group in enumerate(groups):
        inside = np.zeros(group.observed.shape, dtype=bool)
        rows = partition.members(number, one)
        inside[rows] = (group.mask & ~group.left_out)[rows]
        found.append(inside)
    return found
