"""Which targets are seen from where, and why others are not."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.triangles import hidden
from mor.planning.visibility.surfaces import Surroundings


class Limits(NamedTuple):
    """Limits of sights, internal units."""

    nearest: float = 0.0
    farthest: float = np.inf
    incidence: float = 0.5 * np.pi
    steepest: float = 0.5 * np.pi


def outcomes(
    origin: FloatArray,
    up: FloatArray,
    targets: FloatArray,
    normals: FloatArray,
    limits: Limits,
    around: Surroundings,
    shows: Callable[[FloatArray], BoolArray] | None,
) -> IntArray:
    """(n,) what becomes of the sights from one place (3,) to targets (n, 3), as a number of ``REASONS``.

    ``up`` (3,) is upwards there. ``normals`` (n, 3) are NaN if a target has none; ``shows`` says what is on the
    format of an image.
    """
    step = targets - origin
    length = np.linalg.norm(step, axis=1)
    found = np.zeros(len(targets), dtype=np.int64)
    found[~((length > 0.0) & (length >= limits.nearest) & (length <= limits.farthest))] = 1
    left = np.flatnonzero(found == 0)
    direction = step[left] / length[left, None]
    framed = shows(targets[left]) if shows else np.abs(direction @ up) <= np.sin(limits.steepest)
    slant = -np.einsum("ki,ki->k", direction, normals[left])
    away = np.isfinite(slant) & ((slant < np.cos(limits.incidence)) | (slant <= 0.0))
    found[left[away]] = 3
    found[left[~framed]] = 2
    left = np.flatnonzero(found == 0)
    origins = np.broadcast_to(origin, (len(left), 3))
    found[left[hidden(origins, targets[left], around.obstacles, around.clearance)]] = 4
    return found
