"""Orientations for every direction of the base, where parallaxes are small beside their errors.

The errors of the linear system are squared errors of the rays: where a base is so short that parallaxes are few σ, it
can lead to another minimum than the least. Then, however, the second bundle is all but the first one turned. About that
turn the coplanarity is linear in the rest δ of the rotation: for a base b, with u = D*ᵀ p'' in the axes of A,

    g + g_δ · δ = 0,      g = b · (p' × u),      g_δ = u × (b × p')

so for each of many directions of b the best δ and Σ (v/σ)² follow at once, and the minima of that map are all there
are.
"""

from __future__ import annotations

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.vectors import cross
from mor.arrays import FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import exponential

DIRECTIONS = 100
"""Over half a sphere: 0.25 rad from one to the next; the opposite direction has the same map."""
NEIGHBOURS = 0.45
"""Angle in radians within which a minimum of the map is to be the least."""
MOST = 6
"""Best minima that are given on."""


def minima_over_directions(a: Bundle, b: Bundle, turn: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Orientations (b, D*) at the minima of the map, best first; ``turn`` (3, 3) is D* of no base."""
    bases = _half_sphere()
    objectives, rests = _map(a, b, turn, bases)
    near = np.abs(bases @ bases.T) > np.cos(NEIGHBOURS)
    least = objectives <= np.min(np.where(near, objectives[None], np.inf), axis=1)
    order = [k for k in np.argsort(objectives) if least[k]][:MOST]
    return [(bases[k], turn @ exponential(-rests[k])) for k in order]


def _half_sphere() -> FloatArray:
    """Evenly spread unit vectors (m, 3): equal steps in height, the golden angle from one to the next."""
    index = np.arange(DIRECTIONS)
    z = (index + 0.5) / DIRECTIONS
    turn = np.pi * (3.0 - np.sqrt(5.0)) * index
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def _map(a: Bundle, b: Bundle, turn: FloatArray, bases: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Σ (v/σ)² (m,) and the rotations δ (m, 3), in the axes of A, that reach it."""
    rays, turned = a.rays, b.rays @ turn
    crossed, moment = cross(turned[None], bases[:, None]), cross(bases[:, None], rays[None])
    slope_a = np.einsum("mni,nij->mnj", crossed, a.whitened_axes)
    slope_b = np.einsum("mni,nij->mnj", moment, np.einsum("ki,nkj->nij", turn, b.whitened_axes))
    spread = np.sqrt(np.sum(slope_a**2, axis=2) + np.sum(slope_b**2, axis=2))
    spread = np.maximum(
        spread, 1e-3 * np.max(spread, axis=1, keepdims=True)
    )  # a ray along the base says nothing
    condition = bases @ cross(rays, turned).T / spread
    rows = cross(turned[None], moment) / spread[:, :, None]
    normal, side = np.swapaxes(rows, 1, 2) @ rows, np.einsum("mni,mn->mi", rows, condition)
    scale = np.trace(normal, axis1=1, axis2=2)
    rest = -tolerant.solve(normal + 1e-12 * scale[:, None, None] * np.eye(3), side[:, :, None])[:, :, 0]
    return np.sum(condition**2, axis=1) + np.einsum("mi,mi->m", side, rest), rest
