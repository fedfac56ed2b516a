"""Charts of a camera: radial distortion and distortion vectors with confidence, correlations, mean residuals."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from scipy.special import chdtri, ndtri

from mor.arrays import FloatArray
from mor.geometry.cameras import CAMERA_MODELS
from mor.report.html.figures.layout import Figure, figure, joined, numbers, round_length, small_unit
from mor.report.html.page_data import PageData
from mor.report.palette import BAND, BLUE, DIVERGING, ORANGE, RED
from mor.report.tables.distortion import distortion, radial_curve
from mor.report.tables.rays import Window, window
from mor.report.words.language import ENGLISH, Words
from mor.units import LENGTH_UNITS

CONFIDENCE = 0.95
_BESIDE = float(ndtri(0.5 + CONFIDENCE / 2.0))
_AROUND = float(np.sqrt(chdtri(2, 1.0 - CONFIDENCE)))
_FEWEST = 3
"""Residuals a cell must hold for its mean to be drawn."""


def camera_figures(data: PageData) -> list[dict[str, Figure]]:
    """Charts of every camera, in their order."""
    return [_figures(data, camera) for camera in data.view.cameras]


def _figures(data: PageData, camera: dict[str, Any]) -> dict[str, Figure]:
    figures: dict[str, Figure] = {}
    area = camera_window(camera, data.windows.get(camera["id"]), _measured_unit(data, camera))
    if area is not None and CAMERA_MODELS[camera["model"]].central:
        figures["curve"] = distortion_curve(camera, area, data.words)
        figures["field"] = distortion_field(camera, area, data.words)
    if camera["correlations"]["matrix"] is not None and len(camera["correlations"]["components"]) > 1:
        figures["correlations"] = correlations(camera)
    mean = mean_residuals(data, camera)
    if mean is not None:
        figures["residuals"] = mean
    return figures


def _measured_unit(data: PageData, camera: dict[str, Any]) -> str:
    mine = data.view.images.filter(pl.col("camera") == camera["id"])["id"]
    units = data.measured.filter(pl.col("image").is_in(mine.implode()))["unit"]
    return str(units[0]) if len(units) else str(camera["unit"])


def camera_window(camera: dict[str, Any], measured: Window | None, unit: str) -> Window | None:
    """Window about the image centre in the camera's unit."""
    if camera.get("format") is not None:
        centred = {**camera, "format": {**camera["format"], "origin": "centred"}}
        return window(centred, str(camera["unit"]), np.zeros((0, 2)))
    if measured is None:
        return None
    factor = LENGTH_UNITS.get(unit, 1.0) / LENGTH_UNITS.get(str(camera["unit"]), 1.0)
    return Window(
        (measured.x[0] * factor, measured.x[1] * factor),
        (measured.y[0] * factor, measured.y[1] * factor),
        False,
        False,
    )


def distortion_curve(camera: dict[str, Any], area: Window, words: Words = ENGLISH) -> Figure:
    """Radial distortion by radius with its band of confidence."""
    largest = float(np.hypot(max(map(abs, area.x)), max(map(abs, area.y))))
    curve = radial_curve(camera, largest)
    unit, factor = small_unit(str(camera["unit"]), float(np.abs(curve.shift).max(initial=0.0)))
    radius, shift = curve.radius, curve.shift * factor
    beside = _BESIDE * curve.sigma * factor
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


def distortion_field(camera: dict[str, Any], area: Window, words: Words = ENGLISH) -> Figure:
    """Distortion vectors over the image, with ellipses of confidence, both enlarged."""
    x, y = (np.linspace(low, high, count) for (low, high), count in ((area.x, 13), (area.y, 9)))
    ideal = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    outcome = distortion(camera, ideal)
    size = float(np.hypot(*outcome.shift.T).max(initial=0.0))
    spacing = float(x[1] - x[0])
    scale = round_length(1.2 * spacing / size) if size > 0.0 else 1.0
    tips = ideal + scale * outcome.shift
    largest = float(np.sqrt(np.trace(outcome.covariance, axis1=1, axis2=2).max(initial=0.0)))
    enlarged = round_length(0.5 * spacing / (_AROUND * largest)) if largest > 0.0 else scale
    around = _ellipses(tips, outcome.covariance, enlarged * _AROUND)
    unit = str(camera["unit"])
    traces = _vectors(ideal, tips, words("distortion × {scale}", scale=f"{scale:g}"), BLUE)
    bar = _scale_bar(size, scale, unit, area)
    if largest > 0.0:
        traces.append(_confidence(around, words, enlarged))
        said, factor = small_unit(unit, round_length(size) * scale / enlarged)
        length = f"{round_length(size) * scale / enlarged * factor:g} {said}"
        bar["annotations"][0]["text"] += words("; {length} in the ellipses", length=length)
    return _image_chart(traces, unit, area, bar)


def _confidence(around: tuple[list[Any], list[Any]], words: Words, enlarged: float) -> dict[str, Any]:
    """The ellipses of confidence as one line."""
    return {
        "type": "scatter",
        "mode": "lines",
        "name": words("{share} confidence × {scale}", share=f"{CONFIDENCE:.0%}", scale=f"{enlarged:g}"),
        "x": around[0],
        "y": around[1],
        "line": {"color": ORANGE, "width": 1.2},
        "hoverinfo": "skip",
    }


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
    middle = np.stack(np.meshgrid(*(0.5 * (e[1:] + e[:-1]) for e in edges), indexing="ij"), axis=-1).reshape(
        -1, 2
    )
    kept = count >= _FEWEST
    if not kept.any():
        return None
    size = float(np.hypot(*mean[kept].T).max(initial=0.0))
    scale = round_length(float(edges[0][1] - edges[0][0]) / size) if size > 0.0 else 1.0
    unit = str(rays["unit"][0])
    traces = _vectors(
        middle[kept],
        middle[kept] + scale * mean[kept],
        data.words("mean v × {scale}", scale=f"{scale:g}"),
        RED,
    )
    return _image_chart(traces, unit, area, _scale_bar(size, scale, unit, area))


def _vectors(start: FloatArray, end: FloatArray, name: str, colour: str) -> list[dict[str, Any]]:
    x, y = joined(start, end)
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


def _ellipses(centre: FloatArray, covariance: FloatArray, scale: float) -> tuple[list[Any], list[Any]]:
    """Lines of ellipses about centres (n, 2): the images of the unit circle under a square root of the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    t = np.linspace(0.0, 2.0 * np.pi, 21)
    around = centre[:, None, :] + scale * np.einsum(
        "nij,tj->nti", root, np.column_stack([np.cos(t), np.sin(t)])
    )
    closed = np.concatenate([around, np.full((len(centre), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    return numbers(closed[:, 0]), numbers(closed[:, 1])


def _scale_bar(size: float, scale: float, unit: str, area: Window) -> dict[str, Any]:
    """A bar of a round length in the corner, at the scale of the vectors."""
    length = round_length(size)
    left, width = area.x[0], area.x[1] - area.x[0]
    level = (
        area.y[1] + 0.07 * (area.y[1] - area.y[0])
        if area.down
        else area.y[0] - 0.07 * (area.y[1] - area.y[0])
    )
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
    """A chart in image coordinates, equal scales, with the frame of the image where it is known."""
    frame = {"type": "rect", "x0": area.x[0], "x1": area.x[1], "y0": area.y[0], "y1": area.y[1]}
    shapes = [
        *extra["shapes"],
        {**frame, "line": {"width": 1, "color": "#8a8f98", "dash": "solid" if area.known else "dot"}},
    ]
    yaxis: dict[str, Any] = {"scaleanchor": "x", "scaleratio": 1}
    if area.down:
        yaxis["autorange"] = "reversed"
    return figure(
        traces, f"x [{unit}]", f"y [{unit}]", yaxis=yaxis, shapes=shapes, annotations=extra["annotations"]
    )


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
    return figure(
        [heat], "", "", yaxis={"autorange": "reversed", "type": "category"}, xaxis={"type": "category"}
    )
