"""Data of the page: payload of its scripts, derived values."""

from __future__ import annotations

import base64
import json
import zlib
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.errors import InputError, Message
from mor.model.earth import GRS80, Ellipsoid, Horizon
from mor.model.geodetic import earth_types
from mor.model.observation_types import ALL_TYPES
from mor.project.axes import Edge
from mor.project.schema import Axes, Units
from mor.quality.precision import error_ellipsoids
from mor.quality.test_statistics import comparable
from mor.report.estimates import bearings_of
from mor.report.language import ENGLISH, Words, datum_name
from mor.report.layout import frame_of, round_length
from mor.report.observations import SHOWN as RESIDUALS
from mor.report.view import (
    RayPairs,
    View,
    Window,
    centres,
    covered,
    intersection_angles,
    places,
    rays_of,
    scanned_images,
    window,
)
from mor.types import FloatArray
from mor.units import ANGLE_UNITS

# ---- Quantities of points, images and sets that the page shows beyond the result tables.


def _measures() -> list[pl.Expr]:
    return [
        pl.col("r").mean().alias("mean_r"),
        pl.col("r").min().alias("smallest_r"),
        pl.col("w").abs().max().alias("largest_w"),
        pl.len().alias("observations"),
    ]


def points_with_tests(view: View, rays: RayPairs, angle_unit: str) -> pl.DataFrame:
    """The table of points with the smallest r and the best intersection angle."""
    touching = pl.col("type").str.contains("^(difference|level)$").not_()
    used = view.used.filter(touching).select("at", "from", "to", "r")
    named = pl.concat(
        [
            used.filter(pl.col(key) != "").select(pl.col(key).str.strip_prefix("point ").alias("id"), "r")
            for key in ("at", "from", "to")
        ]
    )
    known = view.points.select(pl.col("id").cast(pl.String))
    measured = named.join(known, on="id", how="semi").group_by("id", maintain_order=True)
    smallest = measured.agg(pl.col("r").min().alias("smallest_r"))
    angle = intersection_angles(rays, centres(view), places(view)) / ANGLE_UNITS[angle_unit]
    with_angle = view.points.with_columns(pl.Series("angle", angle).fill_nan(None))
    return with_angle.join(smallest, on="id", how="left", maintain_order="left")


def image_points(view: View) -> pl.DataFrame:
    """One row for each ray: image, point, unit, x, y, vx, vy, mean r, the larger test value, flags."""
    rays = view.rays
    x, y = (rays.filter(pl.col("component") == name) for name in "xy")
    places, others = ["group", "from", "to"], ["observed", "v", "r", "w", "flag"]
    if x.height == y.height and all((x[name] == y[name]).all() for name in places):
        both = x.hstack(y.select(pl.col(name).alias(f"{name}_y") for name in others))
    else:
        again = pl.int_range(pl.len()).over(places).alias("again")
        keys = [*places, "again"]
        both = x.with_columns(again).join(
            y.with_columns(again).select(*keys, *others), on=keys, suffix="_y", maintain_order="left"
        )
    return both.select(
        pl.col("from").alias("image"),
        pl.col("to").alias("point"),
        "unit",
        pl.col("observed").alias("x"),
        pl.col("observed_y").alias("y"),
        pl.col("v").alias("vx"),
        pl.col("v_y").alias("vy"),
        ((pl.col("r") + pl.col("r_y")) / 2.0).alias("r"),
        pl.max_horizontal(pl.col("w").abs(), pl.col("w_y").abs()).alias("w"),
        (pl.col("flag") + pl.col("flag_y")).alias("flag"),
    )


def windows(view: View, measured: pl.DataFrame) -> dict[str, Window]:
    """Window of each camera that took images."""
    rays = measured.join(view.images.select(pl.col("id").alias("image"), "camera"), on="image", maintain_order="left")
    result = {}
    for camera in view.cameras:
        mine = rays.filter(pl.col("camera") == camera["id"])
        if mine.height:
            result[camera["id"]] = window(camera, str(mine["unit"][0]), mine.select("x", "y").to_numpy())
    return result


def images_with_tests(view: View, measured: pl.DataFrame, areas: dict[str, Window]) -> pl.DataFrame:
    """The table of images with the unit of their points and their coverage."""
    if view.images.height == 0:
        return view.images
    by_image = measured.group_by("image", maintain_order=True).agg(pl.col("unit").first())
    camera_of = dict(zip(view.images["id"], view.images["camera"], strict=True))
    coverage: dict[str, float] = {}
    for (name,), rows in measured.group_by(["image"], maintain_order=True):
        if camera_of.get(str(name)) not in areas:
            continue  # an image that was left out has no camera any more
        area = areas[camera_of[name]]
        size = (area.x[1] - area.x[0]) * (area.y[1] - area.y[0])
        coverage[str(name)] = 100.0 * covered(rows.select("x", "y").to_numpy(), size)
    return view.images.join(by_image.rename({"image": "id"}), on="id", how="left", maintain_order="left").with_columns(
        pl.Series("coverage", [coverage.get(name) for name in view.images["id"]], dtype=pl.Float64)
    )


def control_table(view: View) -> pl.DataFrame:
    """Coordinates that were given: v, σ of the given value, r and w, and the smallest detectable error, by point."""
    of_point = pl.col("from").str.starts_with("point ") & pl.col("component").is_in(["x", "y", "z"])
    rows = view.used.filter(((pl.col("type") == "parameter") & of_point) | (pl.col("type") == "coordinates"))
    name = pl.when(pl.col("from") == "").then(pl.col("to")).otherwise(pl.col("from")).str.strip_prefix("point ")
    columns = ["component", "unit", "observed", "adjusted", "v", "sigma", "r", "w", "nabla", "flag"]
    return rows.select(name.alias("point"), *columns)


def deviations(rows: pl.DataFrame) -> list[dict[str, Any]]:
    """Deviations ``v`` of coordinates by component, and in space: number, mean, root mean square, largest.

    ``rows`` are those of :func:`control_table` (more of one point count once each). In space counts what has all of
    x, y, z in one unit; a length has no mean worth telling.
    """
    found, units = [], rows["unit"].unique().to_list()
    used = rows.filter(pl.col("v").is_not_null())
    for component in "xyz":
        own = used.filter(pl.col("component") == component)
        if own.height:
            v = own["v"].to_numpy()
            found.append(_deviation(component.upper(), own["unit"][0], v, float(v.mean())))
    one_each = used.unique(["point", "component"], keep="last", maintain_order=True)
    squares = one_each.group_by("point", maintain_order=True).agg(pl.len(), (pl.col("v") ** 2).sum().sqrt())
    whole = squares.filter(pl.col("len") == len("xyz"))["v"].to_numpy()
    if whole.size and len(units) == 1:
        found.append(_deviation("3-D", units[0], whole, None))
    return found


def _deviation(component: str, unit: str, v: FloatArray, mean: float | None) -> dict[str, Any]:
    sizes = np.abs(v)
    return {
        "component": component,
        "unit": unit,
        "count": len(v),
        "mean": mean,
        "rms": rms(v),
        "largest": float(sizes.max()),
    }


def checked_coordinates(view: View) -> pl.DataFrame:
    """Coordinates that were kept out to check by, as rows of :func:`control_table`."""
    rows = view.residuals.filter((pl.col("flag") == "check") & (pl.col("type") == "coordinates"))
    name = pl.when(pl.col("from") == "").then(pl.col("to")).otherwise(pl.col("from"))
    return rows.select(name.str.strip_prefix("point ").alias("point"), "component", "unit", "v")


def deviations_of_points(view: View) -> list[tuple[str, list[dict[str, Any]]]]:
    """Deviations of control points and of check points, where there are such points."""
    kinds = {"control points": control_table(view), "check points": checked_coordinates(view)}
    return [(kind, found) for kind, rows in kinds.items() if (found := deviations(rows))]


def rms(values: FloatArray) -> float | None:
    """Root mean square of what is there."""
    there = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(there**2))) if there.size else None


# ---- Everything a page is made from, worked out once.


class PageData(NamedTuple):
    """A view with what follows from it."""

    view: View
    rays: RayPairs
    measured: pl.DataFrame
    """One row for each ray, see :func:`mor.report.page_data.image_points`."""
    windows: dict[str, Window]
    points: pl.DataFrame
    images: pl.DataFrame
    sets: pl.DataFrame
    words: Words
    """What everything is said in."""

    @property
    def datum(self) -> str:
        """Name of the datum, in words."""
        return datum_name(self.view.summary["datum"], self.words)

    @property
    def angle_unit(self) -> str:
        """Unit in which angles between rays are said: gon or degrees."""
        return angle_unit_of_rays(self.view)


def page_data(view: View, words: Words = ENGLISH) -> PageData:
    """Return the data of the page of a view, in a language."""
    rays, measured = rays_of(view), image_points(view)
    areas = windows(view, measured)
    used = view.used.filter(pl.col("type") != "image")
    is_set = pl.col("type").str.ends_with("directions")
    named = used.with_columns(
        pl.when(is_set).then(pl.lit(f"{words('station')} ") + pl.col("from")).otherwise(pl.col("group")).alias("set")
    )
    return PageData(
        view=view,
        rays=rays,
        measured=measured,
        windows=areas,
        points=points_with_tests(view, rays, angle_unit_of_rays(view)),
        images=images_with_tests(view, measured, areas),
        sets=named.group_by("set", "type", maintain_order=True).agg(_measures()),
        words=words,
    )


def angle_unit_of_rays(view: View) -> str:
    """Gon where the project has gon, otherwise degrees."""
    return "gon" if view.summary["units"]["angle"] in ("gon", "mgon") else "deg"


# ---- Data of the network figure besides rays: sights by kind, given points, relative ellipses, external reliability.


@cache
def _drawn_kinds() -> dict[str, str]:
    anywhere = earth_types(Horizon(Ellipsoid(*GRS80), 0.0, 0.0))
    return {kind.name: kind.drawn for kind in (*ALL_TYPES.values(), *anywhere.values()) if kind.drawn}


def sights(view: View) -> pl.DataFrame:
    """Pairs of places by kind, once each: numbers of points, of stations behind them; at most so many of each kind.

    A distance between two points that images see is a scale bar.
    """
    places = pl.concat(
        [
            frame.select(pl.col("id").cast(pl.String).alias("name"))
            for frame in (view.points, view.stations)
            if frame.height
        ]
        or [pl.DataFrame({"name": []}, {"name": pl.String})]
    ).with_row_index("number")
    numbers = places.unique("name", keep="first", maintain_order=True)
    kinds = _drawn_kinds()
    used = view.used.filter(pl.col("type").is_in(list(kinds))).select(
        pl.col("type").replace_strict(kinds, return_dtype=pl.String).alias("kind"), "at", "from", "to"
    )
    ends = pl.concat(
        [
            used.select("kind", pl.col(one).alias("start"), pl.col(other).alias("end"))
            for one, other in (("from", "to"), ("at", "from"), ("at", "to"))
        ]
    )
    pairs = (
        ends.unique(maintain_order=True)
        .join(numbers.rename({"name": "start", "number": "a"}), on="start", maintain_order="left")
        .join(numbers.rename({"name": "end", "number": "b"}), on="end", maintain_order="left")
    )
    found = (
        pairs.select("kind", pl.col("a").cast(pl.Int32), pl.col("b").cast(pl.Int32))
        .unique(maintain_order=True)
        .group_by("kind", maintain_order=True)
        .head(20_000)
    )
    seen = places.filter(pl.col("name").is_in(view.rays["to"].unique().implode()))["number"].cast(pl.Int32)
    both = pl.col("a").is_in(seen.implode()) & pl.col("b").is_in(seen.implode())
    is_bar = (pl.col("kind") == "distance") & both
    return found.with_columns(pl.when(is_bar).then(pl.lit("scale")).otherwise(pl.col("kind")).alias("kind"))


def detectable_effects(view: View) -> pl.DataFrame:
    """External reliability of the points, (point, dx, dy, dz) by number of point."""
    numbers = pl.DataFrame({"id": view.points["id"].cast(pl.String)}).with_row_index("number")
    found = view.external.join(numbers, left_on="point", right_on="id", maintain_order="left")
    return found.select(pl.col("number").cast(pl.Int32).alias("point"), "dx", "dy", "dz")


def scale_of_effects(view: View, effects: pl.DataFrame) -> float:
    """Enlargement with which large ones of the vectors take a share of the extent of the network."""
    sizes = np.linalg.norm(effects.select("dx", "dy", "dz").to_numpy(), axis=1)
    extent = float(np.ptp(places(view), axis=0).max(initial=0.0)) if view.points.height else 0.0
    large = float(np.quantile(sizes, 0.9)) if len(sizes) else 0.0
    # Large vectors are drawn as long as 6 % of the extent.
    return round_length(0.06 * extent / large) if large > 0.0 and extent > 0.0 else 1.0


def relative_ellipses(view: View) -> pl.DataFrame:
    """Relative ellipses of the pairs that were asked for: numbers of the points, a, b, direction of a in plan."""
    asked = {name for row in view.relative for name in (row["from"], row["to"])}
    names = view.points["id"].to_list() if asked else []
    numbers = {str(name): k for k, name in enumerate(names) if str(name) in asked}
    rows = [
        (numbers[row["from"]], numbers[row["to"]], row["a"], row["b"], *row["direction"])
        for row in view.relative
        if row["from"] in numbers and row["to"] in numbers and row.get("direction")
    ]
    schema = {"one": pl.Int32, "other": pl.Int32, **dict.fromkeys(("a", "b", "dx", "dy"), pl.Float64)}
    return pl.DataFrame(rows, schema=schema, orient="row")


def with_given(view: View, points: pl.DataFrame) -> pl.DataFrame:
    """Points with the column ``given``: control, check (kept out of the adjustment), or nothing."""
    control = set(control_table(view)["point"].unique().to_list())
    kept_out = view.residuals.filter((pl.col("flag") == "check") & (pl.col("type") == "coordinates"))
    checks = {str(name) for name in kept_out["to"].to_list() + kept_out["from"].to_list() if name}
    held = points["status"].is_in(["fixed", "partly fixed"])
    names = points["id"].cast(pl.String).to_list()
    given = [
        "check" if name in checks else "control" if name in control or fixed else ""
        for name, fixed in zip(names, held.to_list(), strict=True)
    ]
    return points.with_columns(pl.Series("given", given, dtype=pl.String))


# ---- Columns packed for the page: one block of bytes, compressed, the same for the same input.
#
# Layout before compression: length of the head (4 bytes, little-endian), the head as JSON, and behind it
# every buffer, each begun at a multiple of 8. A column of the head is ``{"k": kind, "o": offset, "n":
# length}`` with kind f4, f8, i1, i2 or i4; texts are numbers into ``"t"``, the list of texts there are.
# Missing numbers are NaN.


class Packer:
    """Collects buffers while the head is put together."""

    def __init__(self) -> None:
        self._buffers: list[bytes] = []
        self._offset = 0

    def table(self, frame: pl.DataFrame, exact: tuple[str, ...] = ()) -> dict[str, Any]:
        """Every column of a table; those named ``exact`` keep the precision of their numbers."""
        return {
            "rows": frame.height,
            "columns": {name: self.column(frame[name], name in exact) for name in frame.columns},
        }

    def column(self, values: pl.Series, exact: bool = False) -> dict[str, Any]:
        """One column: texts, whole numbers, or numbers (seven digits and less, unless ``exact``)."""
        if values.dtype == pl.String or values.dtype == pl.Null:
            texts = values.cast(pl.String).fill_null("")
            known = texts.unique(maintain_order=True)
            coded = texts.replace_strict(known, np.arange(len(known), dtype=np.int32), return_dtype=pl.Int32)
            return {**self._whole(coded.to_numpy()), "t": known.to_list()}
        if values.dtype.is_integer():
            return self._whole(values.to_numpy())
        numbers = values.cast(pl.Float64).fill_null(np.nan).to_numpy()
        return self._store(numbers, "f8") if exact else self._store(_shorter(numbers), "f4")

    def _whole(self, numbers: np.ndarray) -> dict[str, Any]:
        largest = int(np.abs(numbers).max(initial=0))
        return self._store(numbers, "i1" if largest < 1 << 7 else "i2" if largest < 1 << 15 else "i4")

    def _store(self, numbers: np.ndarray, kind: str) -> dict[str, Any]:
        data = np.ascontiguousarray(numbers, dtype=f"<{kind}").tobytes()
        place = {"k": kind, "o": self._offset, "n": len(numbers)}
        padded = data + bytes(-len(data) % 8)
        self._buffers.append(padded)
        self._offset += len(padded)
        return place

    def text(self, head: dict[str, Any]) -> str:
        """Head and buffers, compressed, as base64."""
        words = json.dumps(head, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
        words += b" " * (-(len(words) + 4) % 8)
        return compressed(len(words).to_bytes(4, "little") + words + b"".join(self._buffers))


def compressed(data: bytes) -> str:
    """Bytes compressed (zlib) as base64."""
    # Twice as fast as 6, and the page is two per cent longer.
    return base64.b64encode(zlib.compress(data, 4)).decode("ascii")


def _shorter(numbers: np.ndarray) -> np.ndarray:
    """Single precision with 15 of the 23 bits of its mantissa (five digits): what a page shows, and it compresses."""
    single = np.asarray(numbers, dtype="<f4")
    drop = 8
    whole = single.view("<u4")
    rounded = ((whole + np.uint32(1 << (drop - 1))) >> np.uint32(drop)) << np.uint32(drop)
    return np.where(np.isfinite(single), rounded.view("<f4"), single)


# ---- Error ellipsoids of the table of points: covariances, and where their semi-axes point to.


def covariances(table: pl.DataFrame) -> FloatArray:
    """(n, 3, 3) covariance matrices of a table of points or movements, project axes."""
    points = table.fill_null(0.0)
    sigma = points.select("sx", "sy", "sz").to_numpy()
    matrix = np.tile(np.eye(3), (points.height, 1, 1))
    for name, (i, j) in {"rxy": (0, 1), "rxz": (0, 2), "ryz": (1, 2)}.items():
        matrix[:, i, j] = matrix[:, j, i] = points[name].to_numpy()
    return np.asarray(matrix * sigma[:, :, None] * sigma[:, None, :])


def directions_of_semi_axes(view: View) -> pl.DataFrame:
    """Azimuth and elevation of the semi-axes a, b, c of each point, as ``ellipses`` of the text report has them.

    Azimuths as the project counts bearings, elevations above the horizontal plane, in its unit of angles, to a tenth.
    Nothing for semi-axes without length.
    """
    edge = Edge(Units(**view.summary["units"]), Axes(**view.summary["axes"]))
    unit = edge.units.angle
    inside = edge.matrix @ covariances(view.points) @ edge.matrix.T
    space = error_ellipsoids(np.nan_to_num(inside))
    # Part of the longest semi-axis below which an ellipsoid has no extent along another, which then has no direction.
    there = space.axes > 1e-6 * space.axes[:, :1]
    columns = {}
    for k, axis in enumerate("abc"):
        parts = (bearings_of(edge, unit, space.azimuths[:, k]), space.elevations[:, k] / ANGLE_UNITS[unit])
        for which, values in zip(("azimuth", "elevation"), parts, strict=True):
            shown = np.where(there[:, k], np.round(values, {"rad": 3, "mrad": 0, "mgon": 0}.get(unit, 1)), np.nan)
            columns[f"ellipsoid_{which}_{axis}"] = shown
    # Columns of the directions, a semi-axis after the other.
    directions = tuple(f"ellipsoid_{which}_{axis}" for axis in "abc" for which in ("azimuth", "elevation"))
    return pl.DataFrame(columns, schema=dict.fromkeys(directions, pl.Float64))


# ---- The data of the page: tables that its charts and tables are drawn from, with what was left to the files.

MOST_ROWS = 50_000
"""Residuals the page lists; the file beside it has all."""
MOST_VECTORS = 60_000
"""Rays whose residual vectors the page draws."""


def payload(data: PageData, figures: dict[str, Any], overlap: dict[str, Any] | None) -> str:
    """Everything the page draws, packed; ``overlap`` is that of :func:`mor.report.figures.overlap_map`."""
    view, packer = data.view, Packer()
    worst = worst_first(view)
    vectors, effects = shown_vectors(data.measured), detectable_effects(view)
    image_columns = (
        *("id", "camera", "x", "y", "z", "omega", "phi", "kappa", "sx", "sy", "sz", "somega", "sphi", "skappa"),
        *("points", "rms", "unit", "coverage", "mean_r", "largest_w"),
    )
    station_columns = ("id", "x", "y", "z", "orientation", "height", "sx", "sy", "sz", "sorientation")
    exact = ("x", "y", "z", "observed", "omega", "phi", "kappa", "orientation")
    head = {
        "meta": {**meta(data), "effects_scale": scale_of_effects(view, effects)},
        "figures": figures,
        "overlap": overlap,
        "points": packer.table(_to_sigma(_points(data)), exact),
        "images": packer.table(_to_sigma(_columns(data.images, image_columns)), exact),
        "stations": packer.table(_columns(view.stations, station_columns), exact),
        "rays": packer.table(pl.DataFrame({"frame": data.rays.frame, "point": data.rays.point})),
        "sights": packer.table(sights(view)),
        "effects": packer.table(effects),
        "relative": packer.table(relative_ellipses(view)),
        "knots": packer.table(_columns(view.trajectories, ("trajectory", "stretch", "x", "y", "z")), exact),
        "vectors": packer.table(vectors.drop("unit")),
        "residuals": packer.table(worst.select(name for name in RESIDUALS if name != "adjusted"), exact),
    }
    return packer.text(head)


def _points(data: PageData) -> pl.DataFrame:
    """Columns of points; of very many, plane ellipses are in the file beside the page alone."""
    point_columns = (
        *("id", "x", "y", "z", "sx", "sy", "sz", "ellipsoid_a", "ellipsoid_b", "ellipsoid_c"),
        *("ellipse_a", "ellipse_b", "ellipse_azimuth", "rxy", "rxz", "ryz"),
        *("rays", "others", "angle", "mean_r", "smallest_r", "largest_w", "status", "given"),
    )
    points = _columns(with_given(data.view, data.points), point_columns)
    # Points whose ellipses in plan, and directions of ellipsoids, the page lists.
    if points.height > 20_000:
        return points.drop(name for name in points.columns if name.startswith("ellipse_"))
    return points.hstack(directions_of_semi_axes(data.view)) if points.height else points


def _to_sigma(frame: pl.DataFrame) -> pl.DataFrame:
    """Coordinates rounded (binary) to less than a thousandth of nearly every σ: further digits do not compress."""
    rounded = []
    for name in ("x", "y", "z"):
        sigma = frame[f"s{name}"].drop_nulls().drop_nans() if f"s{name}" in frame.columns else pl.Series([])
        sigma = sigma.filter(sigma > 0.0) if len(sigma) else sigma
        if len(sigma):
            step = 2.0 ** np.floor(np.log2(1e-3 * float(np.quantile(sigma.to_numpy(), 0.01))))
            rounded.append((pl.col(name) / step).round() * step)
    return frame.with_columns(rounded)


def _columns(frame: pl.DataFrame, names: tuple[str, ...]) -> pl.DataFrame:
    return frame.select(name for name in names if name in frame.columns)


def worst_first(view: View) -> pl.DataFrame:
    """Residuals as they stand; of very many, those with the largest test values (and all without a test)."""
    if view.residuals.height <= MOST_ROWS:
        return view.residuals
    sizes = comparable(view.residuals["w"].abs().fill_null(np.inf).to_numpy())
    return view.residuals[np.sort(np.argsort(-sizes, kind="stable")[:MOST_ROWS])]


def shown_vectors(measured: pl.DataFrame) -> pl.DataFrame:
    """Residual vectors of all images; of very many, of the images with the largest test values."""
    if measured.height <= MOST_VECTORS:
        return measured
    by_image = measured.group_by("image", maintain_order=True).agg(pl.col("w").max(), pl.len())
    ranked = by_image.sort(["w", "image"], descending=[True, False])
    kept = ranked.filter(pl.col("len").cum_sum() <= MOST_VECTORS)["image"]
    return measured.filter(pl.col("image").is_in(kept.implode()))


def meta(data: PageData) -> dict[str, Any]:
    """Units, axes and windows."""
    view = data.view
    return {
        "length": view.length,
        "angle": view.summary["units"]["angle"],
        "meeting": data.angle_unit,
        "critical": view.critical,
        "datum": data.datum,
        "language": data.words.language,
        "words": dict(data.words.catalogue),
        "scanned": scanned_images(view),
        "axes": drawn_axes(view.summary["axes"]["xy"]),
        "frame": [list(edge) for edge in network_frame(view) or ()],
        "windows": {name: area._asdict() for name, area in data.windows.items()},
        "image_unit": {
            name: str(unit) for name, unit in data.measured.group_by("image").agg(pl.col("unit").first()).rows()
        }
        if data.measured["unit"].n_unique() > 1
        else (str(data.measured["unit"][0]) if data.measured.height else ""),
    }


def network_frame(view: View) -> tuple[FloatArray, FloatArray] | None:
    """Frame of the points, images and stations, see :func:`mor.report.layout.frame_of`."""
    frames = [frame.select("x", "y", "z").to_numpy() for frame in (view.images, view.stations) if frame.height]
    return frame_of(np.concatenate([places(view), *frames]).astype(float))


def drawn_axes(xy: str) -> dict[str, Any]:
    """Return the project axes drawn to the right and upwards, and their signs."""
    right = "x" if xy[0] in "ew" else "y"
    up = "y" if right == "x" else "x"
    letters = dict(zip("xy", xy, strict=True))
    return {"right": right, "up": up, "right_reversed": letters[right] == "w", "up_reversed": letters[up] == "s"}


def plan_axes(xy: str) -> tuple[int, int, tuple[bool, bool, bool]]:
    """Axes drawn to the right and upwards in plan, and which axes count to the left or downwards there."""
    drawn = drawn_axes(xy)
    backwards = {drawn[key]: drawn[f"{key}_reversed"] for key in ("right", "up")}
    return "xy".index(drawn["right"]), "xy".index(drawn["up"]), (backwards["x"], backwards["y"], False)


# ---- The chart library the page carries: plotly.js (MIT licence), which building the package puts beside the other
# assets.


def library_path() -> Path | None:
    """Return the path of plotly.js, or ``None``: packed, and of the package plotly in a source folder never built."""
    packed = Path(__file__).parent / "assets" / "plotly.b64"
    if packed.exists():
        return packed
    spec = find_spec("plotly")
    places = spec.submodule_search_locations if spec is not None else None
    found = (Path(place) / "package_data" / "plotly.min.js" for place in places or ())
    return next((path for path in found if path.exists()), None)


def chart_library() -> str:
    """plotly.js, compressed, as base64. Raises :class:`InputError` if it is missing."""
    path = library_path()
    if path is None:
        raise InputError([Message("report.html needs the Python package plotly: pip install plotly")])
    return path.read_text("ascii") if path.suffix == ".b64" else compressed(path.read_bytes())
