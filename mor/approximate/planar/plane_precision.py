"""Standard deviations and correlations of a plane object in its object system: points, images, sides, angles, heights.

The datum is that of the object system: two points carry origin, direction and length. What is told is a function of the
adjusted points and frames; its covariance follows from theirs by the S-transformation and the law of propagation, for
the a-priori σ of the image coordinates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.planar.plane_adjustment import covariance_in
from mor.approximate.planar.plane_object import PlacedPlane, in_space, sides_and_angles
from mor.approximate.planar.plane_shape import PlaneShape
from mor.approximate.planar.two_images import PlaneOutcome, convex_hull
from mor.arrays import FloatArray, IntArray

ROUNDING = 1e-7
"""σ over the largest one below which it is zero: of what carries the object system."""


class Length(NamedTuple):
    """What gives the object system its origin, direction and scale."""

    first: int
    second: int
    length: float
    sigma: float
    """Zero where the length is exact."""


class Derived(NamedTuple):
    """Numbers that follow from the adjusted points and frames, with their precision."""

    values: FloatArray
    """(k,)"""
    covariance: FloatArray
    """(k, k)"""


def placed_covariance(shape: PlaneShape, placed: PlacedPlane, tie: Length) -> FloatArray:
    """Covariance (u, u) in the object system: X0 and δ of every frame, then X Y Z of every point.

    Not a number on the dangerous locus, where standard deviations of first order mean nothing.
    """
    adjusted = shape.adjusted
    if adjusted is None or shape.outcome is PlaneOutcome.BASE_ALONG_NORMAL:
        unknowns = 6 * len(shape.positions) + 3 * len(shape.points)
        return np.full((unknowns, unknowns), np.nan)
    covariance = covariance_in(adjusted, _tie_constraints(shape, tie))
    frames = 6 * len(shape.positions)
    carried = np.eye(len(covariance))
    for start in [*range(0, frames, 6), *range(frames, len(covariance), 3)]:
        carried[start : start + 3, start : start + 3] = placed.scale * placed.turn
    stretched = np.zeros(len(covariance))
    stretched[:frames] = np.pad(placed.positions, ((0, 0), (0, 3))).ravel()
    stretched[frames:] = np.nan_to_num(placed.points).ravel()
    relative = tie.sigma / tie.length
    result = carried @ covariance @ carried.T + relative**2 * np.outer(stretched, stretched)
    sigma = np.sqrt(np.maximum(np.diag(result), 0.0))
    exact = sigma < ROUNDING * np.max(sigma)
    result[exact] = result[:, exact] = 0.0
    return np.asarray(result)


def _tie_constraints(shape: PlaneShape, tie: Length) -> FloatArray:
    """The first point stays, the second may neither turn round it nor come nearer."""
    frames = 6 * len(shape.positions)
    space = in_space(shape)
    along = space[tie.second] - space[tie.first]
    a, b = frames + 3 * tie.first, frames + 3 * tie.second
    constraints = np.zeros((4, frames + 3 * len(space)))
    constraints[0, a] = constraints[1, a + 1] = 1.0
    constraints[2, b : b + 2] = [-along[1], along[0]]
    constraints[3, b : b + 3], constraints[3, a : a + 3] = along, -along
    return constraints


def corners(shape: PlaneShape) -> IntArray:
    """Points that are the corners, in order round it: four as they come if no sides cross, else the hull."""
    inside = np.flatnonzero(shape.in_plane & np.isfinite(shape.points[:, 0]))
    flat = shape.points[inside]
    if len(inside) == 4 and not (_crossing(flat[[0, 1, 2, 3]]) or _crossing(flat[[1, 2, 3, 0]])):
        return inside
    return np.asarray(inside[convex_hull(flat)])


def _crossing(four: FloatArray) -> bool:
    """Do the sides 12 and 34 cross?"""

    def side(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
        return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

    one, two, three, last = four
    return (
        side(one, two, three) * side(one, two, last) < 0
        and side(three, last, one) * side(three, last, two) < 0
    )


def derived(
    shape: PlaneShape, placed: PlacedPlane, covariance: FloatArray, round_it: IntArray, constants: FloatArray
) -> Derived:
    """Sides, angles (radians), heights of points off the plane, flying heights, and these over the camera constants.

    Corners as in ``round_it`` (k,), from each to the next; (k + k + points off + m + m) numbers.
    """
    flat = placed.scale * shape.points[round_it]
    polygon = sides_and_angles(flat)
    off = np.flatnonzero(~shape.in_plane & ~shape.left_out)
    flying = placed.scale * shape.positions[:, 2]
    values = [polygon.sides, polygon.angles, placed.scale * shape.heights[off], flying, flying / constants]
    frames, up = 6 * len(shape.positions), placed.turn[:, 2]
    rows = np.zeros((2 * len(flat) + len(off) + 2 * len(flying), len(covariance)))
    by_points = _polygon_by_points(flat, placed.turn)
    for number, index in enumerate(round_it):
        column = frames + 3 * int(index)
        rows[: 2 * len(flat), column : column + 3] = by_points[:, number]
    for number, index in enumerate(off):
        column = frames + 3 * int(index)
        rows[2 * len(flat) + number, column : column + 3] = up
    for image, constant in enumerate(constants):
        row = 2 * len(flat) + len(off) + image
        rows[row, 6 * image : 6 * image + 3] = up
        rows[row + len(flying), 6 * image : 6 * image + 3] = up / constant
    return Derived(np.concatenate(values), np.asarray(rows @ covariance @ rows.T))


def _polygon_by_points(flat: FloatArray, turn: FloatArray) -> FloatArray:
    """Derivatives (2k, k, 3) of sides and interior angles by the corners, in the axes of the object system."""
    count = len(flat)
    rows = np.zeros((2 * count, count, 2))
    x, y = flat.T
    sense = np.sign(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    for i in range(count):
        before, after = (i - 1) % count, (i + 1) % count
        along = flat[after] - flat[i]
        direction = along / np.linalg.norm(along)
        rows[i, after], rows[i, i] = direction, -direction
        for other, sign in ((before, sense), (after, -sense)):
            to = flat[other] - flat[i]
            turned = sign * np.array([-to[1], to[0]]) / float(to @ to)
            rows[count + i, other] += turned
            rows[count + i, i] -= turned
    return np.asarray(rows @ turn[:, :2].T)
