"""The reduced system: what is left of the normal equations when the points that only rays meet are eliminated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.sparse.block_matrix import BlockMatrix, BlockStructure


class ReducedSystem(NamedTuple):
    """Normal equations of the unknowns that remain; ``accumulate`` adds to its arrays in place.

    Attributes:
        matrix: S = Σ jᵀj − Σ W N_pp⁻¹ Wᵀ; diagonal blocks hold both triangles.
        right_hand_side: (n,) −Σ jᵀ residual − Σ W N_pp⁻¹ b_p.
        diagonal: (n,) diagonal of Σ jᵀj alone, before the points are eliminated: the measure of what
            vanishes, and of damping.
        gradient: (n,) −Σ jᵀ residual alone, before the points are eliminated.
    """

    matrix: BlockMatrix
    right_hand_side: FloatArray
    diagonal: FloatArray
    gradient: FloatArray


def empty_reduced_system(structure: BlockStructure) -> ReducedSystem:
    """Return a reduced system of zeros."""
    matrix = BlockMatrix(structure, np.zeros(int(structure.position[-1])))
    return ReducedSystem(matrix, *(np.zeros(structure.unknowns) for _ in range(3)))
