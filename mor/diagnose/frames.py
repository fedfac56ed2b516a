"""Whole set-ups and images mixed up: two instruments whose places were exchanged, two images whose names were.

All rows of one frame get the blocks of the other one. With the unknowns as they are, and the orientation of each set of
directions taken from its own rows, the pairs whose rows then cost least are tried. A pair of stations is also judged
with the two points exchanged in all other rows: if few sights go to them, the points follow their instruments.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from mor.adjustment.linearise import misclosures
from mor.arrays import FloatArray, IntArray
from mor.diagnose.circles import _middle
from mor.diagnose.edits import CellEdit, Edit, cells, to
from mor.diagnose.hypothesis import Hypothesis, with_group
from mor.diagnose.situation import SMALL, Situation
from mor.observations import ObservationGroup, is_image_point, wrap
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.quality.gross_errors.description_length import costs_of_sizes

_TRIED = 4
_FRAMES = 12
"""Stations or images that are looked at, those first of which most rows do not fit."""
ALL = -1
"""Stands for all tables."""
_GAIN = 20.0
"""Decrease of the cost that is worth an adjustment."""


def frame_hypotheses(situation: Situation) -> list[Hypothesis]:
    """Return the exchanges of two stations, and of two images, that promise most."""
    if not situation.begun or situation.count > SMALL:
        return []
    return [*_stations(situation), *_images(situation)]


def exchanged_frames(network: Network, pair: tuple[str, str], of: str, only: int = ALL) -> Network:
    """Return the network with the blocks of two frames exchanged in all their rows, or in those of one table.

    ``of`` is ``station``, whose positions are exchanged, or ``image``, whose positions, rotations and interiors are.
    """
    for number, group in enumerate(network.groups):
        if only not in (ALL, number):
            continue
        blocks, changed = list(group.blocks), False
        for slot in _slots(group, of):
            column = group.references[
                [r.name for r in group.type.references].index(group.type.slots[slot].of)
            ]
            names = np.array(list(column))
            rows = [np.flatnonzero(names == name) for name in pair]
            known = _blocks_of(network, pair, of, group.type.slots[slot].part)
            if known is None:
                continue
            own = np.array(blocks[slot])
            own[rows[0]], own[rows[1]] = known[1], known[0]
            changed |= bool(len(rows[0]) + len(rows[1]))
            blocks[slot] = own
        if changed:
            network = with_group(network, number, replace(group, blocks=tuple(blocks)))
    return network


def _slots(group: ObservationGroup, of: str) -> list[int]:
    """Slots of a group that change if its frames are exchanged."""
    if of == "image":
        parts = ("position", "rotation", "interior")
        return [k for k, s in enumerate(group.type.slots) if s.of == "image" and s.part in parts]
    if not group.type.distances or group.type.between_marks:
        return []
    begin = group.type.distances[0]
    return [k for k, s in enumerate(group.type.slots) if s.of == begin and s.part == "position"]


def _blocks_of(network: Network, pair: tuple[str, str], of: str, part: str) -> tuple[int, int] | None:
    things = network.things[of]
    if part not in things.parts:
        return None
    one, other = (int(things.parts[part][things.numbers[name]]) for name in pair)
    return one, other


def _stations(situation: Situation) -> list[Hypothesis]:
    network = situation.network
    if "station" not in network.things:
        return []
    things = network.things["station"]
    declared = [name for name in things.ids if name not in network.sets]
    worst = _worst(situation, "station", declared)
    pairs = [
        pair
        for pair in combinations(declared, 2)
        if set(pair) & set(worst) and len(set(_blocks_of(network, pair, "station", "position") or ())) == 2
    ]
    tables = [k for k, group in enumerate(network.groups) if group.count and _slots(group, "station")]
    variants = [ALL, *tables] if len(tables) > 1 else [ALL]
    best = _best(situation, [(pair, only) for pair in pairs for only in variants], "station")
    ids = network.blocks["point"].ids
    found = []
    for pair, only in best:
        if only != ALL:
            group = network.groups[only]
            column = np.array(list(group.references[0]))
            booked: tuple[Edit, ...] = ()
            for name, other in (pair, pair[::-1]):
                rows = np.flatnonzero(column == name).tolist()
                booked += cells(network, only, rows, group.type.references[0].name, to(other))
            found.append(
                _hypothesis("set-ups exchanged", pair, "station", len(pairs), booked, situation, only)
            )
            continue
        blocks = _blocks_of(network, pair, "station", "position")
        points = [ids[k] for k in blocks or ()]
        edits: tuple[Edit, ...] = tuple(
            CellEdit(("stations",), "point", to(point), cells={"id": name})
            for name, point in zip(pair, reversed(points), strict=True)
        )
        found.append(_hypothesis("set-ups exchanged", pair, "station", len(pairs), edits, situation))
    return found


def _images(situation: Situation) -> list[Hypothesis]:
    network = situation.network
    names = list(network.things["image"].ids) if "image" in network.things else []
    worst = _worst(situation, "image", names)
    pairs = [pair for pair in combinations(worst, 2) if _alike(network, pair)]
    found = []
    for pair, _ in _best(situation, [(pair, ALL) for pair in pairs], "image"):
        edits: tuple[Edit, ...] = ()
        for number, group in enumerate(network.groups):
            if is_image_point(group.type):
                column = np.array(list(group.references[0]))
                for name, other in (pair, pair[::-1]):
                    rows = np.flatnonzero(column == name).tolist()
                    edits += cells(network, number, rows, "image", to(other))
        found.append(_hypothesis("images exchanged", pair, "image", len(pairs), edits, situation))
    return found


def _alike(network: Network, pair: tuple[str, str]) -> bool:
    """True if two images have interiors of one model."""
    cameras = network.things["image"].parts["camera"]
    numbers = network.things["image"].numbers
    models = {
        network.project.cameras[network.things["camera"].ids[cameras[numbers[name]]]].model for name in pair
    }
    return len(models) == 1


def _worst(situation: Situation, of: str, names: list[str]) -> list[str]:
    """Frames with rows that do not fit, those with most of them first."""
    count = dict.fromkeys(names, 0)
    for group, bad in zip(situation.network.groups, situation.misfitting, strict=False):
        for slot in _slots(group, of)[:1]:
            own = group.type.slots[slot].of
            column = group.references[[r.name for r in group.type.references].index(own)]
            for row in np.flatnonzero(bad.any(axis=1)).tolist():
                if column[row] in count:
                    count[column[row]] += 1
    return sorted((name for name in names if count[name]), key=lambda name: -count[name])[:_FRAMES]


_Pair = tuple[tuple[str, str], int]
"""Two frames, and the table in which they are exchanged."""


def _best(situation: Situation, pairs: list[_Pair], of: str) -> list[_Pair]:
    network = situation.network
    now = _cost(situation, network, situation.values)
    gains = {}
    for pair, only in pairs:
        places = [situation.values]
        blocks = _blocks_of(network, pair, of, "position")
        if (
            blocks is not None
        ):  # the points, or images, are where the others have them, or have been exchanged
            places.append(_exchanged_values(situation.values, _kind(network, of), blocks))
        changed = exchanged_frames(network, pair, of, only)
        gains[pair, only] = now - min(_cost(situation, changed, values) for values in places)
    order = sorted((p for p in pairs if gains[p] > _GAIN), key=lambda p: -gains[p])
    return order[:_TRIED]


def _kind(network: Network, of: str) -> str:
    return next(
        group.type.slots[slot].kind
        for group in network.groups
        for slot in _slots(group, of)
        if group.type.slots[slot].part == "position"
    )


def _exchanged_values(values: Values, kind: str, blocks: tuple[int, int]) -> Values:
    moved: FloatArray = values[kind].copy()
    moved[list(blocks)] = moved[list(reversed(blocks))]
    return {**values, kind: moved}


def _cost(situation: Situation, network: Network, values: Values) -> float:
    """What all rows cost, sets of directions turned to where most of their own rows have them."""
    cost = 0.0
    for group in network.groups:
        if not group.count or any(slot.kind not in values for slot in group.type.slots):
            continue
        with np.errstate(all="ignore"):
            misclosure = misclosures(group, values)
        if group.type.turns and group.type.references[0].name == "station":
            column, stations = group.type.turns[0], np.array(list(group.references[0]))
            for name in dict.fromkeys(stations.tolist()):
                own: IntArray = np.flatnonzero(stations == name)
                angles = np.nan_to_num(misclosure[own, column])
                misclosure[own, column] = wrap(angles - _middle(angles))
        sizes = np.abs(misclosure / group.given_sigma)[group.mask]
        cost += float(np.sum(costs_of_sizes(np.nan_to_num(sizes, nan=1e30, posinf=1e30), situation.count)))
    return cost


def _hypothesis(
    cause: str,
    pair: tuple[str, str],
    of: str,
    candidates: int,
    edits: tuple[Edit, ...],
    situation: Situation,
    only: int = ALL,
) -> Hypothesis:
    blocks = _blocks_of(situation.network, pair, of, "position")
    kind = _kind(situation.network, of)
    anew = {kind: np.array(blocks)} if blocks is not None and kind == "point" else {}
    return Hypothesis(
        cause,
        pair if only == ALL else (*pair, situation.network.groups[only].name),
        lambda network: exchanged_frames(network, pair, of, only),
        f"{of}s: {pair[0]} ↔ {pair[1]}"
        if only == ALL
        else f"{situation.network.groups[only].name}: {pair[0]} ↔ {pair[1]}",
        candidates,
        edits=edits,
        anew=anew,
        afresh=True,
    )
