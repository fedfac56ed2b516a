"""The overlap map: how many images measured points in each cell, in the view in which the points are widest."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.report.html.payload import drawn_axes
from mor.report.tables.rays import Rays, places
from mor.report.view import View

_MOST_CELLS = 80
"""Cells along the longer side, at most."""
_IN_A_CELL = 4
"""Points a cell has on average, where they lie evenly."""
RAY_CLASSES = ((1, 1), (2, 2), (3, 3), (4, 5), (6, 9), (10, None))
"""Numbers of rays that are told apart in a picture: two rays check each other across their common plane alone."""


class Overlap(NamedTuple):
    """Counts of images on a grid of square cells."""

    axes: tuple[int, int]
    """Coordinates drawn to the right and upwards."""
    first: FloatArray
    """(2,) centre of the first cell."""
    step: float
    images: IntArray
    """(up, right) images that measured points in the cell."""


def overlap(view: View, rays: Rays) -> Overlap | None:
    """Images over each cell of a grid; nothing if what images measured spans no area.

    Counted is what was measured, not what an image might show: a cell has every image once that measured one of its
    points or more.
    """
    axes = widest(view)
    plane = places(view)[:, axes]
    placed = np.asarray(np.isfinite(plane).all(axis=1))
    seen = (rays.frame < view.images.height) & placed[rays.point]
    frame, point = rays.frame[seen], rays.point[seen]
    measured = np.flatnonzero(np.bincount(point))
    low, size = (
        (plane[measured].min(axis=0), np.ptp(plane[measured], axis=0)) if len(point) else np.zeros((2, 2))
    )
    if not (size > 0.0).all():
        return None
    step = max(float(np.sqrt(_IN_A_CELL * size.prod() / len(measured))), float(size.max()) / _MOST_CELLS)
    cells = np.floor(size / step).astype(np.int64) + 1
    first = low + 0.5 * (size - (cells - 1) * step)
    column, row = (np.rint((plane[point] - first) / step).astype(np.int64).clip(0, cells - 1)).T
    pairs = np.unique((row * cells[0] + column) * view.images.height + frame)
    count = np.bincount(pairs // view.images.height, minlength=int(cells.prod())).reshape(cells[1], cells[0])
    return Overlap(axes, first, step, count)


def widest(view: View) -> tuple[int, int]:
    """Coordinates drawn to the right and upwards: plan, or the elevation along the longer side of a network that is
    higher than deep."""
    drawn = drawn_axes(view.summary["axes"]["xy"])
    extent = np.ptp(places(view), axis=0) if view.points.height else np.zeros(3)
    if extent[2] > extent[:2].min():
        return int(np.argmax(extent[:2])), 2
    return "xyz".index(drawn["right"]), "xyz".index(drawn["up"])


def overlap_map(found: Overlap | None) -> dict[str, Any] | None:
    """The same as plain data of the page."""
    if found is None:
        return None
    right, up = ("xyz"[k] for k in found.axes)
    return {
        "right": right,
        "up": up,
        "first": found.first.tolist(),
        "step": found.step,
        "count": found.images.tolist(),
        "classes": RAY_CLASSES,
    }
