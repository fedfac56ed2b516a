"""Tables of estimates: points, images, cameras, stations, ellipses, trajectories, motions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.errors import UndeterminedObject
from mor.machine import worked_ahead
from mor.model.cameras import CAMERA_MODELS
from mor.model.contract import places_of
from mor.model.images import is_image_point
from mor.model.parameters import INTERIORS, SHAPE
from mor.model.rotations import cross_matrix
from mor.model.shapes import SHAPE_TYPES
from mor.project.axes import Edge, split
from mor.project.prior_knowledge import feature_label, upright
from mor.project.reference_system import EarthModel
from mor.project.schema import Axes, Feature
from mor.project.shapes import FREEDOM
from mor.quality.assessment import Quality, joint_cofactors
from mor.quality.deformation import MovementTests, TestedVectors, movements
from mor.quality.precision import error_ellipses, error_ellipsoids, follower_blocks, follower_poses, of_images
from mor.quality.redundancy import Reliability
from mor.quality.solution import Solved
from mor.quality.test_statistics import ROWS_AT_A_TIME, in_pieces, omega_of, redundancy_of
from mor.report.observations import control_of_images, control_of_points
from mor.report.schema import data_types
from mor.report.units import (
    Estimate,
    angle_unit,
    component_rows,
    motion_columns,
    number_or_none,
    once,
    picked,
    plain,
    points,
    rotations,
    said_attitudes,
    said_places,
)
from mor.types import BoolArray, FloatArray, IntArray, pieces
from mor.units import ANGLE_UNITS, IMAGE

# ---- Error ellipses and ellipsoids of points, and those of the differences of pairs of points.


def ellipse_table(solved: Solved) -> pl.DataFrame:
    """Points with unknowns: ellipse in plan, and the semi-axes of the ellipsoid with directions.

    Azimuths as the project counts bearings, elevations above the horizontal plane, in its unit of angles.
    """
    numbers = free_points(solved)
    covariance = _covariances(solved, numbers)
    ids = solved.network.blocks["point"].ids
    space = error_ellipsoids(covariance)
    edge, unit = solved.network.edge, angle_unit(solved)
    columns: dict[str, FloatArray] = {}
    for k in range(3):
        columns[f"axis{k + 1}"] = space.axes[:, k]
        columns[f"azimuth{k + 1}"] = bearings_of(edge, unit, space.azimuths[:, k])
        columns[f"elevation{k + 1}"] = space.elevations[:, k] / ANGLE_UNITS[unit]
    return pl.DataFrame({"id": [ids[k] for k in numbers], **_in_plan(solved, covariance), **columns})


def free_points(solved: Solved) -> IntArray:
    """Point blocks of named points that have unknowns and σ."""
    numbers = solved.network.things["point"].parts["position"]
    if solved.quality is None:
        return numbers[:0]
    free = solved.network.blocks["point"].free[numbers].any(axis=1)
    if "point" in solved.network.absent:
        free &= ~np.isin(numbers, np.flatnonzero(solved.network.absent["point"]))
    return np.asarray(numbers[free])


def relative_rows(solved: Solved, pairs: IntArray) -> list[dict[str, Any]]:
    """Pairs (n, 2) of point blocks: distance with σ, ellipse in plan and σ of the height of their difference."""
    if solved.quality is None:
        return []
    ids = solved.network.blocks["point"].ids
    differences = np.diff(solved.adjustment.values["point"][pairs], axis=1)[:, 0]
    # Pairs whose covariances are worked out together.
    at_a_time = 100
    parts = [
        _of_differences(solved.quality, pairs[first : first + at_a_time]) for first in range(0, len(pairs), at_a_time)
    ]
    covariance = np.concatenate([np.zeros((0, 3, 3)), *parts])
    lengths = np.linalg.norm(differences, axis=1)
    along = differences / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    sigma = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", along, covariance, along), 0.0))
    plan = _in_plan(solved, covariance)
    azimuth = error_ellipses(covariance).azimuth
    axis = np.column_stack([np.sin(azimuth), np.cos(azimuth), np.zeros(len(azimuth))])
    direction = axis @ solved.network.edge.matrix  # the inverse of a rotation, or of a reflection, of the axes
    return [
        {
            "from": ids[one],
            "to": ids[other],
            "distance": float(lengths[k]),
            "sdistance": float(sigma[k]) if lengths[k] > 0.0 else None,
            **{name: float(column[k]) for name, column in plan.items()},
            "direction": [float(part) for part in direction[k, :2]],
            "sdz": float(np.sqrt(max(covariance[k, 2, 2], 0.0))),
        }
        for k, (one, other) in enumerate(pairs.tolist())
    ]


def chosen_pairs(solved: Solved) -> IntArray:
    """(n, 2) point blocks of the pairs that the project asks for (``report: {relative: …}``)."""
    points = solved.network.things["point"]
    pairs = [[points.part(name, "position") for name in pair] for pair in solved.network.project.report.relative]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def neighbouring_pairs(solved: Solved, most: int) -> IntArray:
    """(n, 2) every point with its nearest neighbour, of the first ``most`` points with unknowns; a pair once."""
    from scipy.spatial import KDTree

    numbers = free_points(solved)[:most]
    if len(numbers) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    places = solved.adjustment.values["point"][numbers]
    nearest = np.asarray(KDTree(places).query(places, k=2)[1])
    # Of two points at one place either may come first.
    other = np.where(nearest[:, 0] == np.arange(len(numbers)), nearest[:, 1], nearest[:, 0])
    pairs = np.sort(np.stack([np.arange(len(numbers)), other], axis=1), axis=1)
    return np.asarray(numbers[np.unique(pairs, axis=0)])


def _of_differences(quality: Quality, pairs: IntArray) -> FloatArray:
    """Covariances (n, 3, 3) of second minus first, internal axes."""
    used, where = np.unique(pairs, return_inverse=True)
    columns = quality.adjustment.problem.index.columns["point"][used]
    q = joint_cofactors(quality, columns.ravel()).reshape(len(used), 3, len(used), 3)
    i, j = where.reshape(pairs.shape).T
    covariance = q[i, :, i] + q[j, :, j] - q[i, :, j] - q[j, :, i]
    return np.asarray(covariance * quality.sigma_factor**2)


def _covariances(solved: Solved, numbers: IntArray) -> FloatArray:
    quality = solved.quality
    if quality is None:
        return np.zeros((len(numbers), 3, 3))
    return np.asarray(np.nan_to_num(quality.cofactors["point"][numbers]) * quality.sigma_factor**2)


def _in_plan(solved: Solved, covariance: FloatArray) -> dict[str, FloatArray]:
    plan, unit = error_ellipses(covariance), angle_unit(solved)
    azimuth = bearings_of(solved.network.edge, unit, plan.azimuth) % float(np.pi / ANGLE_UNITS[unit])
    return {"a": plan.a, "b": plan.b, "azimuth": azimuth}


def ellipse_columns(solved: Solved, covariance: FloatArray | None, count: int) -> dict[str, FloatArray]:
    """Columns ``ellipse_…`` of a table of ``count`` points with covariances (n, 3, 3) in project axes."""
    if covariance is None:
        return {f"ellipse_{name}": np.full(count, np.nan) for name in ("a", "b", "azimuth")}
    M = solved.network.edge.matrix
    return {f"ellipse_{name}": column for name, column in _in_plan(solved, M @ np.nan_to_num(covariance) @ M.T).items()}


def bearings_of(edge: Edge, unit: str, azimuth: FloatArray) -> FloatArray:
    """Azimuths (radians, clockwise from north) as a project counts bearings, in its unit, within the circle."""
    size = ANGLE_UNITS[unit]
    return np.asarray(edge.sense * (azimuth - edge.zero_azimuth) / size % (2.0 * np.pi / size))


# ---- Tables of what was estimated: points, images, cameras, stations, systems, pairs, instruments, groups.

XYZ = ("x", "y", "z")
ANGLES = ("omega", "phi", "kappa")


def has_many_points(solved: Solved) -> bool:
    """True if the table of points is too long to be in memory as a whole."""
    return len(solved.network.things["point"].ids) > ROWS_AT_A_TIME


@once
def point_table(solved: Solved) -> pl.DataFrame:
    """Object points: coordinates, σ, axes of the error ellipsoid, correlations, number of rays and observations."""
    return pl.concat(points_in_pieces(solved))


def points_in_pieces(solved: Solved) -> Iterator[pl.DataFrame]:
    """Yield the table of points, so many rows at a time."""
    seen = _observations_of_points(solved)
    # What a row is made from takes eight times its room.
    rows = pieces(max(len(solved.network.things["point"].ids), 1), ROWS_AT_A_TIME // 8)
    return worked_ahead(rows, lambda some: _rows_of_points(solved, some, seen))


def _rows_of_points(solved: Solved, some: slice, seen: tuple[IntArray, IntArray]) -> pl.DataFrame:
    things, network = solved.network.things["point"], solved.network
    numbers = things.parts["position"][some]
    columns: dict[str, Any] = dict(zip(("rays", "others"), (counts[numbers] for counts in seen), strict=True))
    columns |= control_of_points(solved, numbers)
    # Free, partly fixed, fixed, or what was done about what nothing determines: blocks (n,).
    kind = "point"
    free = network.blocks[kind].free[numbers]
    status: IntArray = np.where(free.all(axis=1), 2, np.where(free.any(axis=1), 1, 0))
    if kind in network.absent:
        status = np.where(network.absent[kind][numbers], 3, status)
        status = np.where(np.isin(numbers, list(network.directions)), 4, status)
    statuses = ("fixed", "partly fixed", "free", "left out", "at infinity")
    columns["status"] = pl.Series(statuses).gather(status)
    return _frame({"id": list(things.ids[some]), **_estimated(solved, numbers), **columns})


def _estimated(solved: Solved, numbers: IntArray) -> dict[str, FloatArray]:
    """Coordinates, σ, ellipsoids and correlations of points."""
    estimate = points(solved, numbers)
    columns = _with_sigma(estimate, XYZ)
    for name, axis in zip(("a", "b", "c"), _ellipsoid_axes(estimate), strict=True):
        columns[f"ellipsoid_{name}"] = axis
    columns |= ellipse_columns(solved, estimate.covariance, len(estimate.values))
    columns |= _correlations_of_axes(estimate)
    absent = np.isnan(estimate.values).all(axis=1)
    if absent.any():
        columns = {name: np.where(absent, np.nan, column) for name, column in columns.items()}
    return columns


class PointSummary(NamedTuple):
    """Summary of all points for the reports."""

    shown: pl.DataFrame
    """The first rows of the table."""
    rms: list[float | None]
    """Root mean squares of σ of x, y, z over the points with unknown coordinates; nothing where none has a σ."""
    weakest: dict[str, Any] | None
    """Row of the point with the longest semi-axis; nothing where no coordinates are unknown."""


SHOWN_POINTS = 2000
"""Points a text report lists; the full table stands beside it."""


@once
def point_summary(solved: Solved) -> PointSummary:
    """Work the summary out from arrays, without the table of points."""
    network, quality = solved.network, solved.quality
    numbers = network.things["point"].parts["position"]
    unknown: BoolArray = np.asarray(network.blocks["point"].free[numbers].any(axis=1))
    if "point" in network.absent:
        unknown[network.absent["point"][numbers] | np.isin(numbers, list(network.directions))] = False
    rows = np.flatnonzero(unknown)
    parts = (points(solved, numbers[rows[some]]).sigma for some in pieces(len(rows), ROWS_AT_A_TIME))
    sigma = np.concatenate([np.zeros((0, 3)), *parts])
    known = [column[~np.isnan(column)] for column in sigma.T]
    rms = [float(np.sqrt(np.mean(column**2))) if len(column) else None for column in known]
    longest = np.zeros(len(rows)) if quality is None else quality.longest_axes[numbers[rows]]
    weakest, seen = None, _observations_of_points(solved)
    if len(rows):
        row = int(rows[np.argmax(longest)])
        (weakest,) = _rows_of_points(solved, slice(row, row + 1), seen).to_dicts()
    return PointSummary(_rows_of_points(solved, slice(SHOWN_POINTS), seen), rms, weakest)


def reference_table(solved: Solved) -> pl.DataFrame:
    """Coordinates that inner constraints refer to, whatever the datum: what another datum of the results needs."""
    things = solved.network.things["point"]
    reference = solved.adjustment.problem.datum.reference["point"][things.parts["position"]]
    coordinates = reference @ solved.network.edge.matrix
    return _frame({"id": list(things.ids), **{name: coordinates[:, k] for k, name in enumerate(XYZ)}})


@once
def image_table(solved: Solved) -> pl.DataFrame:
    """Images: camera, projection centre (or tripod target), ω φ κ, σ, number of points, root mean square residual."""
    images = solved.network.things["image"]
    count = np.zeros(len(images.ids), dtype=np.int64)
    square = np.zeros(len(images.ids))
    for number, group in enumerate(solved.adjustment.problem.groups):
        if not is_image_point(group.type):
            continue
        which = places_of(group.references[0], images.ids)
        count += np.bincount(which, minlength=len(count))
        if solved.quality is not None and group.external is not None:
            squares = _squares(solved.quality.groups[number].v, group.external.factors)
            square += np.bincount(which, weights=squares, minlength=len(count))
    rms = np.sqrt(square / np.maximum(2 * count, 1)) if solved.quality is not None else np.full(len(count), np.nan)
    return _frame(
        {
            "id": list(images.ids),
            "camera": [solved.network.things["camera"].ids[k] for k in images.parts["camera"]],
            **_image_poses(solved),
            "points": count,
            "rms": np.where(count > 0, rms, np.nan),
            **control_of_images(solved),
            **motion_columns(solved),
        }
    )


def station_table(solved: Solved) -> pl.DataFrame:
    """Theodolite stations: position, ω φ κ, orientation of the horizontal circle, instrument height."""
    things = solved.network.things["station"]
    edge = solved.network.edge
    pose = _pose(solved, things.parts["position"], things.parts["rotation"])
    unit = ANGLE_UNITS[angle_unit(solved)]
    orientation = edge.sense * (-pose["kappa"] * unit - edge.zero_azimuth) / unit
    full = 2.0 * np.pi / unit
    idle = np.array([name in solved.network.unoriented for name in things.ids], dtype=bool)
    for column in (orientation, *(pose[key] for name in ANGLES for key in (name, f"s{name}"))):
        column[idle] = np.nan
    return _frame(
        {
            "id": list(things.ids),
            **pose,
            "orientation": np.remainder(orientation, full),
            "sorientation": pose["skappa"],
            "height": solved.adjustment.values["height"][things.parts["height"], 0],
        }
    )


def system_table(solved: Solved) -> pl.DataFrame:
    """Local systems: origin, ω φ κ, scale."""
    things = solved.network.things["system"]
    scale = plain(solved, "scale", things.parts["scale"])
    return _frame(
        {
            "id": list(things.ids),
            **_pose(solved, things.parts["position"], things.parts["rotation"]),
            **_with_sigma(scale, ("scale",)),
        }
    )


def pair_table(solved: Solved) -> pl.DataFrame:
    """Stereo pairs: base in the leading image's system, relative rotation."""
    things = solved.network.things["pair"]
    if not things.ids:
        return _frame({"id": []})
    numbers = things.parts["rotation"]
    neutral = solved.network.edge._replace(axes=Axes())
    return _frame(
        {
            "id": list(things.ids),
            **_with_sigma(plain(solved, "base", things.parts["base"]), ("bx", "by", "bz")),
            **_with_sigma(rotations(replace(solved, network=replace(solved.network, edge=neutral)), numbers), ANGLES),
        }
    )


def interior_rows(solved: Solved) -> list[dict[str, Any]]:
    """Interior orientations, one entry for each block: components with value, σ, status, and their correlations."""
    cameras = solved.network.things["camera"]
    rows = []
    for name, camera in solved.network.project.cameras.items():
        kind = INTERIORS[camera.model].key
        number = cameras.part(name, "interior")
        # Second zero crossing of the radial distortion in camera units, where the project gives one.
        given = solved.network.project.cameras[name].r0
        edge, scale = solved.network.edge, solved.network.scales[name]
        rows.append(
            {
                "id": name,
                "model": camera.model,
                "unit": solved.network.scales[name].unit,
                "r0": edge.number(given, IMAGE, "", scale) if given is not None else None,
                "format": _format(solved, name),
                "components": component_rows(solved, kind, number, CAMERA_MODELS[camera.model].components),
                "correlations": _correlations(solved, kind, number),
            }
        )
    return rows


def _format(solved: Solved, name: str) -> dict[str, Any] | None:
    camera, scale = solved.network.project.cameras[name], solved.network.scales[name]
    if camera.image is None:
        return None
    width, height = (split(text)[0] for text in (camera.image.width, camera.image.height))
    return {"width": width, "height": height, "pixel": scale.pixel, "origin": camera.coordinates}


def _correlations(solved: Solved, kind: str, number: int) -> dict[str, Any]:
    free = np.flatnonzero(solved.network.blocks[kind].free[number])
    covariance = plain(solved, kind, np.array([number])).covariance
    names = [solved.network.blocks[kind].kind.names[k] for k in free]
    if covariance is None:
        return {"components": names, "matrix": None}
    part = covariance[0][np.ix_(free, free)]
    sigma = np.sqrt(np.maximum(np.diagonal(part), 1e-300))
    return {"components": names, "matrix": np.clip(part / np.outer(sigma, sigma), -1.0, 1.0).tolist()}


@once
def group_table(solved: Solved) -> pl.DataFrame:
    """Observation groups: number of observations, Σ r, its part of vᵀPv, estimated σ0 of the group."""
    rows = []
    inside = len(solved.adjustment.problem.groups) - len(solved.network.checks)
    for number, group in enumerate(solved.adjustment.problem.groups[:inside]):
        row: dict[str, Any] = {
            "name": group.name,
            "type": group.type.name,
            "observations": int(np.count_nonzero(group.used)),
        }
        if solved.quality is not None:
            quality = solved.quality.groups[number]
            omega, r = omega_of(quality), redundancy_of(quality)
            row |= {
                "redundancy": r,
                "vtpv": omega,
                "sigma0": float(np.sqrt(omega / r)) if r > 1e-6 and omega >= 0.0 else None,
                "mean_r": r / row["observations"] if row["observations"] else None,
                "largest_w": _largest(solved.quality.reliability[number], ~group.left_out),
                "excluded": int(np.count_nonzero(group.left_out)),
                "flagged": int(np.count_nonzero(solved.quality.flagged[number])),
            }
            if solved.treatment is not None:  # the factor on the σ as estimated, and as used where it was iterated
                factors = solved.treatment.components
                known = np.isfinite(factors.sigma[number])
                row["sigma_factor"] = number_or_none(factors.factors[number]) if known else None
                row["sigma_of_factor"] = number_or_none(factors.sigma[number])
        rows.append(row)
    return pl.DataFrame(rows)


def variance_components(solved: Solved) -> dict[str, Any] | None:
    """Return the estimation of the variance components of the groups."""
    if solved.treatment is None:
        return None
    return picked(solved.treatment.components, "method", "iterated", "settled", "rounds")


def _largest(tests: Reliability, inside: BoolArray) -> float | None:
    largest = -1.0
    for rows in pieces(len(inside), ROWS_AT_A_TIME):
        size = np.abs(tests.at(rows).test)
        largest = max(largest, float(np.where(inside[rows] & np.isfinite(size), size, -1.0).max(initial=-1.0)))
    return largest if largest >= 0.0 else None


def _image_poses(solved: Solved) -> dict[str, FloatArray]:
    images = solved.network.things["image"]
    columns = _pose(solved, images.parts["position"], images.parts["rotation"])
    follows = np.flatnonzero(images.parts["base"] >= 0)
    if not len(follows):
        return columns
    place, D = follower_poses(solved.adjustment.values, follower_blocks(images, follows))
    q = None
    if solved.quality is not None:
        q = of_images(solved.quality.followers, images, follows) * solved.quality.sigma_factor**2
    parts = (None, None) if q is None else (q[:, :3, :3], q[:, 3:, 3:])
    own = _with_sigma(said_places(solved, place, parts[0]), XYZ)
    own |= _with_sigma(said_attitudes(solved, D, parts[1], np.zeros(len(follows), dtype=bool)), ANGLES)
    absent = np.isnan(columns["x"][follows])
    for name, column in own.items():
        columns[name] = columns[name].copy()
        columns[name][follows] = np.where(absent, np.nan, column)
    return columns


def _pose(solved: Solved, positions: IntArray, attitudes: IntArray) -> dict[str, Any]:
    return {**_with_sigma(points(solved, positions), XYZ), **_with_sigma(rotations(solved, attitudes), ANGLES)}


def _with_sigma(estimate: Estimate, names: tuple[str, ...]) -> dict[str, FloatArray]:
    values = {name: estimate.values[:, k] for k, name in enumerate(names)}
    return {**values, **{f"s{name}": estimate.sigma[:, k] for k, name in enumerate(names)}}


def _ellipsoid_axes(estimate: Estimate) -> FloatArray:
    """(3, n) semi-axes of the standard error ellipsoids, largest first."""
    if estimate.covariance is None or len(estimate.values) == 0:
        return np.full((3, len(estimate.values)), np.nan)
    eigenvalues = np.linalg.eigvalsh(np.nan_to_num(estimate.covariance))
    return np.asarray(np.sqrt(np.maximum(eigenvalues[:, ::-1], 0.0)).T)


def _correlations_of_axes(estimate: Estimate) -> dict[str, FloatArray]:
    nothing = np.full(len(estimate.values), np.nan)
    pairs = {"rxy": (0, 1), "rxz": (0, 2), "ryz": (1, 2)}
    if estimate.covariance is None:
        return dict.fromkeys(pairs, nothing)
    product = estimate.sigma[:, :, None] * estimate.sigma[:, None, :]
    some = product > 0.0
    correlation = np.where(some, estimate.covariance / np.where(some, product, 1.0), 0.0)
    correlation = np.clip(correlation, -1.0, 1.0)  # round-off of coordinates that move as one
    return {name: correlation[:, i, j] for name, (i, j) in pairs.items()}


def _observations_of_points(solved: Solved) -> tuple[IntArray, IntArray]:
    count = len(solved.network.blocks["point"].ids)
    rays, others = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    for group in solved.adjustment.problem.groups:
        is_image = is_image_point(group.type)
        for slot, numbers in group.blocks_by_slot:
            if slot.kind == "point" and slot.of != "image":
                target = rays if is_image else others
                target += np.bincount(numbers, minlength=count)
    return rays, others


def _squares(v: FloatArray, factors: FloatArray) -> FloatArray:
    """(n,) Σ v² of rows, in the units they were given in."""
    return in_pieces((len(v),), lambda rows: np.asarray(np.nansum((v[rows] / factors) ** 2, axis=1)))


def _frame(columns: dict[str, Any]) -> pl.DataFrame:
    """Columns as a table; names are texts also where there is none, NaN is no value."""
    texts = [name for name in ("id", "camera", "status") if name in columns]
    frame = pl.DataFrame(columns, schema_overrides=dict.fromkeys(texts, pl.String))
    some = [
        name
        for name, column in columns.items()
        if (isinstance(column, np.ndarray) and column.dtype == np.float64 and bool(np.isnan(column).any()))
    ]
    return frame.with_columns(pl.col(some).fill_nan(None)) if some else frame


# ---- Table of undetermined unknowns, with reason and treatment.

FILE = "undetermined.csv"


def undeterminable_rows(solved: Solved) -> list[dict[str, Any]]:
    """One row for each thing; of points at infinity the unit vector to them, and its σ (the larger semi-axis)."""
    # Unit vectors in project axes by the names of points at infinity, σ in the project's angle unit.
    network = solved.network
    unit = ANGLE_UNITS[angle_unit(solved)]
    directions: dict[str, dict[str, float | None]] = {}
    for point, rotation in network.directions.items():
        vector = solved.adjustment.values["rotation"][rotation][2] @ network.edge.matrix
        sigma = None
        if solved.quality is not None:
            cofactor = solved.quality.cofactors["rotation"][rotation][:2, :2]
            largest = float(np.linalg.eigvalsh(cofactor)[-1])
            sigma = solved.quality.sigma_factor * float(np.sqrt(max(largest, 0.0))) / unit
        row = {f"d{axis}": float(x) for axis, x in zip("xyz", vector, strict=True)}
        directions[network.blocks["point"].ids[point]] = {**row, "sigma": sigma}
    return [
        {**_row(thing), **directions.get(thing.name if thing.treatment == "at infinity" else "", _NOTHING)}
        for thing in solved.network.undeterminable
    ]


def undeterminable_table(things: Sequence[dict[str, Any] | UndeterminedObject]) -> pl.DataFrame:
    """The rows as a table."""
    rows = [_row(thing) | _NOTHING if isinstance(thing, UndeterminedObject) else thing for thing in things]
    return pl.DataFrame(rows, schema=data_types("Undeterminable"))


_NOTHING: dict[str, float | None] = dict.fromkeys(("dx", "dy", "dz", "sigma"))


def _row(thing: UndeterminedObject) -> dict[str, Any]:
    return {"kind": thing.kind, "id": thing.name, **picked(thing, "reason", "treatment", "observations")}


# ---- Planes, lines and other shapes as they came out: where they lie, and how well their points fit.


def feature_table(solved: Solved) -> pl.DataFrame:
    """One row for every feature, two for a right angle, in project axes and length unit.

    (dx, dy, dz) is the unit normal of a plane or the unit direction of a line or an axis, with the largest standard
    deviation ``sd`` of the direction in the project's unit of angles; (x, y, z) the mean of the points, put on the
    plane, line or axis of a cylinder, or else the centre or apex, with σ of the movement along a normal or across an
    axis; ``distance`` of a plane that from the origin, dx x + dy y + dz z; ``rms`` the root mean square distance of
    the points and ``form`` the largest residual minus the smallest. Sizes are null if a feature has none.
    """
    rows = [row for feature in solved.network.project.features for row in _rows(solved, feature)]
    return pl.DataFrame(rows, schema=data_types("Feature"))


def _rows(solved: Solved, feature: Feature) -> list[dict[str, Any]]:
    label = feature_label(feature)
    group = next(g for g in solved.adjustment.problem.groups if g.name == label and len(g.type.slots) >= 5)
    part_of = {slot.part: numbers for slot, numbers in group.blocks_by_slot}
    system: dict[str, int] = {part: int(part_of[part][0]) for part in ("rotation", "turn", "offset") if part in part_of}
    origin, points = int(group.blocks[0][0]), group.blocks[4]
    values, M = solved.adjustment.values, solved.network.edge.matrix
    D, offset = values["rotation"][system["rotation"]], values["eccentricity"][system["offset"]]
    turn = values["rotation"][system["turn"]] if "turn" in system else np.eye(3)
    D = turn @ D
    local = (values["point"][points] - values["point"][origin]) @ D.T + offset
    off, sizes = local, dict[str, float | None]()
    if feature.type in SHAPE_TYPES:
        for name, size in component_rows(solved, SHAPE.key, int(part_of["shape"][0]), SHAPE.components).items():
            if FREEDOM[feature.type].shape[SHAPE.names.index(name)]:
                sizes |= {name: size["value"], f"s{name}": size["sigma"]}
        blocks = [values[slot.kind][numbers] for slot, numbers in group.blocks_by_slot]
        off = group.type.equation(blocks, group.constants).values
    rows = []
    for part, axis, chosen in _parts(feature, len(points)):
        on = local[chosen].mean(axis=0)
        if feature.type in ("plane", "right angle"):
            held, away = axis, off[chosen] @ axis[:, None]
        else:
            # Features that have no centre: the place of one is the mean of its points, put on the axis.
            held, away = 1.0 - axis if feature.type in ("line", "cylinder") else np.ones(3), off[chosen][:, :2]
        on = on * (1.0 - held)
        place = ((on - offset) @ D + values["point"][origin]) @ M
        direction = None if feature.type == "sphere" else upright((axis @ D @ M)[None])[0]
        sd, sigma = _feature_sigma(solved, system, (D, turn), on - offset, axis, held)
        rows.append(
            {
                "id": feature.id,
                "type": feature.type,
                "part": part,
                **dict(zip(("dx", "dy", "dz"), (None,) * 3 if direction is None else direction.tolist(), strict=True)),
                "sd": None if direction is None else sd,
                "distance": float(direction @ place)
                if direction is not None and feature.type in ("plane", "right angle")
                else None,
                **dict(zip("xyz", place.tolist(), strict=True)),
                **dict(zip(("sx", "sy", "sz"), sigma, strict=True)),
                **sizes,
                "points": int(np.count_nonzero(chosen)),
                "rms": float(np.sqrt(np.mean(np.sum(away**2, axis=1)))),
                "form": float(np.ptp(away, axis=0).max()),
            }
        )
    return rows


def _feature_sigma(
    solved: Solved,
    system: dict[str, int],
    rotations: tuple[FloatArray, FloatArray],
    lever: FloatArray,
    axis: FloatArray,
    held: FloatArray,
) -> tuple[float | None, list[float | None]]:
    """σ of the direction of an axis, project unit, and σ (3,) of the place X0 + Dᵀ p, ``lever`` p (3,).

    ``system`` has blocks, ``rotations`` are D = E D_A and E.

    Only movements along the local axes ``held`` (3,), 1 or 0, count: a plane moves along its normal, a line across.
    """
    quality = solved.quality
    if quality is None:
        return None, [None] * 3
    columns = quality.adjustment.problem.index.columns
    D, turn = rotations
    used = [columns["rotation"][system["rotation"]], columns["eccentricity"][system["offset"]]]
    by_system = np.zeros((6, 6))
    by_system[:3, :3], by_system[3:, 3:] = turn, np.eye(3)
    if "turn" in system:
        used.append(columns["rotation"][system["turn"]])
        by_system = np.concatenate([by_system, np.eye(6)[:, :3]], axis=1)
    cofactors = joint_cofactors(quality, np.concatenate(used))
    covariance = by_system @ cofactors @ by_system.T * quality.sigma_factor**2
    across = covariance[:3, :3][np.ix_(axis == 0.0, axis == 0.0)]
    by_unknowns = -held[:, None] * np.concatenate([cross_matrix(lever), np.eye(3)], axis=1)
    turned = solved.network.edge.matrix.T @ D.T @ by_unknowns
    variances = np.einsum("ij,jk,ik->i", turned, covariance, turned)
    largest = max(float(np.linalg.eigvalsh(across)[-1]), 0.0)
    sigma = [float(s) for s in np.sqrt(np.maximum(variances, 0.0))]
    return float(np.sqrt(largest)) / ANGLE_UNITS[angle_unit(solved)], list(sigma)


def _parts(feature: Feature, count: int) -> list[tuple[str, FloatArray, np.ndarray]]:
    first = np.arange(count) < len(feature.points)
    x, z = np.eye(3)[[0, 2]]
    if feature.type == "right angle":
        return [("points", z, first), ("other", x, ~first)]
    return [("", z, first)]


# ---- Trajectories in the result: every knot with its pose and σ, misalignments of inertial systems.

POSE = ("x", "y", "z", "omega", "phi", "kappa")


@once
def knot_table(solved: Solved) -> pl.DataFrame:
    """One row for each knot: trajectory, time in seconds, stretch (from 1), pose with σ."""
    trajectories = solved.network.trajectories.values()
    if not trajectories:
        return pl.DataFrame()
    positions = points(solved, np.concatenate([t.positions for t in trajectories]))
    attitudes = rotations(solved, np.concatenate([t.rotations for t in trajectories]))
    columns: dict[str, Any] = {
        "trajectory": [t.name for t in trajectories for _ in t.times],
        "time": np.concatenate([t.times for t in trajectories]),
        "stretch": np.concatenate([t.stretch + 1 for t in trajectories]),
    }
    columns |= _with_sigma(positions, XYZ) | _with_sigma(attitudes, ANGLES)
    return pl.DataFrame(columns).with_columns(pl.col(pl.Float64).fill_nan(None))


def boresight_rows(solved: Solved) -> list[dict[str, Any]]:
    """Misalignments of inertial systems that are unknown: ω, φ, κ with σ, by instrument."""
    things = solved.network.things["instrument"]
    numbers = things.parts["boresight"]
    blocks = solved.network.blocks.get("rotation")
    rows = []
    for name, number in zip(things.ids, numbers.tolist(), strict=True):
        if number < 0 or blocks is None or not blocks.free[number].any():
            continue
        found = rotations(solved, np.array([number]))
        row: dict[str, Any] = {"instrument": name}
        for k, part in enumerate(POSE[3:]):
            sigma = float(found.sigma[0, k])
            row |= {part: float(found.values[0, k]), f"s{part}": sigma if np.isfinite(sigma) else None}
        rows.append(row)
    return rows


# ---- Movements of points in one adjustment as tables, in project axes: what moves them, and how far they have moved.

PER = {"velocity": "/a", "annual oscillation": "", "step": ""}
"""What stands behind the unit of length of a parameter: velocities are lengths in a year."""


@once
def found_movements(solved: Solved) -> MovementTests | None:
    """Movements of an adjustment, worked out once."""
    return movements(solved)


def epoch_rows(solved: Solved) -> list[dict[str, Any]]:
    """The epochs in the order of time."""
    motion = solved.network.motion
    return [{"epoch": motion.labels[k], "year": motion.times[k]} for k in motion.in_order]


def motion_table(solved: Solved) -> pl.DataFrame:
    """One row for each parameter of a point: velocity, step; of an annual oscillation the sine, then the cosine."""
    found = found_movements(solved)
    if found is None:
        return pl.DataFrame()
    tested = found.parameters
    begins = {"point": list(tested.names), "parameter": list(tested.what), "time": list(tested.end)}
    return _with_tests(solved, tested, begins, 6)


def movement_rows(solved: Solved) -> pl.DataFrame:
    """One row for each point and epoch: movement since the first epoch of the point."""
    found = found_movements(solved)
    if found is None:
        return pl.DataFrame()
    tested = found.between
    begins = {"point": list(tested.names), "from": list(tested.begin), "to": list(tested.end)}
    M = solved.network.edge.matrix
    Q = M.T @ tested.tests.cofactors[:, :3, :3] @ M
    s = np.sqrt(np.maximum(np.diagonal(Q, axis1=1, axis2=2), 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = {f"r{'xyz'[i]}{'xyz'[j]}": Q[:, i, j] / (s[:, i] * s[:, j]) for i, j in ((0, 1), (0, 2), (1, 2))}
    return _with_tests(solved, tested, begins, 3).with_columns(
        pl.Series(name, values).fill_nan(None) for name, values in shares.items()
    )


def _with_tests(solved: Solved, tested: TestedVectors, begins: dict[str, Any], size: int) -> pl.DataFrame:
    quality = solved.quality
    assert quality is not None
    M = solved.network.edge.matrix
    vectors = _turned(tested.tests.vectors, M)
    variances = np.diagonal(tested.tests.cofactors, axis1=1, axis2=2)
    sigma = _turned(np.sqrt(np.maximum(variances, 0.0)), np.abs(M)) * quality.sigma_factor
    has = np.array([what == "annual oscillation" for what in tested.what], dtype=bool)
    columns: dict[str, Any] = dict(begins)
    for k, name in enumerate(("x", "y", "z", "cos_x", "cos_y", "cos_z")[:size]):
        columns[name] = np.where(has | (k < 3), vectors[:, k], np.nan)
        columns[f"s{name}"] = np.where(has | (k < 3), sigma[:, k], np.nan)
    columns["freedom"] = tested.tests.freedom
    columns["test"] = tested.tests.statistic / (quality.sigma_factor**2)
    columns["p"] = np.exp(tested.log_p)
    columns["smallest"] = tested.smallest
    columns["moved"] = tested.significant
    texts = dict.fromkeys(begins, pl.String)
    return pl.DataFrame(columns, schema_overrides=texts).with_columns(pl.col(pl.Float64).fill_nan(None))


def _turned(vectors: FloatArray, M: FloatArray) -> FloatArray:
    """(n, 6) two vectors a row, from internal to project axes."""
    return np.concatenate([vectors[:, :3] @ M, vectors[:, 3:] @ M], axis=1)


# ---- Points of a network on the earth: in its reference system, above ellipsoid and geoid, geocentric.

ANGULAR = ("latitude", "longitude")


@once
def place_table(solved: Solved) -> pl.DataFrame:
    """One row for each point, in the units of the project; angles of a project in d-m-s in degrees.

    Coordinates in the reference system, σ east, north, up in the horizon of the point (in the datum of the adjustment),
    height above the ellipsoid, geoid height and height above the geoid where it is known, geocentric coordinates.
    """
    network = solved.network
    world, things = network.world, network.things["point"]
    if world is None:
        return pl.DataFrame()
    numbers = things.parts["position"]
    positions = solved.adjustment.values["point"][numbers].copy()
    if "point" in network.absent:
        positions[network.absent["point"][numbers]] = np.nan
    N = world.geoid_at(numbers, positions)
    unit = ANGLE_UNITS[angle_unit(solved)]
    columns: dict[str, Any] = {"id": list(things.ids)}
    for name, column in zip(world.system.coordinates, world.from_object(positions, N).T, strict=True):
        columns[name] = column / unit if name in ANGULAR else column
    for name, column in zip(("east", "north", "up"), _sigma(solved, world, positions).T, strict=True):
        columns[f"s{name}"] = column
    height = world.horizon.to_geodetic(positions)[:, 2]
    columns |= {"ellipsoidal_height": height, "geoid": N, "orthometric_height": height - N}
    for name, column in zip("XYZ", world.horizon.to_geocentric(positions).T, strict=True):
        columns[f"geocentric_{name.lower()}"] = column
    return pl.DataFrame(columns).with_columns(pl.col(pl.Float64).fill_nan(None))


def _sigma(solved: Solved, world: EarthModel, positions: FloatArray) -> FloatArray:
    """σ (n, 3) east, north, up at positions (n, 3), NaN if there is no solution."""
    if solved.quality is None:
        return np.full(positions.shape, np.nan)
    numbers = solved.network.things["point"].parts["position"]
    axes = world.horizon.local_axes(positions)
    covariance = solved.quality.cofactors["point"][numbers] * solved.quality.sigma_factor**2
    return np.asarray(np.sqrt(np.maximum(np.einsum("nij,njk,nik->ni", axes, covariance, axes), 0.0)))
