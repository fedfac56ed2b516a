"""Rigorous adjustment of a relative orientation: image coordinates observed, one condition per point.

Gauss–Helmert with the condition g = p'ᵀ (ik) p'' = p' · (u × b) = 0, u = D*ᵀ p'', and five parameters: two
of the unit base b across itself, three of the small rotation δ of D* ← exp(−[δ]×) D*. The compatibility
conditions hold by the choice of the parameters, which is the same adjustment as Rinner's n + 4 equations in
ik (Nr. 4).

    ∂g/∂δ = D* (u × (b × p')),    ∂g/∂b = p' × u,    ∂g/∂p' = u × b,    ∂g/∂p'' = D* (b × p')

Conditions are linearised at the adjusted observations, so the result is the strict minimum of Σ (v/σ)².
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.relative_orientation.rinner import auxiliary_unknowns
from mor.approximate.vectors import cross, tangent_axes
from mor.arrays import BoolArray, FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import exponential, rotate

INNER = 4
"""Iterations for the adjusted observations of given parameters; they gain six digits each at image noise."""
PARALLAX = 3.0
"""Rays whose angle is below so many σ are parallel: in front if they point to the same side."""


class Misfit(NamedTuple):
    """Adjusted observations of given parameters."""

    residuals: FloatArray
    """(n,) signed length of the four corrections v/σ of a point."""
    corrections: FloatArray
    """(n, 4) v/σ: two measured coordinates in A, two in B."""
    rays_a: FloatArray
    rays_b: FloatArray
    """(n, 3) adjusted rays."""
    spread: FloatArray
    """(n,) standard deviation of the condition g."""


class Coplanarity(NamedTuple):
    """An adjusted relative orientation."""

    base: FloatArray
    """(3,) unit vector in A."""
    rotation: FloatArray
    """(3, 3) D*."""
    residuals: FloatArray
    """(n,) signed lengths of v/σ."""
    objective: float
    """Σ (v/σ)²."""
    normal: FloatArray
    """(5, 5) of the two base parameters (along ``base_axes``) and δ."""
    base_axes: FloatArray
    """(3, 2) the directions across the base that its two parameters run along."""
    converged: bool


def misfit(a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray) -> Misfit:
    """Smallest corrections to the rays of ``a`` and ``b`` (n each) that make them meet."""
    ik = auxiliary_unknowns(base, rotation)
    axes_a, axes_b = a.whitened_axes, b.whitened_axes
    corrections = np.zeros((len(a), 4))
    rays_a, rays_b = a.rays, b.rays
    for _ in range(INNER):
        slopes = np.concatenate(
            [
                np.einsum("nij,ni->nj", axes_a, rays_b @ ik.T),
                np.einsum("nij,ni->nj", axes_b, rays_a @ ik),
            ],
            axis=1,
        )
        spread = np.sqrt(np.maximum(np.sum(slopes**2, axis=1), 1e-300))
        condition = np.einsum("ni,ni->n", rays_a @ ik, rays_b)
        residuals = (condition - np.sum(slopes * corrections, axis=1)) / spread
        corrections = -slopes * (residuals / spread)[:, None]
        rays_a = a.rays + np.einsum("nij,nj->ni", axes_a, corrections[:, :2])
        rays_b = b.rays + np.einsum("nij,nj->ni", axes_b, corrections[:, 2:])
    return Misfit(residuals, corrections, rays_a, rays_b, spread)


def first_order_residuals(a: Bundle, b: Bundle, ik: FloatArray) -> FloatArray:
    """Residuals v/σ (m, n) to first order for many sets of ik (m, 3, 3); positive, not iterated."""
    from_b = np.einsum("mij,nj->mni", ik, b.rays)
    from_a = np.einsum("mij,ni->mnj", ik, a.rays)
    condition = np.abs(np.einsum("mni,ni->mn", from_b, a.rays))
    variance = np.sum(np.einsum("nij,mni->mnj", a.whitened_axes, from_b) ** 2, axis=2)
    variance += np.sum(np.einsum("nij,mni->mnj", b.whitened_axes, from_a) ** 2, axis=2)
    return np.asarray(condition / np.sqrt(np.maximum(variance, 1e-300)))


def adjust_coplanarity(
    a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray, iterations: int = 50
) -> Coplanarity:
    """Adjust ``base`` (3,) and ``rotation`` (3, 3) to n ≥ 5 homologous rays, with Levenberg–Marquardt steps.

    Converged when a step no longer changes the parameters by more than rounding, or the objective stands
    still.
    """
    state = misfit(a, b, base, rotation)
    objective = float(state.residuals @ state.residuals)
    damping, converged = 0.0, False
    axes = tangent_axes(base)
    normal = np.zeros((5, 5))
    for _ in range(iterations):
        axes = tangent_axes(base)
        rows = design(state, base, rotation, axes)
        normal = rows.T @ rows
        step = _step(normal, rows.T @ state.residuals, damping)
        moved_base = base + axes @ step[:2]
        moved_base = moved_base / np.linalg.norm(moved_base)
        moved_rotation = rotate(rotation, step[2:])
        moved = misfit(a, b, moved_base, moved_rotation)
        reached = float(moved.residuals @ moved.residuals)
        small = float(np.max(np.abs(step))) < 1e-9
        if reached <= objective:
            still = objective - reached <= 1e-13 * objective
            base, rotation, state, objective = moved_base, moved_rotation, moved, reached
            damping = damping / 10.0 if damping > 1e-10 else 0.0
            converged = (small or still) and damping < 1e-6
        else:
            converged = small
            damping = max(damping * 10.0, 1e-5)
        if converged or damping > 1e10:
            break
    return Coplanarity(base, rotation, state.residuals, objective, normal, axes, converged)


def turned_by(base: FloatArray, rotation: FloatArray, step: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orientation with the base turned by the angle |step[:3]| towards it, and the rotation by δ = step[3:]."""
    axis = cross(base, step[:3])
    return exponential(axis) @ base, rotate(rotation, step[3:])


def design(state: Misfit, base: FloatArray, rotation: FloatArray, axes: FloatArray) -> FloatArray:
    """Derivatives (n, k + 3) of the residuals by k movements ``axes`` (3, k) of the base, and by δ."""
    turned = state.rays_b @ rotation
    across = cross(base, state.rays_a)
    by_base = cross(state.rays_a, turned) @ axes
    by_rotation = cross(turned, across) @ rotation.T
    return np.asarray(np.concatenate([by_base, by_rotation], axis=1) / state.spread[:, None])


def _step(normal: FloatArray, side: FloatArray, damping: float) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(scale, scale) + damping * np.eye(5)
    step = -tolerant.lstsq(scaled, side / scale, rcond=1e-15) / scale
    return np.asarray(step * min(1.0, 0.5 / max(float(np.linalg.norm(step)), 1e-300)))


def in_front(a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray) -> BoolArray:
    """Return (n, 2): is the intersection in front of A, of B? Rays parallel within their noise count as they point."""
    return both_fronts(a, b, base, rotation)[0]


def both_fronts(a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray) -> tuple[BoolArray, BoolArray]:
    """What is in front (n, 2) with this base, and with the opposite one."""
    turned = b.rays @ rotation
    normal = cross(a.rays, turned)
    depths = np.stack([np.einsum("ni,ni->n", cross(base, rays), normal) for rays in (turned, a.rays)], axis=1)
    noise = np.hypot(a.sigma / a.lengths, b.sigma / b.lengths)
    parallel = np.linalg.norm(normal, axis=1) < PARALLAX * noise * (a.lengths * b.lengths)
    same_side = np.einsum("ni,ni->n", a.rays, turned) > 0.0
    ahead, behind = (
        np.where(parallel[:, None], same_side[:, None], towards) for towards in (depths > 0.0, depths < 0.0)
    )
    return ahead, behind
