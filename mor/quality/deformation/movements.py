"""Movements of the points of one adjustment: what moves them, and by how much from one epoch to another.

The position of a point at the time t is linear in its blocks, p(t) = X_i + Σ b_k(t) m_k, and so is the movement between
two epochs, d = p(t2) − p(t1), with cofactors C Q Cᵀ. Parameters (velocity, oscillation, step) are tested against zero.
All of these tests together reject by mistake with the level of the tests of groups; each has its share (Šidák; for
small levels that of Bonferroni).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.observations.motion.moving import basis
from mor.parameters.kinds import COSINE, MOTIONS, SINE, VELOCITY
from mor.project.motion.model import Motion, MovingPoint
from mor.quality.assess import Quality
from mor.quality.deformation.vector_tests import VectorTests, noncentrality_of, vector_tests
from mor.quality.precision.covariance import joint_cofactors
from mor.quality.solved import Solved
from mor.quality.tests.levels import sidak

MOST_COLUMNS = 2_000
"""Coordinates of single epochs whose joint cofactors are worked out unasked: each costs a solution of the system."""
_ROOM = 6
"""Components of the longest vector: an annual oscillation."""
_KINDS = tuple(kind.key for kind in MOTIONS)


class Tested(NamedTuple):
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


class Movements(NamedTuple):
    """What moves, and how far it has moved."""

    parameters: Tested
    between: Tested
    """From the first epoch of every point to each later one."""
    level: float
    """Level of each single test of a parameter."""
    level_between: float
    """Level of each single test of a movement."""
    unlisted: int
    """Points with coordinates of their own in so many epochs that their movements are not worked out unasked."""


def movements(solved: Solved) -> Movements | None:
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
        if wide > MOST_COLUMNS and count > 1:
            unlisted += 1
            continue
        found.between(point, pairs, between)
    overall = quality.levels.overall
    each, each_between = (sidak(overall, max(len(some.names), 1)) for some in (parameters, between))
    estimated = solved.network.project.settings.sigma == "aposteriori" and quality.redundancy > 0
    tested = [
        some.tested(quality, at, estimated) for some, at in ((parameters, each), (between, each_between))
    ]
    return Movements(tested[0], tested[1], each, each_between, unlisted)


def _absent(solved: Solved, point: MovingPoint) -> bool:
    """True for points that were left out, or are at infinity."""
    absent = solved.network.absent.get("point")
    return not point.epochs or (absent is not None and bool(absent[point.block]))


def _in_order(motion: Motion, point: MovingPoint) -> list[int]:
    return sorted((e for e in point.epochs if e >= 0), key=motion.times.__getitem__)


def _blocks(motion: Motion, point: MovingPoint) -> list[int]:
    """Blocks of the coordinates of a point in its epochs."""
    return [point.at(e, motion.times[e]) for e in _in_order(motion, point)]


def _pairs(motion: Motion, point: MovingPoint) -> list[tuple[int, int]]:
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

    def add(
        self, name: str, what: str, span: tuple[str, str], values: FloatArray, cofactors: FloatArray
    ) -> None:
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

    def tested(self, quality: Quality, level: float, estimated: bool) -> Tested:
        """All of them with their tests, with σ0 ``estimated`` or known."""
        none = np.zeros((0, _ROOM)), np.zeros((0, _ROOM, _ROOM))
        tests = vector_tests(
            np.concatenate([none[0], *self.values]), np.concatenate([none[1], *self.cofactors])
        )
        log_p = tests.log_p(quality.redundancy, quality.sigma0**2 if estimated else None)
        of_freedom = {
            h: np.sqrt(
                noncentrality_of(h, level, quality.levels.power, quality.redundancy if estimated else None)
            )
            for h in np.unique(tests.freedom[tests.freedom > 0]).tolist()
        }
        delta = np.array([of_freedom.get(h, np.nan) for h in tests.freedom.tolist()])
        significant = log_p < np.log(level)
        said = tuple(self.names), tuple(self.what), tuple(self.begin), tuple(self.end)
        return Tested(said[0], said[1], said[2], said[3], tests, log_p, significant, delta * tests.longest)


class _Positions:
    """Positions of moving points at any time, as functions of the unknowns, with joint cofactors."""

    def __init__(self, quality: Quality, motion: Motion) -> None:
        self.quality, self.motion = quality, motion
        self.place = {tuple(row): k for k, row in enumerate(quality.moving.blocks.tolist())}

    def parameters(self, point: MovingPoint, into: _Vectors) -> None:
        """Velocity, oscillation and steps of a point."""
        motions = [point.motions.get(kind, 0) for kind in _KINDS]
        if any(motions):
            joint = self._joint(self._first_block(point), motions)
            values = [self.quality.adjustment.values[k][b] for k, b in zip(_KINDS, motions, strict=True)]
            if VELOCITY.key in point.motions:
                into.add(point.name, "velocity", ("", ""), values[0], joint[3:6, 3:6])
            if SINE.key in point.motions and COSINE.key in point.motions:
                both = np.concatenate(values[1:])
                into.add(point.name, "annual oscillation", ("", ""), both, joint[6:, 6:])
        before = point.block
        for _, block in point.steps:
            d, q = self._difference(before, block)
            label = self.quality.adjustment.problem.index.blocks["point"].ids[block].rpartition("@")[2]
            into.add(point.name, "step", ("", label), d, q)
            before = block

    def between(self, point: MovingPoint, pairs: list[tuple[int, int]], into: _Vectors) -> None:
        """Movements of a point between pairs of epochs."""
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

    def _difference(self, before: int, after: int) -> tuple[FloatArray, FloatArray]:
        columns = self.quality.adjustment.problem.index.columns["point"][[before, after]].ravel()
        q = joint_cofactors(self.quality, columns)
        values = self.quality.adjustment.values["point"]
        return values[after] - values[before], q[:3, :3] + q[3:, 3:] - q[:3, 3:] - q[3:, :3]

    def _first_block(self, point: MovingPoint) -> int:
        return _blocks(self.motion, point)[0]

    def _joint(self, block: int, motions: list[int]) -> FloatArray:
        """(12, 12) of coordinates, velocity, sine and cosine."""
        k = self.place.get((block, *motions))
        return np.zeros((12, 12)) if k is None else self.quality.moving.cofactors[k]


def compared(
    solved: Solved, first: int, second: int
) -> tuple[tuple[str, ...], FloatArray, FloatArray, FloatArray]:
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
        own = [
            *index.columns["point"][blocks],
            *(index.columns[k][m] for k, m in zip(_KINDS, motions, strict=True)),
        ]
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
    null = quality.adjustment.defect.datum
    return tuple(p.name for p in points), np.array(d).reshape(-1, 3), q, C @ null[used]
