"""Charts of the tests: w against the normal distribution, redundancy, rays, angles."""

from __future__ import annotations

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.report.bins import WIDTH, normal_bins
from mor.report.html.figures.layout import Figure, figure, numbers
from mor.report.html.page_data import PageData
from mor.report.palette import BLUE, GREEN, GREY, ORANGE, RED
from mor.report.words.language import ENGLISH, Words

_BARS = 60
_MOST_FRAMES = 400


def normal_histogram(w: FloatArray, critical: float, words: Words = ENGLISH) -> Figure:
    """Density of the test values with the standard normal density and the critical values.

    What lies beyond the last class stands in it, and is counted in the legend.
    """
    bins = normal_bins(w, critical)
    edges = bins.edges
    density = np.histogram(bins.w, edges)[0] / max(len(w), 1) / WIDTH
    t = np.linspace(-bins.limit, bins.limit, 241)
    beyond = words("{count} of them beyond ±{limit}", count=bins.beyond, limit=f"{bins.limit:g}")
    bars = {
        "type": "bar",
        "name": f"w ({len(w)}{', ' + beyond if bins.beyond else ''})",
        "x": numbers(0.5 * (edges[1:] + edges[:-1])),
        "y": numbers(density),
        "width": WIDTH,
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


def histogram(
    values: FloatArray, x: str, y: str, colour: str = BLUE, whole: bool = False, top: float = 0.0
) -> Figure:
    """Counts of values from 0 to the largest, at least to ``top``; whole numbers each for itself."""
    there = values[np.isfinite(values)]
    if whole:
        last = int(there.max(initial=1))
        step = max(1, last // _BARS)
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
    if data.images.height and "mean_r" in data.images.columns:
        parts.append((words("images"), data.images.select("id", "mean_r"), BLUE, "circle"))
    if data.sets.height:
        parts.append(
            (
                words("sets and groups"),
                data.sets.select(pl.col("set").alias("id"), "mean_r"),
                ORANGE,
                "diamond",
            )
        )
    traces = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": name,
            "x": [str(label) for label in frame["id"]][:_MOST_FRAMES],
            "y": numbers(frame["mean_r"].cast(pl.Float64).fill_null(np.nan).to_numpy())[:_MOST_FRAMES],
            "marker": {"color": colour, "symbol": symbol, "size": 8},
            "hovertemplate": f"%{{x}}: {words('mean r')} %{{y:.3f}}<extra></extra>",
        }
        for name, frame, colour, symbol in parts
    ]
    if not traces:
        return None
    xaxis = {"type": "category", "tickangle": -60, "automargin": True, "nticks": 60}
    return figure(traces, "", words("mean r [1]"), yaxis={"range": [0, 1.02]}, xaxis=xaxis)


def test_figures(data: PageData) -> dict[str, Figure]:
    """All charts of the section on tests."""
    used, words = data.view.used, data.words
    tested = used["w"].drop_nulls().to_numpy()
    figures = {
        "w": normal_histogram(tested, data.view.critical, words),
        "r": histogram(
            used["r"].drop_nulls().to_numpy(),
            words("redundancy number r [1]"),
            words("observations"),
            GREEN,
            top=1.0,
        ),
    }
    by_frame = redundancy_of_frames(data)
    if by_frame is not None:
        figures["r_frames"] = by_frame
    if len(data.rays.frame):
        rays = np.bincount(data.rays.point, minlength=data.points.height).astype(float)
        figures["rays"] = histogram(
            rays, words("rays and sights of a point"), words("points"), BLUE, whole=True
        )
        angle = data.points["angle"].fill_null(np.nan).to_numpy()
        figures["angles"] = histogram(
            angle, words("best intersection [{unit}]", unit=data.angle_unit), words("points"), GREY
        )
    return figures
