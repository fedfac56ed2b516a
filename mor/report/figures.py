"""Figures of the page."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import polars as pl
from scipy.special import chdtri, ndtri

from mor.model.cameras import CAMERA_MODELS
from mor.report.language import Words
from mor.report.layout import (
    BAND,
    BIN_WIDTH,
    BLUE,
    DIVERGING,
    GREEN,
    GREY,
    ORANGE,
    RED,
    Figure,
    ellipse_lines,
    figure,
    joined,
    normal_bins,
    numbers,
    round_length,
    small_unit,
)
from mor.report.page_data import PageData, plan_axes
from mor.report.view import RayPairs, View, Window, distortion, places, radial_curve, window
from mor.types import FloatArray, IntArray
from mor.units import LENGTH_UNITS

# ---- Charts of a camera: radial distortion and distortion vectors with confidence, correlations, mean residuals.

CONFIDENCE = 0.95
BESIDE = float(ndtri(0.5 + CONFIDENCE / 2.0))
"""Half the width of a band of confidence, in units of σ."""


def camera_figures(data: PageData) -> list[dict[str, Figure]]:
    """Charts of every camera, in their order."""
    return [_figures(data, camera) for camera in data.view.cameras]


def _figures(data: PageData, camera: dict[str, Any]) -> dict[str, Figure]:
    figures: dict[str, Figure] = {}
    mine = data.view.images.filter(pl.col("camera") == camera["id"])["id"]
    units = data.measured.filter(pl.col("image").is_in(mine.implode()))["unit"]
    area = camera_window(camera, data.windows.get(camera["id"]), str(units[0]) if len(units) else str(camera["unit"]))
    if area is not None and CAMERA_MODELS[camera["model"]].central:
        figures["curve"] = distortion_curve(camera, area, data.words)
        figures["field"] = distortion_field(camera, area, data.words)
    if camera["correlations"]["matrix"] is not None and len(camera["correlations"]["components"]) > 1:
        figures["correlations"] = correlations(camera)
    mean = mean_residuals(data, camera)
    if mean is not None:
        figures["residuals"] = mean
    return figures


def camera_window(camera: dict[str, Any], measured: Window | None, unit: str) -> Window | None:
    """Window about the image centre in the camera's unit."""
    if camera.get("format") is not None:
        centred = {**camera, "format": {**camera["format"], "origin": "centred"}}
        return window(centred, str(camera["unit"]), np.zeros((0, 2)))
    if measured is None:
        return None
    factor = LENGTH_UNITS.get(unit, 1.0) / LENGTH_UNITS.get(str(camera["unit"]), 1.0)
    return Window(
        (measured.x[0] * factor, measured.x[1] * factor), (measured.y[0] * factor, measured.y[1] * factor), False, False
    )


def distortion_curve(camera: dict[str, Any], area: Window, words: Words) -> Figure:
    """Radial distortion by radius with its band of confidence."""
    largest = float(np.hypot(max(map(abs, area.x)), max(map(abs, area.y))))
    curve = radial_curve(camera, largest)
    unit, factor = small_unit(str(camera["unit"]), float(np.abs(curve.shift).max(initial=0.0)))
    radius, shift = curve.radius, curve.shift * factor
    beside = BESIDE * curve.sigma * factor
    band = {
        "type": "scatter",
        "mode": "lines",
        "name": words("{share} confidence", share=f"{CONFIDENCE:.0%}"),
        "x": numbers(np.append(radius, radius[::-1])),
        "y": numbers(np.append(shift + beside, (shift - beside)[::-1])),
        "fill": "toself",
        "fillcolor": BAND,
        "line": {"width": 0.6, "color": BLUE, "dash": "dot"},
        "hoverinfo": "skip",
    }
    line = {
        "type": "scatter",
        "mode": "lines",
        "name": words("radial distortion"),
        "x": numbers(radius),
        "y": numbers(shift),
        "customdata": numbers(curve.sigma * factor),
        "line": {"color": BLUE, "width": 2},
        "hovertemplate": f"r %{{x:.3f}} {camera['unit']}: %{{y:.4g}} ± %{{customdata:.2g}} {unit} (σ)<extra></extra>",
    }
    return figure(
        [band, line] if curve.sigma.any() else [line],
        words("distance from the principal point [{unit}]", unit=camera["unit"]),
        words("distortion [{unit}]", unit=unit),
    )


def distortion_field(camera: dict[str, Any], area: Window, words: Words) -> Figure:
    """Distortion vectors over the image, with ellipses of confidence, both enlarged."""
    x, y = (np.linspace(low, high, count) for (low, high), count in ((area.x, 13), (area.y, 9)))
    ideal = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    outcome = distortion(camera, ideal)
    size = float(np.hypot(*outcome.shift.T).max(initial=0.0))
    spacing = float(x[1] - x[0])
    scale = round_length(1.2 * spacing / size) if size > 0.0 else 1.0
    tips = ideal + scale * outcome.shift
    largest = float(np.sqrt(np.trace(outcome.covariance, axis1=1, axis2=2).max(initial=0.0)))
    semi_axis = float(np.sqrt(chdtri(2, 1.0 - CONFIDENCE)))
    enlarged = round_length(0.5 * spacing / (semi_axis * largest)) if largest > 0.0 else scale
    around = ellipse_lines(tips, outcome.covariance, enlarged * semi_axis, 21)
    around = np.concatenate([around, np.full((len(tips), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    unit = str(camera["unit"])
    traces = _vectors(ideal, tips, words("distortion × {scale}", scale=f"{scale:g}"), BLUE)
    bar = _scale_bar(size, scale, unit, area)
    if largest > 0.0:
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": words("{share} confidence × {scale}", share=f"{CONFIDENCE:.0%}", scale=f"{enlarged:g}"),
                "x": numbers(around[:, 0]),
                "y": numbers(around[:, 1]),
                "line": {"color": ORANGE, "width": 1.2},
                "hoverinfo": "skip",
            }
        )
        said, factor = small_unit(unit, round_length(size) * scale / enlarged)
        length = f"{round_length(size) * scale / enlarged * factor:g} {said}"
        bar["annotations"][0]["text"] += words("; {length} in the ellipses", length=length)
    return _image_chart(traces, unit, area, bar)


def mean_residuals(data: PageData, camera: dict[str, Any]) -> Figure | None:
    """Mean residuals of all images of a camera in cells of the image: what the model leaves systematic."""
    mine = data.view.images.filter(pl.col("camera") == camera["id"])["id"]
    rays = data.measured.filter(pl.col("image").is_in(mine.implode()), pl.col("flag") == "")
    area = data.windows.get(camera["id"])
    if area is None or rays.height == 0:
        return None
    edges = [np.linspace(*limits, count) for limits, count in ((area.x, 17), (area.y, 12))]
    xy, v = rays.select("x", "y").to_numpy(), rays.select("vx", "vy").fill_null(0.0).to_numpy()
    cell = [np.clip(np.searchsorted(e, xy[:, k]) - 1, 0, len(e) - 2) for k, e in enumerate(edges)]
    number = cell[0] * (len(edges[1]) - 1) + cell[1]
    count = np.bincount(number, minlength=(len(edges[0]) - 1) * (len(edges[1]) - 1))
    mean = np.column_stack([np.bincount(number, v[:, k], len(count)) / np.maximum(count, 1) for k in (0, 1)])
    middle = np.stack(np.meshgrid(*(0.5 * (e[1:] + e[:-1]) for e in edges), indexing="ij"), axis=-1).reshape(-1, 2)
    # Residuals a cell must hold for its mean to be drawn.
    kept = count >= 3
    if not kept.any():
        return None
    size = float(np.hypot(*mean[kept].T).max(initial=0.0))
    scale = round_length(float(edges[0][1] - edges[0][0]) / size) if size > 0.0 else 1.0
    unit = str(rays["unit"][0])
    traces = _vectors(
        middle[kept], middle[kept] + scale * mean[kept], data.words("mean v × {scale}", scale=f"{scale:g}"), RED
    )
    return _image_chart(traces, unit, area, _scale_bar(size, scale, unit, area))


def _vectors(start: FloatArray, end: FloatArray, name: str, colour: str) -> list[dict[str, Any]]:
    x, y = map(numbers, joined(start, end))
    lines = {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": x,
        "y": y,
        "line": {"color": colour, "width": 1.6},
        "hoverinfo": "skip",
    }
    feet = {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(start[:, 0]),
        "y": numbers(start[:, 1]),
        "marker": {"color": colour, "size": 4},
        "showlegend": False,
        "hoverinfo": "skip",
    }
    return [lines, feet]


def _scale_bar(size: float, scale: float, unit: str, area: Window) -> dict[str, Any]:
    length = round_length(size)
    left, width = area.x[0], area.x[1] - area.x[0]
    level = area.y[1] + 0.07 * (area.y[1] - area.y[0]) if area.down else area.y[0] - 0.07 * (area.y[1] - area.y[0])
    said, factor = small_unit(unit, length)
    line = {"type": "line", "x0": left, "x1": left + scale * length, "y0": level, "y1": level}
    note = {
        "x": min(left + scale * length + 0.01 * width, area.x[1]),
        "y": level,
        "text": f"{length * factor:g} {said}",
        "showarrow": False,
        "xanchor": "left",
    }
    return {"shapes": [{**line, "line": {"width": 3, "color": ORANGE}}], "annotations": [note]}


def _image_chart(traces: list[dict[str, Any]], unit: str, area: Window, extra: dict[str, Any]) -> Figure:
    frame = {"type": "rect", "x0": area.x[0], "x1": area.x[1], "y0": area.y[0], "y1": area.y[1]}
    shapes = [
        *extra["shapes"],
        {**frame, "line": {"width": 1, "color": "#8a8f98", "dash": "solid" if area.known else "dot"}},
    ]
    yaxis: dict[str, Any] = {"scaleanchor": "x", "scaleratio": 1}
    if area.down:
        yaxis["autorange"] = "reversed"
    return figure(traces, f"x [{unit}]", f"y [{unit}]", yaxis=yaxis, shapes=shapes, annotations=extra["annotations"])


def correlations(camera: dict[str, Any]) -> Figure:
    """Correlations of the estimated components as a matrix with its numbers."""
    names, matrix = camera["correlations"]["components"], np.array(camera["correlations"]["matrix"])
    heat = {
        "type": "heatmap",
        "x": names,
        "y": names,
        "z": [[round(value, 4) for value in row] for row in matrix.tolist()],
        "zmin": -1,
        "zmax": 1,
        "colorscale": DIVERGING,
        "text": [[f"{value:.2f}" for value in row] for row in matrix],
        "texttemplate": "%{text}" if len(names) <= 14 else "",
        "colorbar": {"title": {"text": "ρ [1]"}},
        "hovertemplate": "%{y} – %{x}: %{z:.4f}<extra></extra>",
    }
    return figure([heat], "", "", yaxis={"autorange": "reversed", "type": "category"}, xaxis={"type": "category"})


# ---- The overlap map: how many images measured points in each cell, in the view in which the points are widest.

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


def overlap(view: View, rays: RayPairs) -> Overlap | None:
    """Images over each cell of a grid; nothing if what images measured spans no area.

    Counted is what was measured, not what an image might show: a cell has every image once that measured one of its
    points or more.
    """
    axes = widest(view)
    plane = places(view)[:, axes]
    seen = (rays.frame < view.images.height) & np.asarray(np.isfinite(plane).all(axis=1))[rays.point]
    frame, point = rays.frame[seen], rays.point[seen]
    measured = np.flatnonzero(np.bincount(point))
    low, size = (plane[measured].min(axis=0), np.ptp(plane[measured], axis=0)) if len(point) else np.zeros((2, 2))
    if not (size > 0.0).all():
        return None
    # Cells along the longer side, at most.
    # Points a cell has on average, where they lie evenly.
    step = max(float(np.sqrt(4 * size.prod() / len(measured))), float(size.max()) / 80)
    cells = np.floor(size / step).astype(np.int64) + 1
    first = low + 0.5 * (size - (cells - 1) * step)
    column, row = (np.rint((plane[point] - first) / step).astype(np.int64).clip(0, cells - 1)).T
    pairs = np.unique((row * cells[0] + column) * view.images.height + frame)
    count = np.bincount(pairs // view.images.height, minlength=int(cells.prod())).reshape(cells[1], cells[0])
    return Overlap(axes, first, step, count)


def widest(view: View) -> tuple[int, int]:
    """Coordinates drawn to the right and upwards: plan, or the elevation along the longer side of a network that is
    higher than deep."""
    right, up, _ = plan_axes(view.summary["axes"]["xy"])
    extent = np.ptp(places(view), axis=0) if view.points.height else np.zeros(3)
    if extent[2] > extent[:2].min():
        return int(np.argmax(extent[:2])), 2
    return right, up


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


# ---- Charts of the tests: w against the normal distribution, redundancy, rays, angles.


def normal_histogram(w: FloatArray, critical: float, words: Words) -> Figure:
    """Density of the test values with the standard normal density and the critical values.

    What lies beyond the last class stands in it, and is counted in the legend.
    """
    bins = normal_bins(w, critical)
    edges = bins.edges
    density = np.histogram(bins.w, edges)[0] / max(len(w), 1) / BIN_WIDTH
    t = np.linspace(-bins.limit, bins.limit, 241)
    beyond = words("{count} of them beyond ±{limit}", count=bins.beyond, limit=f"{bins.limit:g}")
    bars = {
        "type": "bar",
        "name": f"w ({len(w)}{', ' + beyond if bins.beyond else ''})",
        "x": numbers(0.5 * (edges[1:] + edges[:-1])),
        "y": numbers(density),
        "width": BIN_WIDTH,
        "marker": {"color": BLUE, "line": {"width": 0}},
        "hovertemplate": f"w %{{x}}: {words('density')} %{{y:.4f}}<extra></extra>",
    }
    normal = {
        "type": "scatter",
        "mode": "lines",
        "name": "N(0, 1)",
        "x": numbers(t),
        "y": numbers(np.exp(-0.5 * t**2) / np.sqrt(2.0 * np.pi)),
        "line": {"color": ORANGE, "width": 2.5},
    }
    shapes = [_limit(critical), _limit(-critical)]
    counted = {"rangemode": "tozero"}
    return figure([bars, normal], "w [1]", words("density [1]"), yaxis=counted, shapes=shapes, bargap=0)


def _limit(x: float) -> dict[str, object]:
    return {
        "type": "line",
        "x0": x,
        "x1": x,
        "y0": 0,
        "y1": 1,
        "yref": "paper",
        "line": {"color": RED, "dash": "dash", "width": 1.5},
    }


def histogram(values: FloatArray, x: str, y: str, colour: str = BLUE, whole: bool = False, top: float = 0.0) -> Figure:
    """Counts of values from 0 to the largest, at least to ``top``; whole numbers each for itself."""
    there = values[np.isfinite(values)]
    if whole:
        last = int(there.max(initial=1))
        step = max(1, last // 60)
        edges = np.arange(-0.5, last + step + 0.5, step)
    else:
        high = float(there.max(initial=top)) or 1.0
        edges = np.linspace(0.0, high, 41)
    count = np.histogram(there, edges)[0]
    bars = {
        "type": "bar",
        "x": numbers(0.5 * (edges[1:] + edges[:-1])),
        "y": count.tolist(),
        "width": float(edges[1] - edges[0]) * 0.96,
        "marker": {"color": colour},
        "hovertemplate": "%{x}: %{y}<extra></extra>",
    }
    xaxis = {"range": [float(edges[0]), float(edges[-1])]}
    return figure([bars], x, y, xaxis=xaxis, bargap=0.04, showlegend=False)


def redundancy_of_frames(data: PageData) -> Figure | None:
    """Mean redundancy number of each image, and of each set and group, in their order."""
    parts, words = [], data.words
    if data.images.height:
        parts.append((words("images"), data.images.select("id", "mean_r"), BLUE, "circle"))
    if data.sets.height:
        parts.append(
            (words("sets and groups"), data.sets.select(pl.col("set").alias("id"), "mean_r"), ORANGE, "diamond")
        )
    most_frames = 400
    traces = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": name,
            "x": [str(label) for label in frame["id"]][:most_frames],
            "y": numbers(frame["mean_r"].cast(pl.Float64).fill_null(np.nan).to_numpy())[:most_frames],
            "marker": {"color": colour, "symbol": symbol, "size": 8},
            "hovertemplate": f"%{{x}}: {words('mean r')} %{{y:.3f}}<extra></extra>",
        }
        for name, frame, colour, symbol in parts
    ]
    if not traces:
        return None
    xaxis = {"type": "category", "tickangle": -60, "automargin": True, "nticks": 50}
    return figure(traces, "", words("mean r [1]"), yaxis={"range": [0, 1.02]}, xaxis=xaxis)


def test_figures(data: PageData) -> dict[str, Figure]:
    """All charts of the section on tests."""
    used, words = data.view.used, data.words
    tested = used["w"].drop_nulls().to_numpy()
    figures = {
        "w": normal_histogram(tested, data.view.critical, words),
        "r": histogram(
            used["r"].drop_nulls().to_numpy(), words("redundancy number r [1]"), words("observations"), GREEN, top=1.0
        ),
    }
    by_frame = redundancy_of_frames(data)
    if by_frame is not None:
        figures["r_frames"] = by_frame
    if len(data.rays.frame):
        rays = np.bincount(data.rays.point, minlength=data.points.height).astype(float)
        figures["rays"] = histogram(rays, words("rays and sights of a point"), words("points"), BLUE, whole=True)
        angle = data.points["angle"].drop_nulls().drop_nans().to_numpy()
        if len(angle):
            unit = words("best intersection [{unit}]", unit=data.angle_unit)
            figures["angles"] = histogram(angle, unit, words("points"), GREY)
    return figures
