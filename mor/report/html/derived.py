"""Quantities of points, images and sets that the page shows beyond the result tables."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.report.tables.rays import Rays, Window, centres, covered, intersection_angles, places, window
from mor.report.view import View
from mor.report.words.language import ENGLISH, Words
from mor.units import ANGLE_UNITS

_TOUCHING = pl.col("type").str.contains("^(difference|level)$").not_()


def _measures() -> list[pl.Expr]:
    return [
        pl.col("r").mean().alias("mean_r"),
        pl.col("r").min().alias("smallest_r"),
        pl.col("w").abs().max().alias("largest_w"),
        pl.len().alias("observations"),
    ]


def points_with_tests(view: View, rays: Rays, angle_unit: str) -> pl.DataFrame:
    """The table of points with mean and smallest r, largest |w| and the best intersection angle."""
    used = view.used.filter(_TOUCHING).select("at", "from", "to", "r", "w")
    named = pl.concat(
        [
            used.filter(pl.col(key) != "").select(
                pl.col(key).str.strip_prefix("point ").alias("id"), "r", "w"
            )
            for key in ("at", "from", "to")
        ]
    )
    known = (
        view.points.select(pl.col("id").cast(pl.String))
        if view.points.height
        else pl.DataFrame({"id": []}, {"id": pl.String})
    )
    measured = named.join(known, on="id", how="semi").group_by("id", maintain_order=True).agg(_measures())
    angle = intersection_angles(rays, centres(view), places(view)) / ANGLE_UNITS[angle_unit]
    return view.points.with_columns(pl.Series("angle", angle).fill_nan(None)).join(
        measured.drop("observations", *_there(view.points)), on="id", how="left", maintain_order="left"
    )


def _there(frame: pl.DataFrame) -> list[str]:
    """Columns that the table of results has already."""
    return [name for name in ("mean_r", "largest_w") if name in frame.columns]


def image_points(view: View) -> pl.DataFrame:
    """One row for each ray: image, point, unit, x, y, vx, vy, mean r, the larger test value, flags."""
    rays = view.rays
    x, y = (rays.filter(pl.col("component") == name) for name in "xy")
    places, others = ["group", "from", "to"], ["observed", "v", "r", "w", "flag"]
    if x.height == y.height and all((x[name] == y[name]).all() for name in places):
        both = x.hstack(y.select(pl.col(name).alias(f"{name}_y") for name in others))
    else:
        both = _joined(x, y, places, others)
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


def _joined(x: pl.DataFrame, y: pl.DataFrame, places: list[str], others: list[str]) -> pl.DataFrame:
    """x and y of each ray, where some are missing; what was measured again is told apart by its order."""
    again = pl.int_range(pl.len()).over(places).alias("again")
    keys = [*places, "again"]
    return x.with_columns(again).join(
        y.with_columns(again).select(*keys, *others), on=keys, suffix="_y", maintain_order="left"
    )


def windows(view: View, measured: pl.DataFrame) -> dict[str, Window]:
    """Window of each camera that took images."""
    of_image = view.images.select(pl.col("id").alias("image"), "camera")
    rays = measured.join(of_image, on="image", maintain_order="left")
    result = {}
    for camera in view.cameras:
        mine = rays.filter(pl.col("camera") == camera["id"])
        if mine.height:
            xy = mine.select("x", "y").to_numpy()
            result[camera["id"]] = window(camera, str(mine["unit"][0]), xy)
    return result


def images_with_tests(view: View, measured: pl.DataFrame, areas: dict[str, Window]) -> pl.DataFrame:
    """The table of images with coverage, mean r and largest |w|."""
    if view.images.height == 0:
        return view.images
    by_image = measured.group_by("image", maintain_order=True).agg(
        pl.col("r").mean().alias("mean_r"),
        pl.col("w").max().alias("largest_w"),
        pl.col("unit").first().alias("unit"),
        pl.col("vx").mean().alias("mean_vx"),
        pl.col("vy").mean().alias("mean_vy"),
    )
    coverage = _coverages(view, measured, areas)
    return view.images.join(
        by_image.drop(_there(view.images)).rename({"image": "id"}), on="id", how="left", maintain_order="left"
    ).with_columns(
        pl.Series("coverage", [coverage.get(name) for name in view.images["id"]], dtype=pl.Float64)
    )


def _coverages(view: View, measured: pl.DataFrame, areas: dict[str, Window]) -> dict[str, float]:
    """Share of each image's window inside the hull of its points, in per cent."""
    camera_of = dict(zip(view.images["id"], view.images["camera"], strict=True))
    result: dict[str, float] = {}
    for (name,), rows in measured.group_by(["image"], maintain_order=True):
        if camera_of.get(str(name)) not in areas:
            continue  # an image that was left out has no camera any more
        area = areas[camera_of[name]]
        size = (area.x[1] - area.x[0]) * (area.y[1] - area.y[0])
        result[str(name)] = 100.0 * covered(rows.select("x", "y").to_numpy(), size)
    return result


def sets_with_tests(view: View, words: Words = ENGLISH) -> pl.DataFrame:
    """Groups of directions by station or set, and all other groups: number, mean and smallest r, largest |w|."""
    used = view.used.filter(pl.col("type") != "image")
    is_set = pl.col("type").str.ends_with("directions")
    named = used.with_columns(
        pl.when(is_set)
        .then(pl.lit(f"{words('station')} ") + pl.col("from"))
        .otherwise(pl.col("group"))
        .alias("set")
    )
    return named.group_by("set", "type", maintain_order=True).agg(_measures())


def control_table(view: View) -> pl.DataFrame:
    """Coordinates that were given: v, σ of the given value, r and w, and the smallest detectable error, by point."""
    of_point = pl.col("from").str.starts_with("point ") & pl.col("component").is_in(["x", "y", "z"])
    rows = view.used.filter(((pl.col("type") == "parameter") & of_point) | (pl.col("type") == "coordinates"))
    name = (
        pl.when(pl.col("from") == "").then(pl.col("to")).otherwise(pl.col("from")).str.strip_prefix("point ")
    )
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


def rms(values: FloatArray) -> float | None:
    """Root mean square of what is there."""
    there = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(there**2))) if there.size else None
