"""Tables of what was estimated: points, images, cameras, stations, systems, pairs, instruments, groups."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.cameras import CAMERA_MODELS
from mor.observations import is_image_point
from mor.observations.names import places_of
from mor.parameters.kinds import INTERIORS
from mor.project.edge import split
from mor.project.file.model import Axes
from mor.quality.in_chunks import ROWS_AT_A_TIME, in_pieces
from mor.quality.precision.follower_poses import follower_blocks, follower_poses, of_images
from mor.quality.reliability.detectable_errors import Reliability
from mor.quality.reliability.observation_quality import omega_of, redundancy_of
from mor.quality.solved import Solved
from mor.report.edge import (
    Estimate,
    angle_unit,
    plain,
    points,
    rotations,
    said_attitudes,
    said_places,
)
from mor.report.parameters import component_rows, motion_columns, number_or_none
from mor.report.tables.control import control_of_images, control_of_points
from mor.report.tables.ellipses import ellipse_columns
from mor.report.tables.shared import once
from mor.units import ANGLE_UNITS, IMAGE

XYZ = ("x", "y", "z")
ANGLES = ("omega", "phi", "kappa")
STATUSES = ("fixed", "partly fixed", "free", "left out", "at infinity")


@once
def point_table(solved: Solved) -> pl.DataFrame:
    """Object points: coordinates, σ, axes of the error ellipsoid, correlations, number of rays and observations."""
    things = solved.network.things["point"]
    numbers = things.parts["position"]
    rays, others = _observations_of_points(solved)
    columns: dict[str, Any] = {"id": list(things.ids), **_estimated(solved, numbers)}
    columns["rays"] = rays[numbers]
    columns["others"] = others[numbers]
    columns |= control_of_points(solved, numbers)
    columns["status"] = _status(solved, "point", numbers)
    return _frame(columns)


def _estimated(solved: Solved, numbers: IntArray) -> dict[str, FloatArray]:
    """Coordinates, σ, ellipsoids and correlations of points: their covariances are in memory a piece at a time."""
    parts = []
    for first in range(0, max(len(numbers), 1), ROWS_AT_A_TIME):
        estimate = points(solved, numbers[first : first + ROWS_AT_A_TIME])
        columns = _with_sigma(estimate, XYZ)
        for name, axis in zip(("a", "b", "c"), _ellipsoid_axes(estimate), strict=True):
            columns[f"ellipsoid_{name}"] = axis
        columns |= ellipse_columns(solved, estimate.covariance, len(estimate.values))
        columns |= _correlations_of_axes(estimate)
        absent = np.isnan(estimate.values).all(axis=1)
        if absent.any():
            columns = {name: np.where(absent, np.nan, column) for name, column in columns.items()}
        parts.append({name: np.array(column) for name, column in columns.items()})
    return {name: np.concatenate([part.pop(name) for part in parts]) for name in tuple(parts[0])}


def reference_table(solved: Solved) -> pl.DataFrame:
    """Coordinates that inner constraints refer to, whatever the datum: what another datum of the results needs."""
    things = solved.network.things["point"]
    reference = solved.adjustment.problem.datum.reference["point"][things.parts["position"]]
    coordinates = reference @ solved.network.edge.matrix
    return _frame({"id": list(things.ids), **{name: coordinates[:, k] for k, name in enumerate(XYZ)}})


@once
def image_table(solved: Solved) -> pl.DataFrame:
    """Images: camera, projection centre (or tripod target), ω φ κ, σ, number of points, root mean square residual."""
    things = solved.network.things["image"]
    return _frame(
        {
            "id": list(things.ids),
            "camera": [solved.network.things["camera"].ids[k] for k in things.parts["camera"]],
            **_image_poses(solved),
            **_image_residuals(solved),
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
    return _frame(
        {
            "id": list(things.ids),
            **_with_sigma(plain(solved, "base", things.parts["base"]), ("bx", "by", "bz")),
            **_with_sigma(_relative(solved, things.parts["rotation"]), ANGLES),
        }
    )


def _relative(solved: Solved, numbers: IntArray) -> Estimate:
    """Relative rotations do not refer to object axes: they are said as they are."""
    neutral = solved.network.edge._replace(axes=Axes())
    return rotations(replace(solved, network=replace(solved.network, edge=neutral)), numbers)


def interior_rows(solved: Solved) -> list[dict[str, Any]]:
    """Interior orientations, one entry for each block: components with value, σ, status, and their correlations."""
    cameras = solved.network.things["camera"]
    rows = []
    for name, camera in solved.network.project.cameras.items():
        kind = INTERIORS[camera.model].key
        number = cameras.part(name, "interior")
        rows.append(
            {
                "id": name,
                "model": camera.model,
                "unit": solved.network.scales[name].unit,
                "r0": _zero_crossing(solved, name),
                "format": _format(solved, name),
                "components": component_rows(solved, kind, number, CAMERA_MODELS[camera.model].components),
                "correlations": _correlations(solved, kind, number),
            }
        )
    return rows


def _zero_crossing(solved: Solved, name: str) -> float | None:
    """Second zero crossing of the radial distortion in camera units, where the project gives one."""
    given = solved.network.project.cameras[name].r0
    edge, scale = solved.network.edge, solved.network.scales[name]
    return edge.number(given, IMAGE, "", scale) if given is not None else None


def _format(solved: Solved, name: str) -> dict[str, Any] | None:
    """Image size in px and pixel size in camera units, where the project gives them; the origin of coordinates."""
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
            "observations": int(np.count_nonzero(group.mask & ~group.left_out)),
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
                **_component(solved, number),
            }
        rows.append(row)
    return pl.DataFrame(rows)


def variance_components(solved: Solved) -> dict[str, Any] | None:
    """Return the estimation of the variance components of the groups."""
    if solved.treatment is None:
        return None
    found = solved.treatment.components
    return {
        "method": found.method,
        "iterated": found.iterated,
        "settled": found.settled,
        "rounds": found.rounds,
    }


def _component(solved: Solved, number: int) -> dict[str, Any]:
    """Factor on the σ of a group, as estimated (and, where it was iterated, as used)."""
    treatment = solved.treatment
    if treatment is None:
        return {}
    estimated = treatment.components
    return {
        "sigma_factor": number_or_none(estimated.factors[number])
        if np.isfinite(estimated.sigma[number])
        else None,
        "sigma_of_factor": number_or_none(estimated.sigma[number]),
    }


def _largest(tests: Reliability, inside: BoolArray) -> float | None:
    """The largest |test| of the observations inside."""

    def of_rows(rows: slice) -> FloatArray:
        size = np.abs(tests.at(rows).test)
        return np.where(inside[rows] & np.isfinite(size), size, -1.0)

    largest = float(in_pieces(inside.shape, of_rows).max(initial=-1.0))
    return largest if largest >= 0.0 else None


def _image_poses(solved: Solved) -> dict[str, FloatArray]:
    """Poses of images, those of stereo followers worked out from leader and pair."""
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
    by_angles = np.zeros(len(follows), dtype=bool)
    own |= _with_sigma(said_attitudes(solved, D, parts[1], by_angles), ANGLES)
    absent = np.isnan(columns["x"][follows])
    for name, column in own.items():
        columns[name] = columns[name].copy()
        columns[name][follows] = np.where(absent, np.nan, column)
    return columns


def _pose(solved: Solved, positions: IntArray, attitudes: IntArray) -> dict[str, Any]:
    return {
        **_with_sigma(points(solved, positions), XYZ),
        **_with_sigma(rotations(solved, attitudes), ANGLES),
    }


def _with_sigma(estimate: Estimate, names: tuple[str, ...]) -> dict[str, FloatArray]:
    values = {name: estimate.values[:, k] for k, name in enumerate(names)}
    return {**values, **{f"s{name}": estimate.sigma[:, k] for k, name in enumerate(names)}}


def _ellipsoid_axes(estimate: Estimate) -> FloatArray:
    """(3, n) semi-axes of the standard error ellipsoids, largest first."""
    if estimate.covariance is None or len(estimate.values) == 0:
        return np.full((3, len(estimate.values)), np.nan)
    eigenvalues = np.linalg.eigvalsh(np.nan_to_num(estimate.covariance))
    axes: FloatArray = np.sqrt(np.maximum(eigenvalues[:, ::-1], 0.0)).T
    return axes


def _correlations_of_axes(estimate: Estimate) -> dict[str, FloatArray]:
    """Correlations of X, Y and Z of each point; 0 where a coordinate is fixed."""
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
    """Number of rays, and of other observation rows, by point block."""
    count = len(solved.network.blocks["point"].ids)
    rays, others = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    for group in solved.adjustment.problem.groups:
        is_image = is_image_point(group.type)
        for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind == "point" and slot.of != "image":
                target = rays if is_image else others
                target += np.bincount(numbers, minlength=count)
    return rays, others


def _image_residuals(solved: Solved) -> dict[str, Any]:
    """Points measured in each image, and the root mean square of the normalised and the plain residuals."""
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
    rms = (
        np.sqrt(square / np.maximum(2 * count, 1))
        if solved.quality is not None
        else np.full(len(count), np.nan)
    )
    return {"points": count, "rms": np.where(count > 0, rms, np.nan)}


def _squares(v: FloatArray, factors: FloatArray) -> FloatArray:
    """(n,) Σ v² of rows, in the units they were given in."""
    return in_pieces((len(v),), lambda rows: np.asarray(np.nansum((v[rows] / factors) ** 2, axis=1)))


def _status(solved: Solved, kind: str, numbers: IntArray) -> pl.Series:
    """Free, partly fixed, fixed, or what was done about what nothing determines: blocks (n,)."""
    network = solved.network
    free = network.blocks[kind].free[numbers]
    status: IntArray = np.where(free.all(axis=1), 2, np.where(free.any(axis=1), 1, 0))
    if kind in network.absent:
        status = np.where(network.absent[kind][numbers], 3, status)
        status = np.where(np.isin(numbers, list(network.directions)), 4, status)
    return pl.Series(STATUSES).gather(status)


def _frame(columns: dict[str, Any]) -> pl.DataFrame:
    """Columns as a table; names are texts also where there is none, NaN is no value."""
    texts = [name for name in ("id", "camera", "status") if name in columns]
    frame = pl.DataFrame(columns, schema_overrides=dict.fromkeys(texts, pl.String))
    some = [name for name, column in columns.items() if _has_nan(column)]
    return frame.with_columns(pl.col(some).fill_nan(None)) if some else frame


def _has_nan(column: object) -> bool:
    return isinstance(column, np.ndarray) and column.dtype == np.float64 and bool(np.isnan(column).any())
