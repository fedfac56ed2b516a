"""Simulated observations and Monte Carlo."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, fdtri, ndtri

from mor.errors import InputError, Message, nearest
from mor.model import rotations
from mor.model.cameras import CAMERA_MODELS
from mor.model.contract import ObservationGroup
from mor.model.coordinates import OBSERVED_PARAMETERS
from mor.model.images import FOLLOWER_TYPES, IMAGE_TYPES, MOVING_TYPES, is_read_out_along, shutter_on_trajectory
from mor.model.parameters import ATTITUDE_SHIFT, POSITION_SHIFT, Values, move, moves_by_angles
from mor.model.rotations import angles_from_rotation
from mor.model.trajectory import CUBIC, LINEAR, STEADINESS, on_trajectory
from mor.project.network import Network
from mor.project.planned_network import is_scanned, read_out_at, rescanned, with_image_poses
from mor.quality.assessment import Quality
from mor.quality.test_statistics import CONTROLLED, global_test
from mor.solve.iterate import Adjustment
from mor.solve.problem import Problem, linearise, misclosures, rotation_tangents
from mor.types import BoolArray, FloatArray, IntArray

# ---- What would be measured at a known place of everything: values without errors, and errors as the σ say.
#
# Observations y = f(x) + e, with e normally distributed, of the covariance matrix that the project gives: σ
# with all that its models add at this place (parts per million, centring), correlations where there are some.
# Prior knowledge (control coordinates, interior orientations from a laboratory) is observed as well and gets
# its error like any other observation.

_CORRECTED = [
    types[key]
    for types in (IMAGE_TYPES, FOLLOWER_TYPES)
    for key, model in CAMERA_MODELS.items()
    if model.corrects_measured and key in types
]
_CORRECTING = {
    kind.key
    for kind in (
        *_CORRECTED,
        *(on_trajectory(kind, knots) for kind in _CORRECTED for knots in (LINEAR, CUBIC)),
        *MOVING_TYPES.values(),
        *(shutter_on_trajectory(key, knots) for key in CAMERA_MODELS for knots in (LINEAR, CUBIC)),
    )
}
"""Image coordinates whose distortion, or time, is taken at the measured coordinates."""


def computed_values(group: ObservationGroup, place: Values) -> FloatArray:
    """(n, m) what would be observed without errors; NaN where nothing is."""
    return group.observed - misclosures(group, place)


def errors(problem: Problem, generator: np.random.Generator) -> tuple[FloatArray, ...]:
    """Random errors (n, m) of each group, drawn from the covariances of the problem; 0 where nothing is observed.

    As many numbers are drawn as there are entries, whatever is observed: a seed gives the same errors to the same rows.
    """
    drawn = [generator.standard_normal(group.observed.shape) for group in problem.groups]
    found = [
        np.where(group.mask, unit * np.where(group.mask, group.given_sigma, 0.0), 0.0)
        for group, unit in zip(problem.groups, drawn, strict=True)
    ]
    flat, unit = np.concatenate([e.ravel() for e in found]), np.concatenate([u.ravel() for u in drawn])
    for cluster in problem.clusters:
        flat[cluster.entries] = rotations.cholesky(cluster.covariance) @ unit[cluster.entries]
    return tuple(
        flat[first : first + group.observed.size].reshape(group.observed.shape)
        for first, group in zip(problem.offsets, problem.groups, strict=False)
    )


def with_observed(problem: Problem, observed: Sequence[FloatArray]) -> Problem:
    """The problem with other observed values (n, m) of each group."""
    pairs = zip(problem.groups, observed, strict=True)
    return replace(problem, groups=tuple(replace(group, observed=values) for group, values in pairs))


def measured_at(network: Network, place: Values) -> Network:
    """The network at a place where all of its observations, prior knowledge too, are free of errors.

    Images on trajectories have the poses of their times. Raises :class:`InputError` for points that do not come before
    the line of a scanner.
    """
    place = with_image_poses(network, place)
    groups, checks, candidates = (
        tuple(_measured(_at_its_time(network, group, place), place) for group in some)
        for some in (network.groups, network.checks, network.candidates)
    )
    observed = {
        kind: np.where(np.isfinite(network.sigma[kind]), _said(place[kind]), network.observed[kind])
        for kind in network.observed
    }
    return replace(
        network,
        start=place,
        observed=observed,
        groups=groups,
        checks=checks,
        candidates=candidates,
        datum=network.datum._replace(given=place["point"]),
    )


def _at_its_time(network: Network, group: ObservationGroup, place: Values) -> ObservationGroup:
    """The group with the time of every row; where a row is scanned or read out depends on where things are."""
    if is_read_out_along(group.type):
        return read_out_at(network, _measured(group, place), place)
    return rescanned(network, group, place) if is_scanned(group) else group


def _measured(group: ObservationGroup, place: Values) -> ObservationGroup:
    """The group with what would be observed; camera models that correct what is measured look at just that."""
    scanned = is_scanned(group)
    if group.type.key not in _CORRECTING and not scanned:
        return replace(group, observed=computed_values(group, place))
    looked_at = 1 if scanned else 2
    observed = np.where(group.mask, 0.0, np.nan)
    for _ in range(60):
        constants = group.constants.copy()
        constants[:, :looked_at] = np.nan_to_num(observed[:, :looked_at])
        group = replace(group, constants=constants)
        before, observed = observed, computed_values(group, place)
        if np.nanmax(np.abs(observed - before), initial=0.0) == 0.0:
            break
    return replace(group, observed=observed)


def _said(values: FloatArray) -> FloatArray:
    """Values (n, size) as they are observed; rotations as ω, φ, κ."""
    return angles_from_rotation(values) if values.ndim == 3 else values


# ---- Errors that are planted on purpose: gross ones, systematic ones, and observations that are lost.


class Systematic(NamedTuple):
    """An error that all observations of some groups share."""

    pattern: str
    """Name of groups, or a pattern of names."""
    amount: float
    """In the units that the group is given in, or in parts per million of the value."""
    is_ppm: bool = False


class Wishes(NamedTuple):
    """Mistakes to plant, besides the random errors."""

    gross: int = 0
    """Number of gross errors, in observations drawn at random."""
    size: float = 20.0
    """Their size, in units of σ; the sign is drawn."""
    dropped: float = 0.0
    """Share of the rows of uncorrelated tables that are lost."""
    systematic: tuple[Systematic, ...] = ()


class Planted(NamedTuple):
    """One planted error, or a lost row (component −1, amount 0)."""

    kind: str
    """``gross``, ``systematic`` or ``dropped``."""
    group: int
    row: int
    component: int
    amount: float
    """Internal units."""


def measured_groups(problem: Problem) -> list[int]:
    """Groups whose values stand in tables of observations."""
    return [k for k, group in enumerate(problem.groups) if len(group.lines)]


def planted(problem: Problem, wishes: Wishes, generator: np.random.Generator) -> list[Planted]:
    """The errors to plant into a problem. Raises :class:`InputError` for more than there are observations."""
    entries = [
        (k, int(row), int(component))
        for k in measured_groups(problem)
        for row, component in np.argwhere(problem.groups[k].mask)
    ]
    if wishes.gross > len(entries):
        words = f"found {wishes.gross} gross errors, expected no more than the {len(entries)} observations"
        raise InputError([Message(words, "--gross")])
    lost = _lost(problem, wishes.dropped, generator)
    found: list[Planted] = []
    for number in generator.permutation(len(entries)).tolist():
        k, row, component = entries[number]
        if len(found) == wishes.gross:
            break
        if k in lost and lost[k][row]:
            continue
        sign = 1.0 if generator.random() < 0.5 else -1.0
        amount = sign * wishes.size * float(problem.groups[k].sigma[row, component])
        found.append(Planted("gross", k, row, component, amount))
    found += [Planted("dropped", k, int(row), -1, 0.0) for k, rows in lost.items() for row in np.flatnonzero(rows)]
    return found


def _lost(problem: Problem, share: float, generator: np.random.Generator) -> dict[int, BoolArray]:
    correlated = np.zeros(int(problem.offsets[-1]), dtype=bool)
    for cluster in problem.clusters:
        correlated[cluster.entries] = True
    lost = {}
    for k in measured_groups(problem):
        group, first = problem.groups[k], problem.offsets[k]
        if correlated[first : first + group.observed.size].any():
            continue
        lost[k] = generator.random(group.count) < share
    return lost if share > 0.0 else {}


def systematic_errors(problem: Problem, wishes: Wishes) -> dict[int, list[tuple[int, float, bool]]]:
    """By group: component, amount in internal units or ppm, whether ppm. Raises :class:`InputError`."""
    names = [problem.groups[k].name for k in measured_groups(problem)]
    found: dict[int, list[tuple[int, float, bool]]] = {}
    problems = []
    for wish in wishes.systematic:
        pattern, _, component = wish.pattern.partition(":")
        here = [k for k in measured_groups(problem) if fnmatchcase(problem.groups[k].name, pattern)]
        if not here:
            words = f"there is no group of observations {pattern!r}{nearest(pattern, names)}"
            problems.append(Message(words, "--ppm" if wish.is_ppm else "--offset"))
        for k in here:
            group = problem.groups[k]
            known = [one.name for one in group.type.components]
            if component and component not in known:
                problems.append(Message(f"{group.name} has no component {component!r} (known: {', '.join(known)})"))
                continue
            for c in [known.index(component)] if component else range(len(known)):
                unit = group.external.factors[c] if group.external is not None else 1.0
                found.setdefault(k, []).append((c, wish.amount * (1.0 if wish.is_ppm else unit), wish.is_ppm))
    if problems:
        raise InputError(problems)
    return found


def with_planted(
    problem: Problem, observed: Sequence[FloatArray], errors: Sequence[Planted], wishes: Wishes
) -> tuple[FloatArray, ...]:
    """Observed values (n, m) of each group with the planted errors in them; lost rows are NaN."""
    changed = [values.copy() for values in observed]
    for k, shared in systematic_errors(problem, wishes).items():
        for component, amount, is_ppm in shared:
            values = changed[k][:, component]
            changed[k][:, component] = values * (1.0 + 1e-6 * amount) if is_ppm else values + amount
    for one in errors:
        if one.kind == "dropped":
            changed[one.group][one.row] = np.nan
        else:
            changed[one.group][one.row, one.component] += one.amount
    return tuple(changed)


# ---- Observations whose values stand in no table: planes, levels of instruments, image-variant interiors.
#
# They are observed as zero. In a simulation that is to be read again as a project the error hence cannot be
# in the observation: the truth has it. Points lie beside their plane, an instrument is tilted, an image
# differs from its camera, each by a random amount of the σ given. The place is changed by the smallest steps
# that do this,
#
#     A dx = l − e − f(x),  |dx| least.
#
# Shift and drift that an instrument has separately on every strip are observed once for all of them: they go the
# same way, with what was observed as l, which is 0 otherwise. Constancy and smoothness of trajectories say
# how a flight usually is, and not where it goes: the path stays as it is planned.

_OF_STRIPS = {OBSERVED_PARAMETERS[kind.key].key for kind in (POSITION_SHIFT, ATTITUDE_SHIFT)}


def is_implied(group: ObservationGroup) -> bool:
    """True for groups of whose observed values a project has none for each row."""
    written = {kind.key for kind in OBSERVED_PARAMETERS.values()} - _OF_STRIPS
    return not len(group.lines) and group.type.key not in written


def conditions(problem: Problem) -> list[int]:
    """Groups that say where things are: points on planes, levels, interiors of images."""
    return [k for k in unwritten(problem) if problem.groups[k].type.key not in _OF_STRIPS]


def unwritten(problem: Problem) -> list[int]:
    """Groups whose errors have to be in the place."""
    steady = {kind.key for kind in STEADINESS.values()}
    return [k for k, group in enumerate(problem.groups) if is_implied(group) and group.type.key not in steady]


def place_with_errors(problem: Problem, place: Values, errors: Sequence[FloatArray], chosen: Sequence[int]) -> Values:
    """The place at which the ``chosen`` groups have the ``errors`` (n, m), and observed is what was observed."""
    if not chosen:
        return place
    for _ in range(20):
        jacobians, misclosures, sizes = [], [], []
        tangent = rotation_tangents(problem.index, place)
        for k in chosen:
            group = problem.groups[k]
            part = linearise(group, problem.index, place, tangent, slice(None))
            mask = group.mask
            rows = np.zeros((int(np.count_nonzero(mask)), problem.index.count + 1))
            row = np.broadcast_to(np.arange(len(mask))[:, None], mask.shape)[mask]
            np.add.at(rows, (np.arange(len(row))[:, None], part.columns[row]), part.jacobian[mask])
            computed = group.observed - part.misclosure
            jacobians.append(rows[:, :-1])
            misclosures.append((group.observed - errors[k] - computed)[mask])
            sizes.append(group.sigma[mask])
        wanted, sigma = np.concatenate(misclosures), np.concatenate(sizes)
        # Parts of σ that may be left of an error.
        if np.abs(wanted / sigma).max() < 1e-6:
            break
        A = np.concatenate(jacobians)
        used = np.asarray((A != 0.0).any(axis=0))
        step = np.zeros(problem.index.count)
        step[used] = rotations.lstsq(A[:, used] / sigma[:, None], wanted / sigma, rcond=1e-12)
        place = move(problem.index, place, step)
    return place


# ---- What many simulated measurements say of the statistics of one adjustment: bias, coverage, levels, power.
#
# The adjustment at the true place has cofactors Q, redundancy numbers r and critical values. Each run draws
# errors, adjusts, and compares with the truth: the solution with Q, the residuals with their tests. In a
# second adjustment of each run an observation drawn at random has an error of the size ∇ that its test finds
# with the power β0. What is counted here is added up run by run; sums of chunks of runs, added in their
# order, do not depend on who worked them out.

CONFIDENCE = 0.95
"""Of the regions whose coverage is counted."""

Solve = Callable[[Problem], Adjustment | None]
"""Adjusts a problem; nothing where no start values are found."""


@dataclass(frozen=True)
class Truth:
    """The adjustment at the true place, and what its statistics promise."""

    problem: Problem
    """With observations that are free of errors."""
    place: Values
    quality: Quality

    @cached_property
    def sigma(self) -> FloatArray:
        """(u,) σ of the unknowns for σ0 = 1; 0 where the datum holds one."""
        index = self.problem.index
        variance = np.zeros(index.count)
        for kind, columns in index.columns.items():
            diagonal = np.diagonal(self.quality.cofactors[kind], axis1=1, axis2=2)
            variance[columns[columns >= 0]] = diagonal[columns >= 0]
        return np.sqrt(np.maximum(variance, 0.0))

    @cached_property
    def points(self) -> IntArray:
        """(p,) point blocks that have something unknown."""
        return np.flatnonzero((self.problem.index.columns["point"] >= 0).any(axis=1))

    @cached_property
    def regions(self) -> tuple[FloatArray, IntArray]:
        """(p, 3, 3) pseudo-inverses of the cofactors of the points, and (p,) their ranks."""
        q = np.nan_to_num(self.quality.cofactors["point"][self.points])
        if not len(q):
            return np.zeros((0, 3, 3)), np.zeros(0, dtype=np.int64)
        values, vectors = rotations.eigh(q)
        kept = values > 1e-10 * np.maximum(values[:, -1:], 1e-300)
        inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
        return np.einsum("pij,pj,pkj->pik", vectors, inverse, vectors), kept.sum(axis=1)

    @cached_property
    def testable(self) -> tuple[BoolArray, ...]:
        """(n, m) by group: observations that have a test."""
        found = []
        for group, one in zip(self.problem.groups, self.quality.groups, strict=True):
            with np.errstate(invalid="ignore"):
                controlled = one.q_weighted > CONTROLLED * one.precision
            found.append(np.asarray(controlled & group.used))
        return tuple(found)

    def tests(self, values: Values, problem: Problem) -> FloatArray:
        """(t,) test values w_B of all observations that have a test, with the residuals at these values."""
        weighted = [
            np.nan_to_num(-misclosures(group, values)) / np.nan_to_num(group.sigma, nan=1.0) ** 2
            for group in problem.groups
        ]
        flat = np.concatenate([part.ravel() for part in weighted])
        for cluster in problem.clusters:
            v = np.concatenate([np.nan_to_num(-misclosures(g, values)).ravel() for g in problem.groups])
            flat[cluster.entries] = rotations.solve(cluster.covariance, v[cluster.entries])
        q = np.concatenate([one.q_weighted.ravel() for one in self.quality.groups])
        chosen = np.concatenate([mask.ravel() for mask in self.testable])
        return np.asarray(flat[chosen] / np.sqrt(q[chosen]))

    def corrections(self, values: Values) -> FloatArray:
        """(u,) what a solution differs from the truth."""
        index = self.problem.index
        found = np.zeros(index.count)
        for kind, columns in index.columns.items():
            free = columns >= 0
            found[columns[free]] = self._difference(kind, values[kind])[free]
        return found

    def _difference(self, kind: str, values: FloatArray) -> FloatArray:
        true, blocks = self.place[kind], self.problem.index.blocks[kind]
        if not blocks.kind.is_rotation:
            return values - true
        turn = values @ np.swapaxes(true, 1, 2)
        skew = 0.5 * (np.swapaxes(turn, 1, 2) - turn)
        small = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        angles = angles_from_rotation(values) - angles_from_rotation(true)
        folded = np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi
        return np.where(moves_by_angles(blocks)[:, None], folded, small)


@dataclass(frozen=True)
class Tally:
    """Counts and sums over runs, and single corrections; tallies of more runs are added."""

    runs: FloatArray
    """() number of runs."""
    solved: FloatArray
    """() runs that led to a solution."""
    correction: FloatArray
    """(u,) Σ (x̂ − x)/σ."""
    square: FloatArray
    """(u,) Σ ((x̂ − x)/σ)²."""
    covered: FloatArray
    """(p,) runs in which the confidence region of a point, with σ0 a priori, covers it."""
    covered_after: FloatArray
    """(p,) the same with σ0 a posteriori."""
    coverage: FloatArray
    """(2,) Σ of the share of points that are covered, and of its square."""
    omega: FloatArray
    """() Σ vᵀPv."""
    rejected: FloatArray
    """() runs that the global test rejects."""
    flagged: FloatArray
    """(2,) Σ of the share of observations that are flagged, and of its square."""
    planted: FloatArray
    """() runs with a planted error that led to a solution."""
    found: FloatArray
    """() those of them in which the test of this observation finds it."""
    objective: FloatArray
    """() Σ of w² of all observations that have a test, by their number."""
    drawn: FloatArray
    """(solved, u) (x̂ − x)/σ of every run; without columns if there are more than :data:`MOST_DRAWN` unknowns."""

    def __add__(self, other: Tally) -> Tally:
        return added([self, other])

    def arrays(self) -> dict[str, FloatArray]:
        """The sums by name, to be kept."""
        return {one.name: np.asarray(getattr(self, one.name), dtype=float) for one in fields(self)}


def added(tallies: Sequence[Tally]) -> Tally:
    """The tally of the runs of all of them."""
    sums = {one.name: sum(getattr(tally, one.name) for tally in tallies) for one in fields(Tally)[:-1]}
    return Tally(**sums, drawn=np.concatenate([tally.drawn for tally in tallies]))


def tally_of(arrays: Mapping[str, FloatArray]) -> Tally:
    """A tally that was kept."""
    return Tally(*(np.asarray(arrays[one.name], dtype=float) for one in fields(Tally)))


def empty_tally(truth: Truth) -> Tally:
    """The tally of no run."""
    u, p = truth.problem.index.count, len(truth.points)
    # Unknowns up to which the corrections of every run are kept, for coverage intervals.
    zero, two, drawn = np.zeros(()), np.zeros(2), np.zeros((0, u if u <= 2000 else 0))
    return Tally(
        zero, zero, np.zeros(u), np.zeros(u), np.zeros(p), np.zeros(p), two, zero, zero, two, zero, zero, zero, drawn
    )


def one_run(truth: Truth, seed: int, number: int, solve: Solve) -> Tally:
    """The tally of one run; the same for the same seed and number, whatever was run before."""
    generator = np.random.default_rng([seed, number])
    drawn = errors(truth.problem, generator)
    observed = [group.observed + e for group, e in zip(truth.problem.groups, drawn, strict=True)]
    noisy = with_observed(truth.problem, observed)
    tally = empty_tally(truth)
    adjustment = solve(noisy)
    tally = replace(tally, runs=np.ones(()))
    if adjustment is not None and adjustment.outcome.is_solution:
        tally = _counted(truth, tally, adjustment, noisy)
    return _with_power(truth, tally, noisy, observed, generator, solve)


def _counted(truth: Truth, tally: Tally, adjustment: Adjustment, noisy: Problem) -> Tally:
    quality, omega = truth.quality, adjustment.normals.objective
    redundancy = quality.redundancy
    dx = truth.corrections(adjustment.values)
    z = np.where(truth.sigma > 0.0, dx / np.where(truth.sigma > 0.0, truth.sigma, 1.0), 0.0)
    inverse, rank = truth.regions
    d = (adjustment.values["point"] - truth.place["point"])[truth.points]
    size = np.einsum("pi,pij,pj->p", d, inverse, d)
    covered = (size <= chdtri(np.maximum(rank, 1), 1.0 - CONFIDENCE)).astype(float)
    after = np.zeros(len(rank))
    if redundancy > 0:
        limit = rank * fdtri(np.maximum(rank, 1), redundancy, CONFIDENCE)
        after = (size <= limit * omega / redundancy).astype(float)
    w = truth.tests(adjustment.values, noisy)
    share = float((np.abs(w) > quality.critical).mean()) if len(w) else 0.0
    part = float(covered.mean()) if len(covered) else 0.0
    test = global_test(omega, redundancy, quality.levels.overall)
    return replace(
        tally,
        solved=np.ones(()),
        correction=z,
        square=z**2,
        covered=covered,
        covered_after=after,
        coverage=np.array([part, part**2]),
        omega=np.asarray(omega),
        rejected=np.asarray(0.0 if test.accepted else 1.0),
        flagged=np.array([share, share**2]),
        objective=np.asarray(float(np.mean(w**2)) if len(w) else 0.0),
        drawn=z[None, : tally.drawn.shape[1]],
    )


def _with_power(
    truth: Truth, tally: Tally, noisy: Problem, observed: list[FloatArray], generator: np.random.Generator, solve: Solve
) -> Tally:
    """The tally with an error of the size ∇ in one observation, drawn among all that have a test."""
    ends = np.cumsum([np.count_nonzero(mask) for mask in truth.testable])
    count = int(ends[-1])
    if count == 0:
        return tally
    chosen, sign = int(generator.integers(count)), 1.0 if generator.random() < 0.5 else -1.0
    number = int(np.searchsorted(ends, chosen, side="right"))
    mask = truth.testable[number]
    row, component = np.argwhere(mask)[chosen - int(ends[number]) + int(np.count_nonzero(mask))]
    nabla = float(truth.quality.reliability[number].at(np.array([row])).smallest[0, component])
    with_error = [values.copy() if k == number else values for k, values in enumerate(observed)]
    with_error[number][row, component] += sign * nabla
    adjustment = solve(with_observed(noisy, with_error))
    if adjustment is None or not adjustment.outcome.is_solution:
        return tally
    w = truth.tests(adjustment.values, adjustment.problem)[chosen]
    hit = abs(float(w)) > truth.quality.critical
    return replace(tally, planted=np.ones(()), found=np.asarray(1.0 if hit else 0.0))


# ---- What a Monte Carlo simulation finds, against what theory says, with the limits that chance leaves.

LEVEL = 0.001
"""Of each finding: chance alone puts one in a thousand outside its limits."""


class Finding(NamedTuple):
    """One figure: what theory says, what was found, and between which limits chance leaves it."""

    name: str
    expected: float
    found: float
    lower: float
    upper: float

    @property
    def agrees(self) -> bool:
        """True where chance explains the difference."""
        return bool(self.lower <= self.found <= self.upper)


def findings(truth: Truth, tally: Tally) -> list[Finding]:
    """All figures of a simulation; none but the share of solutions where nothing was solved."""
    runs, n = float(tally.runs), float(tally.solved)
    found = [Finding("solutions", 1.0, n / runs, 1.0, 1.0)]
    if n < 2.0:
        return found
    z = -float(ndtri(0.5 * LEVEL))
    quality = truth.quality
    f = quality.redundancy
    if f > 0:
        s = z * float(np.sqrt(2.0 / (f * n)))
        found.append(Finding("variance", 1.0, float(tally.omega) / (f * n), 1.0 - s, 1.0 + s))
        found.append(_share("global", quality.levels.overall, float(tally.rejected), n, z))
        found.append(
            _mean(
                "flagged",
                quality.levels.snooping,
                tally.flagged,
                n,
                z,
                int(sum(np.count_nonzero(mask) for mask in truth.testable)),
            )
        )
    if len(truth.points):
        found.append(_mean("coverage", CONFIDENCE, tally.coverage, n, z, len(truth.points)))
        found += _of_points(tally, n)
        if f > 0:
            after = float(tally.covered_after.mean()) / n
            spread = _spread(tally.coverage, n) * z
            found.append(Finding("coverage after", CONFIDENCE, after, CONFIDENCE - spread, CONFIDENCE + spread))
    found += _of_unknowns(truth, tally, n)
    if float(tally.planted) > 0.0:
        found.append(_share("power", quality.levels.power, float(tally.found), float(tally.planted), z))
    return found


def _share(name: str, p: float, count: float, n: float, z: float) -> Finding:
    half = z * float(np.sqrt(p * (1.0 - p) / n)) + 0.5 / n
    return Finding(name, p, count / n, max(p - half, 0.0), min(p + half, 1.0))


def _mean(name: str, p: float, sums: FloatArray, n: float, z: float, each: int) -> Finding:
    """A share that each run has a value of, of so many cases ``each``.

    Its spread between the runs says how far chance moves their mean; where few runs have seen no case of something
    rare, that is no less than for independent cases.
    """
    cases = n * max(each, 1)
    spread = max(_spread(sums, n), float(np.sqrt(p * (1.0 - p) / cases)))
    half = z * spread + 0.5 / cases
    return Finding(name, p, float(sums[0]) / n, max(p - half, 0.0), min(p + half, 1.0))


def _spread(sums: FloatArray, n: float) -> float:
    variance = max(float(sums[1]) / n - (float(sums[0]) / n) ** 2, 0.0)
    return float(np.sqrt(variance / (n - 1.0)))


def _of_points(tally: Tally, n: float) -> list[Finding]:
    """The points that are covered least and most often, with limits for all points together (Šidák)."""
    level = -np.expm1(np.log1p(-LEVEL) / len(tally.covered))
    half = -float(ndtri(0.5 * level)) * float(np.sqrt(CONFIDENCE * (1.0 - CONFIDENCE) / n)) + 1.0 / n
    limits = max(CONFIDENCE - half, 0.0), min(CONFIDENCE + half, 1.0)
    share = tally.covered / n
    return [
        Finding("coverage least", CONFIDENCE, float(share.min()), *limits),
        Finding("coverage most", CONFIDENCE, float(share.max()), *limits),
    ]


def _of_unknowns(truth: Truth, tally: Tally, n: float) -> list[Finding]:
    """Largest bias of an unknown, in σ of its mean; smallest and largest of the σ found by the σ said."""
    used = truth.sigma > 0.0
    count = int(np.count_nonzero(used))
    if count == 0:
        return []
    level = -np.expm1(np.log1p(-LEVEL) / count)
    bias = np.abs(tally.correction[used]) / np.sqrt(n)
    ratio = np.sqrt(tally.square[used] / n)
    low, high = (float(np.sqrt(chdtri(n, p) / n)) for p in (1.0 - 0.5 * level, 0.5 * level))
    return [
        Finding("bias", 0.0, float(bias.max()), 0.0, -float(ndtri(0.5 * level))),
        Finding("sigma least", 1.0, float(ratio.min()), low, high),
        Finding("sigma most", 1.0, float(ratio.max()), low, high),
    ]


def coverage_intervals(tally: Tally) -> FloatArray | None:
    """(u, 2) probabilistically symmetric 95 % coverage intervals of the unknowns, as (x̂ − x)/σ (JCGM 101:2008, 7.7).

    None if fewer than 40 runs have a solution, or if there are too many unknowns to keep every run.
    """
    count, q = len(tally.drawn), int(CONFIDENCE * len(tally.drawn) + 0.5)
    if count < 40 or not tally.drawn.shape[1]:
        return None
    low = (count - q + 1) // 2
    ordered = np.sort(tally.drawn, axis=0)
    return np.stack([ordered[low - 1], ordered[low + q - 1]], axis=1)


def interval_noise(runs: int) -> float:
    """σ of the end of a coverage interval from so many runs of a normal variable with σ = 1: √(p (1−p)/n) / φ(k)."""
    p = 0.5 * (1.0 - CONFIDENCE)
    density = np.exp(-0.5 * ndtri(p) ** 2) / np.sqrt(2.0 * np.pi)
    return float(np.sqrt(p * (1.0 - p) / runs) / density)
