"""Free stations in the plane: bearings, arcs, distances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import shortest_path

from mor.model import rotations
from mor.start.bundle import AS_GOOD, congruence, principal_rows
from mor.start.sights import bearing, orient
from mor.types import BoolArray, FloatArray, IntArray

# ---- Which of several measurements of one thing agree, where all together do not: the worst are left out one by one.
#
# A wrong identity among four arcs or a dozen directions draws what follows from all of them away, and with it
# whatever hangs on that later.


class FitQuality(NamedTuple):
    """Agreement of some measurements."""

    sigma0: float
    """Infinite where they lead to nothing."""
    sizes: FloatArray
    """(k,) how far each is off, in any unit; empty where they lead to nothing."""


def agreeing(count: int, fit: Callable[[IntArray], FitQuality], limit: float, least: int) -> IntArray:
    """Rows (k,) of ``count`` measurements that agree to ``limit``; all of them where no ``least`` of them do.

    ``fit``: how well some rows agree. A third of all may be left out: of the rest more would have to be wrong alike.
    """
    rows: IntArray = np.arange(count)
    found = fit(rows)
    most = count // 3
    while not found.sigma0 <= limit:
        if len(rows) <= max(least, count - most):
            return np.arange(count)
        # Measurements of which each is left out on trial: those that fit worst.
        worst = np.argsort(-found.sizes, kind="stable")[:6]
        tried = [np.delete(rows, k) for k in (worst if len(worst) else range(len(rows)))]
        fits = [fit(one) for one in tried]
        best = int(np.argmin([one.sigma0 for one in fits]))
        rows, found = tried[best], fits[best]
    return rows


# ---- Free stationing in the plane and in space: directions and distances to known points, in any mixture.
#
# Three directions give the station in closed form (Rückwärtsschnitt): with the known orientation turned into
# the instrument, n · R (P − S) = 0 is linear and homogeneous in cos κ, sin κ and R S; its null vector is the
# solution, and where it has two, the points and the station lie on one circle, the dangerous one. Two
# distances give two stations (arc section), direction and distance together a congruence. A point that is
# sighted under known bearings is a station of known orientation (forward section). Every seed is refined with
# all that was measured; what then fits alike is ambiguous.


class StationOutcome(Enum):
    """Outcome of a free station."""

    DETERMINED = "determined"
    AMBIGUOUS = "several stations fit: another direction or distance decides between them"
    TOO_FEW = "too few measurements: three directions, or two distances, or both to two points"
    PARALLEL = "the bearings are nearly parallel: the distance of their intersection is undetermined"
    DANGEROUS_CIRCLE = "station and sighted points lie on one circle: directions alone do not determine it"
    DOES_NOT_FIT = "no station fits the measurements: wrong points or a wrong distance"

    @property
    def usable(self) -> bool:
        """True if the station, or one of several, can serve as a start value."""
        return self in (StationOutcome.DETERMINED, StationOutcome.AMBIGUOUS)


class FreeStation(NamedTuple):
    """A station with the orientation of its directions, r = t + κ."""

    outcome: StationOutcome
    position: FloatArray
    """(2,) or (3,)"""
    kappa: float
    """Not a number where no direction was observed."""
    residuals: FloatArray
    """(n, 2) direction (radians) and horizontal distance, computed minus observed; NaN where not observed."""
    sigma0: float
    """In units of the a-priori σ; not a number without redundancy."""
    alternatives: tuple[tuple[FloatArray, float], ...] = ()
    """Other positions and κ that fit as well."""


def free_station_level(
    points: FloatArray,
    directions: FloatArray,
    distances: FloatArray,
    sigma_direction: float,
    sigma_distance: float,
    oriented: bool = False,
) -> FreeStation:
    """Station (2,) from known points (n, 2): ``directions`` (n,), horizontal ``distances`` (n,), NaN where missing.

    ``oriented``: the directions are bearings, κ = 0.
    """
    points = np.asarray(points, dtype=float)
    observed = np.column_stack([directions, distances]).astype(float)
    sigma = np.array([sigma_direction, sigma_distance])
    has = np.isfinite(observed)
    count = int(np.sum(has))
    turns = bool(np.any(has[:, 0])) and not oriented
    unknowns = 2 + turns
    places, sights = _places(points[np.any(has, axis=1)]), _places(points[has[:, 0]])
    if count < unknowns or (not np.any(has[:, 1]) and sights < 2 + turns) or places < 2:
        return _no_station(StationOutcome.TOO_FEW, len(points))
    t = observed[has[:, 0], 0]
    # Radians at which two bearings must meet.
    if oriented and not np.any(has[:, 1]) and np.abs(np.sin(np.subtract.outer(t, t))).max() < 0.05:
        return _no_station(StationOutcome.PARALLEL, len(points))
    if turns and not np.any(has[:, 1]) and _on_circle(points[has[:, 0]], t, sigma_direction):
        return _no_station(StationOutcome.DANGEROUS_CIRCLE, len(points))
    seeds = _oriented_seeds(points, observed, has) if oriented else _seeds(points, observed, has)
    refined = [_refine(points, observed, sigma, seed, turns) for seed in seeds]
    fitting = [one for one in refined if one is not None]
    if not fitting:
        return _no_station(StationOutcome.DOES_NOT_FIT, len(points))
    return _judged(points, observed, sigma, fitting, count - unknowns)


def resect_directions(points: FloatArray, directions: FloatArray) -> tuple[FloatArray, float, FloatArray]:
    """Station (2,) and κ from n ≥ 3 directions in closed form, and the singular values (4,) of its system.

    Points are taken relative to their centre and size, so that the third singular value measures the distance
    from the dangerous circle.
    """
    centre = points.mean(axis=0)
    size = float(np.max(np.linalg.norm(points - centre, axis=1)))
    x, y = ((points - centre) / size).T
    sine, cosine = np.sin(directions), np.cos(directions)
    # Across the direction r in the instrument: (cos r, −sin r); R turns object into instrument axes by κ.
    rows = np.column_stack([cosine * x - sine * y, cosine * y + sine * x, -cosine, sine])
    padded, right = principal_rows(rows)
    solution = right[3] / np.hypot(right[3, 0], right[3, 1])
    c, s, u, v = solution
    ahead = sine * (c * x + s * y - u) + cosine * (c * y - s * x - v)
    if np.sum(ahead > 0.0) < np.sum(ahead < 0.0):
        c, s, u, v = -c, -s, -u, -v
    position = centre + size * np.array([c * u - s * v, s * u + c * v])
    return position, float(np.arctan2(s, c)), padded


def _places(points: FloatArray) -> int:
    """Number of different places: a target that is sighted again tells nothing more of where the station is."""
    return len(np.unique(points, axis=0))


def _on_circle(points: FloatArray, directions: FloatArray, sigma: float) -> bool:
    values = resect_directions(points, directions)[2]
    # σ of a direction, relative to the singular value, beyond which the station is on the dangerous circle.
    return bool(values[2] < 30.0 * sigma + 1e-9)


def _seeds(points: FloatArray, observed: FloatArray, has: BoolArray) -> list[tuple[FloatArray, float]]:
    seeds: list[tuple[FloatArray, float]] = []
    sighted, measured = np.flatnonzero(has[:, 0]), np.flatnonzero(has[:, 1])
    both = np.flatnonzero(has[:, 0] & has[:, 1])
    if len(both) > 1:
        r, d = observed[both].T
        local = np.column_stack([d * np.sin(r), d * np.cos(r)])
        fit = congruence(points[both], local)
        if fit.outcome.usable:
            seeds.append((fit.origin, float(np.arctan2(fit.rotation[0, 1], fit.rotation[0, 0]))))
    if _places(points[sighted]) > 2:
        position, kappa, _ = resect_directions(points[sighted], observed[sighted, 0])
        seeds.append((position, kappa))
    if len(both) > 2:
        return seeds
    for position in _arc_section(points[measured], observed[measured, 1]):
        seeds.append((position, orient(position, points[sighted], observed[sighted, 0]).kappa))
    for i in both:
        for j in sighted[sighted != i][:30]:
            seeds.extend(_side_side_angle(points, observed, int(i), int(j)))
    return seeds


def _oriented_seeds(points: FloatArray, observed: FloatArray, has: BoolArray) -> list[tuple[FloatArray, float]]:
    """Return seeds where bearings meet, by linear equations across them, and where arcs meet."""
    sighted, measured = has.T
    seeds = [(position, 0.0) for position in _arc_section(points[measured], observed[measured, 1])]
    if _places(points[sighted]) > 1:
        t, centre = observed[sighted, 0], points[sighted].mean(axis=0)
        across = np.stack([np.cos(t), -np.sin(t)], axis=1)
        offset = np.einsum("ni,ni->n", across, points[sighted] - centre)
        seeds.append((centre + rotations.lstsq(across, offset, rcond=None), 0.0))
    return seeds


def _arc_section(centres: FloatArray, distances: FloatArray) -> FloatArray:
    """The two points (2, 2) of the arcs (n,) that cut best; where they stay apart the place between them; or none."""
    i, j = np.triu_indices(len(distances), 1)
    base = np.linalg.norm(centres[j] - centres[i], axis=1)
    i, j, base = i[base > 0.0], j[base > 0.0], base[base > 0.0]
    if not len(base):
        return np.zeros((0, 2))
    cosine = (distances[i] ** 2 + distances[j] ** 2 - base**2) / (2.0 * distances[i] * distances[j])
    best = int(np.argmin(np.abs(cosine)))
    one, other, length = distances[i[best]], distances[j[best]], base[best]
    along = (length**2 + one**2 - other**2) / (2.0 * length)
    direction = (centres[j[best]] - centres[i[best]]) / length
    foot = centres[i[best]] + along * direction
    height = np.sqrt(max(one**2 - along**2, 0.0)) * np.array([-direction[1], direction[0]])
    return np.stack([foot + height, foot - height])


def _side_side_angle(points: FloatArray, observed: FloatArray, i: int, j: int) -> list[tuple[FloatArray, float]]:
    """Distance and direction to i, direction to j: the distance to j from the cosine law, up to two."""
    reach, angle = observed[i, 1], observed[j, 0] - observed[i, 0]
    side = float(np.linalg.norm(points[j] - points[i]))
    discriminant = side**2 - (reach * np.sin(angle)) ** 2
    seeds = []
    if discriminant >= 0.0:
        for sign in (1.0, -1.0):
            other = reach * np.cos(angle) + sign * np.sqrt(discriminant)
            if other > 0.0:
                r, d = observed[[i, j], 0], np.array([reach, other])
                fit = congruence(points[[i, j]], np.column_stack([d * np.sin(r), d * np.cos(r)]))
                if fit.outcome.usable:
                    seeds.append((fit.origin, float(np.arctan2(fit.rotation[0, 1], fit.rotation[0, 0]))))
    return seeds


def _misclosure(points: FloatArray, observed: FloatArray, position: FloatArray, kappa: float) -> FloatArray:
    direction = np.angle(np.exp(1j * (bearing(position, points) + np.nan_to_num(kappa) - observed[:, 0])))
    return np.column_stack([direction, np.linalg.norm(points - position, axis=1) - observed[:, 1]])


def _refine(
    points: FloatArray, observed: FloatArray, sigma: FloatArray, seed: tuple[FloatArray, float], turns: bool
) -> tuple[FloatArray, float] | None:
    position, kappa = seed
    used = np.isfinite(observed)
    for _ in range(30):
        offset = points - position
        square = np.maximum(np.sum(offset**2, axis=1), 1e-24)
        design = np.zeros((len(points), 2, 3))
        design[:, 0, 0], design[:, 0, 1], design[:, 0, 2] = -offset[:, 1] / square, offset[:, 0] / square, turns
        design[:, 1, :2] = -offset / np.sqrt(square)[:, None]
        misclosure = _misclosure(points, observed, position, kappa)
        rows = (design / sigma[:, None])[used]
        step = -rotations.lstsq(rows, (misclosure / sigma)[used], rcond=1e-13)
        position, kappa = position + step[:2], kappa + step[2]
        if not np.all(np.isfinite(position)) or np.linalg.norm(step[:2]) > 1e3 * np.sqrt(np.max(square)):
            return None
        if np.linalg.norm(step[:2]) < 1e-13 * np.sqrt(np.max(square)) and abs(step[2]) < 1e-13:
            break
    return position, float(np.angle(np.exp(1j * kappa)))


def _judged(
    points: FloatArray,
    observed: FloatArray,
    sigma: FloatArray,
    fitting: list[tuple[FloatArray, float]],
    redundancy: int,
) -> FreeStation:
    def objective(one: tuple[FloatArray, float]) -> float:
        return float(np.nansum((_misclosure(points, observed, *one) / sigma) ** 2))

    ordered = sorted(fitting, key=objective)
    best = ordered[0]
    size = float(np.max(np.linalg.norm(points - best[0], axis=1)))
    limit = objective(best) + AS_GOOD * max(1.0, objective(best) / max(redundancy, 1))
    rivals: list[tuple[FloatArray, float]] = []
    for one in ordered[1:]:
        far = all(np.linalg.norm(one[0] - other[0]) > 1e-3 * size for other in (best, *rivals))
        if far and objective(one) <= limit:
            rivals.append(one)
    sigma0 = float(np.sqrt(objective(best) / redundancy)) if redundancy > 0 else float("nan")
    outcome = StationOutcome.AMBIGUOUS if rivals else StationOutcome.DETERMINED
    if (redundancy > 0 and sigma0 > 30.0) or (redundancy == 0 and objective(best) > 1.0):
        outcome = StationOutcome.DOES_NOT_FIT
    kappa = best[1] if np.any(np.isfinite(observed[:, 0])) else float("nan")
    return FreeStation(outcome, best[0], kappa, _misclosure(points, observed, *best), sigma0, tuple(rivals))


def _no_station(outcome: StationOutcome, count: int) -> FreeStation:
    return FreeStation(outcome, np.full(2, np.nan), float("nan"), np.full((count, 2), np.nan), float("nan"))


# ---- Three bundles of directions in the plane that see the same points, and nothing else of each other.
#
# Two bundles in a plane always meet. Three lines through S_a, S_b, S_c with bearings t_a, t_b, t_c have a
# common point where Σ sin(t_j − t_k) n_i · S_i = 0 over the cyclic (i, j, k), n = (cos t, −sin t): linear in
# the stations where the orientations are known. So the two orientations relative to the first bundle are
# searched for over the half circle, the stations are the null vector, and both are refined with all rays. A
# bundle turned by half a circle has the same lines: the points are in front of it in one of the two cases.
# Three bundles in the plane leave two shapes (Åström and Oskarsson 2000, "Solutions and ambiguities of the
# structure and motion problem for 1D retinal vision"), which only a fourth one, or a point behind a station,
# tells apart.


class PlanShape(NamedTuple):
    """Stations (3, 2) with the first at the origin, κ (3,) with r = t + κ and 0 for the first, points (n, 2)."""

    stations: FloatArray
    kappas: FloatArray
    points: FloatArray
    misfit: float
    """√ of the mean square of the angles by which the rays pass by the points, radians, per redundant ray."""


def three_bundles(directions: FloatArray) -> list[PlanShape]:
    """Shapes that fit the directions (3, n ≥ 6) of the same points, clockwise in radians, the best first.

    Only those with every point in front of every station. The farther of the other two stations is at the distance 1.
    """
    r = np.asarray(directions, dtype=float)
    grid = (np.arange(60) + 0.5) * np.pi / 60
    b, c = np.meshgrid(grid, grid, indexing="ij")
    values, vectors = rotations.eigh(_normals(r, b, c))
    least = values[..., 0]
    beside = [np.roll(least, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
    minima = np.argwhere(least <= np.min(beside, axis=0))
    # Minima of the search that are refined.
    best = minima[np.argsort(least[tuple(minima.T)])][:12]
    shapes: list[PlanShape] = []
    for i, j in best:
        shape = _refined(r, np.array([0.0, b[i, j], c[i, j]]), vectors[i, j, :, 0])
        # Radians between orientations that are the same.
        if shape is not None and not any(
            bool(np.abs(np.exp(1j * shape.kappas) - np.exp(1j * other.kappas)).max() < 1e-3) for other in shapes
        ):
            shapes.append(shape)
    return sorted(shapes, key=lambda shape: shape.misfit)


def _normals(r: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """(…, 4, 4) of the condition of every point, by S_b and S_c."""
    t = [np.broadcast_to(r[0], (*b.shape, r.shape[1])), r[1] - b[..., None], r[2] - c[..., None]]
    rows = np.concatenate(
        [
            np.sin(t[j] - t[k])[..., None] * np.stack([np.cos(t[i]), -np.sin(t[i])], axis=-1)
            for i, j, k in ((1, 2, 0), (2, 0, 1))
        ],
        axis=-1,
    )
    return np.asarray(np.swapaxes(rows, -1, -2) @ rows)


def _refined(r: FloatArray, kappas: FloatArray, places: FloatArray) -> PlanShape | None:
    """The nearest minimum of the angles; ``None`` where some points are in front of a station and some are behind."""
    from scipy.optimize import least_squares  # hardly any network needs it

    def passed_by(x: FloatArray) -> FloatArray:
        stations, t = np.append([0.0, 0.0], x[2:]).reshape(3, 2), r - np.append(0.0, x[:2])[:, None]
        towards = _intersected(stations, t) - stations[:, None]
        across = towards[..., 0] * np.cos(t) - towards[..., 1] * np.sin(t)
        return np.append((across / np.linalg.norm(towards, axis=2)).ravel(), x[2:] @ x[2:] - 1.0)

    found = least_squares(passed_by, np.append(kappas[1:], places), x_scale="jac", max_nfev=60)
    kappas, stations = np.append(0.0, found.x[:2]), np.append([0.0, 0.0], found.x[2:]).reshape(3, 2)
    t = r - kappas[:, None]
    points = _intersected(stations, t)
    towards = points - stations[:, None]
    ahead = np.sign(towards[..., 0] * np.sin(t) + towards[..., 1] * np.cos(t))
    if not np.all(ahead == ahead[:, :1]):
        return None
    # Ahead of the first by the sign of the whole, of the others by half a turn of theirs.
    size = float(ahead[0, 0] * np.linalg.norm(stations, axis=1).max())
    kappas = (kappas + np.where(ahead[:, 0] == ahead[0, 0], 0.0, np.pi)) % (2.0 * np.pi)
    misfit = float(np.sqrt(2.0 * found.cost / (r.shape[1] - 5)))
    return PlanShape(stations / size, kappas, points / size, misfit)


def _intersected(stations: FloatArray, t: FloatArray) -> FloatArray:
    """Points (n, 2) nearest to the lines through the stations (m, 2) with bearings t (m, n)."""
    normals = np.stack([np.cos(t), -np.sin(t)], axis=-1)
    matrix = np.einsum("mni,mnj->nij", normals, normals)
    right = np.einsum("mni,mnk,mk->ni", normals, normals, stations)
    return np.asarray(rotations.solve(matrix, right[..., None])[..., 0])


# ---- Points from the distances between them alone, in the plane or in space: trilateration without known points.
#
# Minimal stress: the sum of squared differences between measured and present distances (Levenberg-Marquardt).
# It begins in a space of two more dimensions, where hardly any wrong minima are, and is then pressed into the
# wanted one. Several beginnings, the first by classical scaling of the shortest paths (W. S. Torgerson,
# Psychometrika 17 (1952)), tell whether the distances leave more than one shape; mirrored ones count as one.

PRECISE = 1.5
"""Root mean square of the residuals in units of σ up to which a shape is as good as the distances."""


@dataclass(frozen=True)
class PointDistances:
    """Distances between ``count`` points, numbered from 0."""

    count: int
    start: IntArray
    end: IntArray
    value: FloatArray
    sigma: FloatArray

    def among(self, points: IntArray) -> PointDistances:
        """The distances among some points (sorted), which get new numbers in their order."""
        here = np.isin(self.start, points) & np.isin(self.end, points)
        start, end = (np.searchsorted(points, one[here]) for one in (self.start, self.end))
        return PointDistances(len(points), start, end, self.value[here], self.sigma[here])


def shape_of_distances(lengths: PointDistances, dimension: int) -> FloatArray | None:
    """Coordinates (n, dimension) up to a movement and a mirror; ``None`` where there is no shape, or more than one."""
    unknowns = lengths.count * dimension - dimension * (dimension + 1) // 2
    if len(lengths.value) < unknowns:
        return None
    size = float(np.mean(lengths.value))
    scaled = PointDistances(lengths.count, lengths.start, lengths.end, lengths.value / size, lengths.sigma / size)
    shapes = _shapes(scaled, dimension)
    if not shapes:
        return None
    best, shape = min(shapes, key=lambda one: one[0])
    rivals = [other for misfit, other in shapes if misfit < max(PRECISE * best, PRECISE)]
    if any(_different(shape, other) for other in rivals) or not _stiff(scaled, shape, unknowns):
        return None
    return size * shape


def _shapes(lengths: PointDistances, dimension: int) -> list[tuple[float, FloatArray]]:
    """Shapes that fit, with the root mean squares of their residuals in units of σ."""
    draw = np.random.default_rng(1)
    shapes: list[tuple[float, FloatArray]] = []
    for number in range(16):
        random = draw.standard_normal((lengths.count, dimension + 2))
        found = _pressed(lengths, random if number else _scaling(lengths, dimension + 2), dimension)
        off = _residuals(lengths, found)
        # Root mean square of the residuals, in parts of the mean distance, up to which a shape fits.
        if np.sqrt(np.mean(off**2)) < 0.01:
            shapes.append((float(np.sqrt(np.mean((off / np.maximum(lengths.sigma, 1e-9)) ** 2))), found))
        # Shapes within the precision of the distances after which no other is looked for.
        if sum(misfit < PRECISE for misfit, _ in shapes) == 4 or (number == 5 and not shapes):
            break
    return shapes


def _scaling(lengths: PointDistances, dimension: int) -> FloatArray:
    graph = scipy.sparse.csr_array((lengths.value, (lengths.start, lengths.end)), shape=(lengths.count, lengths.count))
    square = shortest_path(graph, directed=False) ** 2
    centred = square - square.mean(axis=0) - square.mean(axis=1)[:, None] + square.mean()
    values, vectors = rotations.eigh(-0.5 * centred)
    largest: FloatArray = vectors[:, -dimension:] * np.sqrt(np.maximum(values[-dimension:], 0.0))
    return largest[:, ::-1]


def _pressed(lengths: PointDistances, points: FloatArray, dimension: int) -> FloatArray:
    for pressure in (0.0, 0.1, 1.0, 10.0):
        points = _minimal_stress(lengths, points, dimension, pressure)
    centred = points - points.mean(axis=0)
    return _minimal_stress(lengths, centred[:, :dimension], dimension, 0.0)


def _residuals(lengths: PointDistances, points: FloatArray) -> FloatArray:
    off: FloatArray = np.linalg.norm(points[lengths.end] - points[lengths.start], axis=1) - lengths.value
    return off


def _minimal_stress(lengths: PointDistances, points: FloatArray, dimension: int, pressure: float) -> FloatArray:
    damping = 1e-2
    cost = _cost(lengths, points, dimension, pressure)
    for _ in range(60):
        n, d = points.shape
        towards = points[lengths.end] - points[lengths.start]
        span = np.maximum(np.linalg.norm(towards, axis=1), 1e-12)
        A = _derivatives(lengths, towards / span[:, None])
        weight = np.tile(np.where(np.arange(d) >= dimension, pressure, 0.0), n)
        N = A.T @ A + np.diag(weight)
        gradient = A.T @ (span - lengths.value) + weight * points.ravel()
        while True:
            step = rotations.solve(N + damping * np.eye(n * d), gradient).reshape(n, d)
            trial = _cost(lengths, points - step, dimension, pressure)
            if trial < cost or damping > 1e6:
                break
            damping *= 4.0
        if not trial < cost:
            return points
        settled = cost - trial < 1e-10 * cost
        points, cost, damping = points - step, trial, max(damping / 5.0, 1e-9)
        if settled:
            break
    return points


def _cost(lengths: PointDistances, points: FloatArray, dimension: int, pressure: float) -> float:
    return float(np.sum(_residuals(lengths, points) ** 2) + pressure * np.sum(points[:, dimension:] ** 2))


def _derivatives(lengths: PointDistances, towards: FloatArray) -> FloatArray:
    """(m, n·d) rows of the distances: ``towards`` (m, d) at their ends, the opposite at their starts."""
    rows, d = np.arange(len(towards)), towards.shape[1]
    A = np.zeros((len(towards), lengths.count, d))
    A[rows, lengths.end], A[rows, lengths.start] = towards, -towards
    return A.reshape(len(towards), lengths.count * d)


def _different(one: FloatArray, other: FloatArray) -> bool:
    """True where the distances between all points differ: neither movements nor mirrors change them."""
    apart = [np.linalg.norm(shape[:, None] - shape[None], axis=2) for shape in (one, other)]
    # Root mean square difference of the distances between all points of two shapes, in the same measure.
    return bool(np.sqrt(np.mean((apart[0] - apart[1]) ** 2)) > 0.05)


def _stiff(lengths: PointDistances, points: FloatArray, unknowns: int) -> bool:
    A = _derivatives(lengths, points[lengths.end] - points[lengths.start])
    values = rotations.singular_values(A)
    # Smallest singular value, in parts of the largest, of a shape that is stiff.
    return bool(values[unknowns - 1] > 1e-4 * values[0])


def core_of(lengths: PointDistances, links: int, most: int) -> IntArray:
    """Points (k,) of which each has distances to ``links`` others or more; of many ``most`` that hang together best."""
    neighbours: list[set[int]] = [set() for _ in range(lengths.count)]
    for a, b in zip(lengths.start.tolist(), lengths.end.tolist(), strict=True):
        neighbours[a].add(b)
        neighbours[b].add(a)
    alive = _linked(neighbours, {k for k in range(lengths.count) if neighbours[k]}, links)
    chosen: set[int] = set()
    while alive - chosen and len(chosen) < most:
        best = max(sorted(alive - chosen), key=lambda k: (len(neighbours[k] & chosen), len(neighbours[k] & alive)))
        if chosen and not neighbours[best] & chosen:
            break
        chosen.add(best)
    return np.array(sorted(_linked(neighbours, chosen, links)), dtype=np.int64)


def _linked(neighbours: list[set[int]], among: set[int], links: int) -> set[int]:
    """Remove points with fewer than ``links`` neighbours, one after the other, and return the rest."""
    while True:
        loose = {k for k in among if len(neighbours[k] & among) < links}
        if not loose:
            return among
        among = among - loose
