"""Grow a block of images: resection, intersection, local adjustment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse

from mor.linalg.block_matrix import BlockMatrix, BlockStructure
from mor.linalg.cholesky import NotFiniteError, factorise
from mor.linalg.symbolic import analyse
from mor.model import rotations
from mor.model.rotations import cross_matrix, rotate
from mor.start.bundle import Bundle, direction_bundle, evenly, misfits, reproject
from mor.start.intersection import SMALLEST_ANGLE, PosedFrames, meet, posed_frames
from mor.start.part import SLACKS, Frame, Part, Sightings, empty_part, loosened, rule
from mor.start.resection import AGREES, Pose, ResectionOutcome, adjust_pose, resect, star_of
from mor.start.scene import Scene, make_upright
from mor.types import BoolArray, FloatArray, IntArray

# ---- The pose of one frame from the points known so far: like its neighbour if that fits, else in closed form.


def pose_frame(part: Part, frame: Frame, number: int, slacks: Sequence[float] = SLACKS) -> bool:
    """Add the pose of a frame to the part; true where the points it sees allow one, with one of some slacks."""
    known, targets = _known_points(part, frame)
    # Known points from which the pose of a neighbour is tried as a start.
    if len(known) >= 10 and _like_a_neighbour(part, frame, number, known, targets):
        return True
    usable = [s for s in slacks if s >= part.slack]
    # Of few points none is to be left out as long as a looser fit has them all: four fit many a wrong pose.
    # Known points from which some may be left out of a resection at once.
    least = [len(known)] * len(usable) if len(known) < 6 else []
    least += [least_agreeing(len(known))] * len(usable)
    for slack, enough in zip([*usable, *usable][-len(least) :], least, strict=True):
        bundle = direction_bundle(frame.rays[known], loosened(frame.sigma[known], slack))
        result = resect(bundle, targets)
        agreeing = int(np.count_nonzero(result.agreeing))
        if result.outcome in (ResectionOutcome.DETERMINED, ResectionOutcome.WEAK) and agreeing >= enough:
            _enter(part, frame, number, Pose(result.position, result.rotation), agreeing, len(known))
            return True
    return False


def least_agreeing(known: int) -> int:
    """Return the least number of known points that must agree with a pose."""
    return max(4, int(np.ceil(0.6 * known)))


def _known_points(part: Part, frame: Frame) -> tuple[IntArray, FloatArray]:
    known = evenly(np.flatnonzero(part.known(frame.points)), 60)
    targets = part.points[frame.points[known]]
    targets[:, 2] += frame.heights[known]
    return known, targets


def _enter(part: Part, frame: Frame, number: int, pose: Pose, agreeing: int, of: int) -> None:
    part.poses[number] = (pose.position, pose.rotation)
    part.how[frame.name] = rule("resection from {count} of {of} points", count=agreeing, of=of)


def _like_a_neighbour(part: Part, frame: Frame, number: int, known: IntArray, targets: FloatArray) -> bool:
    """Pose by adjustment alone, begun at the pose of the frame that shares most points; true where it fits.

    Aerial images and image sequences go this way; a closed form with sampling takes ten times as long.
    """
    neighbours = part.seen_by[frame.points[known]]
    neighbours = neighbours[neighbours >= 0]
    if len(neighbours) == 0:
        return False
    start = Pose(*part.poses[int(np.bincount(neighbours).argmax())])
    bundle = direction_bundle(frame.rays[known], loosened(frame.sigma[known], max(part.slack, SLACKS[1])))
    pose = adjust_pose(bundle, targets, start, 15)
    agreeing = misfits(bundle, star_of(targets, pose)[None])[0] < AGREES
    if np.count_nonzero(agreeing) < 0.8 * len(known):
        return False
    _enter(part, frame, number, pose, int(np.count_nonzero(agreeing)), len(known))
    return True


def observed_centres(
    part: Part, frames: Sequence[Frame], turns: FloatArray, targets: FloatArray
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return the centres (n, 3) and σ (n, 3) of frames with rotations D (n, 3, 3) and a given position.

    O = X0 + h e_Z − Dᵀ r0*. What is given as exact is held by some part of the distance to the targets (m, 3).
    """
    position = np.array([frame.position for frame in frames], dtype=np.int64)
    known = part.fixed[position] & np.array([frame.stands for frame in frames])
    offset = np.array([frame.offset for frame in frames])
    place = part.points[position] - (turns.transpose(0, 2, 1) @ offset[:, 1:, None])[:, :, 0]
    place[:, 2] += offset[:, 0]
    away = np.maximum(np.abs(targets.min(axis=0) - place), np.abs(targets.max(axis=0) - place))
    # σ of a position that is given as exact, in parts of the distance to the points.
    exact = 1e-6 * away.max(axis=1, keepdims=True)
    own = part.sigma[position]
    return known, place, np.maximum(np.where(np.isfinite(own), own, part.place_sigma), exact)


# ---- Frames at the edge of what is known, adjusted together with the points they see.
#
# Such a frame is tied on one side only. Posed one by one, each on points of the last, small errors in
# attitude grow from row to row by a constant factor; adjusted together with its neighbours they do not. It is
# one step of a bundle adjustment of some points of some frames: points eliminated, frames outside held, given
# positions with their σ. More steps are not needed, for every frame takes part several times.


class _PosedRays(NamedTuple):
    """Rays of posed frames to the points that take part."""

    bundle: Bundle
    frame: IntArray
    column: IntArray
    """Number among the moving frames, −1 where a frame is held."""
    point: IntArray
    """Number among the points."""
    height: FloatArray
    held: BoolArray
    """(points,) true where the coordinates are given."""


def settle(part: Part, frames: Sequence[Frame], seen: Sightings, poses: PosedFrames, moving: Sequence[int]) -> None:
    """Adjust the poses of the ``moving`` frames, in ``part`` and in ``poses``; the points only lead to them."""
    points = _points(part, frames, moving)
    if len(points) == 0:
        return
    column = np.full(seen.frames, -1, dtype=np.int64)
    column[list(moving)] = np.arange(len(moving))
    rays = _rays(part, seen, poses, points, column)
    try:
        change = _step(part, frames, poses, rays, part.points[points], moving)
    except NotFiniteError:
        return
    poses.centres[list(moving)] += change[:, :3]
    poses.turns[list(moving)] = rotate(poses.turns[list(moving)], change[:, 3:])
    for number in moving:
        part.poses[number] = (poses.centres[number].copy(), poses.turns[number].copy())


def _points(part: Part, frames: Sequence[Frame], moving: Sequence[int]) -> IntArray:
    """Return some points of each frame, the first in a random order, so that frames have them in common."""
    chosen = np.zeros(len(part.points), dtype=bool)
    for number in moving:
        points = frames[number].points
        points = points[part.known(points)]
        if len(points) > 40:
            # Their order has nothing to do with their numbers (Fibonacci hashing).
            points = points[np.argpartition((points * 2654435769) % 2**32, 40)[:40]]
        chosen[points] = True
    return np.flatnonzero(chosen)


def _rays(part: Part, seen: Sightings, poses: PosedFrames, points: IntArray, column: IntArray) -> _PosedRays:
    rays = seen.of_points(points)
    point = np.repeat(np.arange(len(points)), seen.pointers[points + 1] - seen.pointers[points])
    posed = np.isfinite(poses.centres[seen.frame[rays], 0])
    rays, point = rays[posed], point[posed]
    sigma = loosened(seen.sigma[rays], max(part.slack, SLACKS[1]))
    frame = seen.frame[rays]
    bundle = direction_bundle(seen.rays[rays], sigma)
    return _PosedRays(bundle, frame, column[frame], point, seen.height[rays], part.fixed[points])


def _step(
    part: Part, frames: Sequence[Frame], poses: PosedFrames, rays: _PosedRays, X: FloatArray, moving: Sequence[int]
) -> FloatArray:
    """One step of Gauss–Newton, points eliminated: changes (m, 6) of X0 and δ of the moving frames."""
    residuals, by_pose, by_point = _linearised(poses, rays, X)
    of_points = _summed(by_point, by_point, rays.point, len(X))
    size = np.trace(of_points, axis1=1, axis2=2)
    tie = np.where(size > 0.0, np.where(rays.held, 1e12, 1e-9) * size, 1.0)
    of_points += tie[:, None, None] * np.eye(3)
    inverse = rotations.inv(of_points).astype(np.float64)
    point_side = _summed(by_point, residuals[:, :, None], rays.point, len(X))[:, :, 0]
    order = np.argsort(rays.column, kind="stable")[np.count_nonzero(rays.column < 0) :]
    row, column, shape = rays.column[order], rays.point[order], (len(moving), len(X))
    by_pose = by_pose[order]
    of_frames = _summed(by_pose, by_pose, row, len(moving))
    frame_side = _summed(by_pose, residuals[order][:, :, None], row, len(moving))[:, :, 0]
    known, place, sigma = observed_centres(part, [frames[number] for number in moving], poses.turns[list(moving)], X)
    held = np.flatnonzero(known)
    weight = sigma[held] ** -2.0
    of_frames[held[:, None], np.arange(3), np.arange(3)] += weight
    frame_side[held, :3] += weight * (poses.centres[list(moving)][held] - place[held])
    own = np.einsum("nii->ni", of_frames)
    own += np.where(own > 0.0, 1e-9 * own, 1.0)
    mixed = by_pose.transpose(0, 2, 1) @ by_point[order]
    across = _blocks(mixed, row, column, shape)
    reach = _blocks(mixed @ inverse[column], row, column, shape)
    each = np.arange(len(moving))
    diagonal = _blocks(of_frames, each, each, (len(moving), len(moving)))
    reduced = _lower_triangle((diagonal - reach @ across.T).tobsr())
    return _solved(reduced, frame_side.ravel() - reach @ point_side.ravel()).reshape(-1, 6)


def _linearised(poses: PosedFrames, rays: _PosedRays, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (n, 2), derivatives (n, 2, 6) by the pose and (n, 2, 3) by the point; 0 for rays that pass by."""
    D = poses.turns[rays.frame]
    away = X[rays.point] - poses.centres[rays.frame]
    away[:, 2] += rays.height
    star = np.einsum("nij,nj->ni", D, away)
    computed = reproject(rays.bundle, star)
    # Misfit in units of σ up to which a ray has a say.
    near = np.linalg.norm(computed.residuals, axis=1) < 10.0
    by_star = computed.by_star * near[:, None, None]
    by_point = by_star @ D
    by_pose = np.concatenate([-by_point, by_star @ cross_matrix(star)], axis=2)
    return computed.residuals * near[:, None], by_pose, by_point


def _summed(first: FloatArray, second: FloatArray, number: IntArray, count: int) -> FloatArray:
    """Sums (count, i, j) of firstᵀ second of the rays of each ``number`` (n,), which ascends."""
    products = first.transpose(0, 2, 1) @ second
    begins = np.flatnonzero(np.diff(number, prepend=-1))
    summed = np.zeros((count, *products.shape[1:]))
    summed[number[begins]] = np.add.reduceat(products, begins, axis=0)
    return summed


def _blocks(blocks: FloatArray, row: IntArray, column: IntArray, shape: tuple[int, int]) -> scipy.sparse.bsr_array:
    _, height, width = blocks.shape
    pointers = np.searchsorted(row, np.arange(shape[0] + 1))
    size = (height * shape[0], width * shape[1])
    return scipy.sparse.bsr_array((blocks, column, pointers), shape=size, blocksize=(height, width))


def _lower_triangle(matrix: scipy.sparse.bsr_array) -> BlockMatrix:
    """A symmetric matrix of square blocks as the factorisation takes it, which has an entry in every diagonal block."""
    matrix.sort_indices()
    count = len(matrix.indptr) - 1
    row = np.repeat(np.arange(count), np.diff(matrix.indptr))
    kept = matrix.indices >= row
    column_pointers = np.concatenate([[0], np.cumsum(np.bincount(row[kept], minlength=count))])
    structure = BlockStructure(
        6 * np.arange(count + 1),
        column_pointers.astype(np.int64),
        matrix.indices[kept].astype(np.int64),
        36 * np.arange(int(kept.sum()) + 1),
    )
    return BlockMatrix(structure, matrix.data[kept].transpose(0, 2, 1).ravel())


def _solved(matrix: BlockMatrix, side: FloatArray) -> FloatArray:
    """Return x of matrix · x = −side, scaled; singular unknowns stay. Raises :class:`NotFiniteError`."""
    diagonal = matrix.diagonal()
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    factor = factorise(matrix.scaled(scale), analyse(matrix.structure))
    return -scale * factor.solve(scale * side)


# ---- Grow a part by resection of frames and intersection of points, until nothing more can be known.
#
# Every round looks only at what is new: points that newly posed frames see, frames that see newly known
# points. The time is that of the rays, however many frames see one another.

ENOUGH = 6
"""Known points in a frame from which a resection is unambiguous and controlled."""
FEWEST = 4
"""Known points from which a frame can be resected where there is no other way."""


def grow_bundles(part: Part, frames: Sequence[Frame], seen: Sightings, fewest: int, most: int | None = None) -> bool:
    """Add poses and points to the part; true where anything was added.

    ``fewest`` known points a frame needs for a resection: with 4 a wrong solution may pass for right. The growth pauses
    once ``most`` frames were posed.
    """
    poses = posed_frames(part.poses, seen.frames)
    refused = np.zeros(seen.frames, dtype=np.int64)
    counts = _seen(seen, np.flatnonzero(np.isfinite(part.points).all(axis=1)))
    posed = sorted(part.poses)
    # Frames just joined to given positions that settle with those posed first.
    just_tied = part.place_sigma > 0.0 and len(posed) <= 200
    front = [[number for number in posed if just_tied and frames[number].name in part.how]]
    before, grown = len(posed), False
    while True:
        for number in posed:
            part.seen_by[frames[number].points] = number
            poses.centres[number], poses.turns[number] = part.poses[number]
        fresh = _intersect(part, frames, seen, poses, posed)
        # Frames at least that are posed before they settle.
        if front[-1] and (len(front[-1]) >= 6 or not posed):
            moving = [number for batch in front for number in batch]
            settle(part, frames, seen, poses, moving)
            # What only frames between see changes little, and again with the next batch.
            _intersect(part, frames, seen, poses, [*front[0], *front[-1]] if posed else moving)
            # Batches before them that settle with them: with fewer, errors still grow from row to row of an aerial
            # block.
            front = [*front[-5:], []]
        counts += _seen(seen, fresh)
        paused = most is not None and len(part.poses) - before >= most
        without = np.isnan(poses.centres[:, 0])
        posed = [] if paused else _pose_best(part, frames, np.where(without, counts, 0), refused, fewest)
        front[-1].extend(posed)
        grown |= bool(len(fresh) or posed)
        if not (len(fresh) or posed) or paused:
            return grown


def _intersect(
    part: Part, frames: Sequence[Frame], seen: Sightings, poses: PosedFrames, posed: Sequence[int]
) -> IntArray:
    """Intersect the points that some frames see, also again; those newly known."""
    touched = np.zeros(len(part.points), dtype=bool)
    for number in posed:
        touched[frames[number].points] = True
    points = np.flatnonzero(touched & ~part.fixed)
    known = part.known(points)
    found = meet(points, seen, poses, max(part.slack, SLACKS[1]))
    part.points[points[found.good]] = found.X[found.good]
    fresh: IntArray = points[found.good & ~known]
    return fresh


def intersect_again(part: Part, frames: Sequence[Frame], seen: Sightings, moved: Sequence[int]) -> None:
    """Intersect the points that frames see whose poses are others now."""
    _intersect(part, frames, seen, posed_frames(part.poses, seen.frames), moved)


def _seen(seen: Sightings, points: IntArray) -> IntArray:
    return np.bincount(seen.frame[seen.of_points(points)], minlength=seen.frames)


def _pose_best(part: Part, frames: Sequence[Frame], counts: IntArray, refused: IntArray, fewest: int) -> list[int]:
    """Pose the frames that see the most known points; ``refused`` remembers with how many a frame failed."""
    usable = (counts >= fewest) & (counts > refused)
    posed: list[int] = []
    while usable.any() and not posed:
        # Frames are posed in one round that see so large a part of the most known points that any of them sees.
        threshold = max(fewest, int(0.5 * counts[usable].max()))
        chosen = np.flatnonzero(usable & (counts >= threshold))
        for number in chosen[np.argsort(-counts[chosen], kind="stable")].tolist():
            if pose_frame(part, frames[number], number):
                posed.append(number)
            else:
                refused[number] = counts[number]
        usable &= counts > refused
    return posed


def pose_the_rest(part: Part, frames: Sequence[Frame]) -> bool:
    """Frames that contradict the points they see, which may be rough themselves: better a rough pose than none."""
    posed = False
    for number, frame in enumerate(frames):
        if number in part.poses:
            continue
        known = part.known(frame.points)
        if np.count_nonzero(known) >= FEWEST:
            # Slacks (radians) of frames that see points whose places are rough.
            posed |= pose_frame(part, frame, number, (0.03, 0.1))
    return posed


def intersect_the_rest(part: Part, seen: Sightings) -> None:
    """Points that only rays see that do not meet, or hardly at an angle: better a rough value than none.

    The adjustment will tell which of their rays is wrong.
    """
    points = np.flatnonzero(np.isnan(part.points).any(axis=1) & (np.diff(seen.pointers) > 1))
    if len(points) and len(part.poses) > 1:
        poses = posed_frames(part.poses, seen.frames)
        found = meet(points, seen, poses, np.inf, 0.1 * SMALLEST_ANGLE, rounds=1)
        here = part.points[points[found.good]]
        part.points[points[found.good]] = np.where(np.isnan(here), found.X[found.good], here)


# ---- Parts that are there from the start: systems with measured coordinates, GNSS vectors, tilted total stations.


def rigid_seeds(scene: Scene) -> Iterator[Part]:
    """Every part of points that were measured in one system of their own."""
    for system in scene.systems:
        part = empty_part(scene.points)
        part.points[system.points] = system.coordinates
        part.scaled = system.scaled
        if np.isfinite(system.up).all():
            make_upright(part, system.up)
        part.began = rule("coordinates in {one}", one=system.name)
        part.how |= {f"point {p}": part.began for p in system.points.tolist()}
        yield part
    for cluster in scene.vector_clusters:
        part = empty_part(scene.points)
        part.points[cluster.points] = cluster.values
        part.began = rule("vector")
        part.levelled = part.oriented = part.scaled = True
        part.how |= {f"point {p}": part.began for p in cluster.points.tolist()}
        yield part


def seed_polar(scene: Scene, free: list[int]) -> Part | None:
    """The axes of the first free instrument that measured distances and is not upright; its points are polar points."""
    for number in free:
        if len(polar_points(scene, scene.bare[0], number)) >= 3:
            part = empty_part(scene.points)
            part.poses[number] = (np.zeros(3), np.eye(3))
            part.scaled = True
            part.began = rule("axes of {one}", one=scene.frames[number].name)
            part.how[scene.frames[number].name] = part.began
            return part
    return None


def polar_points(scene: Scene, frames: Sequence[Frame], number: int) -> dict[int, FloatArray]:
    """Point → its coordinates (3,) in the axes of an instrument, where ray and distance were measured."""
    frame, slopes = frames[number], scene.terrestrial.slopes
    rows = np.flatnonzero((slopes.start == frame.position) & (slopes.start_block == frame.height))
    length = dict(zip(slopes.end[rows].tolist(), slopes.value[rows, 0], strict=True))
    return {p: length[p] * ray for p, ray in zip(frame.points.tolist(), frame.rays, strict=True) if p in length}


def grow_polar(part: Part, scene: Scene) -> bool:
    """Add points by ray and distance from posed instruments; true where anything was added."""
    if not part.scaled:
        return False
    added, frames = False, scene.rays_for(part)[0]
    for number in range(scene.image_count, len(frames)):
        if number not in part.poses or part.known(frames[number].points).all():
            continue
        centre, D = part.poses[number]
        frame = frames[number]
        heights = dict(zip(frame.points.tolist(), frame.heights, strict=True))
        for point, star in polar_points(scene, frames, number).items():
            if np.isnan(part.points[point]).any():
                part.points[point] = centre + D.T @ star - [0.0, 0.0, heights[point]]
                part.how[f"point {point}"] = rule("polar from {one}", one=frame.name)
                added = True
    return added
