"""Memory of an adjustment from its sizes, before any of it is done.

The coefficients were measured: the largest resident size of the whole command, on blocks of 32 000 to 504 000 image
points and networks of 625 to 10 000 points with up to 2 000 long ties (``python -m tests.memory``).
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.plan import Plan
from mor.long_arrays import is_limited

LESS = "fewer observations at a time, or parts of the network by themselves"
"""Advice."""
_NUMBER = 8
_FACTORS = 2
"""The factor, and its selected inverse in the same fronts."""
_FRONTS = 2
"""Dense fronts at a time: that of a parent, and the update it gets."""
_BUFFERS = 20e6
_KERNELS = 30e6
"""Compiled passes over rays, which are loaded when they are needed."""
_OF_RAY, _OF_OTHER = 210, 350
"""Bytes of an image point, and of another row: derivatives, residuals, and what is kept of their quality."""
_OF_RAY_IN_FILES = 80
"""The same of an image point if long arrays are in files: mostly what is kept of its object point."""


def memory_of_adjustment(plan: Plan) -> float:
    """Bytes that iterations and statistics take beside what is there when the plan is made."""
    elimination = plan.elimination
    rows = np.diff(elimination.row_pointers)
    factor = float(np.sum(elimination.pivots * (elimination.pivots + rows)))
    others = sum(len(row_set.rows) for row_set in plan.row_sets)
    dense = _NUMBER * (_FACTORS * factor + _FRONTS * float(elimination.largest_front) ** 2)
    kernels = _KERNELS if len(plan.rays.row) else 0.0
    of_ray = _OF_RAY_IN_FILES if is_limited() else _OF_RAY
    return _BUFFERS + kernels + dense + of_ray * len(plan.rays.row) + _OF_OTHER * others
