"""Deformation analysis: congruence of epochs, movements of points."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, chndtrinc, fdtri, ncfdtrinc

from mor.model import rotations
from mor.model.parameters import COSINE, MOTIONS, SINE, VELOCITY
from mor.model.trajectory import basis
from mor.project.entities import MovingPoint, TimeModel
from mor.project.network import Network
from mor.quality.assessment import Quality, cofactors_of_difference, joint_cofactors
from mor.quality.solution import Solved
from mor.quality.test_statistics import log_p_chi2, log_p_f, sidak
from mor.solve.datum import network_components
from mor.types import BoolArray, FloatArray, IntArray

# ---- Tests of many vectors at once: is a velocity, a step, a movement more than chance?
#
# T = dᵀ Q⁻¹ d/h for a vector d with cofactors Q of rank h, against χ² (σ0 known) or F (σ0 estimated). A
# vector of length ∇ is found with the power β0 where ∇ᵀ Q⁻¹ ∇ reaches the non-centrality λ of that test at
# its level: the smallest one that every direction is found of has the length √(λ q), q the largest eigenvalue
# of Q.

_RANK = 1e-10


class VectorTests(NamedTuple):
    """Tests of n vectors of k components."""

    vectors: FloatArray
    """(n, k)."""
    cofactors: FloatArray
    """(n, k, k) for σ0 = 1."""
    statistic: FloatArray
    """(n,) dᵀ Q⁻¹ d/h for σ0 = 1."""
    freedom: IntArray
    """(n,) h; 0 where nothing has a variance."""
    longest: FloatArray
    """(n,) square root of the largest eigenvalue of Q."""

    def log_p(self, redundancy: int, variance: float | None) -> FloatArray:
        """(n,) natural logarithms of the p-values, with σ0 known, or with the estimated ``variance`` factor."""
        h = self.freedom.astype(float)
        with np.errstate(divide="ignore", invalid="ignore"):
            if variance is None or redundancy <= 0:
                found = log_p_chi2(self.statistic * h, h)
            else:
                found = log_p_f(self.statistic / variance, np.maximum(h, 1.0), redundancy)
        return np.where(self.freedom > 0, found, np.nan)


def _quadratic_forms(d: FloatArray, q: FloatArray) -> tuple[FloatArray, IntArray]:
    """Dᵀ Q⁺ d (n,) of vectors d (n, k) with cofactors q (n, k, k), and the ranks h (n,) of these.

    Directions without any variance are left out.
    """
    size = np.sqrt(np.maximum(np.diagonal(q, axis1=1, axis2=2), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    eigenvalues, axes = rotations.eigh(q / (scale[:, :, None] * scale[:, None, :]))
    used = eigenvalues > _RANK * np.maximum(eigenvalues[:, -1:], 1e-300)
    along = np.einsum("nki,nk->ni", axes, d / scale)
    total = np.sum(np.where(used, along**2 / np.where(used, eigenvalues, 1.0), 0.0), axis=1)
    return total, np.count_nonzero(used, axis=1)


def vector_tests(d: FloatArray, q: FloatArray) -> VectorTests:
    """Tests of vectors d (n, k) with cofactors q (n, k, k)."""
    total, freedom = _quadratic_forms(d, q)
    longest = np.sqrt(np.maximum(rotations.eigvalsh(q)[:, -1], 0.0))
    return VectorTests(d, q, total / np.maximum(freedom, 1), freedom, longest)


def noncentrality_of(freedom: int, level: float, power: float, redundancy: int | None = None) -> float:
    """λ at which the test of h degrees of freedom at a level has this power; σ0 known, or of a ``redundancy``."""
    if redundancy is None:
        return float(chndtrinc(float(chdtri(freedom, level)), freedom, 1.0 - power))
    return float(ncfdtrinc(freedom, redundancy, 1.0 - power, float(fdtri(freedom, redundancy, 1.0 - level))))


# ---- Congruence: have points moved between two epochs?
#
# The movements d of the points that both epochs have, with cofactors Q_d = Q_1 + Q_2, in one datum over those
# points. The hypothesis that nothing moved is tested with T = dᵀ Q_d⁺ d, rank h: T/h against the χ²
# distribution (σ0 known) or, over the pooled variance of both epochs, the F distribution (H. Pelzer, 1971).
# Where it is rejected, the point whose removal from the datum leaves the rest most congruent is taken to have
# moved, and so on until the rest is congruent. A movement with its own 3 × 3 cofactors is then tested for
# every point, in the datum of the stable ones.


class MovementTest(NamedTuple):
    """Test of one movement."""

    movement: FloatArray
    """(3,)."""
    sigma: FloatArray
    """(3,) standard deviations, a posteriori."""
    statistic: float
    """dᵀ Q⁺ d/h for σ0 = 1."""
    ratio: float
    """The same over the estimated variance factor."""
    freedom: int
    log_p: float
    """Natural logarithm of the p-value with σ0 known."""
    log_p_estimated: float
    """With σ0 estimated."""
    cofactors: FloatArray
    """(3, 3) of the movement, for σ0 = 1."""


class Congruence(NamedTuple):
    """Outcome of a congruence test over n points."""

    global_test: MovementTest | None
    """Test of all movements in the datum over all common points."""
    critical: float
    stable: BoolArray
    """(n,) points that carry the datum in the end."""
    points: tuple[MovementTest, ...]
    variance: float
    """Pooled variance factor."""


def movement_test(d: FloatArray, q: FloatArray, variance: float, redundancy: int) -> MovementTest:
    """Test of a movement d (k,) with cofactors q (k, k)."""
    totals, ranks = _quadratic_forms(d[None], q[None])
    freedom = int(ranks[0])
    mean = float(totals[0]) / freedom if freedom else 0.0
    ratio = mean / variance if variance > 0.0 else np.inf
    log_p, log_estimated = float(log_p_chi2(totals, ranks.astype(float))[0]), float(log_p_f(ratio, freedom, redundancy))
    sigma = np.sqrt(variance * np.maximum(np.diagonal(q), 0.0))
    return MovementTest(d, sigma, mean, ratio, freedom, log_p, log_estimated, q)


def pair_movement(quality: Quality, first: int, second: int) -> MovementTest:
    """Movement from one point to another of the same adjustment, in which every epoch has its own points."""
    cofactors = cofactors_of_difference(quality, first, second)
    points = quality.adjustment.values["point"]
    d = np.where(np.diagonal(cofactors) > 0.0, points[second] - points[first], 0.0)
    return movement_test(d, cofactors, quality.sigma0**2, quality.redundancy)


def congruence(
    d: FloatArray,
    q: FloatArray,
    generators: FloatArray,
    variance: float,
    redundancy: int,
    level: float,
    known: bool = False,
) -> Congruence:
    """Congruence test of movements d (n, 3) with cofactors q (3n, 3n).

    ``generators`` (3n, k) are movements of the whole network that neither epoch determines: the datum is free in them.
    ``known``: σ0 = 1 is known; otherwise the pooled ``variance`` is used.
    """
    n = len(d)
    stable = np.ones(n, dtype=bool)
    first: MovementTest | None = None
    while True:
        moved, cofactors = _in_datum(d, q, generators, stable)
        here = np.repeat(stable, 3)
        test = movement_test(moved.ravel()[here], cofactors[np.ix_(here, here)], variance, redundancy)
        critical = _critical(test.freedom, redundancy, level, known)
        first = first or test
        value = test.statistic if known else test.ratio
        enough = test.freedom > 1 and np.count_nonzero(stable) > 1
        if value <= critical or not enough or test.freedom == 0:
            break
        stable[_most_moved(moved, cofactors, stable)] = False
    tests = tuple(
        movement_test(moved[i], cofactors[3 * i : 3 * i + 3, 3 * i : 3 * i + 3], variance, redundancy) for i in range(n)
    )
    overall = _critical(first.freedom, redundancy, level, known)
    return Congruence(first, overall, stable, tests, variance)


def _critical(freedom: int, redundancy: int, level: float, known: bool) -> float:
    if freedom == 0:
        return 0.0
    if known or redundancy <= 0:
        return float(chdtri(freedom, level)) / freedom
    return float(fdtri(freedom, redundancy, 1.0 - level))


def _in_datum(d: FloatArray, q: FloatArray, generators: FloatArray, stable: BoolArray) -> tuple[FloatArray, FloatArray]:
    if generators.shape[1] == 0:
        return d, q
    B = generators * np.repeat(stable, 3)[:, None]
    S = np.eye(len(q)) - generators @ rotations.pinv(B.T @ generators, rcond=1e-12) @ B.T
    return (S @ d.ravel()).reshape(d.shape), S @ q @ S.T


def _most_moved(d: FloatArray, q: FloatArray, stable: BoolArray) -> int:
    """The stable point without which the others are most congruent.

    Without point B, T falls by T_B = (P d)_Bᵀ (P_BB)⁺ (P d)_B, P the inverse of the cofactors (Pelzer's decomposition).
    """
    where = np.flatnonzero(stable)
    here = np.repeat(stable, 3)
    P = rotations.pinv(q[np.ix_(here, here)], rcond=_RANK, hermitian=True)
    pulled = P @ d.ravel()[here]
    parts = []
    for k in range(len(where)):
        own = slice(3 * k, 3 * k + 3)
        parts.append(float(pulled[own] @ rotations.pinv(P[own, own], rcond=1e-9, hermitian=True) @ pulled[own]))
    return int(where[int(np.argmax(parts))])


# ---- Fixed coordinates given free again: what the S-transformation out of a datum of fixed points starts from.


def released(solved: Solved) -> Network:
    """The network with every fixed coordinate free that an observation looks at; the same one where there is none.

    Coordinates that are none of the dimensions of the network stay.
    """
    network = solved.network
    _, fixed = network_components(solved.adjustment.problem, solved.adjustment.values)
    fixed &= np.array([axis in network.project.settings.dimensions for axis in "xyz"])
    if not fixed.any():
        return network
    points = network.blocks["point"]
    free: BoolArray = points.free | fixed
    return replace(network, blocks={**network.blocks, "point": points._replace(free=free)})


def strained(before: Solved, after: Solved) -> bool:
    """True where the fixed coordinates forced the observations, so that releasing them changes the residuals."""
    one, other = (solved.adjustment.normals.objective for solved in (before, after))
    return one - other > 1e-6 * max(one, 1.0)


# ---- Movements of the points of one adjustment: what moves them, and by how much from one epoch to another.
#
# The position of a point at the time t is linear in its blocks, p(t) = X_i + Σ b_k(t) m_k, and so is the
# movement between two epochs, d = p(t2) − p(t1), with cofactors C Q Cᵀ. Parameters (velocity, oscillation,
# step) are tested against zero. All of these tests together reject by mistake with the level of the tests of
# groups; each has its share (Šidák; for small levels that of Bonferroni).

_ROOM = 6
"""Components of the longest vector: an annual oscillation."""
_KINDS = tuple(kind.key for kind in MOTIONS)


class TestedVectors(NamedTuple):
    """Vectors of points with their tests: n parameters, or n movements between two epochs."""

    names: tuple[str, ...]
    what: tuple[str, ...]
    """velocity, annual oscillation, step; or nothing for a movement between epochs."""
    begin: tuple[str, ...]
    """Epoch before."""
    end: tuple[str, ...]
    tests: VectorTests
    log_p: FloatArray
    """(n,) by the σ0 that the project reports with."""
    significant: FloatArray
    """(n,) true where the vector is more than chance at the level of each."""
    smallest: FloatArray
    """(n,) ∇: from this length on the vector is found in every direction with the power β0; for σ0 = 1."""


class MovementTests(NamedTuple):
    """Points that may move, and their movements."""

    parameters: TestedVectors
    between: TestedVectors
    """From the first epoch of every point to each later one."""
    level: float
    """Level of each single test of a parameter."""
    level_between: float
    """Level of each single test of a movement."""
    unlisted: int
    """Points with coordinates of their own in so many epochs that their movements are not worked out unasked."""


def movements(solved: Solved) -> MovementTests | None:
    """Movements of all points that move; ``None`` where nothing does, or there is no solution."""
    quality, motion = solved.quality, solved.network.motion
    points = [p for p in motion.points.values() if not _absent(solved, p)]
    if quality is None or not points:
        return None
    found = _Positions(quality, motion)
    parameters = _Vectors()
    for point in points:
        found.parameters(point, parameters)
    asked = [_pairs(motion, point) for point in points]
    places = [len(set(_blocks(motion, point))) for point in points]
    wide = sum(3 * count for count in places if count > 1)
    between, unlisted = _Vectors(), 0
    for point, pairs, count in zip(points, asked, places, strict=True):
        if wide > 2_000 and count > 1:  # their joint cofactors cost a solution of the system for each coordinate
            unlisted += 1
            continue
        found.between(point, pairs, between)
    overall = quality.levels.overall
    each, each_between = (sidak(overall, max(len(some.names), 1)) for some in (parameters, between))
    estimated = solved.network.project.settings.sigma == "aposteriori" and quality.redundancy > 0
    tested = [some.tested(quality, at, estimated) for some, at in ((parameters, each), (between, each_between))]
    return MovementTests(tested[0], tested[1], each, each_between, unlisted)


def _absent(solved: Solved, point: MovingPoint) -> bool:
    """True for points that were left out, or are at infinity."""
    absent = solved.network.absent.get("point")
    return not point.epochs or (absent is not None and bool(absent[point.block]))


def _in_order(motion: TimeModel, point: MovingPoint) -> list[int]:
    return sorted((e for e in point.epochs if e >= 0), key=motion.times.__getitem__)


def _blocks(motion: TimeModel, point: MovingPoint) -> list[int]:
    return [point.at(e, motion.times[e]) for e in _in_order(motion, point)]


def _pairs(motion: TimeModel, point: MovingPoint) -> list[tuple[int, int]]:
    epochs = _in_order(motion, point)
    return [(epochs[0], later) for later in epochs[1:]]


class _Vectors:
    """Vectors as they are gathered."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.what: list[str] = []
        self.begin: list[str] = []
        self.end: list[str] = []
        self.values: list[FloatArray] = []
        self.cofactors: list[FloatArray] = []

    def add(self, name: str, what: str, span: tuple[str, str], values: FloatArray, cofactors: FloatArray) -> None:
        """One more; a vector of three components takes the room of six."""
        self.add_many(name, what, [span], values[None], cofactors[None])

    def add_many(
        self, name: str, what: str, spans: list[tuple[str, str]], values: FloatArray, cofactors: FloatArray
    ) -> None:
        """Several vectors (n, k) of a point with their cofactors (n, k, k)."""
        count, size = values.shape
        self.names += [name] * count
        self.what += [what] * count
        self.begin += [begin for begin, _ in spans]
        self.end += [end for _, end in spans]
        self.values.append(np.pad(values, ((0, 0), (0, _ROOM - size))))
        self.cofactors.append(np.pad(cofactors, ((0, 0), (0, _ROOM - size), (0, _ROOM - size))))

    def tested(self, quality: Quality, level: float, estimated: bool) -> TestedVectors:
        none = np.zeros((0, _ROOM)), np.zeros((0, _ROOM, _ROOM))
        tests = vector_tests(np.concatenate([none[0], *self.values]), np.concatenate([none[1], *self.cofactors]))
        log_p = tests.log_p(quality.redundancy, quality.sigma0**2 if estimated else None)
        of_freedom = {
            h: np.sqrt(noncentrality_of(h, level, quality.levels.power, quality.redundancy if estimated else None))
            for h in np.unique(tests.freedom[tests.freedom > 0]).tolist()
        }
        delta = np.array([of_freedom.get(h, np.nan) for h in tests.freedom.tolist()])
        significant = log_p < np.log(level)
        said = tuple(self.names), tuple(self.what), tuple(self.begin), tuple(self.end)
        return TestedVectors(said[0], said[1], said[2], said[3], tests, log_p, significant, delta * tests.longest)


class _Positions:
    """Positions of moving points at any time, as functions of the unknowns, with joint cofactors."""

    def __init__(self, quality: Quality, motion: TimeModel) -> None:
        self.quality, self.motion = quality, motion
        self.place = {tuple(row): k for k, row in enumerate(quality.moving.blocks.tolist())}

    def parameters(self, point: MovingPoint, into: _Vectors) -> None:
        """Velocity, oscillation and steps of a point."""
        motions = [point.motions.get(kind, 0) for kind in _KINDS]
        if any(motions):
            joint = self._joint(_blocks(self.motion, point)[0], motions)
            values = [self.quality.adjustment.values[k][b] for k, b in zip(_KINDS, motions, strict=True)]
            if VELOCITY.key in point.motions:
                into.add(point.name, "velocity", ("", ""), values[0], joint[3:6, 3:6])
            if SINE.key in point.motions and COSINE.key in point.motions:
                both = np.concatenate(values[1:])
                into.add(point.name, "annual oscillation", ("", ""), both, joint[6:, 6:])
        before = point.block
        for _, block in point.steps:
            places = self.quality.adjustment.values["point"]
            q = cofactors_of_difference(self.quality, before, block)
            label = self.quality.adjustment.problem.index.blocks["point"].ids[block].rpartition("@")[2]
            into.add(point.name, "step", ("", label), places[block] - places[before], q)
            before = block

    def between(self, point: MovingPoint, pairs: list[tuple[int, int]], into: _Vectors) -> None:
        motions = [point.motions.get(kind, 0) for kind in _KINDS]
        if len(set(_blocks(self.motion, point))) == 1 and any(motions):
            self._between_by_motions(point, motions, pairs, into)
            return
        for first, second in pairs:
            d, q = self.movement(point, first, second)
            into.add(point.name, "", (self.motion.labels[first], self.motion.labels[second]), d, q)

    def _between_by_motions(
        self, point: MovingPoint, motions: list[int], pairs: list[tuple[int, int]], into: _Vectors
    ) -> None:
        """The same of a point whose coordinates are the same all the time: only what moves it counts."""
        times = np.array([[self.motion.times[first], self.motion.times[second]] for first, second in pairs])
        first, second = (basis(column, self.motion.reference) for column in times.reshape(-1, 2).T)
        by = second - first
        values = self.quality.adjustment.values
        vectors = np.stack([values[k][m] for k, m in zip(_KINDS, motions, strict=True)])
        joint = self._joint(_blocks(self.motion, point)[0], motions)[3:, 3:].reshape(3, 3, 3, 3)
        q = np.einsum("na,nb,aibj->nij", by, by, joint)
        spans = [(self.motion.labels[one], self.motion.labels[other]) for one, other in pairs]
        into.add_many(point.name, "", spans, by @ vectors, q)

    def movement(self, point: MovingPoint, first: int, second: int) -> tuple[FloatArray, FloatArray]:
        """d (3,) from one epoch to another, and its cofactors (3, 3)."""
        times = [self.motion.times[first], self.motion.times[second]]
        blocks = [point.at(e, t) for e, t in zip((first, second), times, strict=True)]
        motions = [point.motions.get(kind, 0) for kind in _KINDS]
        by = np.diff(basis(np.array(times), self.motion.reference), axis=0)[0]
        values = self.quality.adjustment.values
        d = sum((b * values[k][m] for b, k, m in zip(by, _KINDS, motions, strict=True)), np.zeros(3))
        if blocks[0] == blocks[1]:
            if not any(motions):
                return d, np.zeros((3, 3))
            C = np.concatenate([np.zeros((3, 3)), *(b * np.eye(3) for b in by)], axis=1)
            return d, C @ self._joint(blocks[0], motions) @ C.T
        columns = self.quality.adjustment.problem.index.columns
        joint = np.concatenate(
            [*columns["point"][blocks], *(columns[k][m] for k, m in zip(_KINDS, motions, strict=True) if m)]
        )
        C = np.concatenate(
            [-np.eye(3), np.eye(3), *(b * np.eye(3) for b, m in zip(by, motions, strict=True) if m)], axis=1
        )
        d = d + values["point"][blocks[1]] - values["point"][blocks[0]]
        return d, C @ joint_cofactors(self.quality, joint) @ C.T

    def _joint(self, block: int, motions: list[int]) -> FloatArray:
        """(12, 12) of coordinates, velocity, sine and cosine."""
        k = self.place.get((block, *motions))
        return np.zeros((12, 12)) if k is None else self.quality.moving.cofactors[k]


def compared(solved: Solved, first: int, second: int) -> tuple[tuple[str, ...], FloatArray, FloatArray, FloatArray]:
    """Movements (n, 3) between two epochs with their joint cofactors (3n, 3n): names of the points seen in both.

    Also the columns of the null space of the network on these movements (3n, d), for the congruence test.
    """
    quality, motion = solved.quality, solved.network.motion
    assert quality is not None
    points = [p for p in motion.points.values() if {first, second} <= p.epochs and not _absent(solved, p)]
    index, values = quality.adjustment.problem.index, quality.adjustment.values
    times = [motion.times[first], motion.times[second]]
    by = np.diff(basis(np.array(times), motion.reference), axis=0)[0]
    columns, rows, d = [], [], []
    for point in points:
        blocks = [point.at(e, t) for e, t in zip((first, second), times, strict=True)]
        motions = [point.motions.get(kind, 0) for kind in _KINDS]
        own = [*index.columns["point"][blocks], *(index.columns[k][m] for k, m in zip(_KINDS, motions, strict=True))]
        columns.append(np.concatenate(own) if any(motions) else np.concatenate(own[:2]))
        rows.append(np.concatenate([[-1.0, 1.0], by if any(motions) else []]))
        moved = values["point"][blocks[1]] - values["point"][blocks[0]]
        if any(motions):
            moved = moved + sum(b * values[k][m] for b, k, m in zip(by, _KINDS, motions, strict=True))
        d.append(moved)
    used = np.unique(np.concatenate(columns)) if columns else np.zeros(0, dtype=np.int64)
    used = used[used >= 0]
    C = np.zeros((3 * len(points), len(used)))
    for k, (some, factors) in enumerate(zip(columns, rows, strict=True)):
        for part, factor in enumerate(factors):
            for axis, column in enumerate(some[3 * part : 3 * part + 3].tolist()):
                if column >= 0:
                    C[3 * k + axis, np.searchsorted(used, column)] += factor
    q = C @ joint_cofactors(quality, used) @ C.T
    return tuple(p.name for p in points), np.array(d).reshape(-1, 3), q, C @ quality.adjustment.defect.datum[used]


# ---- Two epochs of one network: the same points, brought into one datum, and their movements tested.


class EpochComparison(NamedTuple):
    """Outcome of the comparison of two epochs."""

    names: tuple[str, ...]
    result: Congruence
    """With the movements, second minus first, in the datum of the stable points, internal axes."""


def common_points(first: Network, second: Network) -> tuple[str, ...]:
    """Names of the points that both networks have, in the order of the first."""
    return tuple(name for name in first.things["point"].ids if name in second.things["point"].numbers)


def over_points(network: Network, names: tuple[str, ...], coordinates: FloatArray) -> Network:
    """The network, free over named points, the datum referring to their coordinates (n, 3), internal axes."""
    blocks = blocks_of(network, names)
    mask = np.zeros_like(network.datum.mask)
    mask[blocks] = True
    reference = network.start["point"].copy()
    reference[blocks] = coordinates
    datum = network.datum._replace(
        name="free, inner constraints over common points", free=True, mask=mask, minimal=False, reference=reference
    )
    return replace(network, datum=datum)


def blocks_of(network: Network, names: tuple[str, ...]) -> IntArray:
    """Point blocks of names."""
    points = network.things["point"]
    return np.array([points.part(name, "position") for name in names], dtype=np.int64)


def compare_epochs(
    names: tuple[str, ...], one: tuple[Quality, IntArray], other: tuple[Quality, IntArray], level: float, known: bool
) -> EpochComparison:
    """Congruence test of two assessed epochs in the datum over their common points; blocks (n,) by epoch."""
    first, second = one[0], other[0]
    places = [q.adjustment.values["point"][blocks] for q, blocks in (one, other)]
    columns = [q.adjustment.problem.index.columns["point"][blocks].ravel() for q, blocks in (one, other)]
    cofactors = joint_cofactors(first, columns[0]) + joint_cofactors(second, columns[1])
    generators = np.concatenate([_movements(q, own) for q, own in zip((first, second), columns, strict=True)], axis=1)
    redundancy = first.redundancy + second.redundancy
    variance = (first.omega + second.omega) / redundancy if redundancy else 1.0
    result = congruence(places[1] - places[0], cofactors, _basis(generators), variance, redundancy, level, known)
    return EpochComparison(names, result)


def compare_within(solved: Solved, first: int, second: int, level: float, known: bool) -> EpochComparison:
    """Congruence test of two epochs of one adjustment, over the points that move and were seen in both.

    What the network leaves open between the epochs is settled by the points that are stable.
    """
    quality = solved.quality
    assert quality is not None
    names, d, q, generators = compared(solved, first, second)
    variance = quality.omega / quality.redundancy if quality.redundancy else 1.0
    return EpochComparison(names, congruence(d, q, _basis(generators), variance, quality.redundancy, level, known))


def _movements(quality: Quality, columns: IntArray) -> FloatArray:
    """(3n, d) free movements of a network on some coordinates."""
    return np.where((columns >= 0)[:, None], quality.adjustment.defect.datum[columns], 0.0)


def _basis(generators: FloatArray) -> FloatArray:
    if generators.shape[1] == 0:
        return generators
    vectors, sizes, _ = rotations.svd(generators, full_matrices=False)
    return np.asarray(vectors[:, sizes > max(1e-6 * sizes[0], 1e-9)])
