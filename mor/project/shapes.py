"""Circles, spheres, cylinders, cones and tori: which parameters are free, and start values fitted to points."""

from __future__ import annotations

from itertools import chain
from typing import NamedTuple

import numpy as np

from mor.model.rotations import exponential, rotate
from mor.model.shapes import PERPENDICULAR, PERPENDICULAR_TURNS, SHAPE_TYPES
from mor.types import BoolArray, FloatArray

# ---- What is free: the offset of the origin and the turns, both along and about the axes of the local system, and
# the size.


class Freedom(NamedTuple):
    """Components (3,) each that are unknowns of a shape if nothing is said of them."""

    offset: BoolArray
    turns: BoolArray
    shape: BoolArray

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return int(sum(np.count_nonzero(part) for part in self))


def _freedom(offset: str, turns: str, shape: str) -> Freedom:
    return Freedom(*(np.array([sign == "1" for sign in part]) for part in (offset, turns, shape)))


FREEDOM = {
    "circle": _freedom("111", "110", "100"),
    "sphere": _freedom("111", "000", "100"),
    "cylinder": _freedom("110", "110", "100"),
    "cone": _freedom("111", "110", "001"),
    "torus": _freedom("111", "110", "110"),
}
"""By type; the shape has radius, minor radius and semi-angle."""


# ---- Start values: the best of algebraic fits about many directions of the axis, each refined by least squares.

_REFINED, _STEPS = 8, 30
"""Fits that are refined, those with the smallest Σ v², and steps of each."""


class Held(NamedTuple):
    """The part of a shape that another feature holds, D = E D_A."""

    rotation: FloatArray
    """(3, 3) D_A."""
    perpendicular: bool = False
    """True if E is unknown; otherwise it is the identity."""
    origin: FloatArray | None = None
    """(3,) X0 if some of the offset r̄ is held at 0."""
    offsets: BoolArray = np.zeros(3, dtype=bool)
    """(3,) true for components of r̄ that are held."""


class FittedShape(NamedTuple):
    """A shape in its local system, x̄ = D (X − X0) + r̄."""

    rotation: FloatArray
    origin: FloatArray
    offset: FloatArray
    shape: FloatArray
    """(3,) radius, minor radius, semi-angle."""


def fit_shape(type_: str, points: FloatArray, shape: FloatArray, held: Held | None) -> FittedShape | None:
    """Fit a shape to points (n, 3) by least squares; ``None`` if they are too few or lie on no such shape.

    Components of ``shape`` (3,) that are known stay, those that are not are NaN. ``held`` is what another feature
    determines. Without it the offset r̄ is 0.
    """
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3:
        return None
    # Points that a fit takes; of more, evenly chosen ones.
    points = points[np.linspace(0, len(points) - 1, min(len(points), 400)).astype(int)]
    origin = held.origin if held is not None else None
    centre = points.mean(axis=0) if origin is None else origin
    size = float(np.abs(points - centre).max())
    if not size > 0.0:
        return None
    q, known = (points - centre) / size, shape / np.array([size, size, 1.0])
    free = FREEDOM[type_]
    free = Freedom(
        free.offset if held is None else free.offset & ~held.offsets,
        free.turns
        if held is None
        else np.array(PERPENDICULAR_TURNS)
        if held.perpendicular
        else np.zeros(3, dtype=bool),
        free.shape & np.isnan(known),
    )
    found = [_guess(type_, q, D, known, free) for D in _candidates(q, free, held)]
    # Factors of the radius of the circle through the points: in a thick torus this circle follows the tube.
    guesses = [
        [
            guess._replace(shape=guess.shape * np.where(free.shape & [True, False, False], factor, 1.0))
            for guess in found
            if guess is not None
        ]
        for factor in {"torus": (1.0, 2.0)}.get(type_, (1.0,))
    ]
    best = _refined(type_, q, guesses, free)
    if best is None:
        return None
    D, _, offset, sizes = _opened_upwards(best) if free.turns.any() else best
    sizes, offset = sizes * np.array([size, size, 1.0]), offset * size
    if origin is None:
        return FittedShape(D, centre - offset @ D, np.zeros(3), sizes)
    return FittedShape(D, centre, offset, sizes)


def _candidates(q: FloatArray, free: Freedom, held: Held | None) -> list[FloatArray]:
    """Rotations whose z axes are the principal axes of points (n, 3), and then spread over the half sphere.

    Those of a perpendicular shape are spread over half a turn about the axis of the other feature.
    """
    if held is not None and not held.perpendicular:
        return [held.rotation]
    # Directions of the axis that are tried.
    tried = 100
    if held is not None:
        angles = np.pi / tried * np.arange(tried)
        turns = exponential(angles[:, None] * np.array([0.0, 0.0, 1.0]))
        return list(PERPENDICULAR @ turns @ held.rotation)
    if not free.turns.any():
        return [np.eye(3)]
    height = (np.arange(tried) + 0.5) / tried
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(tried)
    flat = np.sqrt(1.0 - height**2)
    spread = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    return [_about(z) for z in (*np.linalg.svd(q - q.mean(axis=0))[2], *spread)]


def _about(z: FloatArray) -> FloatArray:
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _guess(type_: str, q: FloatArray, D: FloatArray, known: FloatArray, free: Freedom) -> FittedShape | None:
    """Algebraic fit about the z axis of D: ρ² is linear in the centre, in ρ0² − r² and, of a cone, in z̄² and z̄."""
    local = q @ D.T
    z = local[:, 2]
    spatial = 3 if type_ == "sphere" else 2
    columns = [2.0 * local[:, :spatial], np.ones((len(q), 1))]
    if type_ == "cone":
        columns.insert(1, np.stack([z**2, z], axis=1))
    square = np.sum(local[:, :spatial] ** 2, axis=1)
    answer = np.linalg.lstsq(np.concatenate(columns, axis=1), square, rcond=None)[0]
    offset = np.append(-answer[:spatial], [-z.mean()] if spatial == 2 else [])
    shape = np.zeros(3)
    if type_ == "cone":
        if answer[2] <= 0.0:
            return None
        offset[2] = 0.5 * answer[3] / answer[2]
        shape[2] = np.arctan(np.sqrt(answer[2])) * np.sign(np.mean(z + offset[2]))
    else:
        shape[0] = np.sqrt(max(answer[-1] + np.sum(answer[:spatial] ** 2), 0.0))
    offset = np.where(free.offset, offset, 0.0)
    if type_ == "torus":
        away = np.hypot(*(local[:, :2] + offset[:2]).T) - shape[0]
        shape[1] = np.sqrt(np.mean(away**2 + (z + offset[2]) ** 2))
    return FittedShape(D, np.zeros(3), offset, np.where(np.isnan(known), shape, known))


def _refined(type_: str, q: FloatArray, guesses: list[list[FittedShape]], free: Freedom) -> FittedShape | None:
    from scipy.optimize import least_squares

    def adjusted(fit: FittedShape) -> FittedShape:
        def distances(step: FloatArray) -> FloatArray:
            return _distances(type_, q, _moved(fit, step, free))

        return _moved(fit, least_squares(distances, np.zeros(free.unknowns), x_scale="jac", max_nfev=_STEPS).x, free)

    fits: list[tuple[float, FittedShape]] = []
    ordered = [sorted(some, key=lambda guess: _squares(type_, q, guess))[:_REFINED] for some in guesses]
    # Refined fits that must lead to the same, smallest Σ v² to try no other, and the relative difference allowed.
    agreeing, same = 5, 1e-3
    for guess in chain.from_iterable(ordered):
        fit = adjusted(guess)
        fits = sorted([*fits, (_squares(type_, q, fit), fit)], key=lambda one: one[0])
        if len(fits) >= agreeing and fits[agreeing - 1][0] <= (1.0 + same) * fits[0][0]:
            break
    return fits[0][1] if fits else None


def _moved(fit: FittedShape, step: FloatArray, free: Freedom) -> FittedShape:
    whole = np.zeros(9)
    whole[np.concatenate(free)] = step
    return FittedShape(
        rotate(fit.rotation[None], whole[None, 3:6])[0], fit.origin, fit.offset + whole[:3], fit.shape + whole[6:]
    )


def _distances(type_: str, q: FloatArray, fit: FittedShape) -> FloatArray:
    blocks = [np.broadcast_to(part, (len(q), *part.shape)) for part in (fit.origin, *fit[:1], *fit[2:])]
    return np.asarray(SHAPE_TYPES[type_].equation([*blocks, q], np.zeros((len(q), 0))).values.ravel())


def _squares(type_: str, q: FloatArray, fit: FittedShape) -> float:
    return float(np.sum(_distances(type_, q, fit) ** 2))


def _opened_upwards(fit: FittedShape) -> FittedShape:
    """The same with a semi-angle that is not negative: a cone opens along its z axis."""
    if fit.shape[2] >= 0.0:
        return fit
    half_turn = np.array([1.0, -1.0, -1.0])
    return fit._replace(
        rotation=half_turn[:, None] * fit.rotation,
        offset=half_turn * fit.offset,
        shape=fit.shape * np.array([1.0, 1.0, -1.0]),
    )
