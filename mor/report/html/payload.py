"""The data of the page: tables that its charts and tables are drawn from, with what was left to the files."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from mor.quality.tests.test_statistics import comparable
from mor.report.html.ellipsoids import directions_of_semi_axes
from mor.report.html.packing import Packer
from mor.report.html.page_data import PageData
from mor.report.html.sights import detectable_effects, relative_ellipses, scale_of_effects, sights, with_given
from mor.report.tables.rays import scanned_images
from mor.report.view import View

MOST_ROWS = 50_000
"""Residuals the page lists; the file beside it has all."""
MOST_VECTORS = 60_000
"""Rays whose residual vectors the page draws."""
POINT_COLUMNS = (
    *(
        "id",
        "x",
        "y",
        "z",
        "sx",
        "sy",
        "sz",
        "ellipsoid_a",
        "ellipsoid_b",
        "ellipsoid_c",
        "ellipse_a",
        "ellipse_b",
        "ellipse_azimuth",
        "rxy",
        "rxz",
        "ryz",
    ),
    *("rays", "others", "angle", "mean_r", "smallest_r", "largest_w", "status", "given"),
)
IMAGE_COLUMNS = (
    *("id", "camera", "x", "y", "z", "omega", "phi", "kappa", "sx", "sy", "sz", "somega", "sphi", "skappa"),
    *("points", "rms", "unit", "coverage", "mean_r", "largest_w"),
)
STATION_COLUMNS = ("id", "x", "y", "z", "orientation", "height", "sx", "sy", "sz", "sorientation")
RESIDUAL_COLUMNS = (
    *("type", "group", "at", "from", "to", "component", "unit", "observed", "v", "sigma"),
    *("r", "w", "error", "nabla", "external", "influence", "flag"),
)
MOST_ELLIPSES = 20_000
"""Points whose ellipses in plan, and directions of ellipsoids, the page lists."""
_EXACT = ("x", "y", "z", "observed", "omega", "phi", "kappa", "orientation")


def payload(data: PageData, figures: dict[str, Any], overlap: dict[str, Any] | None = None) -> str:
    """Everything the page draws, packed; ``overlap`` is that of :func:`mor.report.html.figures.overlap.overlap_map`."""
    view, packer = data.view, Packer()
    worst = worst_first(view)
    vectors, effects = shown_vectors(data.measured), detectable_effects(view)
    head = {
        "meta": {**meta(data), "effects_scale": scale_of_effects(view, effects)},
        "figures": figures,
        "overlap": overlap,
        "points": packer.table(_to_sigma(_points(data)), _EXACT),
        "images": packer.table(_to_sigma(_columns(data.images, IMAGE_COLUMNS)), _EXACT),
        "stations": packer.table(_columns(view.stations, STATION_COLUMNS), _EXACT),
        "rays": packer.table(pl.DataFrame({"frame": data.rays.frame, "point": data.rays.point})),
        "sights": packer.table(sights(view)),
        "effects": packer.table(effects),
        "relative": packer.table(relative_ellipses(view)),
        "knots": packer.table(_columns(view.trajectories, ("trajectory", "stretch", "x", "y", "z")), _EXACT),
        "vectors": packer.table(vectors.drop("unit")),
        "residuals": packer.table(worst.select(RESIDUAL_COLUMNS), _EXACT),
    }
    return packer.text(head)


def _points(data: PageData) -> pl.DataFrame:
    """Columns of points; of very many, plane ellipses are in the file beside the page alone."""
    points = _columns(with_given(data.view, data.points), POINT_COLUMNS)
    if points.height > MOST_ELLIPSES:
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
        "windows": {
            name: {"x": area.x, "y": area.y, "down": area.down, "known": area.known}
            for name, area in data.windows.items()
        },
        "image_unit": {
            name: str(unit)
            for name, unit in data.measured.group_by("image").agg(pl.col("unit").first()).rows()
        }
        if data.measured["unit"].n_unique() > 1
        else (str(data.measured["unit"][0]) if data.measured.height else ""),
    }


def drawn_axes(xy: str) -> dict[str, Any]:
    """Return the project axes drawn to the right and upwards, and their signs."""
    right = "x" if xy[0] in "ew" else "y"
    up = "y" if right == "x" else "x"
    letters = dict(zip("xy", xy, strict=True))
    return {
        "right": right,
        "up": up,
        "right_reversed": letters[right] == "w",
        "up_reversed": letters[up] == "s",
    }
