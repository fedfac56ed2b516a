"""Simulated blocks as adjustment problems, without a project file: what the kernel alone is timed on."""

from __future__ import annotations

import numpy as np
from scenes import (
    SIGMA_BEARING,
    SIGMA_CENTRE,
    SIGMA_DISTANCE,
    SIGMA_HEIGHT,
    SIGMA_IMAGE,
    Block,
    Grid,
    Mixed,
    Scene,
)

from mor.model.contract import ObservationGroup
from mor.model.coordinates import OBSERVED_PARAMETERS
from mor.model.images import IMAGE_TYPES
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import (
    DISTANCE_METER,
    ECCENTRICITY,
    HEIGHT,
    INTERIORS,
    POINT,
    ROTATION,
    BlockKind,
    Blocks,
    index_unknowns,
)
from mor.model.rotations import rotation_from_angles
from mor.solve.problem import DatumDefinition, Problem
from mor.types import FloatArray, IntArray

Posed = tuple[Problem, dict[str, FloatArray]]
"""A problem and the values it starts from."""


def as_problem(scene: Scene) -> Posed:
    """The problem of any scene, and its start values."""
    if isinstance(scene, Block):
        return problem_of_block(scene)
    return problem_of_grid(scene) if isinstance(scene, Grid) else problem_of_mixed(scene)


def problem_of_block(block: Block) -> Posed:
    """An image block: all poses, all points and the whole interior are free."""
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
    return Problem(index_unknowns(blocks), (rays, centres), (), _fixed(values)), values


def problem_of_grid(grid: Grid) -> Posed:
    """A geodetic network: all points are free but the control points."""
    free = np.ones((len(grid.point), 3), bool)
    free[grid.control] = False
    points = _blocks(POINT, len(grid.point), True)
    blocks = {
        "point": Blocks(POINT, points.ids, free, points.owner),
        "height": _blocks(HEIGHT, 1, False),
        "distance meter": _blocks(DISTANCE_METER, 1, False),
    }
    values = {
        "point": np.where(free, grid.start, grid.point),
        "height": np.zeros((1, 1)),
        "distance meter": np.array([[1.0, 0.0]]),
    }
    sights = _sights(grid.one, grid.other, grid.distance, grid.bearing)
    heights = _between("height_difference", grid.one, grid.other, grid.height_difference, SIGMA_HEIGHT)
    return Problem(index_unknowns(blocks), (*sights, heights), (), _fixed(values)), values


def problem_of_mixed(scene: Mixed) -> Posed:
    """An image block with sights between its points, which are therefore not eliminated on the fly."""
    problem, values = problem_of_block(scene.block)
    values["distance meter"] = np.array([[1.0, 0.0]])
    blocks = dict(problem.index.blocks) | {"distance meter": _blocks(DISTANCE_METER, 1, False)}
    images = len(scene.block.centre)
    sights = _sights(scene.one + images, scene.other + images, scene.distance, scene.bearing)
    return Problem(index_unknowns(blocks), problem.groups + sights, (), problem.datum), values


def _sights(one: IntArray, other: IntArray, distance: FloatArray, bearing: FloatArray) -> tuple[ObservationGroup, ...]:
    return (
        _between("distance", one, other, distance, SIGMA_DISTANCE),
        _between("bearing", one, other, bearing, SIGMA_BEARING),
    )


def _between(key: str, one: IntArray, other: IntArray, observed: FloatArray, sigma: float) -> ObservationGroup:
    """Observations of a type between two points; heights of instrument and target are block 0, fixed to 0."""
    kind, count = PLAIN_TYPES[key], len(one)
    nothing = np.zeros(count, dtype=np.int64)
    ends = iter((one, other))
    blocks = tuple(next(ends) if slot.kind == "point" else nothing for slot in kind.slots)
    columns = np.full((count, 1), sigma)
    return ObservationGroup(
        key,
        kind,
        blocks,
        observed[:, None],
        columns,
        np.zeros((count, 0)),
        tuple(() for _ in kind.references),
    )


def _fixed(values: dict[str, FloatArray]) -> DatumDefinition:
    return DatumDefinition("fixed", False, {"point": np.zeros(values["point"].shape, bool)}, {"point": values["point"]})


def _blocks(kind: BlockKind, count: int, free: bool) -> Blocks:
    owner = np.repeat(np.arange(count)[:, None], kind.size, axis=1)
    return Blocks(kind, tuple(map(str, range(count))), np.full((count, kind.size), free), owner)
