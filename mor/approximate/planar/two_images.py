"""Two images of a plane object: from four or more rays to the orientation and the plane, by Killian's
quadrilateral.

With more than four points all of them fix the collineation of the bundles; a quadrilateral inside the field
of the points is then carried over by it, so that every point has its share in the shape.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from mor.approximate.bundle import Bundle
from mor.approximate.planar.homography import Homography, fit_homography, fit_turn, significance_of_gaps
from mor.approximate.planar.killian import corners_in_frame, solve_quadrilateral
from mor.approximate.relative_orientation.rinner import nearest_rotation
from mor.approximate.vectors import principal_rows, tangent_axes, unit
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant

COLLINEAR = 3.0
"""A field of points thinner than so many σ of a ray is a line."""

MORE_THAN_A_TURN = 5
"""Unknowns that a collineation has and a rotation has not."""
BY_ITSELF = 2.9e-7
"""Probability that two images from one centre seem to have a base, by their errors alone (5 σ)."""
CERTAIN = 5.0
"""Standard deviations by which singular values of the collineation differ where the dangerous locus is excluded."""


class PlaneOutcome(Enum):
    """What became of two images of a plane object, in words."""

    UNIQUE = "one solution is visible"
    AMBIGUOUS = "several shapes fit both images; a further image, a known angle or length ratio decides"
    TOO_FEW = "fewer than four points"
    INVALID = "a ray is zero or not a number"
    COLLINEAR = "three of four points, or all, lie in one line"
    WEAK = (
        "one solution is visible, but so loosely determined that its standard deviations do not hold: a longer base, "
        "more points, or a further image"
    )
    NO_BASE = (
        "no base: the second image is the first one turned, to its precision; the shape of the plane is open"
    )
    BASE_ALONG_NORMAL = (
        "dangerous locus: both projection centres lie on one normal of the plane, or the measurements cannot tell; "
        "the two solutions coincide and errors of the image coordinates enter with their square root"
    )
    NOT_VISIBLE = (
        "no solution has all points in front of both images: mirrored coordinates, mismatched points, or a shape that "
        "the measurements leave open"
    )
    NOT_PLANE = "the points do not lie in one plane, or identities are mismatched"

    @property
    def usable(self) -> bool:
        """True if the solution, or one of several, can serve as a start value."""
        return self in (
            PlaneOutcome.UNIQUE,
            PlaneOutcome.AMBIGUOUS,
            PlaneOutcome.WEAK,
            PlaneOutcome.BASE_ALONG_NORMAL,
        )


class PlaneOrientation(NamedTuple):
    """Plane and second frame in the first one; unit of length: the distance of the plane from A, n · X = 1."""

    normal: FloatArray
    """(3,) unit normal n in A, pointing from A to the plane."""
    base: FloatArray
    """(3,) b; its length is in units of the distance of the plane."""
    rotation: FloatArray
    """(3, 3) D*."""
    front: int
    """Number of points in front of both images."""


class PlaneSolutions(NamedTuple):
    """All orientations of a plane object, visible ones first; without a base the rotation alone."""

    outcome: PlaneOutcome
    solutions: list[PlaneOrientation]
    homography: Homography | None


def planar_orientations(a: Bundle, b: Bundle) -> PlaneSolutions:
    """All solutions for n ≥ 4 homologous rays of a plane object; degenerate cases named in the outcome."""
    if len(a) < 4:
        return PlaneSolutions(PlaneOutcome.TOO_FEW, [], None)
    if not _valid(a) or not _valid(b):
        return PlaneSolutions(PlaneOutcome.INVALID, [], None)
    if _thin(a) or _thin(b) or (len(a) == 4 and (_three_in_line(a) or _three_in_line(b))):
        return PlaneSolutions(PlaneOutcome.COLLINEAR, [], None)
    homography = fit_homography(a, b)
    if homography.objective > misfit_limit(homography.redundancy):
        return PlaneSolutions(PlaneOutcome.NOT_PLANE, [], homography)
    turn = fit_turn(a, b)
    variance = max(1.0, homography.objective / max(homography.redundancy, 1))
    if turn.objective - homography.objective < variance * float(chdtri(MORE_THAN_A_TURN, BY_ITSELF)):
        standing = PlaneOrientation(np.full(3, np.nan), np.zeros(3), turn.rotation, 0)
        return PlaneSolutions(PlaneOutcome.NO_BASE, [standing], homography)
    solutions = solutions_of_homography(homography.matrix, a.rays, b.rays)
    along = significance_of_gaps(homography) < CERTAIN
    if along and not any(one.front == len(a) for one in solutions):
        solutions = [along_normal(homography.matrix, a.rays, b.rays)]
    return PlaneSolutions(_outcome(homography, solutions, along, len(a)), solutions, homography)


def misfit_limit(redundancy: int) -> float:
    """Value of Σ (v/σ)² beyond which the model does not hold: expectation plus five standard deviations, σ doubled."""
    return float(4.0 * (redundancy + 5.0 * np.sqrt(2.0 * redundancy) + 1.0))


def solutions_of_homography(
    matrix: FloatArray, rays_a: FloatArray, rays_b: FloatArray
) -> list[PlaneOrientation]:
    """Orientations from a collineation H (3, 3) by Killian's cubic, those that see all the rays (n, 3) first."""
    corners = corners_within(rays_a)
    image = corners @ matrix.T
    found = []
    for solution in solve_quadrilateral(corners, image):
        in_a, in_b = corners_in_frame(corners, solution, 0), corners_in_frame(image, solution, 1)
        found.append(_orientation(in_a, in_b, rays_a, rays_b))
    return sorted(found, key=lambda orientation: -orientation.front)


def _orientation(
    in_a: FloatArray, in_b: FloatArray, rays_a: FloatArray, rays_b: FloatArray
) -> PlaneOrientation:
    centre_a, centre_b = in_a.mean(axis=0), in_b.mean(axis=0)
    rotation = nearest_rotation((in_b - centre_b).T @ (in_a - centre_a))
    normal = principal_rows(in_a - centre_a)[1][2]
    distance = float(normal @ centre_a)
    if distance < 0.0:
        normal, distance = -normal, -distance
    base = (centre_a - rotation.T @ centre_b) / distance
    return PlaneOrientation(normal, base, rotation, _in_front(normal, base, rotation, rays_a, rays_b))


def corners_within(rays: FloatArray) -> FloatArray:
    """Quadrilateral (4, 3) of rays inside the field of the rays (n, 3), convex; 12 and 34 are its diagonals.

    Of the hull of the field the four corners of largest area; of a triangle a
    trapezoid.
    """
    directions = unit(rays)
    flat = _flat(directions)
    hull = convex_hull(flat)
    if len(hull) == 3:
        one, two, three = directions[hull]
        return np.stack([one, unit(two + three), two, unit(one + three)])
    first, second = _diagonal(flat, hull)
    return np.asarray(directions[[first[0], first[1], second[0], second[1]]])


def _flat(directions: FloatArray) -> FloatArray:
    """Coordinates (n, 2) that keep straight lines straight: the rays cut by a plane they all reach."""
    axis = unit(directions.sum(axis=0))
    if float(np.min(directions @ axis)) < 0.1:
        axis = _facing_axis(directions)
    across = tolerant.svd(axis[None, :])[2][1:]
    return np.asarray((directions @ across.T) / np.maximum(directions @ axis, 1e-6)[:, None])


def _facing_axis(directions: FloatArray) -> FloatArray:
    """Direction (3,) that the rays (n, 3) are least far from: they fill less than a half-space if it is a plane.

    Largest t with p · a ≥ t, |a_i| ≤ 1, a linear programme.
    """
    from scipy.optimize import linprog  # slow to import, and only very wide fields come here

    bound = np.column_stack([-directions, np.ones(len(directions))])
    limits = [(-1.0, 1.0)] * 3 + [(None, None)]
    found = linprog([0.0, 0.0, 0.0, -1.0], A_ub=bound, b_ub=np.zeros(len(directions)), bounds=limits)
    if found.x is None:  # never: zero is feasible
        return unit(directions.sum(axis=0))
    return unit(np.asarray(found.x[:3], dtype=float))


def _diagonal(flat: FloatArray, hull: IntArray) -> tuple[tuple[int, int], tuple[int, int]]:
    best, chosen = -1.0, ((0, 0), (0, 0))
    for i in range(len(hull)):
        for j in range(i + 2, len(hull)):
            line = flat[hull[j]] - flat[hull[i]]
            offset = flat[hull] - flat[hull[i]]
            side = line[0] * offset[:, 1] - line[1] * offset[:, 0]
            low, high = int(np.argmin(side)), int(np.argmax(side))
            area = side[high] - side[low] if side[low] < 0.0 < side[high] else -1.0
            if area > best:
                best, chosen = float(area), ((int(hull[i]), int(hull[j])), (int(hull[high]), int(hull[low])))
    return chosen


def convex_hull(points: FloatArray) -> IntArray:
    """Indices of the convex hull of points (n, 2), counter-clockwise (A. M. Andrew's chains)."""
    order = np.lexsort((points[:, 1], points[:, 0]))
    chains: list[list[int]] = []
    for sequence in (order, order[::-1]):
        chain: list[int] = []
        for index in sequence:
            while len(chain) > 1 and _turn(points[chain[-2]], points[chain[-1]], points[index]) <= 0.0:
                chain.pop()
            chain.append(int(index))
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1], dtype=np.int64)


def _turn(first: FloatArray, second: FloatArray, third: FloatArray) -> float:
    one, two = second - first, third - first
    return float(one[0] * two[1] - one[1] * two[0])


def _valid(bundle: Bundle) -> bool:
    return bool(np.all(np.isfinite(bundle.rays)) and np.all(np.linalg.norm(bundle.rays, axis=1) > 0.0))


def _thin(bundle: Bundle) -> bool:
    return thickness(bundle) < COLLINEAR * bundle.noise


def thickness(bundle: Bundle) -> float:
    """Root mean square distance (radians) of the rays from the plane that fits them best: 0 for a line of points."""
    values = tolerant.singular_values(bundle.directions)
    return float(values[2] / np.sqrt(len(bundle)))


def _three_in_line(bundle: Bundle) -> bool:
    directions = bundle.directions
    return any(
        thickness(bundle.take(np.delete(np.arange(4), k))) < COLLINEAR * bundle.noise
        for k in range(len(directions))
    )


def along_normal(matrix: FloatArray, rays_a: FloatArray, rays_b: FloatArray) -> PlaneOrientation:
    """Both centres on one normal n, H = D* (1 − β n nᵀ): n belongs to the singular value that stands alone."""
    _, values, right = tolerant.svd(matrix)
    alone = 2 if values[0] / values[1] < values[1] / values[2] else 0
    pair = float(np.sqrt(np.prod(np.delete(values, alone))))
    normal = right[alone] * np.where(np.sum(rays_a @ right[alone]) < 0.0, -1.0, 1.0)
    distance_b = float(values[alone]) / pair * float(np.sign(np.linalg.det(matrix)))
    base = (1.0 - distance_b) * normal
    rotation = nearest_rotation(matrix @ (np.eye(3) + np.outer(normal, normal) * (1.0 / distance_b - 1.0)))
    return PlaneOrientation(normal, base, rotation, _in_front(normal, base, rotation, rays_a, rays_b))


def under_normal(
    matrix: FloatArray, normal: FloatArray, rays_a: FloatArray, rays_b: FloatArray
) -> PlaneOrientation:
    """Orientation from a collineation H (3, 3) of a plane whose unit ``normal`` in A is known: H t = D* t across it."""
    across = tangent_axes(normal)
    carried = matrix @ across
    scale = float(np.linalg.norm(carried) / np.sqrt(2.0))
    both = np.column_stack([across, normal])
    image = np.column_stack([carried, np.cross(carried[:, 0], carried[:, 1]) / scale])
    rotation = nearest_rotation(image @ both.T * np.linalg.det(both))
    base = normal - rotation.T @ matrix @ normal / scale
    return PlaneOrientation(normal, base, rotation, _in_front(normal, base, rotation, rays_a, rays_b))


def _in_front(
    normal: FloatArray, base: FloatArray, rotation: FloatArray, rays_a: FloatArray, rays_b: FloatArray
) -> int:
    side_of_b = np.sign(1.0 - float(normal @ base))
    return int(np.sum((rays_a @ normal > 0.0) & ((rays_b @ (rotation @ normal)) * side_of_b > 0.0)))


def _outcome(
    homography: Homography, solutions: list[PlaneOrientation], along: bool, points: int
) -> PlaneOutcome:
    visible = sum(solution.front == points for solution in solutions)
    if not homography.same_side or visible == 0:
        return PlaneOutcome.NOT_VISIBLE
    if along:
        return PlaneOutcome.BASE_ALONG_NORMAL
    return PlaneOutcome.UNIQUE if visible == 1 else PlaneOutcome.AMBIGUOUS
