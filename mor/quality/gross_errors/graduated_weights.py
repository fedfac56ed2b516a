"""Redescending weights of shrinking width: an adjustment that gross errors do not lead astray before it has converged.

Graduated non-convexity (A. Blake, A. Zisserman 1987; H. Yang et al. 2020) with the weights of S. Geman, D. McClure,

    f = (c² / (c² + s²))²,    s = |v|/σ,

of a width c that is some multiple of the median of s in the group, so that most of the group always counts in full: at
the start values, where every residual is large, hardly anything is made lighter; as the good observations come to fit,
the median falls, c with it, and what does not come along loses its weight. The multiple shrinks from very wide to the
usual three σ. Each iteration is one damped step of the weighted system: it makes the robust objective smaller
(majorisation). The two coordinates of a ray are one pointing and share their weight.

Images begin with directions in place of coordinates, which come to their places from farther away
(:mod:`mor.observations.on_the_sphere`), and at three σ: the median alone is wide enough there, and with more the wrong
rays bend a block that hangs on a few control points before they lose their weight. Groups of few observations, which
have no median of their own, begin wide all the same: a few scale bars must not be outvoted by rays that know no scale.
Nor must the rays of one image, or those to control points: while directions lead, they are judged by their own median
where that is larger (:mod:`mor.quality.gross_errors.parts`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.inverse import damped_step
from mor.adjustment.normals import objective
from mor.adjustment.plan import Plan, make_plan
from mor.adjustment.problem import Problem
from mor.adjustment.rays.eliminable import eliminable_rays
from mor.adjustment.reweighting import Factors, normalised_misclosures, reweighted_plan
from mor.adjustment.state import Iteration, Watcher, counting_on
from mor.arrays import LARGEST, BoolArray, FloatArray
from mor.observations import ObservationGroup, is_image_point
from mor.parameters.index import Values, move
from mor.quality.gross_errors.on_the_sphere import problem_on_the_sphere
from mor.quality.gross_errors.parts import Parts, parts_of, whole
from mor.sparse.cholesky import NotFiniteError

WIDEST, NARROWEST = 20.0, 3.0
"""Width in units of the robust σ of a group, first and last."""
_SHRINKS = 0.8
_MEDIAN = 0.6745
"""Median of |x| of a standard normal x."""
_FEW = 10
"""Observations of a group below which its own median says nothing of it."""
_ITERATIONS = 60
_FIRST_DAMPING, _LEAST_DAMPED, _MOST_DAMPED = 1e-3, 1e-7, 1e8
_SMALLEST = 1e-10
"""Factor on a weight below which nothing is made lighter: the system must stay regular."""
_SETTLED, _NEARLY_SETTLED = 1e-3, 1e-2
"""Root mean square change of the factors after which they have settled, and of directions, which only lead there."""
REJECTED = 3.29
"""Residual in units of the robust σ beyond which an observation is a suspect: level 0.001."""


class Graduated(NamedTuple):
    """Where graduated weights lead."""

    values: Values
    suspects: tuple[BoolArray, ...]
    """(n, m) of each group: what has no weight in the end."""
    sizes: tuple[FloatArray, ...]
    """(n, m) |v|/σ of each group."""
    iterations: int


class Scales(NamedTuple):
    """Robust σ in units of that given a priori, 1 at least, from medians."""

    groups: FloatArray
    """(g,) of each group; small groups have that of all observations together."""
    overall: float


def graduated_weights(
    problem: Problem, start: Values, watch: Watcher | None = None, by_parts: bool = True
) -> Graduated:
    """Adjust with graduated redescending weights from the start values, images by directions before by coordinates.

    ``by_parts``: judge directions by the median of their part as well, which most of it must bear.
    """
    sphere = problem_on_the_sphere(problem, start)
    if sphere is None:
        return _narrowed(problem, start, WIDEST, _SETTLED, watch)
    first = _narrowed(
        sphere, start, NARROWEST, _NEARLY_SETTLED, watch, parts_of(sphere) if by_parts else None
    )
    last = settled_weights(problem, first.values, counting_on(watch, first.iterations))
    return last._replace(iterations=first.iterations + last.iterations)


def settled_weights(problem: Problem, values: Values, watch: Watcher | None = None) -> Graduated:
    """Go on with weights of the narrowest width from where most observations fit."""
    return _narrowed(problem, values, NARROWEST, _SETTLED, watch)


def _narrowed(
    problem: Problem,
    start: Values,
    widest: float,
    settled: float,
    watch: Watcher | None,
    parts: tuple[Parts, ...] | None = None,
) -> Graduated:
    """Where weights of shrinking width lead, from the widest to the narrowest until they have settled."""
    parts = whole(problem) if parts is None else parts
    plan = make_plan(problem, eliminable_rays(problem, start))
    place = _Place(start, _sizes(plan, start), _FIRST_DAMPING)
    scales = _scales(problem, place.sizes, parts)
    multiples = np.where(_few(problem), WIDEST, widest)
    factors = _factors(problem, place.sizes, multiples, scales)
    for number in range(1, _ITERATIONS + 1):
        place = _descend(reweighted_plan(plan, factors), place, factors)
        multiples = np.maximum(multiples * _SHRINKS, NARROWEST)
        now = _scales(problem, place.sizes, parts)
        scales = tuple(np.minimum(earlier, own) for earlier, own in zip(scales, now, strict=True))
        before, factors = factors, _factors(problem, place.sizes, multiples, scales)
        if watch is not None:
            watch(_iteration(problem, number, place, before))
        if (multiples == NARROWEST).all() and _change(factors, before) < settled:
            break
    suspects = tuple(
        group.mask & ~group.left_out & (_joint(group, size) > REJECTED * scale)
        for group, size, scale in zip(problem.groups, place.sizes, scales, strict=True)
    )
    return Graduated(place.values, suspects, place.sizes, number)


def _few(problem: Problem) -> BoolArray:
    """(g,) groups of so few observations that their median says nothing of them."""
    counts = [np.count_nonzero(group.mask & ~group.left_out) for group in problem.groups]
    return np.asarray(np.array(counts, dtype=np.int64) < _FEW)


class _Place(NamedTuple):
    """Where the iteration is: values, |v|/σ there, and the damping with which it goes on."""

    values: Values
    sizes: tuple[FloatArray, ...]
    damping: float
    change: float = 0.0
    """The last step in units of σ."""


def _iteration(problem: Problem, number: int, place: _Place, factors: Factors) -> Iteration:
    """The iteration as those who watch see it: with the weighted sum of squares and what weights are left."""
    weighted = sum(float(np.sum(f * s**2)) for f, s in zip(factors, place.sizes, strict=True))
    active = sum(float(np.sum(f * (s > 0.0))) for f, s in zip(factors, place.sizes, strict=True))
    return Iteration(number, weighted, place.change, place.damping, max(int(active) - problem.index.count, 0))


def _sizes(plan: Plan, values: Values) -> tuple[FloatArray, ...]:
    return tuple(np.abs(found) for found in normalised_misclosures(plan, values))


def _joint(group: ObservationGroup, size: FloatArray) -> FloatArray:
    """(n, m) sizes by which observations are judged: of the two coordinates of a ray the root mean square times √2."""
    if not is_image_point(group.type):
        return size
    together = np.sqrt(np.sum(size**2, axis=1, keepdims=True))
    return np.broadcast_to(together / np.sqrt(1.4), size.shape)


def robust_scales(problem: Problem, sizes: tuple[FloatArray, ...]) -> Scales:
    """Robust σ of every group and of all observations, from |v|/σ (n, m) of each group."""
    used = [size[group.mask & ~group.left_out] for group, size in zip(problem.groups, sizes, strict=True)]
    every = np.concatenate([np.zeros(0), *used])
    overall = float(np.median(every)) if every.size else 0.0
    medians = [float(np.median(size)) if size.size >= _FEW else overall for size in used]
    return Scales(np.maximum(np.array(medians) / _MEDIAN, 1.0), max(overall / _MEDIAN, 1.0))


def _scales(
    problem: Problem, sizes: tuple[FloatArray, ...], parts: tuple[Parts, ...]
) -> tuple[FloatArray, ...]:
    """(n, 1) of each group: its robust σ, or that of the part of a row where it is larger."""
    groups = robust_scales(problem, sizes).groups
    return tuple(
        np.maximum(own.sigmas(size), scale) for own, size, scale in zip(parts, sizes, groups, strict=True)
    )


def _factors(
    problem: Problem, sizes: tuple[FloatArray, ...], multiples: FloatArray, scales: tuple[FloatArray, ...]
) -> tuple[FloatArray, ...]:
    widths = [multiple * scale for multiple, scale in zip(multiples, scales, strict=True)]
    return tuple(
        np.maximum((width**2 / (width**2 + _joint(group, size) ** 2)) ** 2, _SMALLEST)
        for group, size, width in zip(problem.groups, sizes, widths, strict=True)
    )


def _change(factors: Factors, before: Factors) -> float:
    """Root mean square change of the factors."""
    squares = sum(float(np.sum((a - b) ** 2)) for a, b in zip(factors, before, strict=True))
    return float(np.sqrt(squares / max(sum(a.size for a in factors), 1)))


def _descend(weighted: Plan, place: _Place, factors: Factors) -> _Place:
    """One step that makes the weighted sum of squares smaller, damped as the gain ratio asks for (H. B. Nielsen)."""
    damping, raise_by = place.damping, 2.0
    while damping < _MOST_DAMPED:
        try:
            tried = damped_step(weighted, place.values, damping)
        except NotFiniteError:
            break  # derivatives beyond all size: no step leads on from there
        moved = move(weighted.problem.index, place.values, tried.step)
        within = all(float(np.abs(values).max(initial=0.0)) <= LARGEST for values in moved.values())
        gain = (tried.objective - objective(weighted, moved)) / max(tried.gain, 1e-300) if within else -np.inf
        if gain > 0.0:
            easier = max(1.0 / 3.0, 1.0 - (2.0 * min(gain, 1.0) - 1.0) ** 3)
            sizes, change = _sizes_of_all(weighted, moved, factors), float(np.sqrt(max(tried.gain, 0.0)))
            return _Place(moved, sizes, max(damping * easier, _LEAST_DAMPED), change)
        damping, raise_by = damping * raise_by, raise_by * 2.0
    return place._replace(damping=_FIRST_DAMPING)


def _sizes_of_all(weighted: Plan, values: Values, factors: Factors) -> tuple[FloatArray, ...]:
    """Sizes under the weights the observations came with."""
    found = normalised_misclosures(weighted, values)
    return tuple(np.abs(v) / np.sqrt(f) for v, f in zip(found, factors, strict=True))
