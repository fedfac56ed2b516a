"""Search for outliers by graduated weights and description length."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import betaln, gammaln

from mor.model import rotations
from mor.model.contract import Computed, ObservationGroup, wrap
from mor.model.images import is_image_point, is_on_the_sphere
from mor.model.parameters import ROTATION, Blocks, Values, index_unknowns
from mor.quality.robust_estimation import (
    WIDEST,
    Graduated,
    exclude,
    frames_of,
    graduated_weights,
    medians_of_parts,
    problem_on_the_sphere,
    robust_scales,
    settled_weights,
)
from mor.quality.test_statistics import LEVEL, MEDIAN_OF_NORMAL, robust_sigma
from mor.solve.inverse import normalised_misclosures
from mor.solve.iterate import Adjustment, Outcome, Patience, SolverSettings, Watcher, adjust
from mor.solve.problem import Problem, misclosures
from mor.types import BoolArray, FloatArray, IntArray

# ---- How well observations are explained: what is left of vᵀPv, with a price for everything that was chosen to fit.
#
# Models that differ in their number of unknowns, in the units of their observations, and in how many others
# were looked through are compared by −2 ln of how likely the observations are (J. Rissanen 1978; G. Schwarz
# 1978):
#
#     L = Σ min(s², 2 ln n + 2 ln s) + 2 n ln k + q ln n + 2 ln m − 2 Σ r ln |dl'/dl|
#
# with s = |v|/(k σ). An observation that does not fit at all costs what it takes to say which of n it is, and
# how large its error: a model is not judged by errors that it is not about. k is 1, or where that is shorter
# the robust factor of all σ: no model is better than another for σ that are all too small. q additional
# unknowns, the best of m alike; r is the part of the changed observations that is controlled
# (:func:`mor.diagnose.hypothesis.controlled_part`).


BY_CHANCE = float(-2.0 * np.log(LEVEL))
"""By how much chance may make L smaller."""


def sizes_of(groups: Sequence[ObservationGroup], values: Values) -> tuple[FloatArray, ...]:
    """|v|/σ (n, m) of every group at some values, 0 where not observed."""
    return tuple(
        np.nan_to_num(np.abs(misclosures(group, values)) / group.given_sigma, nan=0.0, posinf=1e30) for group in groups
    )


def cost_of_residuals(sizes: Sequence[FloatArray], count: int) -> float:
    """Σ min(s², 2 ln n + 2 ln s) + 2 n ln k of |v|/σ (n, m) by group, ``count`` being n."""
    every = observed(sizes)
    return float(_costs_of_rows(every[None], count, np.inf)[0]) if every.size else 0.0


def _costs_of_rows(sizes: FloatArray, count: int, most: float) -> FloatArray:
    """(p,) :func:`cost_of_residuals` of each row of |v|/σ (p, s), none of which is 0, with k up to ``most``.

    A few that contradict each other would have any k at a place that fits none of them.
    """
    plain = np.sum(costs_of_sizes(sizes, count), axis=1)
    factor = np.clip(np.median(sizes, axis=1) / MEDIAN_OF_NORMAL, 1.0, max(most, 1.0))
    scaled = np.sum(costs_of_sizes(sizes / factor[:, None], count), axis=1)
    return np.asarray(np.minimum(plain, scaled + 2.0 * sizes.shape[1] * np.log(factor)))


def observed(sizes: Sequence[FloatArray]) -> FloatArray:
    """(s,) all |v|/σ of groups that are not 0."""
    return np.concatenate([np.zeros(0), *(size[size > 0.0] for size in sizes)])


def costs_of_sizes(sizes: FloatArray, count: int) -> FloatArray:
    """min(s², 2 ln n + 2 ln s) of each of some |v|/(k σ) out of ``count`` observations."""
    price = 2.0 * np.log(max(count, 2))
    return np.asarray(np.minimum(sizes**2, price + 2.0 * np.log(np.maximum(sizes, 1.0))))


def factor_of_sigmas(sizes: Sequence[FloatArray]) -> float:
    """Robust factor of all σ: the median of |v|/σ (n, m) by group over that of a normal distribution; 1 without any."""
    every = observed(sizes)
    return robust_sigma(every) if every.size else 1.0


def price_of_gross_error(count: int) -> float:
    """|v|/σ beyond which one of ``count`` observations costs less as a gross error: s² = 2 ln n + 2 ln s."""
    price = 2.0 * np.log(max(count, 2))
    s = np.sqrt(price)
    for _ in range(20):
        s = np.sqrt(price + 2.0 * np.log(s))
    return float(s)


def cost_of_choice(count: int, candidates: int, parameters: int, stretch: float) -> float:
    """The rest of L."""
    return parameters * float(np.log(max(count, 2))) + 2.0 * float(np.log(max(candidates, 1))) - 2.0 * stretch


# ---- Points of which some observations do not fit, intersected again: at the place where most of them have it.
#
# An iteration that began with a wrong sight may have left the point where that one and another agree. Of all
# places that as few observations determine as can, two sights, a sight and a distance, three distances, the
# one at which all observations of the point cost least (:func:`cost_of_residuals`) is taken.

SUSPECT = 4.5
"""|v|/σ beyond which an observation is looked at: nothing is decided by it."""
OF_THEMSELVES = ("observed/", "coordinates", "control")
"""Types of observations that tell where a point is without seeing it."""


class Starts(NamedTuple):
    """Start values of points: they decide where observations fit two places alike."""

    places: FloatArray
    """(k, 3) of all points."""
    spread: float
    """Robust σ of a coordinate, told by how far points came from there; 0 where that tells nothing."""

    def costs(self, places: FloatArray, points: IntArray | slice, count: int) -> FloatArray:
        """(k,) what places (k, 3) of these points cost as further observations of ``count``, the whole way one."""
        away = np.nan_to_num(np.linalg.norm(places - self.places[points], axis=-1))
        return costs_of_sizes(away / self.spread, count) if self.spread > 0.0 else np.zeros(len(away))


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
    count, middle = problem.observations, np.nanmedian(values["point"], axis=0)
    most = factor_of_sigmas(sizes)
    moved, columns = values["point"].copy(), problem.index.columns["point"]
    for point in points_in_doubt(problem, sizes, but):
        told = _told_of(problem, point)
        if (columns[point] >= 0).any() and len(_components(told)) > 3:
            places = np.array([moved[point], *_meetings(told, values, [moved[point], middle])])
            costs = _costs(told, values, places, count, most)
            costs[0] -= gain
            if starts is not None:
                costs += starts.costs(places, np.full(len(places), point), count)
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
    ends = ("point", "to", "from")  # of a point that is observed, and no place of a frame
    return [k for k, slot in enumerate(group.type.slots) if slot.kind == "point" and slot.of in ends]


def points_in_doubt(problem: Problem, sizes: tuple[FloatArray, ...], but: Collection[int] = ()) -> list[int]:
    """Points that might be elsewhere, those first at which most is suspect beside what fits.

    At another place nothing fits of what fits here but so much as leaves a choice of places, three components at most:
    two rays meet once, a ray and a distance or three distances twice. So as many components as are suspect, and three,
    are outvoted by what fits, if that is more. So many as are looked at, less the others (``but``).
    """
    bad, good = (np.zeros(len(problem.index.columns["point"]), dtype=np.int64) for _ in range(2))
    for group, size in zip(problem.groups, sizes, strict=True):
        used = group.used
        suspect = (used & (size > SUSPECT)).any(axis=1)
        told = np.count_nonzero(used, axis=1)
        for slot in slots_of_ends(group):
            np.add.at(bad, group.blocks[slot], np.where(suspect, told, 0))
            np.add.at(good, group.blocks[slot], np.where(suspect, 0, told))
    in_doubt = (bad > 0) & (good <= bad + 3)
    in_doubt[list(but)] = False
    points = np.flatnonzero(in_doubt)
    points = points[np.argsort((good - bad)[points], kind="stable")]
    return [int(k) for k in points[: max(200 - len(but), 0)]]


def _told_of(problem: Problem, point: int) -> list[_Observed]:
    found, left = [], 8  # rows of a point that are put together
    for group in problem.groups:
        used = group.used
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


def _costs(told: list[_Observed], values: Values, places: FloatArray, count: int, most: float = np.inf) -> FloatArray:
    """(p,) what the observations of a point cost if it were at places (p, 3); ∞ where they have no value.

    ``most``: factor by which all σ may be too small.
    """
    sizes = np.maximum(np.abs(_residuals(told, values, places)[0]), np.finfo(float).tiny)
    with np.errstate(all="ignore"):
        found = _costs_of_rows(sizes, count, most)
    return np.where(np.isfinite(sizes).all(axis=1) & np.isfinite(found), found, np.inf)


def _intersected(told: list[_Observed], values: Values, begins: FloatArray, few: IntArray) -> FloatArray:
    """Least squares (Gauss–Newton) of components (p, w) each: places (p, 3) from as many beginnings.

    Where an iteration comes to where an observation has no value, the place is where it began.
    """
    places, goes_on = begins.copy(), np.arange(len(begins))
    for _ in range(8):
        residuals, jacobians = _residuals(told, values, places[goes_on])
        sound = np.isfinite(residuals).all(axis=1) & np.isfinite(jacobians).all(axis=(1, 2))
        places[goes_on[~sound]] = begins[goes_on[~sound]]
        goes_on, at = goes_on[sound], np.flatnonzero(sound)[:, None]
        if not len(goes_on):
            break
        none = np.zeros((len(residuals), 1, 4))
        rows, off = np.split(
            np.concatenate([np.dstack([jacobians, residuals]), none], axis=1)[at, few[goes_on]], [3], 2
        )
        # Observations do not tell a direction whose singular value is round-off of the largest.
        places[goes_on] += (rotations.pinv(rows, rcond=4.0 * float(np.finfo(np.float64).eps)) @ off)[:, :, 0]
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
    blocks = [values[s.kind][b[every]] for s, b in group.blocks_by_slot]
    blocks[one.slot] = np.repeat(places, len(one.rows), axis=0)
    return blocks, group.constants[every]


# ---- What keeps a plain adjustment from a solution: suspects found by graduated weights, and the adjustment
# without them.
#
# Least squares finds gross errors only once it has converged, and near the truth. Where it does not converge,
# or where it lands at a place that all observations contradict, graduated weights tell the observations apart
# first; those without weight in the end are suspects. What the rest cannot do without stays in, however bad
# it is.

_WORSE = 3.0
"""Times that half of all residuals are larger than they need be, where a converged solution is no good."""
_SAME = 1e-6
"""Part of vᵀPv by which two minima that are one may differ."""
_ROUNDS = 8
"""Times that what suspects leave undetermined is given up with them."""
BY_WEIGHTS = (
    "the start values lead to no solution, or to one that fits badly; "
    "all observations were adjusted again from a solution with graduated weights"
)
BY_DIRECTIONS = (
    "the start values lead to no solution, or to one that fits badly; "
    "all observations were adjusted again from a solution that uses directions instead of image coordinates"
)
"""Notes on how the start values were repaired."""
_GIVEN_UP = ("point", "rotation")
"""Kinds of blocks that are given up where suspects are most of what tells of them."""


@dataclass(frozen=True)
class SuspectedOutliers:
    """Observations left out so that the rest has a solution that fits."""

    plain: Adjustment
    """The adjustment of all observations, which is none, or an absurd one."""
    masks: tuple[BoolArray, ...]
    """(n, m) of each group."""
    sizes: tuple[FloatArray, ...]
    """(n, m) |v|/σ of all observations against the robust solution."""
    lost: tuple[tuple[str, str], ...]
    """(kind, name) of the blocks of which so little is left that all that refers to them is among the suspects."""

    @property
    def count(self) -> int:
        """Number of suspects."""
        return int(sum(np.count_nonzero(mask) for mask in self.masks))


class Attempt(NamedTuple):
    """An adjustment, and what it took to reach it from the start values."""

    adjustment: Adjustment
    suspects: SuspectedOutliers | None = None
    robust: Values | None = None
    """Values found with graduated weights, if the plain adjustment was not enough."""
    note: str = ""
    """How the start values were repaired, if they were."""

    @property
    def is_complete(self) -> bool:
        """True for a solution of all observations."""
        return self.adjustment.outcome.is_solution and self.suspects is None

    @property
    def stayed_plain(self) -> bool:
        """True for a plain solution that graduated weights led to nothing better than."""
        return self.is_complete and self.robust is not None and not self.note


def may_be_absurd(adjustment: Adjustment) -> bool:
    """True where a converged solution fits so badly that another one might exist.

    Half of its residuals are beyond 3 σ, and they have long tails or are beyond 30 σ. Residuals that are normal with a
    larger σ come from σ that are too small.
    """
    if not _fits_badly(adjustment):
        return False
    overall, problem = _overall(adjustment), adjustment.problem
    # Times that σ may be too small. Of 178 landings far off, 11 had residuals without long tails, from 1 400 σ on.
    if overall > 30.0:
        return True
    # Root mean square of residuals by their robust σ: 1 if normal, 1.7 with 2 % errors of ten σ among them.
    return overall > _WORSE and adjustment.normals.objective > problem.observations * (1.6 * overall) ** 2


def _fits_badly(adjustment: Adjustment) -> bool:
    redundancy = adjustment.redundancy
    return redundancy > 0 and adjustment.normals.objective > redundancy * _WORSE**2


def _sees_beside(adjustment: Adjustment) -> bool:
    """True where a ray fits on another branch of its projection: behind the camera, or where the distortion turns back.

    There the arc from the measured ray to the point is far larger than the residual.
    """
    sphere = problem_on_the_sphere(adjustment.problem, adjustment.values)
    if sphere is None:
        return False
    for group, own in zip(sphere.groups, adjustment.problem.groups, strict=True):
        if is_on_the_sphere(group.type):
            arc = misclosures(group, adjustment.values)
            v = misclosures(own, adjustment.values)
            far = np.linalg.norm(arc, axis=1) > 0.5  # rad
            less = np.linalg.norm(v / own.sigma, axis=1) < 0.1 * np.linalg.norm(arc / group.sigma, axis=1)
            if (far & less).any():
                return True
    return False


def frames_far_off(problem: Problem, values: Values) -> BoolArray:
    """(n,) rotations at which half of the rays are far from their points, if that is so at less than half of them."""
    sphere, count = problem_on_the_sphere(problem, values), len(problem.index.columns[ROTATION.key])
    frames, arcs = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for group in sphere.groups if sphere is not None else ():
        if is_on_the_sphere(group.type):
            arc = np.linalg.norm(misclosures(group, values), axis=1)
            frames.append(frames_of(group)[np.isfinite(arc)])
            arcs.append(arc[np.isfinite(arc)])
    frame = np.concatenate(frames)
    # Arc (rad) between rays and points that no rough pose leaves.
    far = np.asarray(medians_of_parts(frame, np.concatenate(arcs), count) > 0.2)
    return far if 2 * np.count_nonzero(far) < len(np.unique(frame)) else np.zeros_like(far)


def without_suspects(
    plain: Adjustment, settings: SolverSettings | None = None, watch: Watcher | None = None
) -> Attempt:
    """Return the plain adjustment if it is a sensible solution; otherwise repair start values, then leave out suspects.

    All observations are tried again from where graduated weights have led; where that converges and fits, nothing is
    left out. A solution is absurd where another one is known that half of the observations fit three times better. In
    place of none, or of an absurd one, comes the adjustment without the suspects. But a solution of all observations
    stands, however bad, where it is come to from there, too (then it is no matter of where the iteration began), unless
    suspects are few; where most of a group of observations are among them, or all that see a given point (of two
    sources that contradict each other they would only be the smaller one); and where as many chosen ones would lessen
    vᵀPv so by chance. A bad one with a ray on another branch of its projection gives way to any other.

    Weights begin with the medians of parts. Where that finds no solution, or contradicts most of an image or set-up,
    they begin with those of whole groups. Of two solutions the one with fewer suspects is taken.
    """
    if plain.outcome is Outcome.SINGULAR and not plain.iterations:
        return Attempt(plain)
    if plain.outcome is Outcome.CONVERGED and _fits_badly(plain) and _sees_beside(plain):
        other = _repaired(plain._replace(outcome=Outcome.NOT_CONVERGED), settings, watch)
        if other.adjustment.outcome is not Outcome.CONVERGED:
            return Attempt(plain, robust=other.robust)
        suspects = None if other.suspects is None else replace(other.suspects, plain=plain)
        return other._replace(suspects=suspects)
    if plain.outcome in (Outcome.SINGULAR, Outcome.CONVERGED) and not may_be_absurd(plain):
        return Attempt(plain)
    if plain.normals.objective < 0.01 * plain.redundancy:  # residuals are a tenth of their σ: none is a suspect
        return Attempt(plain)
    return _repaired(plain, settings, watch)


def _repaired(plain: Adjustment, settings: SolverSettings | None, watch: Watcher | None) -> Attempt:
    from_far = cache(partial(_from_far, plain, settings, watch))
    found = _by_weights(plain, watch, by_parts=True)
    # From a robust σ of 10⁴ σ on not even half of the observations fit, whatever is left out.
    if plain.outcome is not Outcome.CONVERGED and robust_scales(plain.problem, found.sizes).overall > 1e4:
        return from_far()._replace(robust=found.values)
    first = _attempt(plain, found, settings, watch, from_far)
    if first is None:
        first = Attempt(plain) if plain.outcome is Outcome.CONVERGED else from_far()
    first = first._replace(robust=found.values)
    if not any(is_image_point(group.type) for group in plain.problem.groups):
        return first
    converged = first.adjustment.outcome is Outcome.CONVERGED
    if converged and (first.suspects is None or not _contradicted_frames(plain.problem, first.suspects.masks).any()):
        return first
    other = _by_weights(plain, watch, by_parts=False)
    if all(map(np.array_equal, found.suspects, other.suspects)):
        return first
    second = _attempt(plain, other, settings, watch, from_far)
    if second is None or (converged and _left_out_count(second) >= _left_out_count(first)):
        return first
    return second._replace(robust=other.values)


def _left_out_count(attempt: Attempt) -> int:
    return 0 if attempt.suspects is None else attempt.suspects.count


def _by_weights(plain: Adjustment, watch: Watcher | None, by_parts: bool) -> Graduated:
    """Return the solution with graduated weights; ``by_parts``: most of every part is assumed right."""
    found = graduated_weights(plain.problem, plain.start, watch, by_parts)
    found = _with_frames_put_back(plain.problem, found, plain.start, watch)
    return _with_points_moved(plain.problem, found, plain.start, watch)


def _with_frames_put_back(problem: Problem, found: Graduated, start: Values, watch: Watcher | None) -> Graduated:
    """Return the solution after frames that most of their rows contradict were turned from their start values.

    All else is held meanwhile. The solution stays as it was where this costs no less.
    """
    if ROTATION.key not in problem.index.blocks:
        return found
    turned = _contradicted_frames(problem, found.suspects)
    if not turned.any():
        return found
    blocks = {
        kind: own._replace(free=own.free & turned[:, None] if kind == ROTATION.key else np.zeros_like(own.free))
        for kind, own in problem.index.blocks.items()
    }
    frames = np.where(turned[:, None, None], start[ROTATION.key], found.values[ROTATION.key])
    alone = replace(problem, index=index_unknowns(blocks))
    there = graduated_weights(alone, {**found.values, ROTATION.key: frames}, watch)
    other = settled_weights(problem, there.values, watch)
    costs = [cost_of_residuals(one.sizes, problem.observations) for one in (other, found)]
    return other if costs[0] < costs[1] else found


def _contradicted_frames(problem: Problem, suspects: Sequence[BoolArray]) -> BoolArray:
    """(n,) rotations most of whose rows are suspects."""
    seen, wrong = np.zeros((2, len(problem.index.columns[ROTATION.key])), dtype=np.int64)
    for group, mask in zip(problem.groups, suspects, strict=True):
        for blocks in group.blocks_of(ROTATION.key):
            np.add.at(seen, blocks, group.used.any(axis=1))
            np.add.at(wrong, blocks, mask.any(axis=1))
    return np.asarray(2 * wrong > seen)


def _attempt(
    plain: Adjustment,
    found: Graduated,
    settings: SolverSettings | None,
    watch: Watcher | None,
    from_far: Callable[[], Attempt],
) -> Attempt | None:
    """Return the adjustment of all observations, or of those that fit the weights; ``None`` if neither converges."""
    problem = plain.problem
    scale = robust_scales(problem, found.sizes).overall
    if plain.outcome is not Outcome.CONVERGED and scale > WIDEST:
        return None  # half of the observations are farther off than the widest weights reach
    if plain.outcome is Outcome.CONVERGED and not _overall(plain) > _WORSE * scale:
        return Attempt(plain)
    most = settings if plain.outcome is Outcome.CONVERGED else _from_near(settings)
    of_all = cache(partial(adjust, problem, found.values, most, watch))
    # The first four iterations at most tell whether a solution of all observations may fit.
    if not _overall(adjust(problem, found.values, SolverSettings(2), watch)) > 10.0 * _WORSE * scale:
        again = of_all()
        if _is_minimum(again, plain) and not _overall(again) > _WORSE * scale:
            return Attempt(again, note=BY_WEIGHTS)
    suspects = _enough_left(problem, SuspectedOutliers(plain, found.suspects, found.sizes, ()))
    for _ in range(_ROUNDS):
        remaining = left_out(problem, suspects)
        if 2 * remaining.index.count < problem.index.count:
            break
        if plain.outcome is Outcome.CONVERGED and _outvoted(problem, suspects):
            break
        rest = adjust(remaining, found.values, _from_near(settings), watch)
        if rest.outcome is Outcome.CONVERGED:
            if plain.outcome is Outcome.CONVERGED and not (
                _are_gross(plain, rest) and (_are_few(plain, rest) or not _same_place(plain, of_all()))
            ):
                break
            # True where most suspects are such for what is lost with them: that alone may be what is far off.
            of_lost = tuple(np.zeros_like(mask) for mask in suspects.masks)
            _add_rows(problem, of_lost, set(suspects.lost))
            mostly_lost = 2 * sum(int(np.count_nonzero(mask)) for mask in of_lost) > suspects.count
            recomputed = from_far() if mostly_lost else Attempt(plain)
            return recomputed if recomputed.adjustment is not plain else Attempt(rest, suspects)
        missing = {unknown[:2] for one in rest.defect.undetermined for unknown in one.unknowns[:1]}
        missing = {block for block in missing if block[0] in _GIVEN_UP and block not in suspects.lost}
        if not missing or rest.outcome is Outcome.NOT_CONVERGED:
            break
        suspects = _enough_left(problem, _without(problem, suspects, missing))
    return None


def _with_points_moved(problem: Problem, found: Graduated, start: Values, watch: Watcher | None) -> Graduated:
    """Return the solution with misfitting points intersected again, as long as that lowers the cost of all.

    A few observations of large weight may have drawn a point away from all its rays before weights told them apart.
    Each point is looked at once.
    """
    if "point" not in problem.index.blocks:
        return found
    off = np.abs(found.values["point"] - start["point"])[problem.index.columns["point"] >= 0]
    starts, seen = Starts(start["point"], robust_sigma(off[np.isfinite(off)])), set[int]()
    for _ in range(_ROUNDS):
        moved = reintersected(problem, found.values, found.sizes, starts, but=seen)
        seen.update(points_in_doubt(problem, found.sizes, seen))
        if np.array_equal(moved["point"], found.values["point"], equal_nan=True):
            break
        other = settled_weights(problem, moved, watch)
        if not _cost(problem, other, starts) < _cost(problem, found, starts):
            break
        found = other
    return found


def _cost(problem: Problem, found: Graduated, starts: Starts) -> float:
    count = problem.observations
    ways = starts.costs(found.values["point"], slice(None), count)
    return cost_of_residuals(found.sizes, count) + float(np.sum(ways))


def _from_near(settings: SolverSettings | None) -> SolverSettings:
    """At most 15 iterations from where most observations fit: a solution, if there is one, is not far from there."""
    return SolverSettings(min((settings or SolverSettings()).max_iterations, 15))


def _from_far(plain: Adjustment, settings: SolverSettings | None, watch: Watcher | None) -> Attempt:
    """Adjust all observations with their full weights, starting from a solution by directions instead of coordinates.

    Where nothing is wrong but the start values, weights may lose a point for ever whose few rays were far off at first.
    The plain adjustment where that does not converge to a place that fits either.
    """
    sphere = problem_on_the_sphere(plain.problem, plain.start)
    if sphere is None:
        return Attempt(plain)
    # Iterations by directions: where nothing but start values is wrong, a dozen do, seldom thirty.
    there = adjust(sphere, plain.start, SolverSettings(20, Patience(6, 1e-2, 1e-2)), watch)
    if there.outcome is not Outcome.CONVERGED:
        return Attempt(plain)
    again = adjust(plain.problem, there.values, _from_near(settings), watch)
    fits = _is_minimum(again, plain) and not may_be_absurd(again)
    return Attempt(again, note=BY_DIRECTIONS) if fits else Attempt(plain)


def _is_minimum(again: Adjustment, plain: Adjustment) -> bool:
    """True where all observations converge, and not above a vᵀPv that a plain adjustment reached without converging."""
    if again.outcome is not Outcome.CONVERGED or plain.outcome is Outcome.CONVERGED:
        return again.outcome is Outcome.CONVERGED
    return not again.normals.objective > (1.0 + _SAME) * plain.normals.objective


def _are_few(plain: Adjustment, rest: Adjustment) -> bool:
    """True where 3 degrees of freedom are left for each that suspects take: the rest outvotes them beyond doubt."""
    return rest.redundancy >= 3 * (plain.redundancy - rest.redundancy)


def _same_place(one: Adjustment, other: Adjustment) -> bool:
    objectives = one.normals.objective, other.normals.objective
    return other.outcome is Outcome.CONVERGED and abs(objectives[0] - objectives[1]) <= _SAME * objectives[0]


def _outvoted(problem: Problem, suspects: SuspectedOutliers) -> bool:
    used = [group.used for group in problem.groups]
    return _given_points_contradicted(problem, suspects, used) or any(
        2 * np.count_nonzero(mask) > np.count_nonzero(own) for mask, own in zip(suspects.masks, used, strict=True)
    )


def _given_points_contradicted(problem: Problem, suspects: SuspectedOutliers, used: Sequence[BoolArray]) -> bool:
    """True where a point that is held or observed itself is seen more than once, and every time by a suspect."""
    given: BoolArray = np.asarray(~(problem.index.columns["point"] >= 0).all(axis=1))
    seen, wrong = (np.zeros(len(given), dtype=np.int64) for _ in range(2))
    for group, mask, own in zip(problem.groups, suspects.masks, used, strict=True):
        itself = group.type.key.startswith(OF_THEMSELVES)
        for blocks in group.blocks_of("point"):
            if itself:
                given[blocks[own.any(axis=1)]] = True
            else:
                np.add.at(seen, blocks, own.any(axis=1))
                np.add.at(wrong, blocks, (own & mask).any(axis=1))
    return bool(np.any(given & (wrong == seen) & (seen > 1)))


def _are_gross(plain: Adjustment, rest: Adjustment) -> bool:
    """True where vᵀPv falls more without the suspects than without any other as many, by chance, whatever σ0 is.

    With normal residuals the part of vᵀPv that is left with r' of r degrees of freedom is a Beta(r'/2, (r − r')/2);
    its lower tail is told by its first term, and taken as often as there are choices of so many of all (Bonferroni).
    """
    before, after = plain.redundancy, rest.redundancy
    if after <= 0 or plain.normals.objective <= 0.0:
        return False
    count, gone = plain.problem.observations, max(before - after, 1)
    a, b = 0.5 * after, 0.5 * gone
    part = max(rest.normals.objective / plain.normals.objective, 1e-300)
    choices = gammaln(count + 1) - gammaln(gone + 1) - gammaln(count - gone + 1)
    return bool(a * np.log(part) - np.log(a) - betaln(a, b) + choices < np.log(LEVEL))


def left_out(problem: Problem, suspects: SuspectedOutliers) -> Problem:
    """The problem without the suspects; what was kept out before stays out, and lost blocks are held."""
    masks = [mask | out for mask, out in zip(suspects.masks, problem.left_out, strict=True)]
    return replace(exclude(problem, masks), index=index_unknowns(held(problem.index.blocks, suspects.lost)))


def with_suspects(rest: Problem, suspects: SuspectedOutliers) -> tuple[Problem, tuple[BoolArray, ...]]:
    """The problem of the rest with the suspects in it again, and which they are. Lost blocks stay out."""
    plain = suspects.plain.problem
    gone = tuple(np.zeros(group.observed.shape, dtype=bool) for group in plain.groups)
    _add_rows(plain, gone, set(suspects.lost))
    kept_out = [group.left_out | mask for group, mask in zip(plain.groups, gone, strict=True)]
    masks = tuple(mask & ~out for mask, out in zip(suspects.masks, kept_out, strict=True))
    return exclude(replace(rest, clusters=plain.clusters), kept_out), masks


def held(blocks: Mapping[str, Blocks], lost: Sequence[tuple[str, str]]) -> dict[str, Blocks]:
    """Blocks with the lost ones (kind, name) fixed."""
    result = dict(blocks)
    for kind in {kind for kind, _ in lost}:
        gone = lost_blocks(blocks[kind], kind, lost)
        result[kind] = blocks[kind]._replace(free=blocks[kind].free & ~gone[:, None])
    return result


def lost_blocks(blocks: Blocks, kind: str, lost: Sequence[tuple[str, str]]) -> BoolArray:
    """(n,) which blocks of a kind are lost."""
    names = {name for k, name in lost if k == kind}
    return np.array([name in names for name in blocks.ids], dtype=bool)


def _overall(adjustment: Adjustment) -> float:
    sizes = tuple(map(np.abs, normalised_misclosures(adjustment.plan, adjustment.values)))
    return robust_scales(adjustment.problem, sizes).overall


def _enough_left(problem: Problem, suspects: SuspectedOutliers) -> SuspectedOutliers:
    """The suspects, and with them whatever has fewer observations left than free components."""
    while True:
        short = {
            (kind, problem.index.blocks[kind].ids[block])
            for kind in _GIVEN_UP
            if kind in problem.index.blocks
            for block in _short(problem, suspects.masks, kind)
        }
        short.difference_update(suspects.lost)
        if not short:
            return suspects
        suspects = _without(problem, suspects, short)


def _short(problem: Problem, masks: Sequence[BoolArray], kind: str) -> list[int]:
    columns = problem.index.columns[kind]
    needed = np.count_nonzero(columns >= 0, axis=1)
    before, left = (np.zeros(len(columns), dtype=np.int64) for _ in range(2))
    for group, mask in zip(problem.groups, masks, strict=True):
        had = group.used
        counts = np.count_nonzero(had, axis=1), np.count_nonzero(had & ~mask, axis=1)
        for blocks in group.blocks_of(kind):
            np.add.at(before, blocks, counts[0])
            np.add.at(left, blocks, counts[1])
    return [int(block) for block in np.flatnonzero((left < needed) & (before > left))]


def _without(problem: Problem, suspects: SuspectedOutliers, blocks: set[tuple[str, str]]) -> SuspectedOutliers:
    masks = tuple(mask.copy() for mask in suspects.masks)
    _add_rows(problem, masks, blocks)
    return replace(suspects, masks=masks, lost=(*suspects.lost, *sorted(blocks)))


def _add_rows(problem: Problem, masks: tuple[BoolArray, ...], blocks: set[tuple[str, str]]) -> None:
    """Add all observations that refer to these blocks (kind, name) to the masks, in place."""
    for kind in {kind for kind, _ in blocks}:
        gone = lost_blocks(problem.index.blocks[kind], kind, sorted(blocks))
        for group, mask in zip(problem.groups, masks, strict=True):
            for numbers in group.blocks_of(kind):
                mask |= gone[numbers][:, None] & group.used
