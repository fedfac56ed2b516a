"""The movement that carries one system into another by rays of each to points of the other, and by common points.

target = s R source + t. A ray of the target is two planes through a point of the source, n · (s R p + t − c) = 0; a
horizontal direction is one. A ray of the source is two through a point of the target, R n · (X − t) − s n · c = 0. A
known component of a common point is a plane as well. Given R all of them are linear in s and t; so turns are sampled,
over all attitudes or about the vertical, and the best are adjusted (Gauss-Newton, Cauchy weights).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.parts.movement import Movement, Turn
from mor.approximate.remembered import remembered
from mor.approximate.similarity import Similarity, SimilarityOutcome
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import exponential

PRECISION = 2e-3
"""Radians, or parts of a distance, that planes pass by their points at the best: models are bent a little."""
FITS = 5.0 * PRECISION
AGREEING = 0.7
"""Part of all planes that pass by their points by less, at the least."""
CLEAR = 9.0
"""Difference of two objectives from which on one movement is told from another."""
OPEN = 0.1
"""σ of a movement (radians, or parts of the size) from which on it is open."""
_APART = 0.05
_REFINED = 16
_STEPS = 25
_DIFFERENCE = 1e-6
_REMEMBERED = 256


class Planes(NamedTuple):
    """Planes (n) of one system through points of the other; a row is one plane."""

    normal: FloatArray
    """(n, 3) unit vectors in the system of the rays."""
    at: FloatArray
    """(n, 3) a point of the plane, the centre of the ray, in that system."""
    point: FloatArray
    """(n, 3) what it passes through, in the other system."""
    of_source: BoolArray
    """(n,) true where the ray is one of the source."""
    reach: FloatArray
    """(n,) length (target) that residuals are parts of; 0 where that is the distance from ``at``."""
    ahead: FloatArray
    """(n, 3) where the point lies from the centre, in the system of the rays; 0 where either side will do."""


def movement_by_rays(planes: Planes, turn: Turn, scaled: bool, redundant: int) -> Movement | None:
    """The movement by which most planes pass through their points; ``None`` where too few do.

    ``redundant``: planes that must agree with it beyond those it takes.
    """
    if len(planes.normal) < _unknowns(turn, scaled) + redundant:
        return None
    arrays = planes.normal, planes.at, planes.point, planes.of_source, planes.reach, planes.ahead
    return _found(*arrays, turn, scaled, redundant)


@remembered(_REMEMBERED)
def _found(
    normal: FloatArray,
    at: FloatArray,
    point: FloatArray,
    of_source: BoolArray,
    reach: FloatArray,
    ahead: FloatArray,
    turn: Turn,
    scaled: bool,
    redundant: int,
) -> Movement | None:
    ties = _about_middle(Planes(normal, at, point, of_source, reach, ahead))
    rotations = sampled_turns(turn)
    linear = _linear(ties, rotations, scaled)
    off = _residuals(ties, rotations, *linear)
    order = np.argsort(np.log1p(np.square(off / (10.0 * PRECISION))).sum(axis=1), kind="stable")[:_REFINED]
    found = _refined(ties, _Movements(linear[0][order], rotations[order], linear[1][order]), turn, scaled)
    found.sort(key=lambda one: one.objective)
    return _judged(ties, found, turn, scaled, redundant) if found else None


class _Ties(NamedTuple):
    planes: Planes
    middles: tuple[FloatArray, FloatArray]
    sizes: tuple[float, float]


def _about_middle(planes: Planes) -> _Ties:
    """Both systems about the middle of what is in them, in parts of its size."""
    own, other = planes.at, planes.point
    source = np.where(planes.of_source[:, None], own, other)
    target = np.where(planes.of_source[:, None], other, own)
    middles = source.mean(axis=0), target.mean(axis=0)
    sizes = tuple(
        float(np.linalg.norm(one - middle, axis=1).max()) or 1.0
        for one, middle in zip((source, target), middles, strict=True)
    )
    of_ray = np.where(planes.of_source[:, None], (own - middles[0]) / sizes[0], (own - middles[1]) / sizes[1])
    through = np.where(
        planes.of_source[:, None], (other - middles[1]) / sizes[1], (other - middles[0]) / sizes[0]
    )
    moved = planes._replace(at=of_ray, point=through, reach=planes.reach / sizes[1])
    return _Ties(moved, middles, (sizes[0], sizes[1]))


def sampled_turns(turn: Turn) -> FloatArray:
    """Rotations (k, 3, 3) over all attitudes, about the vertical, or none."""
    if turn is Turn.NONE:
        return np.eye(3)[None]
    angles = 2.0 * np.pi * np.arange(72) / 72
    about = exponential(np.stack([0.0 * angles, 0.0 * angles, angles], axis=1))
    if turn is Turn.VERTICAL:
        return about
    k = np.arange(60) + 0.5
    z, around = 1.0 - 2.0 * k / 60.0, np.pi * (1.0 + 5.0**0.5) * k
    tilt, azimuth = np.arccos(z), around
    axes = np.stack([-np.sin(azimuth), np.cos(azimuth), 0.0 * k], axis=1) * tilt[:, None]
    return np.concatenate([one @ about[::4] for one in exponential(axes)])


def _linear(ties: _Ties, rotations: FloatArray, scaled: bool) -> tuple[FloatArray, FloatArray]:
    """Scale (k,) and shift (k, 3) that suit each rotation, far rays first counting as near ones."""
    weight = np.ones((len(rotations), len(ties.planes.normal)))
    fixed = ties.sizes[0] / ties.sizes[1]
    scale, shift = np.full(len(rotations), fixed), np.zeros((len(rotations), 3))
    for _ in range(4):
        by_scale, by_shift, constant = _coefficients(ties.planes, rotations)
        if scaled:
            constant = constant + fixed * by_scale
            rows = by_shift
        else:
            rows = np.concatenate([by_shift, by_scale[..., None]], axis=2)
        normal = np.einsum("kni,kn,knj->kij", rows, weight, rows)
        side = np.einsum("kni,kn,kn->ki", rows, weight, constant)
        damping = 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] + 1e-30
        solution = -tolerant.solve(normal + damping * np.eye(rows.shape[2]), side[:, :, None])[:, :, 0]
        shift = solution[:, :3]
        scale = scale if scaled else np.maximum(solution[:, 3], 1e-3)
        reach = _reach(ties.planes, rotations, scale, shift)
        off = _residuals(ties, rotations, scale, shift)
        weight = 1.0 / np.square(reach) / (1.0 + np.square(off / (20.0 * PRECISION)))
    return scale, shift


def _coefficients(planes: Planes, rotations: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of s (k, n), of t (k, n, 3) and the rest (k, n) of each plane equation."""
    turned = planes.normal @ np.swapaxes(rotations, 1, 2)
    carried = planes.point @ np.swapaxes(rotations, 1, 2)
    mine = planes.of_source[None, :]
    by_scale = np.where(
        mine, -np.sum(planes.normal * planes.at, axis=1), np.sum(planes.normal * carried, axis=2)
    )
    by_shift = np.where(mine[..., None], -turned, planes.normal)
    constant = np.where(
        mine, np.sum(turned * planes.point, axis=2), -np.sum(planes.normal * planes.at, axis=1)
    )
    return by_scale, by_shift, constant


def _reach(planes: Planes, rotations: FloatArray, scale: FloatArray, shift: FloatArray) -> FloatArray:
    """(k, n) distances from centres to points in the target."""
    moved = np.where(planes.of_source[:, None], planes.at, planes.point)
    stays = np.where(planes.of_source[:, None], planes.point, planes.at)
    line = scale[:, None, None] * (moved @ np.swapaxes(rotations, 1, 2)) + shift[:, None, :] - stays
    length = np.maximum(np.linalg.norm(line, axis=2), 1e-6)
    return np.asarray(np.where(planes.reach > 0.0, planes.reach, length))


def _residuals(ties: _Ties, rotations: FloatArray, scale: FloatArray, shift: FloatArray) -> FloatArray:
    """(k, n) by which planes pass by their points, as parts of the distance."""
    by_scale, by_shift, constant = _coefficients(ties.planes, rotations)
    off = by_scale * scale[:, None] + np.einsum("kni,ki->kn", by_shift, shift) + constant
    return np.asarray(off / _reach(ties.planes, rotations, scale, shift))


class _Fit(NamedTuple):
    scale: float
    rotation: FloatArray
    shift: FloatArray
    residuals: FloatArray

    @property
    def objective(self) -> float:
        """Sum of log(1 + (v/s)²)."""
        return float(np.log1p(np.square(self.residuals / PRECISION)).sum())


class _Movements(NamedTuple):
    """Movements of one kind: scales (k,), rotations (k, 3, 3) and shifts (k, 3) by which the source is moved."""

    scale: FloatArray
    rotation: FloatArray
    shift: FloatArray

    def moved(self, change: FloatArray, turn: Turn, scaled: bool) -> _Movements:
        """After changes (k, u) of shift, turn and scale."""
        turns = np.zeros((len(change), 3))
        if turn is Turn.ANY:
            turns = change[:, 3:6]
        elif turn is Turn.VERTICAL:
            turns[:, 2] = change[:, 3]
        scale = self.scale if scaled else self.scale * np.exp(change[:, -1])
        return _Movements(scale, exponential(turns) @ self.rotation, self.shift + change[:, :3])

    def residuals(self, ties: _Ties) -> FloatArray:
        """(k, n), as of :func:`_residuals`."""
        return _residuals(ties, self.rotation, self.scale, self.shift)

    def each(self, times: int) -> _Movements:
        """Every one of them so many times, one after the other."""
        return _Movements(*(np.repeat(one, times, axis=0) for one in (self.scale, self.rotation, self.shift)))


def _refined(ties: _Ties, near: _Movements, turn: Turn, scaled: bool) -> list[_Fit]:
    """The minima near movements; planes that pass far by count less."""
    off = near.residuals(ties)
    for step in range(_STEPS):
        width = max(PRECISION, 20.0 * PRECISION * 0.6**step)
        weight = 1.0 / (1.0 + np.square(off / width))
        rows = _derivatives(ties, near, off, turn, scaled)
        weighted = np.swapaxes(rows * weight[..., None], 1, 2)
        normal = weighted @ rows + 1e-10 * np.eye(rows.shape[2])
        change = -tolerant.solve(normal, weighted @ off[..., None])[..., 0]
        near = near.moved(np.clip(change, -0.3, 0.3), turn, scaled)
        off = near.residuals(ties)
        if width == PRECISION and float(np.abs(change).max()) < 1e-9:
            break
    return [
        _Fit(float(s), *rest) for s, *rest in zip(near.scale, near.rotation, near.shift, off, strict=True)
    ]


def _derivatives(ties: _Ties, at: _Movements, off: FloatArray, turn: Turn, scaled: bool) -> FloatArray:
    """(k, n, u) of the residuals by shift, turn and scale, by differences."""
    count = _unknowns(turn, scaled)
    steps = np.tile(_DIFFERENCE * np.eye(count), (len(off), 1))
    there = at.each(count).moved(steps, turn, scaled).residuals(ties).reshape(len(off), count, -1)
    return np.swapaxes((there - off[:, None, :]) / _DIFFERENCE, 1, 2)


def _unknowns(turn: Turn, scaled: bool) -> int:
    return 3 + {Turn.ANY: 3, Turn.VERTICAL: 1, Turn.NONE: 0}[turn] + (not scaled)


def _judged(ties: _Ties, found: list[_Fit], turn: Turn, scaled: bool, redundant: int) -> Movement | None:
    best = found[0]
    agrees = (np.abs(best.residuals) < FITS) & _ahead(ties, best)
    alone = _Movements(np.array([best.scale]), best.rotation[None], best.shift[None])
    rows = _derivatives(ties, alone, best.residuals[None], turn, scaled)[0]
    redundancy = int(np.count_nonzero(agrees)) - rows.shape[1]
    if redundancy < redundant or np.count_nonzero(agrees) < AGREEING * len(agrees):
        return None
    values = tolerant.singular_values(rows[agrees])
    others: list[_Fit] = []
    for one in found[1:]:
        if one.objective < best.objective + CLEAR and all(_apart(one, other) for other in (best, *others)):
            others.append(one)
    return Movement(
        *_outwards(ties, best),
        int(np.count_nonzero(values * OPEN < PRECISION)),
        float(np.sqrt(np.mean(np.square(best.residuals[agrees])))),
        redundancy,
        tuple(_similarity(*_outwards(ties, one)) for one in others),
    )


def _ahead(ties: _Ties, fit: _Fit) -> BoolArray:
    """(n,) true where a point does not lie behind the centre of its ray."""
    planes = ties.planes
    turned = planes.ahead @ fit.rotation.T
    moved = np.where(planes.of_source[:, None], planes.at, planes.point)
    carried = fit.scale * moved @ fit.rotation.T + fit.shift
    of_source = np.sum((planes.point - carried) * turned, axis=1)
    of_target = np.sum((carried - planes.at) * planes.ahead, axis=1)
    return np.asarray(np.where(planes.of_source, of_source, of_target) >= 0.0)


def _apart(one: _Fit, other: _Fit) -> bool:
    turned = float(np.trace(one.rotation @ other.rotation.T)) < 3.0 - _APART**2
    shifted = float(np.linalg.norm(one.shift - other.shift)) > _APART
    return turned or shifted or abs(np.log(one.scale / other.scale)) > _APART


def _outwards(ties: _Ties, fit: _Fit) -> tuple[float, FloatArray, FloatArray]:
    scale = fit.scale * ties.sizes[1] / ties.sizes[0]
    shift = ties.middles[1] + ties.sizes[1] * fit.shift - scale * fit.rotation @ ties.middles[0]
    return scale, fit.rotation, shift


def _similarity(scale: float, rotation: FloatArray, shift: FloatArray) -> Similarity:
    return Similarity(SimilarityOutcome.DETERMINED, scale, rotation, shift, np.zeros((0, 3)), 0.0)


__all__ = ["Planes", "movement_by_rays", "sampled_turns"]
