"""Precision of the unknowns, in the datum of the adjustment: cofactor blocks of every parameter block."""

from __future__ import annotations

import numpy as np

from mor.adjustment.datum.s_transformation import STransformation, s_transformation
from mor.adjustment.plan import reduced_columns
from mor.adjustment.state import Adjustment
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.rotations import angles_by_tangent, angles_from_rotation
from mor.sparse.block_matrix import BlockMatrix
from mor.sparse.rows import block_cofactors


def datum_transformation(adjustment: Adjustment) -> STransformation:
    """S-transformation from the minimal datum of the factorisation into the datum of the adjustment."""
    constraint = adjustment.constraint
    return s_transformation(adjustment.defect.datum, constraint, adjustment.inverse.solve(constraint.normals))


def parameter_cofactors(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    of_eliminated: FloatArray,
    datum: STransformation,
    kind: str,
) -> FloatArray:
    """Cofactor matrices (n, k, k) of all blocks of a kind for σ0 = 1; zero rows where fixed.

    ``of_eliminated`` (n, 3, 3), by point block, are those of the eliminated points, in the minimal datum like
    ``cofactors``. The array is taken over: of points it is what is returned.
    Rotations are given for the small rotation vector, or for ω, φ, κ where they move by angles.
    """
    columns = adjustment.problem.index.columns[kind]
    result = of_eliminated if kind == "point" else np.empty((*columns.shape, columns.shape[1]))
    return joint_blocks(adjustment, cofactors, datum, columns, result)


def joint_blocks(
    adjustment: Adjustment,
    cofactors: BlockMatrix,
    datum: STransformation,
    columns: IntArray,
    result: FloatArray,
) -> FloatArray:
    """Cofactor matrices (n, k, k) of sets of unknowns ``columns`` (n, k) that observations have together, σ0 = 1.

    Zero rows where a column is −1; of eliminated points ``result``, which is taken over, has the part of their rays.
    """
    plan = adjustment.plan
    for first in range(0, len(columns), _BLOCKS_AT_A_TIME):
        piece = slice(first, first + _BLOCKS_AT_A_TIME)
        own, q = columns[piece], result[piece]
        kept = (own[:, 0] < 0) | (plan.reduced[own[:, 0]] >= 0)
        reduced = reduced_columns(own[kept], plan.reduced)
        q[kept] = block_cofactors(plan.target, cofactors.values, reduced)
        if adjustment.inverse.weak.shape[1]:
            weak = np.where((own >= 0)[:, :, None], adjustment.inverse.weak[own], 0.0)
            q += weak @ np.swapaxes(weak, 1, 2)
        if datum.null.shape[1]:
            q += datum.correction(own, own)
        held = _held(adjustment, own)
        if held.any():
            q[held[:, :, None] | held[:, None, :]] = 0.0
    return result


_BLOCKS_AT_A_TIME = 50_000
"""Blocks that are worked on together: the indices of a million of them would take more room than their cofactors."""


def _held(adjustment: Adjustment, columns: IntArray) -> BoolArray:
    """Components that carry a minimal datum: as many as there are free movements, they do not move at all."""
    mask = adjustment.constraint.mask
    if len(mask) == 0 or np.count_nonzero(mask) != adjustment.defect.datum.shape[1]:
        return np.zeros(columns.shape, dtype=bool)
    return (columns >= 0) & mask[columns]


def angle_cofactors(q: FloatArray, D: FloatArray, by_angles: BoolArray) -> FloatArray:
    """Cofactors (n, 3, 3) of ω, φ, κ from those of the small rotation vectors, rigorously; infinite at φ = ±100 gon.

    Rotations that move ``by_angles`` have their cofactors for the angles already.
    """
    to_angles = angles_by_tangent(angles_from_rotation(D))
    to_angles[by_angles] = np.eye(3)
    with np.errstate(invalid="ignore"):
        turned: FloatArray = to_angles @ q @ np.swapaxes(to_angles, 1, 2)
    return turned
