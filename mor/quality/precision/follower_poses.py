"""Stereo followers in the result: projection centre and attitude, from those of the leading image A and the pair.

    X_p = X0 + h e_Z + D_Aᵀ (b* − r0*)          D_B = D(ω*, φ*, κ*) D_A                  (MOR eqs. 3, 4)

Every image point of a follower has all of these blocks, so the selected inverse has their cofactors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.s_transformation import STransformation
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray, IntArray
from mor.geometry.frames import by_rotation
from mor.parameters.index import Values, tangents
from mor.project.network.entities import Entities
from mor.quality.precision.cofactors import joint_blocks
from mor.sparse.block_matrix import BlockMatrix

PARTS = ("position", "rotation", "height", "eccentricity", "relative rotation", "base")
"""Parts of a follower that its pose depends on; the first four are those of its leading image."""
_KINDS = ("point", "rotation", "height", "eccentricity", "rotation", "base")


class FollowerCofactors(NamedTuple):
    """Blocks (k, 6) of followers, called as ``PARTS``, and cofactors (k, 6, 6) of X_p and the small rotation of D_B."""

    blocks: IntArray
    cofactors: FloatArray


def follower_poses(values: Values, blocks: IntArray) -> tuple[FloatArray, FloatArray]:
    """Projection centres (n, 3) and attitudes (n, 3, 3) of followers by their blocks (n, 6)."""
    position, D, height, eccentricity, relative, base = _values(values, blocks)
    arm = np.einsum("nji,nj->ni", D, base - eccentricity)
    arm[:, 2] += height[:, 0]
    return position + arm, relative @ D


def follower_cofactors(
    adjustment: Adjustment, cofactors: BlockMatrix, datum: STransformation
) -> FollowerCofactors:
    """Cofactors of the poses of all followers that have image points, in the datum of the adjustment, for σ0 = 1."""
    blocks = _measured(adjustment)
    if not len(blocks):
        return FollowerCofactors(blocks, np.zeros((0, 6, 6)))
    index = adjustment.problem.index
    columns = np.concatenate([index.columns[kind][blocks[:, k]] for k, kind in enumerate(_KINDS)], axis=1)
    size = columns.shape[1]
    q = joint_blocks(adjustment, cofactors, datum, columns, np.zeros((len(columns), size, size)))
    design = _derivatives(adjustment, blocks)
    return FollowerCofactors(blocks, design @ q @ np.swapaxes(design, 1, 2))


def of_images(found: FollowerCofactors, images: Entities, followers: IntArray) -> FloatArray:
    """Cofactors (n, 6, 6) of the poses of some images; not a number where a follower has no points."""
    row_of = {tuple(blocks): row for row, blocks in enumerate(found.blocks.tolist())}
    rows = [row_of.get(tuple(blocks), -1) for blocks in follower_blocks(images, followers).tolist()]
    result = np.full((len(rows), 6, 6), np.nan)
    known = np.array(rows, dtype=np.int64) >= 0
    result[known] = found.cofactors[np.array(rows, dtype=np.int64)[known]]
    return result


def follower_blocks(images: Entities, followers: IntArray) -> IntArray:
    """Blocks (n, 6) of images that follow another one."""
    return np.stack([images.parts[part][followers] for part in PARTS], axis=1)


def _values(values: Values, blocks: IntArray) -> list[FloatArray]:
    return [values[kind][blocks[:, k]] for k, kind in enumerate(_KINDS)]


def _measured(adjustment: Adjustment) -> IntArray:
    """Blocks (k, 6) of the followers that image coordinates are of; none of images on trajectories."""
    found = [np.zeros((0, len(PARTS)), dtype=np.int64)]
    for group in adjustment.problem.groups:
        parts = [slot.part if slot.of == "image" else "" for slot in group.type.slots]
        if set(PARTS) <= set(parts):
            own = [group.blocks[parts.index(part)] for part in PARTS]
            leader, pair = own[PARTS.index("rotation")].astype(np.int64), own[PARTS.index("base")]
            _, first = np.unique(leader * (1 + int(pair.max(initial=0))) + pair, return_index=True)
            found.append(np.stack([blocks[first] for blocks in own], axis=1))
    return np.unique(np.concatenate(found), axis=0)


def _derivatives(adjustment: Adjustment, blocks: IntArray) -> FloatArray:
    """(k, 6, 16) derivatives of X_p and of the small rotation of D_B by the unknowns of the blocks (k, 6)."""
    _, D, _, eccentricity, relative, base = _values(adjustment.values, blocks)
    back = np.swapaxes(D, 1, 2)
    result = np.zeros((len(blocks), 6, 16))
    result[:, :3, :3] = np.eye(3)
    result[:, :3, 3:6] = -by_rotation(back, base - eccentricity)
    result[:, 2, 6] = 1.0
    result[:, :3, 7:10] = -back
    result[:, :3, 13:] = back
    result[:, 3:, 3:6] = relative
    result[:, 3:, 10:13] = np.eye(3)
    by_angles = tangents(adjustment.problem.index.blocks["rotation"], adjustment.values["rotation"])
    if by_angles is not None:
        for first, k in ((3, 1), (10, 4)):
            result[:, :, first : first + 3] = result[:, :, first : first + 3] @ by_angles[blocks[:, k]]
    return result
