"""A part without vertical gets it from horizontal directions and vertical angles to its points."""

from __future__ import annotations

import numpy as np

from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene
from mor.approximate.terrestrial.sights import Sight
from mor.approximate.vertical.of_directions import (
    FITS,
    OPEN,
    Angles,
    HorizontalSet,
    Vertical,
    vertical_of_directions,
)
from mor.arrays import FloatArray

MOST_SETS = 8
MOST_POINTS = 16
"""Of each set: start values do not become better with more."""
AGREEING = 0.7
"""Part of all directions that agree with a vertical, at the least."""


def vertical_by_directions(part: Part, scene: Scene, redundant: int) -> FloatArray | None:
    """The vertical (3,) in the axes of a part that has none, where at least ``redundant`` directions control it.

    ``None`` where it is open, where another vertical fits alike, or where too few directions agree. It is asked again
    only where more points are known than before.
    """
    sets, angles = _sets(part, scene), _angles(part, scene)
    told = sum(len(one.points) for one in sets) + len(angles.values)
    if told <= part.asked_for_vertical.get(redundant, 0):
        return None
    part.asked_for_vertical[redundant] = told
    found = vertical_of_directions(sets, angles)
    if found is None or not _settles(found, told, redundant):
        return None
    return found.up


def _settles(found: Vertical, told: int, redundant: int) -> bool:
    enough = found.redundancy >= redundant and found.agreeing >= AGREEING * told
    return enough and found.alone and found.sigma < OPEN


def _sets(part: Part, scene: Scene) -> list[HorizontalSet]:
    """The sets of most known points, without those that tell nothing of the vertical."""
    found = [_set(part, sight) for sight in scene.terrestrial.sights if not sight.oriented]
    found = [one for one in found if len(one.points) > (1 if np.isfinite(one.place).all() else 3)]
    return sorted(found, key=lambda one: -len(one.points))[:MOST_SETS]


def _set(part: Part, sight: Sight) -> HorizontalSet:
    known = part.known(sight.points) & np.isfinite(sight.directions) & (sight.points != sight.position)
    rows = np.flatnonzero(known)
    if len(rows) > MOST_POINTS:
        rows = rows[np.linspace(0, len(rows) - 1, MOST_POINTS).astype(int)]
    place = part.points[sight.position]
    return HorizontalSet(place, part.points[sight.points[rows]], sight.directions[rows])


def _angles(part: Part, scene: Scene) -> Angles:
    """Vertical angles between known points; heights of instruments and targets must not matter beside the distance."""
    measured = scene.distances[1]
    start, end = (part.points[block] for block in measured.ends.T)
    length = np.linalg.norm(end - start, axis=1)
    near = np.abs(measured.rises) <= FITS * length * part.scaled
    rows = np.flatnonzero(np.isfinite(length) & near)[: MOST_SETS * MOST_POINTS]
    return Angles(start[rows], end[rows], np.arctan(measured.tangents[rows]))
