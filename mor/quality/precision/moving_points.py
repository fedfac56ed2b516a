"""Points that move: joint cofactors of their coordinates, velocities and oscillations.

Every observation of such a point has all of these blocks, so the selected inverse has their cofactors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.s_transformation import STransformation
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray, IntArray
from mor.parameters.kinds import MOTIONS, POINT
from mor.quality.precision.cofactors import joint_blocks
from mor.sparse.block_matrix import BlockMatrix

SIZE = 3 * (1 + len(MOTIONS))


class MovingCofactors(NamedTuple):
    """Blocks (k, 4) of coordinates, velocity, sine and cosine of points that move, and cofactors (k, 12, 12)."""

    blocks: IntArray
    cofactors: FloatArray


def moving_cofactors(
    adjustment: Adjustment, cofactors: BlockMatrix, datum: STransformation
) -> MovingCofactors:
    """Joint cofactors of every combination of coordinates and movements that observations have, for σ0 = 1."""
    combinations = [np.zeros((0, 1 + len(MOTIONS)), dtype=np.int64)]
    for group in adjustment.problem.groups:
        plain = group.type.still
        if plain is None:
            continue
        positions = [k for k, slot in enumerate(plain.slots) if slot.kind == POINT.key]
        for number, k in enumerate(positions):
            first = len(plain.slots) + number * len(MOTIONS)
            own = np.stack([group.blocks[k], *group.blocks[first : first + len(MOTIONS)]], axis=1)
            combinations.append(own[(own[:, 1:] != 0).any(axis=1)].astype(np.int64))
    blocks = np.unique(np.concatenate(combinations), axis=0)
    columns = adjustment.problem.index.columns
    kinds = (POINT.key, *(kind.key for kind in MOTIONS))
    if not len(blocks):
        return MovingCofactors(blocks, np.zeros((0, SIZE, SIZE)))
    joint = np.concatenate([columns[kind][blocks[:, k]] for k, kind in enumerate(kinds)], axis=1)
    found = joint_blocks(adjustment, cofactors, datum, joint, np.zeros((len(joint), SIZE, SIZE)))
    return MovingCofactors(blocks, found)
