"""Relative orientation of two bundles that both know the vertical: one turn and a base, four points and more.

With both bundles turned upright X_B = R_κ (X_A − b). Given κ the coplanarity (p', R_κᵀ p'', b) = 0 is linear in b: its
smallest singular value, as a function of κ alone, has its minimum at the solution. κ is searched over the full circle
and refined; points must lie in front of both bundles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant

FEWEST = 4
_STEP = np.pi / 360.0
_REFINEMENTS = 12


class Upright(NamedTuple):
    """Base, turn and which rays meet."""

    base: FloatArray
    """(3,) of length one, from A to B in the upright axes of A."""
    turn: FloatArray
    """(3, 3) from the upright axes of A to those of B."""
    meets: BoolArray
    """(n,) rays that are coplanar with the base and meet in front."""


def upright_orientation(a: FloatArray, b: FloatArray, tolerance: float) -> Upright | None:
    """Orientation of unit rays (n, 3) in upright axes; ``None`` with fewer than four points or where they do not meet.

    ``tolerance`` (radians) is what a ray may be off its epipolar plane.
    """
    if len(a) < FEWEST:
        return None
    kappas = np.arange(0.0, 2.0 * np.pi, _STEP)
    misfit = _misfits(a, b, kappas)
    lower = (misfit < np.roll(misfit, 1)) & (misfit <= np.roll(misfit, -1))
    order = np.flatnonzero(lower)[np.argsort(misfit[lower])][:6]
    best: tuple[int, float, Upright] | None = None
    for kappa in kappas[order]:
        value, refined = _refined(a, b, float(kappa))
        for sign in (1.0, -1.0):
            found = _judged(a, b, refined, sign, tolerance)
            key = int(found.meets.sum()), -value
            if best is None or key > best[:2]:
                best = (*key, found)
    enough = best is not None and best[0] >= max(FEWEST, 0.8 * len(a))
    return best[2] if best is not None and enough else None


def _about_vertical(kappa: float) -> FloatArray:
    c, s = np.cos(kappa), np.sin(kappa)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _misfits(a: FloatArray, b: FloatArray, kappas: FloatArray) -> FloatArray:
    """Smallest singular values (k,), by the eigenvalues of the normal matrices of all turns at once."""
    c, s, o = np.cos(kappas), np.sin(kappas), np.zeros_like(kappas)
    turns = np.stack([c, s, o, -s, c, o, o, o, o + 1.0], axis=1).reshape(-1, 3, 3)
    normals = np.cross(a[None], b @ turns)
    smallest = tolerant.eigvalsh(np.swapaxes(normals, 1, 2) @ normals)[:, 0]
    return np.sqrt(np.maximum(smallest, 0.0)).astype(np.float64)


def _smallest(a: FloatArray, b: FloatArray, kappa: float) -> tuple[float, FloatArray]:
    normals = np.cross(a, b @ _about_vertical(kappa))
    _, values, right = tolerant.svd(normals)
    return float(values[2]), right[2]


def _refined(a: FloatArray, b: FloatArray, kappa: float) -> tuple[float, float]:
    """Golden section between the neighbours of a minimum of the search."""
    low, high = kappa - _STEP, kappa + _STEP
    share = 0.5 * (5.0**0.5 - 1.0)
    for _ in range(2 * _REFINEMENTS):
        one, other = high - share * (high - low), low + share * (high - low)
        if _smallest(a, b, one)[0] < _smallest(a, b, other)[0]:
            high = other
        else:
            low = one
    kappa = 0.5 * (low + high)
    return _smallest(a, b, kappa)[0], kappa


def _judged(a: FloatArray, b: FloatArray, kappa: float, sign: float, tolerance: float) -> Upright:
    base, turn = sign * _smallest(a, b, kappa)[1], _about_vertical(kappa)
    seen = b @ turn
    normals = np.cross(a, seen)
    length = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    off = np.abs(normals @ base) / length
    # s a − t seen = base: the depths by the components across the other ray.
    depth_a = np.einsum("ni,ni->n", np.cross(base, seen), normals) / length**2
    depth_b = np.einsum("ni,ni->n", np.cross(base, a), normals) / length**2
    return Upright(base, turn, (off < tolerance / length.clip(0.05)) & (depth_a > 0.0) & (depth_b > 0.0))
