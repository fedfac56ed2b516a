"""Points of which some observations do not fit, intersected anew: at the place where most of them have it.

An iteration that began with a wrong sight may have left the point where that one and another agree. Of all places that
as few observations determine as can, two sights, a sight and a distance, three distances, the one at which all
observations of the point cost least (``description_length.py``) is taken.
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import combinations
from typing import NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry import tolerant
from mor.observations import Computed, ObservationGroup, wrap
from mor.parameters.index import Values
from mor.quality.gross_errors.description_length import (
    cost_of_residuals,
    costs_of_sizes,
    factor_of_sigmas,
    robust_sigma,
)

SUSPECT = 4.5
"""|v|/σ beyond which an observation is looked at: nothing is decided by it."""
POINTS = 200
"""Points that are looked at, the most doubtful first."""
_SHARED = 3
"""Components of observations that may fit a point at two places."""
_ROWS = 8
"""Rows of a point that are put together."""
_ITERATIONS = 8
_SINGULAR = 4.0 * float(np.finfo(np.float64).eps)
"""Part of the largest singular value of observations below which they do not tell a direction."""
_ENDS = ("point", "to", "from")
"""Whose a slot is that holds a point which is observed, and no place of a frame."""
OF_THEMSELVES = ("observed/", "coordinates", "control")
"""Types of observations that tell where a point is without seeing it."""


class Starts(NamedTuple):
    """Where points were thought to be: it tells them apart where their observations fit two places alike."""

    places: FloatArray
    """(k, 3) of all points."""
    spread: float
    """Robust σ of a coordinate, told by how far points came from there; 0 where that tells nothing."""

    def costs(self, places: FloatArray, points: IntArray | slice, count: int) -> FloatArray:
        """(k,) what places (k, 3) of these points cost as further observations of ``count``, the whole way one."""
        away = np.nan_to_num(np.linalg.norm(places - self.places[points], axis=-1))
        return costs_of_sizes(away / self.spread, count) if self.spread > 0.0 else np.zeros(len(away))


def starts_of(problem: Problem, values: Values, start: Values) -> Starts:
    """Where points were thought to be, and how well, by where most of them are."""
    off = np.abs(values["point"] - start["point"])[problem.index.columns["point"] >= 0]
    return Starts(start["point"], robust_sigma(off[np.isfinite(off)]))


class _Observed(NamedTuple):
    """Rows of one group that tell of a point."""

    group: ObservationGroup
    rows: IntArray
    slot: int
    """Of the point."""
    told: BoolArray
    """(r, m) components that were observed."""


def reintersected(
    problem: Problem,
    values: Values,
    sizes: tuple[FloatArray, ...],
    starts: Starts | None = None,
    gain: float = 0.0,
    but: Collection[int] = (),
) -> dict[str, FloatArray]:
    """Values with points moved of whose observations, |v|/σ (n, m) of each group in ``sizes``, some are suspect.

    ``starts``: where they were thought to be, which counts as one observation more. ``gain``: what another place must
    cost less. ``but``: points that are not looked at.
    """
    middle = np.nanmedian(values["point"], axis=0)
    among = Among(problem.observations, middle, factor_of_sigmas(sizes))
    return intersected_anew(problem, values, points_in_doubt(problem, sizes, but), among, starts, gain)


class Among(NamedTuple):
    """What is to be known of all observations and points to look at one."""

    observations: int
    """Their number."""
    middle: FloatArray
    """(3,) median of all points."""
    most: float
    """Robust factor of all σ."""


def intersected_anew(
    problem: Problem,
    values: Values,
    points: Collection[int],
    among: Among,
    starts: Starts | None = None,
    gain: float = 0.0,
) -> dict[str, FloatArray]:
    """Values with some points where they cost least, as :func:`reintersected`."""
    moved = values["point"].copy()
    columns = problem.index.columns["point"]
    for point in points:
        told = _told_of(problem, point)
        if (columns[point] >= 0).any() and len(_components(told)) > 3:
            places = np.array([moved[point], *_meetings(told, values, [moved[point], among.middle])])
            costs = _costs(told, values, places, among.observations, among.most)
            costs[0] -= gain
            if starts is not None:
                costs += starts.costs(places, np.full(len(places), point), among.observations)
            found = places[int(np.argmin(costs))]
            moved[point] = np.where(columns[point] >= 0, found, moved[point])
    return {**values, "point": moved}


def by_sights_alone(problem: Problem, values: Values, points: IntArray) -> FloatArray:
    """(k, 3) places of points by what sees them alone, whatever their coordinates say; NaN where that is too little."""
    places = np.full((len(points), 3), np.nan)
    middle = np.nanmedian(values["point"], axis=0)
    for k, point in enumerate(points.tolist()):
        told = _told_of(problem, point)
        if len(_determining(_components(told))):
            met = _meetings(told, values, [values["point"][point], middle])
            places[k] = met[int(np.argmin(_costs(told, values, met, problem.observations)))]
    return places


def costs_at_places(problem: Problem, values: Values, point: int, places: FloatArray) -> FloatArray:
    """(k,) what the observations of a point cost if it were at other places (k, 3); 0 where there are none."""
    told = _told_of(problem, point)
    if not told:
        return np.zeros(len(places))
    return _costs(told, values, places, problem.observations)


def slots_of_ends(group: ObservationGroup) -> list[int]:
    """The slots of points that a group tells of, without seeing by itself where they are."""
    if group.type.key.startswith(OF_THEMSELVES):
        return []
    return [k for k, slot in enumerate(group.type.slots) if slot.kind == "point" and slot.of in _ENDS]


def points_in_doubt(problem: Problem, sizes: tuple[FloatArray, ...], but: Collection[int] = ()) -> list[int]:
    """Points that might be elsewhere, those first at which most is suspect beside what fits.

    At another place nothing fits of what fits here but so much as leaves a choice of places, three components at most:
    two rays meet once, a ray and a distance or three distances twice. So as many components as are suspect, and three,
    are outvoted by what fits, if that is more. So many as are looked at, less the others (``but``).
    """
    points, _ = doubtful_points(problem, sizes, but)
    return [int(k) for k in points[: max(POINTS - len(but), 0)]]


def doubtful_points(
    problem: Problem, sizes: tuple[FloatArray, ...], but: Collection[int] = ()
) -> tuple[IntArray, IntArray]:
    """All points in doubt (k,), the most doubtful first, and by how much more fits than is suspect at each (k,)."""
    bad, good = (np.zeros(len(problem.index.columns["point"]), dtype=np.int64) for _ in range(2))
    for group, size in zip(problem.groups, sizes, strict=True):
        used = group.mask & ~group.left_out
        suspect = (used & (size > SUSPECT)).any(axis=1)
        told = np.count_nonzero(used, axis=1)
        for slot in slots_of_ends(group):
            np.add.at(bad, group.blocks[slot], np.where(suspect, told, 0))
            np.add.at(good, group.blocks[slot], np.where(suspect, 0, told))
    in_doubt = (bad > 0) & (good <= bad + _SHARED)
    in_doubt[list(but)] = False
    points = np.flatnonzero(in_doubt)
    points = points[np.argsort((good - bad)[points], kind="stable")]
    return points, (good - bad)[points]


def _told_of(problem: Problem, point: int) -> list[_Observed]:
    found, left = [], _ROWS
    for group in problem.groups:
        used = group.mask & ~group.left_out
        for slot in slots_of_ends(group):
            rows = np.flatnonzero((group.blocks[slot] == point) & used.any(axis=1))[:left]
            found += [_Observed(group, rows, slot, used[rows])] if len(rows) else []
            left -= len(rows)
    return found


def _components(told: list[_Observed]) -> IntArray:
    """(e,) the row of each component that was observed, rows numbered through."""
    counts = np.concatenate([np.zeros(0, dtype=np.int64), *(one.told.sum(axis=1) for one in told)])
    return np.repeat(np.arange(len(counts)), counts)


def _determining(row_of: IntArray) -> IntArray:
    """(c, w) components of each two rows that have three, and of each three rows of one; filled up with e."""
    entries = [np.flatnonzero(row_of == row) for row in range(int(row_of.max(initial=-1)) + 1)]
    alone = [one for one in entries if len(one) == 1]
    found = [one for one in map(np.concatenate, combinations(entries, 2)) if len(one) >= 3]
    found += [np.concatenate(three) for three in combinations(alone, 3)]
    filled = np.full((len(found), max(map(len, found), default=0)), len(row_of), dtype=np.int64)
    for row, one in zip(filled, found, strict=True):
        row[: len(one)] = one
    return filled


def _meetings(told: list[_Observed], values: Values, begins: list[FloatArray]) -> FloatArray:
    """(p, 3) where as few observations as determine the point meet, all choices of them."""
    few = _determining(_components(told))
    begun = np.tile(np.array(begins), (len(few), 1))
    return _intersected(told, values, begun, np.repeat(few, len(begins), axis=0))


def _costs(
    told: list[_Observed], values: Values, places: FloatArray, count: int, most: float = np.inf
) -> FloatArray:
    """(p,) what the observations of a point cost if it were at places (p, 3); ∞ where they have no value.

    ``most``: factor by which all σ may be too small.
    """
    sizes = np.abs(_residuals(told, values, places)[0])
    found: FloatArray = np.array([cost_of_residuals([size], count, most) for size in sizes])
    return np.where(np.isfinite(sizes).all(axis=1) & np.isfinite(found), found, np.inf)


def _intersected(told: list[_Observed], values: Values, begins: FloatArray, few: IntArray) -> FloatArray:
    """Least squares (Gauss–Newton) of components (p, w) each: places (p, 3) from as many beginnings.

    Where an iteration comes to where an observation has no value, the place is where it began.
    """
    places, goes_on = begins.copy(), np.arange(len(begins))
    for _ in range(_ITERATIONS):
        residuals, jacobians = _residuals(told, values, places[goes_on])
        sound = np.isfinite(residuals).all(axis=1) & np.isfinite(jacobians).all(axis=(1, 2))
        places[goes_on[~sound]] = begins[goes_on[~sound]]
        goes_on, at = goes_on[sound], np.flatnonzero(sound)[:, None]
        if not len(goes_on):
            break
        rows = np.pad(jacobians, ((0, 0), (0, 1), (0, 0)))[at, few[goes_on]]
        off = np.pad(residuals, ((0, 0), (0, 1)))[at, few[goes_on]]
        places[goes_on] += np.einsum("pij,pj->pi", tolerant.pinv(rows, rcond=_SINGULAR), off)
    return places


def _residuals(told: list[_Observed], values: Values, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(observed − computed)/σ (p, e) of what tells of the point at places (p, 3), and its derivatives (p, e, 3)."""
    misclosures, jacobians = [], []
    for one, equation in zip(told, _equations(told, values, places), strict=True):
        group, every = one.group, np.tile(one.rows, len(places))
        difference = group.observed[every] - equation.values
        difference[:, group.type.wraps] = wrap(difference[:, group.type.wraps])
        sigma = group.given_sigma[every]
        shape = (len(places), *one.told.shape)
        misclosures.append((difference / sigma).reshape(shape)[:, one.told])
        derivatives = equation.jacobians[one.slot] / sigma[:, :, None]
        jacobians.append(derivatives.reshape(*shape, 3)[:, one.told])
    return np.concatenate(misclosures, axis=1), np.concatenate(jacobians, axis=1)


def _equations(told: list[_Observed], values: Values, places: FloatArray) -> list[Computed]:
    """The equations of what tells of the point at places (p, 3), all rows for each place; those of a type together."""
    alike: dict[int, list[int]] = {}
    for number, one in enumerate(told):
        alike.setdefault(id(one.group.type), []).append(number)
    found: dict[int, Computed] = {}
    for numbers in alike.values():
        blocks, constants = zip(*(_arguments(told[k], values, places) for k in numbers), strict=True)
        type_, ends = told[numbers[0]].group.type, np.cumsum([len(own) for own in constants])
        with np.errstate(all="ignore"):
            every = type_.equation(
                [np.concatenate(of_slot) for of_slot in zip(*blocks, strict=True)], np.concatenate(constants)
            )
        for k, end, own in zip(numbers, ends, constants, strict=True):
            part = slice(end - len(own), end)
            found[k] = Computed(every.values[part], tuple(jacobian[part] for jacobian in every.jacobians))
    return [found[k] for k in range(len(told))]


def _arguments(one: _Observed, values: Values, places: FloatArray) -> tuple[list[FloatArray], FloatArray]:
    """Blocks and constants of rows, with the point at places (p, 3), all rows for each place."""
    group, every = one.group, np.tile(one.rows, len(places))
    blocks = [values[s.kind][b[every]] for s, b in zip(group.type.slots, group.blocks, strict=True)]
    blocks[one.slot] = np.repeat(places, len(one.rows), axis=0)
    return blocks, group.constants[every]
