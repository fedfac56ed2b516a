"""The movement that carries one system into another: shift, turn and scale, as far as what ties them determines it.

target = s R source + t. What ties two systems are points of which any components are known in the target, and
directions known in both (verticals, axes of frames). Given R the rest is linear; so turns are sampled, over all
attitudes, about the vertical, or not at all, whatever the systems are free to do, and the best are adjusted
(Gauss-Newton). Further starts come from the closed form over points known in all three components.

Not determined stays as near as possible to where it was, and is counted. Coordinates are taken relative to
their centre, so the distance from the origin does not matter.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from mor.model import rotations
from mor.model.rotations import exponential
from mor.start.bundle import Similarity, SimilarityOutcome, congruence, movement_by, similarity, sphere
from mor.types import BoolArray, FloatArray

OPEN = 0.1
"""σ of a movement (radians, or parts of the size) from which on it is open rather than determined."""
PRECISION = 1e-4
"""What coordinates are good to at the best, in parts of the size of the target."""


class FreeRotation(Enum):
    """Turns that a movement is free to make."""

    ANY = "any"
    VERTICAL = "about the vertical"
    NONE = "none"

    @property
    def count(self) -> int:
        """Number of angles."""
        return {FreeRotation.ANY: 3, FreeRotation.VERTICAL: 1, FreeRotation.NONE: 0}[self]


class Ties(NamedTuple):
    """Points and directions that two systems have in common."""

    source: FloatArray
    """(n, 3) points in the one."""
    target: FloatArray
    """(n, 3) the same in the other; NaN where a component is not known."""
    source_axes: FloatArray
    """(m, 3) unit vectors in the one."""
    target_axes: FloatArray
    """(m, 3) the same in the other."""


class Movement(NamedTuple):
    """A similarity, what is left open of it, and how well it fits."""

    scale: float
    rotation: FloatArray
    shift: FloatArray
    open: int
    """Number of movements that the ties do not determine."""
    misfit: float
    """Root mean square of the residuals, in parts of the size of the target."""
    redundancy: int
    alternatives: tuple[Similarity, ...] = ()
    """Other movements that fit as well."""

    @property
    def similarity(self) -> Similarity:
        """The movement as a similarity."""
        return movement_by(self.scale, self.rotation, self.shift)


def movement(ties: Ties, turn: FreeRotation, scaled: bool) -> Movement | None:
    """The movement that fits best; ``scaled``: both systems have the same scale. ``None`` where nothing ties them."""
    if not np.isfinite(ties.target).any() and len(ties.source_axes) == 0:
        return None
    frame = _normalised(ties, np.isfinite(ties.target))
    refined = [_refined(frame, R, turn, scaled) for R in _starts(frame, turn, scaled)]
    found = [one for one in refined if one is not None and one.scale > 0.0]
    if not found:
        return None
    found.sort(key=lambda one: one.cost)
    best = found[0]
    limit = best.cost + max(9.0 * best.cost / max(best.redundancy, 1), 1e-7)
    others = [one for one in found[1:] if one.cost <= limit and _apart(one.rotation, best.rotation)]
    distinct: list[_Fit] = []
    for one in others:
        if all(_apart(one.rotation, other.rotation) for other in distinct):
            distinct.append(one)
    carried = [frame.outwards(one) for one in (best, *distinct)]
    return Movement(
        *carried[0], best.open, best.misfit, best.redundancy, tuple(movement_by(*one) for one in carried[1:])
    )


class _Fit(NamedTuple):
    """A movement between normalised systems."""

    scale: float
    rotation: FloatArray
    shift: FloatArray
    cost: float
    open: int
    misfit: float
    redundancy: int


class _Normalised(NamedTuple):
    """Ties about the centre of the points, in parts of their size."""

    source: FloatArray
    target: FloatArray
    known: BoolArray
    source_axes: FloatArray
    target_axes: FloatArray
    centres: tuple[FloatArray, FloatArray]
    sizes: tuple[float, float]

    def outwards(self, fit: _Fit) -> tuple[float, FloatArray, FloatArray]:
        scale = fit.scale * self.sizes[1] / self.sizes[0]
        shift = self.centres[1] + self.sizes[1] * fit.shift - scale * fit.rotation @ self.centres[0]
        return scale, fit.rotation, shift


def _normalised(ties: Ties, known: BoolArray) -> _Normalised:
    used = known.any(axis=1)
    source, target, known = ties.source[used], ties.target[used], known[used]
    counts = np.maximum(known.sum(axis=0), 1)
    from_ = source.mean(axis=0) if len(source) else np.zeros(3)
    to = np.where(known, target, 0.0).sum(axis=0) / counts
    source, target = source - from_, np.where(known, target - to, 0.0)
    # The same measure of both: the spread of the source, and that of the components known of the target.
    spread = float(np.sqrt(np.mean(np.sum(source**2, axis=1)))) if len(source) else 0.0
    reach = float(np.sqrt(np.sum(target**2) / max(known.sum(), 1) * 3.0)) if len(source) else 0.0
    # Of a single place nothing tells a scale: it stays as it is.
    extends = reach > 1e-9 * float(np.abs(to).max(initial=0.0))
    sizes = spread or 1.0, reach if extends and spread else spread or 1.0
    return _Normalised(
        source / sizes[0], target / sizes[1], known, ties.source_axes, ties.target_axes, (from_, to), sizes
    )


def _starts(ties: _Normalised, turn: FreeRotation, scaled: bool) -> FloatArray:
    """Rotations (k, 3, 3) to start from, the most promising ones."""
    if turn is FreeRotation.NONE:
        return np.eye(3)[None]
    sampled = sampled_turns(turn, 48, 12)
    if turn is FreeRotation.ANY and len(ties.source_axes):
        sampled = _towards(ties.target_axes[0]) @ sampled_turns(FreeRotation.VERTICAL) @ _towards(ties.source_axes[0]).T
    sampled = np.concatenate([sampled, *_closed_forms(ties, turn, scaled)])
    cost = _costs(ties, sampled, scaled)
    return sampled[np.argsort(cost, kind="stable")[:12]]


def sampled_turns(turn: FreeRotation, axes: int = 60, about: int = 18) -> FloatArray:
    """Return rotations (k, 3, 3) about so many axes all over, 72 about the vertical, or none."""
    if turn is FreeRotation.NONE:
        return np.eye(3)[None]
    angles = 2.0 * np.pi * np.arange(72) / 72
    turns = exponential(np.stack([0.0 * angles, 0.0 * angles, angles], axis=1))
    if turn is FreeRotation.VERTICAL:
        return turns
    return np.concatenate([_towards(axis) @ turns[:: 72 // about] for axis in sphere(axes)])


def _towards(axis: FloatArray) -> FloatArray:
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _closed_forms(ties: _Normalised, turn: FreeRotation, scaled: bool) -> list[FloatArray]:
    """Rotations from points known in all components of use: from all of them and, against errors, from triples."""
    axes = 2 if turn is FreeRotation.VERTICAL else 3
    full = np.flatnonzero(ties.known[:, :axes].all(axis=1))
    if len(full) < axes:
        return []
    draw = np.random.default_rng(1)
    samples = [full, *(draw.choice(full, axes, replace=False) for _ in range(20 if len(full) > axes else 0))]
    fitted = congruence if scaled and abs(ties.sizes[0] - ties.sizes[1]) < 1e-12 * ties.sizes[0] else similarity
    found = []
    for chosen in samples:
        one = fitted(ties.source[chosen, :axes], ties.target[chosen, :axes])
        if one.outcome is SimilarityOutcome.DETERMINED:
            rotation = np.eye(3)
            rotation[:axes, :axes] = one.rotation
            found.append(rotation[None])
    return found


def _costs(ties: _Normalised, rotations: FloatArray, scaled: bool) -> FloatArray:
    """Sums of absolute residuals (k,) with the best scale and shift for each rotation."""
    cost = np.zeros(len(rotations))
    if len(ties.source_axes):
        off = rotations @ ties.source_axes.T - ties.target_axes.T
        cost += np.linalg.norm(off, axis=1).sum(axis=1)
    if len(ties.source) == 0:
        return cost
    mask = ties.known.astype(float)
    turned = ties.source @ np.swapaxes(rotations, 1, 2)
    mean = (turned * mask).sum(axis=1) / np.maximum(mask.sum(axis=0), 1.0)
    turned = (turned - mean[:, None, :]) * mask
    if scaled:
        scale = np.full(len(rotations), ties.sizes[0] / ties.sizes[1])
    else:
        scale = np.sum(turned * ties.target, axis=(1, 2)) / np.maximum(np.sum(turned**2, axis=(1, 2)), 1e-30)
    behind = scale <= 0.0
    off = np.abs(np.maximum(scale, 0.0)[:, None, None] * turned - ties.target)
    return np.asarray(cost + off.sum(axis=(1, 2)) + np.where(behind, 1e-3, 0.0))


def _refined(ties: _Normalised, R: FloatArray, turn: FreeRotation, scaled: bool) -> _Fit | None:
    """Gauss-Newton from a rotation; residuals that are large beside the others count less (Cauchy)."""
    fixed = ties.sizes[0] / ties.sizes[1]
    s, t = (fixed if scaled else _scale(ties, R)), np.zeros(3)
    turns = {
        FreeRotation.ANY: (True, True, True),
        FreeRotation.VERTICAL: (False, False, True),
        FreeRotation.NONE: (False, False, False),
    }
    moves = np.array([True, True, True, *turns[turn], not scaled])
    weight = np.ones(int(ties.known.sum()) + 3 * len(ties.source_axes))
    lift = 1e-3
    cost = np.inf
    for step in range(20):
        rows, residuals = _rows(ties, s, R, t)
        rows = rows[:, moves]
        scatter = max(float(np.median(np.abs(residuals))) * 1.48, PRECISION)
        enough = len(residuals) > rows.shape[1] + 3
        weight = 1.0 / (1.0 + (residuals / (3.0 * scatter)) ** 2) if enough and step > 3 else weight
        root = np.sqrt(weight)
        cost = float(np.sum(weight * residuals**2))
        size = 1e-9 + lift if step < 3 else 1e-9
        A = np.concatenate([rows * root[:, None], size * np.eye(rows.shape[1])])
        change = np.zeros(7)
        change[moves] = -rotations.lstsq(A, np.concatenate([root * residuals, np.zeros(rows.shape[1])]), rcond=None)
        if not np.isfinite(change).all():
            return None
        R = exponential(np.clip(change[3:6], -0.5, 0.5)[None])[0] @ R
        s, t = s * float(np.exp(np.clip(change[6], -0.7, 0.7))), t + change[:3]
        if float(np.abs(change).max()) < 1e-12:
            break
    rows, residuals = _rows(ties, s, R, t)
    cost = float(np.sum(weight * residuals**2))
    return _judged(s, R, t, rows[:, moves], weight, cost)


def _judged(s: float, R: FloatArray, t: FloatArray, rows: FloatArray, weight: FloatArray, cost: float) -> _Fit:
    redundancy = len(rows) - rows.shape[1]
    values = rotations.singular_values(rows * np.sqrt(weight)[:, None])
    values = np.append(values, np.zeros(max(rows.shape[1] - len(values), 0)))
    noise = max(np.sqrt(cost / redundancy) if redundancy > 0 else 0.0, PRECISION)
    unsettled = int(np.count_nonzero(values * OPEN < noise))
    return _Fit(s, R, t, cost, unsettled, float(np.sqrt(cost / max(len(rows), 1))), redundancy)


def _scale(ties: _Normalised, R: FloatArray) -> float:
    turned = np.where(ties.known, ties.source @ R.T, 0.0)
    turned -= np.where(ties.known, turned.sum(axis=0) / np.maximum(ties.known.sum(axis=0), 1), 0.0)
    square = float(np.sum(turned**2))
    found = float(np.sum(turned * ties.target)) / square if square > 0.0 else 1.0
    return found if found > 0.0 else 0.1


def _rows(ties: _Normalised, s: float, R: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives (n, 7) and residuals (n,) of the known components and of the directions."""
    moved = s * ties.source @ R.T
    point = np.zeros((len(moved), 3, 7))
    point[:, :, :3] = np.eye(3)
    point[:, :, 3:6] = _turning(moved)
    point[:, :, 6] = moved
    axis = np.zeros((len(ties.source_axes), 3, 7))
    turned = ties.source_axes @ R.T
    axis[:, :, 3:6] = _turning(turned)
    rows = np.concatenate([point[ties.known], axis.reshape(-1, 7)])
    off = np.concatenate([(moved + t - ties.target)[ties.known], (turned - ties.target_axes).ravel()])
    return rows, off


def _turning(moved: FloatArray) -> FloatArray:
    """Derivatives (n, 3, 3) of turned vectors by a small turn about the axes of the target: −[v]×."""
    x, y, z = moved.T
    o = np.zeros_like(x)
    return np.stack([o, z, -y, -z, o, x, y, -x, o], axis=1).reshape(-1, 3, 3)


def _apart(one: FloatArray, other: FloatArray) -> bool:
    return bool(np.trace(one @ other.T) < 3.0 - 1e-4)
