"""Iterations of a block of 500 images with rolling shutters beside those of frame images.

    python benchmarks/rolling_shutters.py

The same block three times: frames, rolling shutters with a motion of six unknowns for each image, and with motions that
are known. Times are CPU seconds, the rounds of the three one after the other: the ratio is the median of its rounds.
"""

from __future__ import annotations

import numpy as np
from measure import now, since
from problems import Posed, problem_of_block
from scenes import INTERIOR, SIGMA_IMAGE, Block, aerial

from mor.model.contract import ObservationGroup
from mor.model.coordinates import OBSERVED_PARAMETERS
from mor.model.images import MOVING_TYPES
from mor.model.parameters import IMAGE_VELOCITY, READOUT, ROTATION_RATE, BlockKind, Blocks, index_unknowns
from mor.model.rotations import rotation_from_angles
from mor.solve.inverse import invert_alike
from mor.solve.iterate import Adjustment, adjust
from mor.solve.normals import build_normals, full_step
from mor.solve.problem import Problem
from mor.types import FloatArray

READOUT_TIME = 0.03
SIGMAS = {"image velocity": 0.3, "rotation rate": 0.005}
"""Of the observed motions, m/s and rad/s."""
ROUNDS = 10


def problem_of_rolling_shutters(block: Block, known: bool) -> Posed:
    """An image block flown at 60 m/s; the readout time is free, the motions are observed, or ``known``."""
    problem, values = problem_of_block(block)
    images, n, random = len(block.centre), len(block.image), np.random.default_rng(3)
    truth = {
        "image velocity": random.normal((60.0, 0.0, 0.0), (3.0, 2.0, 1.0), (images, 3)),
        "rotation rate": random.normal(0.0, 0.03, (images, 3)),
    }
    blocks = dict(problem.index.blocks) | {READOUT.key: _blocks(READOUT, 1, True)}
    values = dict(values) | {READOUT.key: np.array([[0.028]])}
    observed = []
    for kind in (IMAGE_VELOCITY, ROTATION_RATE):
        blocks[kind.key] = _blocks(kind, images, not known)
        noise = 0.0 if known else SIGMAS[kind.key]
        values[kind.key] = truth[kind.key] + noise * random.standard_normal((images, 3))
        if not known:
            observed.append(_observed(kind, values[kind.key]))
    rays, centres = problem.groups
    position, rotation, height, eccentricity, interior, point = rays.blocks
    nothing = np.broadcast_to(np.int64(0), (n,))
    of_rows = block.image
    clock = np.tile([0.0, -1.0 / 70.0, 0.0], (n, 1))
    rows = [
        block.centre[of_rows],
        rotation_from_angles(block.angles)[of_rows],
        np.zeros((n, 1)),
        np.zeros((n, 3)),
        *(moved[of_rows] for moved in truth.values()),
        np.full((n, 1), READOUT_TIME),
        np.repeat(INTERIOR[None], n, axis=0),
        block.point[block.of_point],
    ]
    type_ = MOVING_TYPES["mor"]
    seen = type_.equation(rows, np.column_stack([block.xy, np.zeros(n), clock])).values
    xy = seen + random.normal(0.0, SIGMA_IMAGE, seen.shape)
    moving = ObservationGroup(
        rays.name,
        type_,
        (position, rotation, height, eccentricity, of_rows, of_rows, nothing, interior, point),
        xy,
        rays.sigma,
        np.column_stack([xy, np.zeros(n), clock]),
        rays.references,
    )
    groups = (moving, centres, *observed)
    return Problem(index_unknowns(blocks), groups, (), problem.datum), values


def _observed(kind: BlockKind, values: FloatArray) -> ObservationGroup:
    sigma = np.full(values.shape, SIGMAS[kind.key])
    type_, rows = OBSERVED_PARAMETERS[kind.key], np.arange(len(values))
    return ObservationGroup(kind.key, type_, (rows,), values.copy(), sigma, np.zeros((len(values), 0)), ((),))


def _blocks(kind: BlockKind, count: int, free: bool) -> Blocks:
    owner = np.repeat(np.arange(count)[:, None], kind.size, axis=1)
    return Blocks(kind, tuple(map(str, range(count))), np.full((count, kind.size), free), owner)


def iteration(adjustment: Adjustment) -> float:
    """CPU seconds of one iteration where the adjustment has ended: normal equations, factor, step."""
    begin, plan, values = now(), adjustment.plan, adjustment.values
    normals = build_normals(plan, values)
    inverse = invert_alike(plan, normals, values, np.zeros(0, dtype=np.int64))
    full_step(plan, values, inverse.scale * inverse.factor.solve(inverse.scale * normals.reduced_rhs))
    return since(begin).cpu


def main() -> None:
    """Print a line for each of the three."""
    block = aerial(20, 25)
    cases = {
        "frames": problem_of_block(block),
        "rolling shutters": problem_of_rolling_shutters(block, False),
        "with known motions": problem_of_rolling_shutters(block, True),
    }
    adjusted = [adjust(*posed) for posed in cases.values()]
    seconds = np.array([[iteration(one) for one in adjusted] for _ in range(ROUNDS)])
    ratios = np.median(seconds / seconds[:, :1], axis=0)
    for name, one, least, ratio in zip(cases, adjusted, seconds.min(axis=0), ratios, strict=True):
        unknowns = one.problem.index.count
        print(f"{name:20s} {one.outcome.value}, {unknowns} unknowns: {least:.2f} s, {ratio:.2f} times frames")


if __name__ == "__main__":
    main()
