"""Robust estimation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from mor.linalg.cholesky import NotFiniteError
from mor.model.cameras import CAMERA_MODELS
from mor.model.contract import OUT, ObservationGroup, without
from mor.model.images import MOTION_SLOTS, image_scale, is_image_point, on_the_sphere, stereographic
from mor.model.parameters import Values, index_unknowns, move
from mor.quality.assessment import Quality
from mor.quality.test_statistics import LEVEL, MEDIAN_OF_NORMAL, critical_value, robust_sigma
from mor.solve.inverse import Factors, damped_step, normalised_misclosures, reweighted_plan
from mor.solve.iterate import Adjustment, Iteration, Watcher, adjust, counting_on
from mor.solve.normals import Plan, eliminable_rays, make_plan, objective
from mor.solve.problem import CorrelatedObservations, Problem, misclosures
from mor.start.bundle import ideal_rays
from mor.types import LARGEST, BoolArray, FloatArray, IntArray

# ---- Observations taken out of a problem, and put back: their weights vanish, their residuals stay.


def exclude(problem: Problem, excluded: Sequence[BoolArray]) -> Problem:
    """The problem (with nothing excluded yet) without these entries, one mask (n, m) for each group.

    What was correlated with an excluded entry keeps its own covariances, as if the entry had never been measured.
    """
    groups = tuple(without(group, mask) for group, mask in zip(problem.groups, excluded, strict=True))
    return replace(problem, groups=groups, clusters=_clusters(problem, excluded))


def _clusters(problem: Problem, excluded: Sequence[BoolArray]) -> tuple[CorrelatedObservations, ...]:
    if not problem.clusters:
        return ()
    flat = np.concatenate([mask.ravel() for mask in excluded])
    return tuple(_without(cluster, flat[cluster.entries]) for cluster in problem.clusters)


def _without(cluster: CorrelatedObservations, out: BoolArray) -> CorrelatedObservations:
    if not out.any():
        return cluster
    covariance = np.where(out[:, None] ^ out[None, :], 0.0, cluster.covariance)
    covariance[np.ix_(out, out)] = np.diag(np.diagonal(cluster.covariance)[out] * OUT**2)
    return cluster._replace(covariance=covariance)


def reweighted(problem: Problem, factors: Sequence[FloatArray]) -> Problem:
    """The problem with every σ multiplied by a factor, one array (n, m) for each group; correlations stay."""
    groups = tuple(
        replace(group, sigma=group.sigma * factor) for group, factor in zip(problem.groups, factors, strict=True)
    )
    flat = np.concatenate([factor.ravel() for factor in factors])
    clusters = tuple(
        cluster._replace(covariance=cluster.covariance * np.outer(flat[cluster.entries], flat[cluster.entries]))
        for cluster in problem.clusters
    )
    return replace(problem, groups=groups, clusters=clusters)


# ---- Parts of a network of which some rows alone tell, and the medians of those: what is far off is no gross error.
#
# A ray is judged by how well most of its group fit. But where an image is, and how turned, its own rays alone
# tell; and where the network lies, those to given points. Their part of a group is so small that the group
# comes to fit without them: an image that is off by more than others has lost all its rays before they could
# draw it to its place, and a block that fits itself beside its control points those to these. So rows are
# judged by the median of their part as well, the larger of both.


class Parts(NamedTuple):
    """Parts of one group: the entries that are used, and their division."""

    used: BoolArray
    """(n, m)."""
    divisions: tuple[IntArray, ...]
    """(n,) each: the number of the part that a row alone tells of, −1 where there is none."""

    def sigmas(self, sizes: FloatArray) -> FloatArray:
        """(n, 1) robust σ of the part of every row, the largest of all divisions, from |v|/σ (n, m); 0 without any."""
        largest = np.zeros(len(sizes))
        for part in self.divisions:
            rows, components = np.nonzero(self.used & (part >= 0)[:, None])
            medians = medians_of_parts(part[rows], sizes[rows, components], int(part.max(initial=-1)) + 1)
            largest = np.maximum(largest, np.append(medians, 0.0)[part] / MEDIAN_OF_NORMAL)
        return largest[:, None]


def parts_of(problem: Problem) -> tuple[Parts, ...]:
    """The parts of every group: frames, and where the network lies."""
    given: BoolArray = np.asarray(~(problem.index.columns["point"] >= 0).any(axis=1))
    return tuple(Parts(group.used, (frames_of(group), _tied(group, given))) for group in problem.groups)


def whole(problem: Problem) -> tuple[Parts, ...]:
    """Every group undivided."""
    return tuple(Parts(group.used, ()) for group in problem.groups)


def frames_of(group: ObservationGroup) -> IntArray:
    """Return (n,) the frame of every row; −1 where there is none."""
    frames = group.blocks_of("rotation")
    return np.asarray(frames[0], dtype=np.int64) if frames else np.full(group.count, -1)


def _tied(group: ObservationGroup, given: BoolArray) -> IntArray:
    """(n,) 0 for rows at a point that is given, −1 for others."""
    tied = np.zeros(group.count, dtype=bool)
    for blocks in group.blocks_of("point"):
        tied |= given[blocks]
    return np.where(tied, 0, -1)


def medians_of_parts(part: IntArray, sizes: FloatArray, count: int) -> FloatArray:
    """Return (count,) the median size of the rows (n,) of each part; 0 for parts without rows."""
    order = np.lexsort((sizes, part))
    part, sizes = part[order], sizes[order]
    first = np.searchsorted(part, np.arange(count + 1))
    number, begin = np.diff(first), first[:-1]
    medians = np.zeros(count)
    some = number > 0
    low, high = ((begin + (number - 1) // 2)[some], (begin + number // 2)[some])
    medians[some] = 0.5 * (sizes[low] + sizes[high])
    return medians


# ---- A problem whose image coordinates are directions: it comes from farther away to nearly the same solution.


def problem_on_the_sphere(problem: Problem, values: Values) -> Problem | None:
    """The problem with its image rays as directions; ``None`` where there are no images.

    Interior orientations are held, and how images move while they are read out.

    What one coordinate only was measured of takes no part.
    """
    groups, factors = list(problem.groups), [np.ones(group.sigma.shape) for group in problem.groups]
    for number, group in enumerate(problem.groups):
        if is_image_point(group.type) and on_the_sphere(group.type) is not None:
            groups[number], factors[number] = _directions(group, values)
    if all(one is other for one, other in zip(groups, problem.groups, strict=True)):
        return None
    scaled = reweighted(problem, factors)
    motions = {slot.kind for slot in MOTION_SLOTS}
    blocks = {
        kind: own._replace(free=np.zeros_like(own.free)) if kind.startswith("interior/") or kind in motions else own
        for kind, own in problem.index.blocks.items()
    }
    turned = tuple(replace(group, sigma=own.sigma) for group, own in zip(groups, scaled.groups, strict=True))
    return replace(scaled, groups=turned, index=index_unknowns(blocks))


def _directions(group: ObservationGroup, values: Values) -> tuple[ObservationGroup, FloatArray]:
    """The group as directions, and radians per image unit (n, 2)."""
    model = CAMERA_MODELS[group.type.key.partition("/")[2]]
    interior, of = next(
        (values[slot.kind], numbers) for slot, numbers in group.blocks_by_slot if slot.kind.startswith("interior/")
    )
    whole: BoolArray = np.asarray(group.mask.all(axis=1))
    measured = np.where(whole[:, None], group.observed, 0.0)
    rays = ideal_rays(model, interior, of, group.constants[:, 2:], measured)
    scale = image_scale(model, rays, interior[of], group.constants)
    used: BoolArray = np.asarray(whole & np.isfinite(scale) & (scale > 0.0))
    type_ = on_the_sphere(group.type)
    assert type_ is not None
    constants = np.concatenate([stereographic(rays), rays], axis=1)
    blocks = tuple(numbers for slot, numbers in group.blocks_by_slot if slot in type_.slots)
    observed = np.where(used[:, None], np.zeros(2), np.nan)
    factor = np.repeat(np.where(used, 1.0 / np.where(used, scale, 1.0), 1.0)[:, None], 2, axis=1)
    return replace(group, type=type_, blocks=blocks, observed=observed, constants=constants), factor


# ---- Redescending weights of shrinking width: an adjustment that gross errors do not lead astray before it has
# converged.
#
# Graduated non-convexity (A. Blake, A. Zisserman 1987; H. Yang et al. 2020) with the weights of S. Geman, D. McClure,
#
#     f = (c² / (c² + s²))²,    s = |v|/σ,
#
# of a width c that is some multiple of the median of s in the group, so that most of the group always counts
# in full: at the start values, where every residual is large, hardly anything is made lighter; as the good
# observations come to fit, the median falls, c with it, and what does not come along loses its weight. The
# multiple shrinks from very wide to the usual three σ. Each iteration is one damped step of the weighted
# system: it makes the robust objective smaller (majorisation). The two coordinates of a ray are one pointing
# and share their weight.
#
# Images begin with directions instead of coordinates, which come to their places from farther away
# (:mod:`mor.model.images`), and at three σ: the median alone is wide enough there, and with more the wrong
# rays bend a block that hangs on a few control points before they lose their weight. Groups of few
# observations, which have no median of their own, begin wide all the same: a few scale bars must not be
# outvoted by rays that know no scale. Nor must the rays of one image, or those to control points: while
# directions lead, they are judged by their own median where that is larger
# (:mod:`mor.quality.robust_estimation`).

WIDEST, NARROWEST = 20.0, 3.0
"""Width in units of the robust σ of a group, first and last."""
_FEW = 10
"""Observations of a group below which its own median says nothing of it."""
_FIRST_DAMPING = 1e-3
_SETTLED = 1e-3
"""Root mean square change of the factors after which they have settled."""


class Graduated(NamedTuple):
    """Solution with graduated weights."""

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
    # Directions only lead there: they need not settle as well.
    first = _narrowed(sphere, start, NARROWEST, 10.0 * _SETTLED, watch, parts_of(sphere) if by_parts else None)
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
    """Return the solution with weights of shrinking width, from the widest to the narrowest, until they settle."""
    parts = whole(problem) if parts is None else parts
    plan = make_plan(problem, eliminable_rays(problem, start))
    # What has no image at these values (a point where a camera stands, say) is as far off as can be.
    sizes = tuple(np.fmin(np.abs(found), 1e100) for found in normalised_misclosures(plan, start))
    place = _IterationState(start, sizes, _FIRST_DAMPING)
    scales = _scales(problem, place.sizes, parts)
    multiples = np.where(_few(problem), WIDEST, widest)
    factors = _factors(problem, place.sizes, multiples, scales)
    for number in range(1, 61):
        place = _descend(reweighted_plan(plan, factors), place, factors)
        multiples = np.maximum(multiples * 0.8, NARROWEST)
        now = _scales(problem, place.sizes, parts)
        scales = tuple(np.minimum(earlier, own) for earlier, own in zip(scales, now, strict=True))
        before, factors = factors, _factors(problem, place.sizes, multiples, scales)
        if watch is not None:
            weighted = sum(float(np.sum(f * s**2)) for f, s in zip(before, place.sizes, strict=True))
            active = sum(float(np.sum(f * (s > 0.0))) for f, s in zip(before, place.sizes, strict=True))
            watch(Iteration(number, weighted, place.change, place.damping, max(int(active) - problem.index.count, 0)))
        if (multiples == NARROWEST).all() and _change(factors, before) < settled:
            break
    rejected = critical_value(LEVEL)
    suspects = tuple(
        group.used & (_joint(group, size) > rejected * scale)
        for group, size, scale in zip(problem.groups, place.sizes, scales, strict=True)
    )
    return Graduated(place.values, suspects, place.sizes, number)


def _few(problem: Problem) -> BoolArray:
    """(g,) groups of so few observations that their median says nothing of them."""
    counts = [np.count_nonzero(group.used) for group in problem.groups]
    return np.asarray(np.array(counts, dtype=np.int64) < _FEW)


class _IterationState(NamedTuple):
    """State of the iteration: values, |v|/σ at them, and the damping of the next step."""

    values: Values
    sizes: tuple[FloatArray, ...]
    damping: float
    change: float = 0.0
    """The last step in units of σ."""


def _joint(group: ObservationGroup, size: FloatArray) -> FloatArray:
    """(n, m) sizes by which observations are judged: of the two coordinates of a ray the root mean square times √2."""
    if not is_image_point(group.type):
        return size
    together = np.sqrt(np.sum(size**2, axis=1, keepdims=True))
    return np.broadcast_to(together / np.sqrt(1.4), size.shape)


def robust_scales(problem: Problem, sizes: tuple[FloatArray, ...]) -> Scales:
    """Robust σ of every group and of all observations, from |v|/σ (n, m) of each group."""
    used = [size[group.used] for group, size in zip(problem.groups, sizes, strict=True)]
    every = np.concatenate([np.zeros(0), *used])
    overall = robust_sigma(every)
    own = [robust_sigma(size) if size.size >= _FEW else overall for size in used]
    return Scales(np.maximum(np.array(own), 1.0), max(overall, 1.0))


def _scales(problem: Problem, sizes: tuple[FloatArray, ...], parts: tuple[Parts, ...]) -> tuple[FloatArray, ...]:
    """(n, 1) of each group: its robust σ, or that of the part of a row where it is larger."""
    groups = robust_scales(problem, sizes).groups
    return tuple(np.maximum(own.sigmas(size), scale) for own, size, scale in zip(parts, sizes, groups, strict=True))


def _factors(
    problem: Problem, sizes: tuple[FloatArray, ...], multiples: FloatArray, scales: tuple[FloatArray, ...]
) -> tuple[FloatArray, ...]:
    squares = [_joint(group, size) ** 2 for group, size in zip(problem.groups, sizes, strict=True)]
    widths = [(multiple * scale) ** 2 for multiple, scale in zip(multiples, scales, strict=True)]
    # The least factor keeps the system regular. Residuals that exceed 1 σ even with it get less.
    smallest = 1e-10
    return tuple(
        np.maximum((width / (width + square)) ** 2, smallest / np.maximum(1.0, smallest * square))
        for square, width in zip(squares, widths, strict=True)
    )


def _change(factors: Factors, before: Factors) -> float:
    squares = sum(float(np.sum((a - b) ** 2)) for a, b in zip(factors, before, strict=True))
    return float(np.sqrt(squares / max(sum(a.size for a in factors), 1)))


def _descend(weighted: Plan, place: _IterationState, factors: Factors) -> _IterationState:
    """One step that makes the weighted sum of squares smaller, damped as the gain ratio asks for (H. B. Nielsen)."""
    damping, raise_by = place.damping, 2.0
    while damping < 1e8:
        try:
            tried = damped_step(weighted, place.values, damping)
        except NotFiniteError:
            break  # derivatives beyond all size: no step leads on from there
        moved = move(weighted.problem.index, place.values, tried.step)
        within = all(float(np.abs(values).max(initial=0.0)) <= LARGEST for values in moved.values())
        gain = (tried.objective - objective(weighted, moved)) / max(tried.gain, 1e-300) if within else -np.inf
        if gain > 0.0:
            easier = max(1.0 / 3.0, 1.0 - (2.0 * min(gain, 1.0) - 1.0) ** 3)
            found = normalised_misclosures(weighted, moved)
            sizes, change = (
                tuple(np.abs(v) / np.sqrt(f) for v, f in zip(found, factors, strict=True)),
                float(np.sqrt(max(tried.gain, 0.0))),
            )
            return _IterationState(moved, sizes, max(damping * easier, 1e-7), change)
        damping, raise_by = damping * raise_by, raise_by * 2.0
    return place._replace(damping=_FIRST_DAMPING)


# ---- Robust estimation by iteratively reweighted least squares: for starting, and for comparison with least squares.
#
# The weight of an observation is multiplied by a factor that depends on its residual, s = |v|/(σ √r) with r its
# redundancy number under the weights the observations came with (leverage would hide an error otherwise):
#
#     l1       1/max(s, ½)                        the sum of absolute residuals (smoothed near 0): starts everywhere
#     danish   1 for s ≤ 2, exp(1 − (s/2)²) beyond, after the L1 rounds: what is far off no longer counts
#   (redescending)
#
# T. Krarup, J. Juhl, K. Kubik (1980): Götterdämmerung over least squares adjustment.

Method = Literal["l1", "danish"]


class RobustSolution(NamedTuple):
    """A robust solution."""

    method: Method
    adjustment: Adjustment
    factors: tuple[FloatArray, ...]
    """Factors on the weights of each group (n, m), 1 where not observed."""
    settled: bool

    @property
    def rejected(self) -> tuple[BoolArray, ...]:
        """Observations that hardly count."""
        groups = self.adjustment.problem.groups
        # Factor on a weight below which an observation counts as rejected.
        return tuple((f < 0.1) & group.mask for f, group in zip(self.factors, groups, strict=True))


def robust_estimate(quality: Quality, method: Method) -> RobustSolution:
    """Robust solution that starts from an assessed least-squares one."""
    problem = quality.adjustment.problem
    spread = tuple(np.sqrt(np.maximum(np.nan_to_num(group.r, nan=1.0), 0.01)) for group in quality.groups)
    adjustment = quality.adjustment
    factors = factors_of(problem, adjustment.values, spread, "l1")
    settled = False
    # The sum of absolute residuals comes first in all of them.
    stages: tuple[Method, ...] = ("l1",) if method == "l1" else ("l1", "danish")
    for stage in stages:
        settled = False
        for _ in range(60):
            scaled = reweighted(problem, [1.0 / np.sqrt(f) for f in factors])
            found = adjust(scaled, adjustment.values)
            if not found.outcome.is_solution:
                return RobustSolution(method, adjustment, factors, False)
            adjustment, before = found, factors
            factors = factors_of(problem, adjustment.values, spread, stage)
            pairs = zip(factors, before, strict=True)
            # Largest relative change of a factor at which the weights have settled.
            if max((float(np.abs(np.log(a / b)).max(initial=0.0)) for a, b in pairs), default=0.0) < 0.01:
                settled = True
                break
    return RobustSolution(method, adjustment, factors, settled)


def factors_of(
    problem: Problem, values: Values, spread: tuple[FloatArray, ...], method: Method
) -> tuple[FloatArray, ...]:
    """Factors (n, m) on the weights of each group that its residuals at some values ask for."""
    result = []
    for group, root in zip(problem.groups, spread, strict=True):
        size = np.nan_to_num(np.abs(misclosures(group, values)) / group.sigma) / root
        if method == "l1":
            factor = 1.0 / np.maximum(size, 0.5) * 0.5
        else:
            factor = np.where(size <= 2.0, 1.0, np.exp(np.minimum(1.0 - (size / 2.0) ** 2, 0.0)))
        # Factor on a weight below which nothing is made lighter: the system must stay regular.
        result.append(np.where(group.mask, np.maximum(factor, 1e-8), 1.0))
    return tuple(result)
