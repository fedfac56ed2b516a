"""Iterations of a block of panoramas, and of images along trajectories, beside those of frame images.

    python benchmarks/panoramas.py

The same points and rays: frames; panoramas that lie on their side, by the compiled kernel and by the numpy equation it
is tested against; frames and rolling shutters between knots a second apart. Times are CPU seconds, the rounds of all
one after the other, for 100 000 image points; the ratio is the median of its rounds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from problems import Posed, problem_of_block
from rolling_shutters import iteration
from scenes import INTERIOR, SIGMA_IMAGE, Block, aerial

from mor.model.contract import ObservationType
from mor.model.images import IMAGE_TYPES, shutter_on_trajectory
from mor.model.motion import linear_weights
from mor.model.parameters import INTERIORS, READOUT, Blocks, index_unknowns
from mor.model.rotations import rotation_from_angles
from mor.model.trajectory import on_trajectory
from mor.solve.iterate import SolverSettings, adjust
from mor.solve.problem import Problem
from mor.types import FloatArray

OF_PANORAMAS = np.array([100, 0.02, -0.03, 1e-4, 0.01, 0.002, 1e-4, 1e-3, 1e-8, 0.0, 1e-4, 1e-4, 0.0, 0.0])
STRIPS, IMAGES = 10, 20
SINCE, READOUT_TIME = 0.3, 0.03
"""Seconds of an image after its knot, and of the readout."""
ROUNDS = 5


def problem_of_panoramas(block: Block, compiled: bool) -> Posed:
    """The block seen by panoramas, of which five components are free; ``compiled`` or left to the numpy equation."""
    problem, values = problem_of_block(block)
    kind, type_, n = INTERIORS["panorama"], IMAGE_TYPES["panorama"], len(block.image)
    rotation = rotation_from_angles(block.angles + np.array([0.35 * np.pi, 0.0, 0.0]))
    rows = _rows(block, [block.centre[block.image], rotation[block.image]], OF_PANORAMAS)
    seen = type_.equation(rows, type_.equation(rows, np.zeros((n, 2))).values).values
    xy = seen + np.random.default_rng(1).normal(0.0, SIGMA_IMAGE, seen.shape)
    values = {**values, kind.key: OF_PANORAMAS[None], "rotation": rotation}
    del values[INTERIORS["mor"].key]
    blocks = dict(problem.index.blocks)
    del blocks[INTERIORS["mor"].key]
    free = (np.arange(kind.size) < 5)[None]
    blocks = {kind.key: Blocks(kind, ("0",), free, np.zeros((1, kind.size), dtype=np.int64)), **blocks}
    type_ = type_ if compiled else type_._replace(written="in numpy")
    rays = replace(problem.groups[0], type=type_, observed=xy, constants=xy)
    return Problem(index_unknowns(blocks), (rays, *problem.groups[1:]), (), problem.datum), values


def problem_of_images(block: Block, read_out: bool) -> Posed:
    """The strips of the block as trajectories with a knot for each image, and images between them."""
    problem, values = problem_of_block(block)
    kept = block.image % IMAGES < IMAGES - 1
    block = replace(block, image=block.image[kept], of_point=block.of_point[kept], xy=block.xy[kept])
    n, knots = len(block.image), [block.image, block.image + 1]
    rotation = rotation_from_angles(block.angles)
    clock = np.column_stack([np.full(n, SINCE), np.repeat(linear_weights(np.ones(1)).reshape(1, 4), n, axis=0)])
    type_: ObservationType = on_trajectory(IMAGE_TYPES["mor"], 2)
    rows = _rows(block, [*(block.centre[k] for k in knots), *(rotation[k] for k in knots)], INTERIOR)
    between, blocks = np.zeros((n, 1)), dict(problem.index.blocks)
    if read_out:
        type_, between = shutter_on_trajectory("mor", 2), np.tile([0.0, 0.0, -1.0 / 70.0, 0.0], (n, 1))
        rows.insert(-2, np.full((n, 1), READOUT_TIME))
        blocks[READOUT.key] = Blocks(READOUT, ("0",), np.ones((1, 1), bool), np.zeros((1, 1), dtype=np.int64))
        values = {**values, READOUT.key: np.array([[READOUT_TIME]])}
    seen = type_.equation(rows, np.column_stack([block.xy, between, clock])).values
    xy = seen + np.random.default_rng(2).normal(0.0, SIGMA_IMAGE, seen.shape)
    nothing = np.broadcast_to(np.int64(0), (n,))
    given = problem.groups[0]
    rays = replace(
        given,
        type=type_,
        blocks=(*knots, *knots, *([nothing] * (len(rows) - 5)), block.of_point + len(block.centre)),
        observed=xy,
        sigma=given.sigma[kept],
        constants=np.column_stack([xy, between, clock]),
    )
    return Problem(index_unknowns(blocks), (rays, *problem.groups[1:]), (), problem.datum), values


def _rows(block: Block, pose: list[FloatArray], interior: FloatArray) -> list[FloatArray]:
    """Values of all slots for each ray: of pose, height, eccentricity, interior orientation and point."""
    n = len(block.image)
    none = [np.zeros((n, 1)), np.zeros((n, 3))]
    return [*pose, *none, np.repeat(interior[None], n, axis=0), block.point[block.of_point]]


def main() -> None:
    """Print a line for each case."""
    block = aerial(STRIPS, IMAGES)
    cases = {
        "frames": problem_of_block(block),
        "panoramas, compiled": problem_of_panoramas(block, True),
        "panoramas, numpy": problem_of_panoramas(block, False),
        "between knots": problem_of_images(block, False),
        "between knots, read out": problem_of_images(block, True),
    }
    adjusted = [adjust(*posed, SolverSettings(8)) for posed in cases.values()]
    rays = np.array([len(problem.groups[0].observed) for problem, _ in cases.values()])
    seconds = np.array([[iteration(one) for one in adjusted] for _ in range(ROUNDS)]) / rays * 1e5
    ratios = np.median(seconds / seconds[:, :1], axis=0)
    for name, one, n, least, ratio in zip(cases, adjusted, rays, seconds.min(axis=0), ratios, strict=True):
        print(
            f"{name:24s} {one.outcome.value}, {n} image points, {one.problem.index.count} unknowns: "
            f"{least:.3f} s for 100 000, {ratio:.2f} times frames"
        )


if __name__ == "__main__":
    main()
