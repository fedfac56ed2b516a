"""The part of results.json that figures and pages show."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.errors import InputError, Message
from mor.input_files import note_input
from mor.model.cameras import lens_of
from mor.project.document import plain_column
from mor.quality.solution import Solved
from mor.report.estimates import (
    chosen_pairs,
    group_table,
    image_table,
    interior_rows,
    knot_table,
    movement_rows,
    point_table,
    relative_rows,
    station_table,
)
from mor.report.identity import RunIdentity, identity_of, note_rows
from mor.report.observations import SCHEMA, check_rows, gross_errors, possible_causes, suspects
from mor.report.schema import data_types, missing
from mor.report.summary import SCHEMA_VERSION, summary
from mor.report.units import points
from mor.report.verdict import FILE, external_reliability, reliability_rows, verdict_rows
from mor.report.verdict import SCHEMA as EXTERNAL
from mor.types import FloatArray, IntArray

# ---- Tables for pictures and pages of an adjustment, from an outcome or from its results folder.


@dataclass(frozen=True)
class View:
    """Tables of one adjustment, in project axes and units, as they stand in ``results.json``."""

    summary: dict[str, Any]
    identity: dict[str, Any]
    notes: list[dict[str, Any]]
    points: pl.DataFrame
    images: pl.DataFrame
    stations: pl.DataFrame
    groups: pl.DataFrame
    cameras: list[dict[str, Any]]
    relative: list[dict[str, Any]]
    checks: list[dict[str, Any]]
    gross_errors: dict[str, Any]
    suspects: dict[str, Any] | None
    verdict: dict[str, Any] | None
    reliability: dict[str, Any] | None
    possible_causes: list[dict[str, Any]]
    residuals: pl.DataFrame
    residuals_file: str = "residuals.csv"
    """Where the residuals stand as a table."""
    external: pl.DataFrame = field(default_factory=lambda: pl.DataFrame(schema=EXTERNAL))
    """External reliability of points, see :func:`mor.report.verdict.external_reliability`."""
    trajectories: pl.DataFrame = field(default_factory=pl.DataFrame)
    """Knots of trajectories, see :func:`mor.report.estimates.knot_table`; none is written by itself."""
    movements: pl.DataFrame = field(default_factory=pl.DataFrame)
    """Movements of points, see :func:`mor.report.estimates.movement_rows`."""

    @property
    def length(self) -> str:
        """Unit of lengths."""
        return str(self.summary["units"]["length"])

    @property
    def critical(self) -> float:
        """Critical value of |w|."""
        return float(self.summary["critical_w"])

    @cached_property
    def rays(self) -> pl.DataFrame:
        """Image coordinates among the residuals."""
        rays = is_ray(self.residuals)
        return self.residuals if rays.all() else self.residuals.filter(rays)

    @cached_property
    def used(self) -> pl.DataFrame:
        """Residuals of the observations that took part."""
        flag = self.residuals["flag"]
        out = (flag == "excluded") | (flag == "check")
        return self.residuals.filter(~out) if out.any() else self.residuals


def is_ray(residuals: pl.DataFrame) -> pl.Series:
    """True for image coordinates."""
    return residuals["type"] == "image"


def view_of(
    solved: Solved,
    residuals: pl.DataFrame,
    file: str = "residuals.csv",
    of: RunIdentity = RunIdentity(),  # noqa: B008 - frozen
) -> View:
    """The view of an adjustment that converged, with its table of residuals, the file that has it, what was read."""
    images = image_table(solved)
    centres = projection_centres(solved)
    images = images.with_columns(*(pl.Series(name, centres[:, k]) for k, name in enumerate("xyz")))
    return View(
        summary=summary(solved),
        identity=identity_of(solved.network.project, of),
        notes=note_rows(solved.network.notes, of.folder),
        points=_placed(point_table(solved)),
        images=_placed(images.with_columns(pl.col("x", "y", "z").fill_nan(None))),
        stations=station_table(solved),
        groups=group_table(solved),
        cameras=interior_rows(solved),
        relative=relative_rows(solved, chosen_pairs(solved)),
        checks=check_rows(solved),
        gross_errors=gross_errors(solved),
        suspects=suspects(solved),
        verdict=verdict_rows(solved),
        reliability=reliability_rows(solved),
        possible_causes=possible_causes(solved),
        residuals=residuals,
        residuals_file=file,
        external=external_reliability(solved),
        trajectories=knot_table(solved),
        movements=movement_rows(solved),
    )


def view_of_folder(folder: Path) -> View:
    """The view of results on disk. Raises :class:`InputError` if they are missing or tell of no solution."""
    path = folder / "results.json"
    note_input(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError([Message("there is no results.json in this folder", str(folder))]) from None
    except (ValueError, RecursionError):
        raise InputError([Message("this is not a results.json of mor", str(path))]) from None
    if isinstance(data, dict) and (version := data.get("schema_version")) != SCHEMA_VERSION:
        words = (
            f"these results are of version {version}, this program reads version {SCHEMA_VERSION}; "
            "mor adjust --force writes them again"
        )
        raise InputError([Message(words, str(path))])
    if not isinstance(data, dict) or data.get("global_test") is None:
        raise InputError(
            [
                Message(
                    "these results contain no solution (the adjustment did not converge); there is nothing to plot",
                    str(path),
                )
            ]
        )
    try:
        if missing(data) or not {"critical_w", "snooping_level"} <= data.keys():  # the two come with a solution
            raise KeyError
        points, images = (_table(data, name, folder) for name in ("points", "images"))
        view = view_of_rows(data, points, images, _residuals(data, folder))
        if (folder / FILE).is_file():
            view = replace(view, external=_read(folder / FILE, "external reliability", EXTERNAL))
        return replace(
            view,
            movements=_additional(data, "movements", folder, ("point", "from", "to")),
            trajectories=_additional(data, "trajectories", folder, ("trajectory",)),
        )
    except (KeyError, TypeError, pl.exceptions.PolarsError):
        raise InputError([Message("these results are not complete", str(path))]) from None


def _additional(data: dict[str, Any], key: str, folder: Path, texts: tuple[str, ...]) -> pl.DataFrame:
    """A table that a report can do without: empty if it is not there."""
    path = folder / data["tables"].get(key, f"{key}.csv")
    if key not in data["tables"] or not path.exists():
        return pl.DataFrame()
    return _read(path, key, dict.fromkeys(texts, pl.String))


def view_of_rows(data: dict[str, Any], points: pl.DataFrame, images: pl.DataFrame, residuals: pl.DataFrame) -> View:
    """The view of what stands in ``results.json`` and in the tables beside it."""
    return View(
        summary=data,
        identity=data["identity"],
        notes=data.get("notes", []),
        points=_placed(points),
        images=_placed(images),
        stations=_frame(data["stations"], "Station"),
        groups=_frame(data["groups"], "Group"),
        cameras=data["cameras"],
        relative=data["relative"],
        checks=data["checks"],
        gross_errors=data["gross_errors"],
        suspects=data.get("suspects"),
        verdict=data.get("verdict"),
        reliability=data.get("reliability"),
        possible_causes=data.get("possible_causes", []),
        residuals=residuals,
        residuals_file="residuals.csv",
    )


def _placed(frame: pl.DataFrame) -> pl.DataFrame:
    """Rows with coordinates: what was left out or is at infinity has no place in a picture."""
    return frame.filter(pl.col("x").is_not_null()) if frame["x"].null_count() else frame


def _residuals(data: dict[str, Any], folder: Path) -> pl.DataFrame:
    if data["residuals"] is not None:
        return pl.DataFrame(data["residuals"], schema_overrides=SCHEMA, infer_schema_length=None)
    if "residuals_worst" in data["tables"] or "residuals" not in data["tables"]:
        words = "these results have no table of all residuals: mor adjust --tables all writes it"
        raise InputError([Message(words, str(folder / "results.json"))])
    return _read(folder / data["tables"]["residuals"], "residuals", SCHEMA)


def _table(data: dict[str, Any], key: str, folder: Path) -> pl.DataFrame:
    """Points or images, which stand in ``results.json`` or, where they are many, beside it."""
    if data[key] is not None:
        return _frame(data[key], {"points": "Point", "images": "Image"}[key])
    path = folder / data["tables"].get(key, f"{key}.csv")
    return _read(path, key, dict.fromkeys(("id", "camera", "status"), pl.String))


def _read(path: Path, what: str, kinds: dict[str, type[pl.DataType]]) -> pl.DataFrame:
    if not path.exists():
        raise InputError([Message(f"the table of {what} is missing beside results.json", str(path))])
    note_input(path)
    if path.is_dir():  # a table in parts
        for part in path.glob("*.parquet"):
            note_input(part)
        return pl.read_parquet(path / "*.parquet")
    if path.suffix == ".parquet":
        return pl.read_parquet(path)
    frame = pl.read_csv(path, schema_overrides=kinds, infer_schema_length=None)
    texts = frame.select(pl.col(pl.String).fill_null(""))
    return frame.with_columns(*map(plain_column, texts))


def _frame(rows: list[dict[str, Any]], part: str) -> pl.DataFrame:
    return pl.DataFrame(rows, infer_schema_length=None) if rows else pl.DataFrame(schema=data_types(part))


def projection_centres(solved: Solved) -> FloatArray:
    """(n, 3) projection centres in project axes; a follower's is that of its leader and the base."""
    parts = solved.network.things["image"].parts
    centres = points(solved, parts["position"]).values.copy()
    follows = parts["base"] >= 0
    if follows.any():
        values = solved.adjustment.values
        D = values["rotation"][parts["rotation"][follows]]
        base = np.einsum("nji,nj->ni", D, values["base"][parts["base"][follows]])
        centres[follows] += base @ solved.network.edge.matrix
    return centres


# ---- The geometry of rays: who sees what, at which angles rays meet, how much of each image is measured.


class RayPairs(NamedTuple):
    """Rays as pairs of numbers: frame (image or station, images first) and point."""

    frame: IntArray
    point: IntArray


def rays_of(view: View) -> RayPairs:
    """Every ray of an image and every sight of a station to a point of the table of points, once each."""
    points = _numbers(view.points["id"], "to", "point", 0)
    images = _numbers(view.images["id"], "from", "frame", 0)
    stations = _numbers(view.stations["id"], "from", "frame", view.images.height)
    seen = view.used.select("type", "from", "to")
    parts = [
        seen.filter(is_ray(seen)).join(images, on="from", maintain_order="left"),
        seen.filter(pl.col("type").str.ends_with("directions")).join(stations, on="from", maintain_order="left"),
    ]
    pairs = pl.concat(parts).join(points, on="to", maintain_order="left").select("frame", "point")
    pairs = pairs.drop_nulls().unique(maintain_order=True)
    return RayPairs(pairs["frame"].to_numpy(), pairs["point"].to_numpy())


def _numbers(ids: pl.Series, key: str, name: str, first: int) -> pl.DataFrame:
    numbers = np.arange(first, first + len(ids), dtype=np.int64)
    return pl.DataFrame({key: ids.cast(pl.String), name: numbers}).unique(key, keep="first", maintain_order=True)


def centres(view: View) -> FloatArray:
    """(n, 3) places the rays start from: projection centres, then stations; NaN for images that were scanned.

    What was scanned along a trajectory has a place for every line, and that of the table is the first line's.
    """
    parts = [frame.select("x", "y", "z").to_numpy().copy() for frame in (view.images, view.stations) if frame.height]
    if view.images.height:
        parts[0][view.images["id"].is_in(scanned_images(view)).to_numpy()] = np.nan
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def scanned_images(view: View) -> list[str]:
    """Images that line scanners took while they moved along a trajectory."""
    if not view.trajectories.height:
        return []
    lines = [
        camera["id"]
        for camera in view.cameras
        if camera["model"] != "panorama" and (camera.get("format") or {}).get("height") == 1
    ]
    return view.images.filter(pl.col("camera").is_in(lines))["id"].to_list()


def places(view: View) -> FloatArray:
    """(n, 3) coordinates of the table of points."""
    return view.points.select("x", "y", "z").to_numpy() if view.points.height else np.zeros((0, 3))


def intersection_angles(rays: RayPairs, start: FloatArray, end: FloatArray) -> FloatArray:
    """(p,) radians between those two rays of each point that meet best, at most π/2; NaN with fewer than two."""
    result = np.full(len(end), np.nan)
    along = end[rays.point] - start[rays.frame]
    length = np.linalg.norm(along, axis=1)
    known = np.flatnonzero(np.isfinite(length) & (length > 0.0))
    order = known[np.argsort(rays.point[known], kind="stable")]
    along, owner = along[order] / length[order, None], rays.point[order]
    numbers, first, count = np.unique(owner, return_index=True, return_counts=True)
    for k in np.unique(count[count > 1]):
        chosen = np.flatnonzero(count == k)
        # Pairs of rays looked at together.
        for part in np.array_split(chosen, max(1, len(chosen) * k * k // 2_000_000)):
            bundle = along[first[part, None] + np.arange(k)]
            cosine = np.abs(bundle @ np.swapaxes(bundle, 1, 2)).reshape(len(part), -1).min(axis=1)
            result[numbers[part]] = np.arccos(np.clip(cosine, 0.0, 1.0))
    return result


class Window(NamedTuple):
    """The area image coordinates of a camera lie in, and whether y counts downwards."""

    x: tuple[float, float]
    y: tuple[float, float]
    down: bool
    known: bool
    """False if the camera says nothing of its format: the extent of what was measured."""


def window(camera: dict[str, Any], unit: str, xy: FloatArray) -> Window:
    """Window of a camera for image coordinates (n, 2) in ``unit``."""
    size = camera.get("format")
    if size is None:
        low, high = (xy.min(axis=0), xy.max(axis=0)) if len(xy) else (np.zeros(2), np.ones(2))
        return Window((float(low[0]), float(high[0])), (float(low[1]), float(high[1])), False, False)
    factor = 1.0 if unit == "px" else size["pixel"] * _per_camera_unit(camera["unit"], unit)
    width, height = size["width"] * factor, size["height"] * factor
    if size["height"] == 1 and len(xy):  # a line scanner: its images have as many rows as lines were taken
        across = (0.0, width) if size["origin"] == "corner" else (-width / 2.0, width / 2.0)
        return Window(across, (float(xy[:, 1].min()), float(xy[:, 1].max())), size["origin"] == "corner", False)
    if size["origin"] == "corner":
        return Window((0.0, width), (0.0, height), True, True)
    return Window((-width / 2.0, width / 2.0), (-height / 2.0, height / 2.0), False, True)


def _per_camera_unit(camera_unit: str, unit: str) -> float:
    from mor.units import LENGTH_UNITS

    return LENGTH_UNITS.get(camera_unit, 1.0) / LENGTH_UNITS.get(unit, 1.0)


def covered(xy: FloatArray, area: float) -> float:
    """Share of an image's area inside the convex hull of its points (n, 2); 0 with fewer than three."""
    if len(xy) < 3 or area <= 0.0:
        return 0.0
    from scipy.spatial import ConvexHull, QhullError  # no network without images waits for it

    try:
        return float(min(ConvexHull(xy).volume / area, 1.0))
    except QhullError:
        return 0.0


# ---- Distortion of a camera with its standard deviation, from the interior orientation as it stands in
# ``results.json``.
#
# The distortion is what the model makes of an ideal image point beyond central projection with the camera
# constant and the principal point alone. Its σ follows from the covariance of the distortion components,
# those of the camera constant and the principal point left aside.


class DistortionField(NamedTuple):
    """Distortion at n ideal image points (n, 2), with covariances (n, 2, 2); image unit of the camera."""

    shift: FloatArray
    covariance: FloatArray


class RadialCurve(NamedTuple):
    """Radial distortion (mean over all directions) by radius, with σ; all (n,)."""

    radius: FloatArray
    shift: FloatArray
    sigma: FloatArray


def distortion(camera: dict[str, Any], ideal: FloatArray) -> DistortionField:
    """Distortion of a camera (an entry of ``cameras``) at ideal points (n, 2) counted from the principal point."""
    shift, by_terms, covariance = _linearised(camera, ideal)
    return DistortionField(shift, by_terms @ covariance @ np.swapaxes(by_terms, 1, 2))


def radial_curve(camera: dict[str, Any], largest: float, count: int = 61) -> RadialCurve:
    """Radial distortion of a camera from the principal point to the radius ``largest``."""
    radius = np.linspace(0.0, largest, count)[1:]
    azimuths = 16
    azimuth = np.arange(azimuths) * 2.0 * np.pi / azimuths
    direction = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    shift, by_terms, covariance = _linearised(camera, (radius[:, None, None] * direction).reshape(-1, 2))
    along = np.tile(direction, (len(radius), 1))
    mean = np.einsum("nk,nk->n", shift, along).reshape(-1, azimuths).mean(axis=1)
    form = np.einsum("nk,nkp->np", along, by_terms).reshape(len(radius), azimuths, -1).mean(axis=1)
    sigma = np.sqrt(np.maximum(np.einsum("np,pq,nq->n", form, covariance, form), 0.0))
    zero = np.zeros(1)
    return RadialCurve(np.append(zero, radius), np.append(zero, mean), np.append(zero, sigma))


def _linearised(camera: dict[str, Any], ideal: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distortion (n, 2), its derivatives (n, 2, k) by the estimated terms, their covariance (k, k)."""
    model = lens_of(camera["model"])
    names = [component.name for component in model.components]
    values = np.array([camera["components"][name]["value"] for name in names])
    not_distortion = {"c", "f", "xh", "yh", "fx", "fy", "cx", "cy"}
    plain = np.where([name in not_distortion for name in names], values, 0.0)
    constants = np.full((len(ideal), len(model.constants)), float(camera["r0"] or 0.0))
    focal = values[0]
    scale = np.array([1.0, focal / values[names.index("fy")] if "fy" in names else 1.0])
    star = np.column_stack([ideal * scale, np.full(len(ideal), -focal)])
    centre = model.project(star, np.tile(plain, (len(ideal), 1)), constants, ideal)
    seen = model.project(star, np.tile(values, (len(ideal), 1)), constants, centre.xy)
    base = model.project(star, np.tile(plain, (len(ideal), 1)), constants, centre.xy)
    distorting = set(names) - not_distortion
    terms = [k for k, name in enumerate(camera["correlations"]["components"]) if name in distorting]
    free = [camera["correlations"]["components"][k] for k in terms]
    by_terms = seen.by_interior[:, :, [names.index(name) for name in free]]
    return seen.xy - base.xy, by_terms, _covariance(camera, terms, free)


def _covariance(camera: dict[str, Any], terms: list[int], free: list[str]) -> FloatArray:
    matrix = camera["correlations"]["matrix"]
    if matrix is None or not free:
        return np.zeros((len(free), len(free)))
    sigma = np.array([camera["components"][name]["sigma"] for name in free])
    correlation = np.array(matrix)[np.ix_(terms, terms)]
    return np.asarray(correlation * np.outer(sigma, sigma))
