"""A problem whose image coordinates are directions: it comes from farther away to nearly the same solution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mor.adjustment.problem import Problem
from mor.approximate.undistort import ideal_rays
from mor.arrays import BoolArray, FloatArray
from mor.geometry.cameras import CAMERA_MODELS
from mor.observations import ObservationGroup, is_image_point
from mor.observations.on_the_sphere import image_scale, on_the_sphere, stereographic
from mor.observations.time.rolling_shutter import MOTION_SLOTS
from mor.parameters.index import Values, index_unknowns
from mor.quality.gross_errors.exclusion import reweighted

_INTERIOR = "interior/"
_MOTIONS = frozenset(slot.kind for slot in MOTION_SLOTS)


def problem_on_the_sphere(problem: Problem, values: Values) -> Problem | None:
    """The problem with its image rays as directions; ``None`` where there are no images.

    Interior orientations are held, and how images move while they are read out.

    What one coordinate only was measured of takes no part.
    """
    groups, factors = list(problem.groups), [np.ones(group.sigma.shape) for group in problem.groups]
    for number, group in enumerate(problem.groups):
        if is_image_point(group.type) and on_the_sphere(group.type) is not None:
            groups[number], factors[number] = _directions(group, values)
    if all(one is other for one, other in zip(groups, problem.groups, strict=True)):
        return None
    scaled = reweighted(problem, factors)
    blocks = {
        kind: own._replace(free=np.zeros_like(own.free))
        if kind.startswith(_INTERIOR) or kind in _MOTIONS
        else own
        for kind, own in problem.index.blocks.items()
    }
    pairs = zip(groups, scaled.groups, strict=True)
    turned = tuple(replace(group, sigma=own.sigma) for group, own in pairs)
    return replace(scaled, groups=turned, index=index_unknowns(blocks))


def _directions(group: ObservationGroup, values: Values) -> tuple[ObservationGroup, FloatArray]:
    """The group as directions, and radians per image unit (n, 2)."""
    model = CAMERA_MODELS[group.type.key.partition("/")[2]]
    interior, of = next(
        (values[slot.kind], numbers)
        for slot, numbers in zip(group.type.slots, group.blocks, strict=True)
        if slot.kind.startswith(_INTERIOR)
    )
    whole: BoolArray = np.asarray(group.mask.all(axis=1))
    measured = np.where(whole[:, None], group.observed, 0.0)
    rays = ideal_rays(model, interior, of, group.constants[:, 2:], measured)
    scale = image_scale(model, rays, interior[of], group.constants)
    used: BoolArray = np.asarray(whole & np.isfinite(scale) & (scale > 0.0))
    type_ = on_the_sphere(group.type)
    assert type_ is not None
    constants = np.concatenate([stereographic(rays), rays], axis=1)
    pairs = zip(group.type.slots, group.blocks, strict=True)
    blocks = tuple(numbers for slot, numbers in pairs if slot in type_.slots)
    observed = np.where(used[:, None], np.zeros(2), np.nan)
    factor = np.repeat(np.where(used, 1.0 / np.where(used, scale, 1.0), 1.0)[:, None], 2, axis=1)
    return replace(group, type=type_, blocks=blocks, observed=observed, constants=constants), factor
