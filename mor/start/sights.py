"""Sights of stations: polar points, sets of directions, verticals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import numpy as np

from mor.model.contract import ObservationGroup, some_rows, wrap
from mor.project.network import Network
from mor.start.bundle import evenly
from mor.types import FloatArray, IntArray

# ---- Which of several answers that fit alike is taken whenever one is asked for, and how well start values agree.

ROWS = 20_000
"""Rows of a group by which start values are judged; observations of a network up to which trying again costs little."""
AGREES = float(np.log1p(5.0**2))
"""Mean of log(1 + (v/σ)²) of a group up to which start values agree with it: 5 σ."""
SOUND = float(np.log1p(2.0**2))
"""The same of adjusted ones, and of those that need not be adjusted before they are judged: 2 σ."""
SMALLER = 1e-6
"""Part of v'Pv from which on one minimum lies below another."""
TRIES = 4
"""Other answers that are tried one after another without finding better start values."""

Found = TypeVar("Found")


class Question(NamedTuple):
    """A question with several answers."""

    answers: int
    taken: int
    alike: bool
    """True where the answers fit alike; false where the first one is the best, and may be wrong all the same."""


@dataclass
class Choices:
    """The answers to take, in the order in which they are asked for: the first one where nothing else is ``wanted``."""

    wanted: tuple[int, ...] = ()
    asked: list[Question] = field(default_factory=list)

    def take(self, count: int, alike: bool = True) -> int:
        """The number of the answer to take of ``count``, the likeliest first."""
        if count <= 1:
            return 0
        place = len(self.asked)
        taken = min(self.wanted[place], count - 1) if place < len(self.wanted) else 0
        self.asked.append(Question(count, taken, alike))
        return taken

    def others(self) -> list[tuple[int, ...]]:
        """Other answers, one changed each: first where answers fit alike, then the next likely ones."""
        before = tuple(question.taken for question in self.asked)
        found = [
            (other, not question.alike, place)
            for place, question in enumerate(self.asked)
            for other in range(question.answers)
            if other != question.taken
        ]
        # Without the likeliest answers at its end, which are taken anyhow: the first answer is 0.
        wanted = [(*before[:place], other) for other, _, place in sorted(found)]
        return [one[: max((k + 1 for k, answer in enumerate(one) if answer), default=0)] for one in wanted]

    @property
    def open(self) -> bool:
        """True where answers fitted alike."""
        return any(question.alike for question in self.asked)


class Judgement(NamedTuple):
    """Quality of start values."""

    missing: int
    """Things that have none."""
    fit: float
    """Mean of log(1 + (v/σ)²) over all observations that they reach."""
    worst: float
    """The largest of a group."""
    squares: float = np.inf
    """v'Pv, where they were adjusted and that came to an end."""
    before: float = np.inf
    """``fit`` before they were adjusted, whatever came of it."""

    @property
    def agrees(self) -> bool:
        """True where nothing better is to be looked for.

        An adjustment that ends with a worse fit was drawn away by gross errors: then start values count as they stood.
        """
        adjusted = np.isfinite(self.squares) and self.fit <= self.before
        return not self.missing and self.worst <= (SOUND if adjusted else AGREES)

    @property
    def as_they_stood(self) -> Judgement:
        """Judgement of the same start values before their adjustment."""
        return Judgement(self.missing, min(self.fit, self.before), self.worst)

    def beats(self, other: Judgement) -> bool:
        """True where these are clearly better, or end at a smaller v'Pv.

        Gross errors can draw good ones and bad ones to one end, from where nothing tells what is wrong: the good ones
        fit most observations as they stand.
        """
        clearly = 0.1
        if np.isfinite(self.squares) and np.isfinite(other.squares):
            if abs(self.squares - other.squares) <= SMALLER * other.squares:
                return self.before + clearly < other.before
            return self.squares < other.squares
        return (self.missing, self.fit + clearly * (self.missing == other.missing)) < (other.missing, other.fit)


def likeliest(
    attempt: Callable[[Choices], Found],
    judged: Callable[[Found], Judgement],
    adjusted: Callable[[Found, Judgement], Judgement],
    most: int,
) -> tuple[Found, Choices]:
    """Return the start values that agree best.

    One answer after another is changed, as long as that helps. Other answers are adjusted where they fit better as
    they stand, or to a question whose answers fit alike: else they lead to the same end. ``most``: attempts in a row
    that find nothing better.
    """
    choices = Choices()
    best = attempt(choices)
    if not choices.asked:
        return best, choices
    judgement = adjusted(best, judged(best))
    tried, left = {choices.wanted}, _tries(choices, judgement, most)
    while left > 0:
        wanted, alike = _next(choices, tried, judgement.agrees)
        if wanted is None:
            break
        tried.add(wanted)
        other = Choices(wanted)
        found = attempt(other)
        of_it = judged(found)
        left -= 1
        if not (alike or of_it.beats(judgement.as_they_stood)):
            continue
        of_it = adjusted(found, of_it)
        if of_it.beats(judgement):
            best, choices, judgement = found, other, of_it
            left = _tries(choices, judgement, most)
    return best, choices


def _tries(choices: Choices, judgement: Judgement, most: int) -> int:
    """Return the number of other answers to try: those that fit alike may all agree, and one of them best."""
    if not judgement.agrees:
        return most
    return TRIES if choices.open and np.isfinite(judgement.squares) else 0


def _next(choices: Choices, tried: set[tuple[int, ...]], only_alike: bool) -> tuple[tuple[int, ...] | None, bool]:
    """Return the next answers to try, and whether they are to a question whose answers fit alike."""
    for wanted in choices.others():
        place = len(wanted) - 1
        alike = place >= 0 and choices.asked[place].alike
        if wanted not in tried and (alike or not only_alike):
            return wanted, alike
    return None, False


def disagreement(groups: Sequence[ObservationGroup], start: Mapping[str, FloatArray]) -> tuple[float, float]:
    """Mean of log(1 + (v/σ)²) over what can be computed, and the largest of a group; few wrong ones weigh little."""
    found = [_of_group(group, start) for group in groups]
    total, count = sum(one[0] for one in found), sum(one[1] for one in found)
    return total / max(count, 1), max((one[0] / one[1] for one in found if one[1]), default=0.0)


def _of_group(group: ObservationGroup, start: Mapping[str, FloatArray]) -> tuple[float, int]:
    """Sum of log(1 + (v/σ)²) over the observations of a group, and how many there are."""
    if group.count > ROWS:
        group = some_rows(group, np.linspace(0, group.count - 1, ROWS).astype(np.int64))
    blocks = [start[slot.kind][at] for slot, at in zip(group.type.slots, group.blocks, strict=True)]
    with np.errstate(all="ignore"):
        off = group.observed - group.type.equation(blocks, group.constants).values
        off = np.where(group.type.wraps, wrap(off), off) / group.sigma
    told = np.isfinite(off) & group.mask
    sizes = np.minimum(np.abs(off[told]), 1e100)
    return float(np.log1p(np.square(sizes)).sum()), int(np.count_nonzero(told))


# ---- Polar points, heights and rays: from directions, vertical directions and distances to coordinates and back.
#
# Bearings t = atan2(ΔX, ΔY) run clockwise from +Y. A set of directions r has an orientation κ, r = t + κ.
# Vertical directions v are positive upwards; of a zenith angle z it is v = π/2 − z. All angles in radians.


class Orientation(NamedTuple):
    """Orientation of a set of directions."""

    kappa: float
    """κ of r = t + κ, in (−π, π]; not a number where nothing was sighted."""
    residuals: FloatArray
    """(n,) computed minus observed direction."""


def bearing(start: FloatArray, end: FloatArray) -> FloatArray:
    """Bearings (…) from ``start`` to ``end`` (…, 2 or 3)."""
    difference = np.asarray(end, dtype=float) - np.asarray(start, dtype=float)
    return np.asarray(np.arctan2(difference[..., 0], difference[..., 1]))


def polar_rays(directions: FloatArray, verticals: FloatArray) -> FloatArray:
    """Unit rays (n, 3) in the axes of a theodolite with r = atan2(X*, Y*) and v = atan(Z*/√(X*² + Y*²))."""
    level = np.cos(verticals)
    return np.stack([level * np.sin(directions), level * np.cos(directions), np.sin(verticals)], axis=-1)


def orient(station: FloatArray, points: FloatArray, directions: FloatArray) -> Orientation:
    """Orientation of ``directions`` (n,) from a station (2 or 3,) to known ``points`` (n, 2 or 3).

    The mean of those that agree with the sight of the least sum of absolute differences from all the others: a median
    on the circle, which a few wrong identities do not turn.
    """
    differences = np.asarray(directions) - bearing(station, points)
    if not len(differences):
        return Orientation(float("nan"), differences)
    units = np.exp(1j * differences)
    # Sights of which the orientation of a set may be that of one.
    candidates = evenly(units, 100)
    apart = np.abs(np.angle(candidates[:, None] * units.conj())).sum(axis=1)
    # Mean absolute differences (radians) that are the same.
    median = candidates[apart <= apart.min() + 1e-9 * len(units)].mean()
    # Radians up to which sights agree: places may be rough.
    near = np.abs(np.angle(units * np.conj(median))) <= 0.05
    kappa = float(np.angle(units[near].mean() if near.any() else median))
    return Orientation(kappa, np.angle(np.exp(1j * kappa) * units.conj()))


# ---- Sets of directions, gathered from all the tables that read them, in face one; and which frames know the vertical.


class DirectionSet(NamedTuple):
    """Directions r = t + κ read clockwise at one position, and vertical directions, in face one; NaN for none."""

    name: str
    position: int
    rotation: int
    """Rotation block of the set, −1 for angles and bearings."""
    oriented: bool
    """True where κ = 0 is known: bearings."""
    height: float
    """Of the instrument."""
    points: IntArray
    heights: FloatArray
    """(n,) of the targets."""
    directions: FloatArray
    verticals: FloatArray
    sigma: FloatArray = np.zeros(0)
    """(n,) radians, the larger of the two; of a set of directions."""
    height_block: int = -1
    """Block of the height of the instrument, of a set of directions."""


def direction_sets(network: Network) -> list[DirectionSet]:
    """All sets of a network, in the order of their rotation blocks; rows of one set may stand in several tables."""
    groups = [
        group for group in network.groups if group.type.key in ("directions", "zenith_directions") and group.count
    ]
    if not groups:
        return []
    blocks = [np.concatenate([group.blocks[slot] for group in groups]).astype(np.int64) for slot in range(5)]
    names = np.concatenate([np.asarray(list(group.references[0]), dtype=object) for group in groups])
    readings = np.concatenate([np.stack(first_face(group), axis=1) for group in groups])
    sigma = np.concatenate([np.fmax(group.sigma[:, 0], group.sigma[:, 1]) for group in groups])
    heights = network.start["height"][:, 0]
    order = np.argsort(blocks[1], kind="stable")
    cuts = np.flatnonzero(np.diff(blocks[1][order])) + 1
    sets = []
    for rows in np.split(order, cuts):
        position, rotation, height = (int(blocks[slot][rows[0]]) for slot in range(3))
        sets.append(
            DirectionSet(
                f"station {names[rows[0]]}",
                position,
                rotation,
                False,
                float(heights[height]),
                blocks[3][rows],
                heights[blocks[4][rows]],
                readings[rows, 0],
                readings[rows, 1],
                sigma[rows],
                height,
            )
        )
    return sets


def first_face(group: ObservationGroup) -> tuple[FloatArray, FloatArray]:
    """Horizontal and vertical directions (n,) reduced to face one; NaN where not observed."""
    second = group.constants[:, 1] == 2.0
    horizontal = group.observed[:, 0] - np.where(second, np.pi, 0.0)
    given = group.observed[:, 1]
    if group.type.key == "zenith_directions":
        vertical = np.where(second, given - 1.5 * np.pi, 0.5 * np.pi - given)
    else:
        vertical = np.where(second, np.pi - given, given)
    return horizontal, vertical


def frame_verticals(network: Network) -> FloatArray:
    """(rotation blocks, 3) the vertical D e_Z in the axes of each frame; NaN where no angles and no level tell it."""
    start = network.start.get("rotation", np.zeros((0, 3, 3)))
    up = np.full((len(start), 3), np.nan)
    if len(start) == 0:
        return up
    free = network.blocks["rotation"].free
    fixed = ~free[:, :2].any(axis=1)
    known = fixed & np.isfinite(start).all(axis=(1, 2))
    up[known] = start[known, :, 2]
    # With κ alone unknown the vertical is the same for every κ only where the frame stands upright.
    up[fixed & ~known] = [0.0, 0.0, 1.0]
    for group in network.groups:
        if group.type.key == "level":
            tilt = group.observed
            told = np.isfinite(tilt).all(axis=1)
            z = np.sqrt(np.maximum(1.0 - np.sum(np.square(tilt), axis=1), 0.0))
            up[group.blocks[0][told]] = np.column_stack([tilt, z])[told]
    return up


# ---- Levelled sights of a network: sets of directions, angles and bearings, and the lengths between positions.


class PositionDifferences(NamedTuple):
    """Measured lengths, height differences or vectors between positions, with the heights of instrument and target."""

    start: IntArray
    end: IntArray
    start_height: FloatArray
    end_height: FloatArray
    start_block: IntArray
    """Height block of the instrument."""
    value: FloatArray
    """(n, m)."""
    sigma: FloatArray
    """(n,) the largest of a row."""


class Terrestrial(NamedTuple):
    """Everything terrestrial that start values can be taken from."""

    sights: tuple[DirectionSet, ...]
    slopes: PositionDifferences
    horizontals: PositionDifferences
    height_differences: PositionDifferences
    vectors: PositionDifferences
    verticals: PositionDifferences
    """Vertical directions between two positions, reduced to face one."""


def terrestrial(network: Network) -> Terrestrial:
    """Sights and lengths of a network."""
    up = frame_verticals(network)
    # Levelled: the cosine of the tilt is that of 0.3 gon or less.
    sights = [one for one in direction_sets(network) if up[one.rotation, 2] > 1.0 - 1e-5]
    for group in network.groups:
        if group.type.key == "angle":
            sights += _angles(group)
        elif group.type.key == "bearing":
            sights += _bearings(group)
    return Terrestrial(
        tuple(sights),
        _lengths(network, "distance"),
        _lengths(network, "horizontal_distance"),
        _lengths(network, "height_difference"),
        _lengths(network, "vector"),
        _verticals(network),
    )


def _angles(group: ObservationGroup) -> list[DirectionSet]:
    """Angles at one point, those with common legs joined to one set."""
    at, back, fore = group.blocks
    sights = []
    for station in np.unique(at):
        rows = np.flatnonzero(at == station)
        remaining = {(int(back[i]), int(fore[i])): float(group.observed[i, 0]) for i in rows}
        while remaining:
            (first, second), angle = next(iter(remaining.items()))
            legs = {first: 0.0, second: angle}
            grown = True
            while grown:
                grown = False
                for (b, f), beta in remaining.items():
                    if b in legs and f not in legs:
                        legs[f], grown = legs[b] + beta, True
                    elif f in legs and b not in legs:
                        legs[b], grown = legs[f] - beta, True
            remaining = {key: beta for key, beta in remaining.items() if key[0] not in legs}
            points = np.array(list(legs), dtype=np.int64)
            none = np.full(len(points), np.nan)
            sights.append(
                DirectionSet(
                    "angles",
                    int(station),
                    -1,
                    False,
                    0.0,
                    points,
                    np.zeros(len(points)),
                    np.array(list(legs.values())),
                    none,
                )
            )
    return sights


def _bearings(group: ObservationGroup) -> list[DirectionSet]:
    start, start_height, end, end_height = group.blocks
    del start_height, end_height
    return [
        DirectionSet("bearing", int(a), -1, True, 0.0, np.array([b]), np.zeros(1), np.array([t]), np.full(1, np.nan))
        for a, b, t in zip(start, end, group.observed[:, 0], strict=True)
    ]


def _lengths(network: Network, key: str) -> PositionDifferences:
    groups = [group for group in network.groups if group.type.key == key]
    return _collected(network, groups, [group.observed for group in groups])


def _verticals(network: Network) -> PositionDifferences:
    groups, values = [], []
    for group in network.groups:
        if group.type.key == "zenith_angle":
            second = group.constants[:, 1] == 2.0
            given = group.observed[:, 0]
            values.append(np.where(second, given - 1.5 * np.pi, 0.5 * np.pi - given)[:, None])
        elif group.type.key == "vertical_direction":
            values.append(group.observed)
        else:
            continue
        groups.append(group)
    return _collected(network, groups, values)


def _collected(network: Network, groups: list[ObservationGroup], values: list[FloatArray]) -> PositionDifferences:
    none = np.zeros(0, dtype=np.int64)
    heights = network.start["height"][:, 0]
    width = values[0].shape[1] if values else 1
    return PositionDifferences(
        np.concatenate([none, *(group.blocks[0] for group in groups)]),
        np.concatenate([none, *(group.blocks[2] for group in groups)]),
        np.concatenate([np.zeros(0), *(heights[group.blocks[1]] for group in groups)]),
        np.concatenate([np.zeros(0), *(heights[group.blocks[3]] for group in groups)]),
        np.concatenate([none, *(group.blocks[1] for group in groups)]),
        np.concatenate([np.zeros((0, width)), *values]),
        np.concatenate([np.zeros(0), *(np.nan_to_num(group.sigma).max(axis=1) for group in groups)]),
    )
