"""Names of BINGO's files, and the rotation of its orientations."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.arrays import FloatArray

IMAGES, GROUND, ORIENTATIONS = "image.dat", "geoin.dat", "itera.dat"


def is_bingo(names: frozenset[str], path: Path) -> bool:
    """True for a folder with both files, and for one of them beside the other."""
    known = {name.lower() for name in names}
    if {IMAGES, GROUND} <= known:
        return True
    if path.name.lower() not in (IMAGES, GROUND):
        return False
    other = GROUND if path.name.lower() == IMAGES else IMAGES
    return any((path.parent / name).is_file() for name in (other, other.upper()))


def rotation_from_bingo(angles: FloatArray) -> FloatArray:
    """Rotations D (n, 3, 3) from object to image of φ, ω, κ (n, 3), radians: D = (R_y(φ) R_x(ω) R_z(κ))ᵀ."""
    (sp, so, sk), (cp, co, ck) = np.moveaxis(np.sin(angles), -1, 0), np.moveaxis(np.cos(angles), -1, 0)
    rows = [
        [ck * cp + sk * so * sp, sk * co, -ck * sp + sk * so * cp],
        [-sk * cp + ck * so * sp, ck * co, sk * sp + ck * so * cp],
        [co * sp, -so, co * cp],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def bingo_angles(D: FloatArray) -> FloatArray:
    """φ, ω, κ (n, 3), radians, of rotations from object to image (n, 3, 3); κ = 0 where ω is ±100 gon."""
    cosine = np.hypot(D[:, 2, 0], D[:, 2, 2])
    omega = np.arctan2(-D[:, 2, 1], cosine)
    locked = cosine < 1e-9
    phi = np.where(locked, np.arctan2(-D[:, 0, 2], D[:, 0, 0]), np.arctan2(D[:, 2, 0], D[:, 2, 2]))
    kappa = np.where(locked, 0.0, np.arctan2(D[:, 0, 1], D[:, 1, 1]))
    return np.stack([phi, omega, kappa], axis=1)
