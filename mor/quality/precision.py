"""Precision: cofactors, covariance matrices, confidence ellipses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mor.linalg.block_matrix import BlockMatrix, block_cofactors
from mor.model import rotations
from mor.model.parameters import MOTIONS, POINT, Values, tangents
from mor.model.rotations import angles_by_tangent, angles_from_rotation, by_rotation
from mor.project.entities import Entities
from mor.solve.datum import STransformation, s_transformation
from mor.solve.iterate import Adjustment
from mor.solve.normals import reduced_columns
from mor.types import BoolArray, FloatArray, IntArray, pieces

# ---- Precision of the unknowns, in the datum of the adjustment: cofactor blocks of every parameter block.


def datum_transformation(adjustment: Adjustment) -> STransformation:
    """S-transformation from the minimal datum of the factorisation into the datum of the adjustment."""
    constraint = adjustment.constraint
    return s_transformation(adjustment.defect.datum, constraint, adjustment.inverse.solve(constraint.normals))


def parameter_cofactors(
    adjustment: Adjustment, cofactors: BlockMatrix, of_eliminated: FloatArray, datum: STransformation, kind: str
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
    adjustment: Adjustment, cofactors: BlockMatrix, datum: STransformation, columns: IntArray, result: FloatArray
) -> FloatArray:
    """Cofactor matrices (n, k, k) of sets of unknowns ``columns`` (n, k) that observations have together, σ0 = 1.

    Zero rows where a column is −1; of eliminated points ``result``, which is taken over, has the part of their rays.
    """
    plan = adjustment.plan
    # The indices of a million blocks would take more room than their cofactors.
    for piece in pieces(len(columns), 50_000):
        own, q = columns[piece], result[piece]
        firsts = own[:, :1]
        kept = (firsts < 0)[:, 0] | (reduced_columns(firsts, plan.reduced) >= 0)[:, 0]
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


# ---- Error ellipses and ellipsoids: semi-axes and their directions, from covariances of coordinates.


class Ellipses(NamedTuple):
    """Standard error ellipses in plan of n points."""

    a: FloatArray
    """(n,) larger semi-axis."""
    b: FloatArray
    """(n,) smaller semi-axis."""
    azimuth: FloatArray
    """(n,) of the larger one, radians clockwise from north, 0 to π."""


class Ellipsoids(NamedTuple):
    """Standard error ellipsoids of n points."""

    axes: FloatArray
    """(n, 3) semi-axes, the largest first."""
    azimuths: FloatArray
    """(n, 3) of the semi-axes, radians clockwise from north; of that end which does not point down."""
    elevations: FloatArray
    """(n, 3) above the horizontal plane, radians, 0 to π/2."""


def error_ellipses(covariance: FloatArray) -> Ellipses:
    """Ellipses of covariances (n, 2 or more, …) whose first two components are east and north."""
    east, north, both = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    mean, half = 0.5 * (east + north), np.hypot(0.5 * (north - east), both)
    a, b = np.sqrt(np.maximum(mean + half, 0.0)), np.sqrt(np.maximum(mean - half, 0.0))
    return Ellipses(a, b, 0.5 * np.arctan2(2.0 * both, north - east) % np.pi)


def error_ellipsoids(covariance: FloatArray) -> Ellipsoids:
    """Ellipsoids of covariances (n, 3, 3) in east, north, up."""
    eigenvalues, vectors = rotations.eigh(0.5 * (covariance + np.swapaxes(covariance, 1, 2)))
    directions = np.swapaxes(vectors, 1, 2)[:, ::-1]
    east, north, up = np.moveaxis(directions, -1, 0)
    # Both ends of a level axis are as good: it is the one in the eastern half, whatever the round-off in its height.
    other_end = np.where(np.abs(up) > 1e-9, up < 0.0, (east < 0.0) | ((east == 0.0) & (north < 0.0)))
    east, north, up = (np.where(other_end, -part, part) for part in (east, north, up))
    return Ellipsoids(
        np.sqrt(np.maximum(eigenvalues[:, ::-1], 0.0)),
        np.arctan2(east, north) % (2.0 * np.pi),
        np.arcsin(np.clip(up, 0.0, 1.0)),
    )


def confidence_factor(dimensions: int, redundancy: float | None) -> float:
    """Factor from the standard ellipse or ellipsoid to that which holds the point with a probability of 95 %.

    With σ0 a posteriori of a ``redundancy`` from F, with σ0 a priori (``None``) from χ².
    """
    from scipy.special import chdtri, fdtri

    if redundancy is None:
        return math.sqrt(float(chdtri(dimensions, 0.05)))
    return math.sqrt(dimensions * float(fdtri(dimensions, redundancy, 0.95)))


# ---- Stereo followers in the result: projection centre and attitude, from those of the leading image A and the pair.
#
#     X_p = X0 + h e_Z + D_Aᵀ (b* − r0*)          D_B = D(ω*, φ*, κ*) D_A                  (MOR eqs. 3, 4)
#
# Every image point of a follower has all of these blocks, so the selected inverse has their cofactors.

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


def follower_cofactors(adjustment: Adjustment, cofactors: BlockMatrix, datum: STransformation) -> FollowerCofactors:
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


# ---- Points that move: joint cofactors of their coordinates, velocities and oscillations.
#
# Every observation of such a point has all of these blocks, so the selected inverse has their cofactors.


class MovingCofactors(NamedTuple):
    """Blocks (k, 4) of coordinates, velocity, sine and cosine of points that move, and cofactors (k, 12, 12)."""

    blocks: IntArray
    cofactors: FloatArray


def moving_cofactors(adjustment: Adjustment, cofactors: BlockMatrix, datum: STransformation) -> MovingCofactors:
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
    size = 3 * (1 + len(MOTIONS))
    if not len(blocks):
        return MovingCofactors(blocks, np.zeros((0, size, size)))
    joint = np.concatenate([columns[kind][blocks[:, k]] for k, kind in enumerate(kinds)], axis=1)
    found = joint_blocks(adjustment, cofactors, datum, joint, np.zeros((len(joint), size, size)))
    return MovingCofactors(blocks, found)
