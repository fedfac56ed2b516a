"""Precision of the unknowns, in the datum of the adjustment: cofactor blocks of every parameter block."""

from __future__ import annotations

import numpy as np

from mor.adjustment.block_matrix import BlockMatrix
from mor.adjustment.datum import STransformation, s_transformation
from mor.adjustment.rows import Target, block_cofactors
from mor.adjustment.solve import Adjustment
from mor.geometry.arrays import FloatArray
from mor.geometry.rotations import angles_by_tangent, angles_from_rotation
from mor.parameters.index import partly_free


def datum_transformation(adjustment: Adjustment) -> STransformation:
    """S-transformation from the minimal datum of the factorisation into the datum of the adjustment."""
    constraint = adjustment.constraint
    return s_transformation(adjustment.defect.datum, constraint, adjustment.inverse.solve(constraint.normals))


def parameter_cofactors(
    adjustment: Adjustment, cofactors: BlockMatrix, datum: STransformation, kind: str
) -> FloatArray:
    """Cofactor matrices (n, k, k) of all blocks of a kind for σ0 = 1; zero rows where fixed.

    Rotations are given for ω, φ, κ (rigorously, from the small rotation vector).
    """
    index = adjustment.problem.index
    columns = index.columns[kind]
    plan = adjustment.plan
    q = block_cofactors(Target(plan.target.structure, plan.target.block_of), cofactors.values, columns)
    weak = np.where((columns >= 0)[:, :, None], adjustment.inverse.weak[columns], 0.0)
    q = q + weak @ np.swapaxes(weak, 1, 2) + datum.correction(columns, columns)
    blocks = index.blocks[kind]
    if not blocks.kind.is_rotation:
        return q
    to_angles = angles_by_tangent(angles_from_rotation(adjustment.values[kind]))
    to_angles[partly_free(blocks)] = np.eye(3)
    with np.errstate(invalid="ignore"):
        turned: FloatArray = to_angles @ q @ np.swapaxes(to_angles, 1, 2)
    return turned
