"""One free movement of a network that is a rotation about some line: which line, and which points lie on it."""

from __future__ import annotations

import numpy as np

from mor.adjustment.datum.defect import similarities
from mor.adjustment.state import Adjustment
from mor.geometry import tolerant
from mor.quality.diagnosis.sentences import Say, english, enumerated

_SMALL = 1e-5
_SHOWN = 4


def tilt(adjustment: Adjustment, say: Say = english) -> str | None:
    """Words for the only free movement of a network, where it is a rotation about a line; ``None`` otherwise.

    A movement t + ω × x with t ⊥ ω (and no change of scale) leaves the points of a line in direction ω at rest.
    """
    null = adjustment.defect.datum
    columns = adjustment.problem.index.columns["point"]
    free = columns >= 0
    if null.shape[1] != 1 or not free.any():
        return None
    points = adjustment.values["point"]
    centre = points[free.any(axis=1)].mean(axis=0)
    generators = similarities(points, centre)
    movement = tolerant.lstsq(generators[free], null[columns[free], 0], rcond=1e-12)
    t, turn, scale = movement[:3], movement[3:6], movement[6]
    size = float(np.linalg.norm(turn))
    extent = float(np.ptp(points, axis=0).max())
    if size == 0.0 or abs(scale) > _SMALL * size or abs(t @ turn) > _SMALL * size**2 * extent:
        return None
    direction, through = turn / size, centre + np.cross(turn, t) / size**2
    away = points - through
    distance = np.linalg.norm(away - np.outer(away @ direction, direction), axis=1)
    fixed = ~free.any(axis=1) & (distance < _SMALL * extent)
    ids = adjustment.problem.index.blocks["point"].ids
    names = [ids[i] for i in np.flatnonzero(fixed)]
    if names:
        return say(
            "The network can tilt about the line through {names}.", names=enumerated(names, _SHOWN, say)
        )
    x, y, z = (say("{amount}", amount=f"{x:.3f}") for x in direction)
    return say("The network can tilt about a line in the direction ({x}, {y}, {z}), X, Y, Z.", x=x, y=y, z=z)
