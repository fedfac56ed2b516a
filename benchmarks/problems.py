"""Simulated blocks as adjustment problems, without a project file: what the kernel alone is timed on."""

from __future__ import annotations

import numpy as np
from scenes import SIGMA_CENTRE, SIGMA_IMAGE, Block

from mor.adjustment.problem import Datum, Problem
from mor.geometry.arrays import FloatArray
from mor.geometry.rotations import rotation_from_angles
from mor.observations import IMAGE_TYPES, OBSERVED_PARAMETERS, ObservationGroup
from mor.parameters.index import Blocks, index_unknowns
from mor.parameters.kinds import ECCENTRICITY, HEIGHT, INTERIORS, POINT, ROTATION, BlockKind


def problem_of(block: Block) -> tuple[Problem, dict[str, FloatArray]]:
    """The problem, and the values it starts from: all poses, all points and the whole interior are free."""
    images, points, n = len(block.centre), len(block.point), len(block.image)
    interior = INTERIORS["mor"]
    blocks = {
        interior.key: _blocks(interior, 1, True),
        "height": _blocks(HEIGHT, 1, False),
        "eccentricity": _blocks(ECCENTRICITY, 1, False),
        "rotation": _blocks(ROTATION, images, True),
        "point": _blocks(POINT, images + points, True),
    }
    values = {
        interior.key: block.start_interior[None, :],
        "height": np.zeros((1, 1)),
        "eccentricity": np.zeros((1, 3)),
        "rotation": rotation_from_angles(block.start_angles),
        "point": np.vstack([block.start_centre, block.start_point]),
    }
    nothing = np.broadcast_to(np.int64(0), (n,))
    rays = ObservationGroup(
        "image points",
        IMAGE_TYPES["mor"],
        (block.image, block.image, nothing, nothing, nothing, block.of_point + images),
        block.xy,
        np.full((n, 2), SIGMA_IMAGE),
        np.column_stack([block.xy, np.zeros(n)]),
        ((), ()),
    )
    centres = ObservationGroup(
        "projection centres",
        OBSERVED_PARAMETERS["point"],
        (np.arange(images),),
        block.observed_centre,
        np.full((images, 3), SIGMA_CENTRE),
        np.zeros((images, 0)),
        ((),),
    )
    datum = Datum("fixed", False, {"point": np.zeros((images + points, 3), bool)}, {"point": values["point"]})
    return Problem(index_unknowns(blocks), (rays, centres), (), datum), values


def _blocks(kind: BlockKind, count: int, free: bool) -> Blocks:
    owner = np.repeat(np.arange(count)[:, None], kind.size, axis=1)
    return Blocks(kind, tuple(map(str, range(count))), np.full((count, kind.size), free), owner)
