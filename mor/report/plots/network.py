"""The network in plan (or elevation): points, images, stations, rays, and error ellipses where they are asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mor.arrays import FloatArray
from mor.report.html.ellipsoids import covariances
from mor.report.html.figures.layout import round_length, small_unit
from mor.report.html.payload import drawn_axes
from mor.report.palette import BLUE, GREY, ORANGE, RED
from mor.report.plots.labels import draw_names
from mor.report.plots.overlays import draw_effects, draw_given, draw_paths, draw_relative, draw_sights
from mor.report.plots.sheet import scale_bar, sheet
from mor.report.tables.rays import centres, places, rays_of
from mor.report.view import View
from mor.report.words.datum import datum_name
from mor.report.words.language import ENGLISH, Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_RAYS = 5000
_SHARE = 0.03
"""Share of the extent that a large ellipse is drawn with."""


def network(view: View, words: Words = ENGLISH) -> Figure:
    """Points, images, stations and rays in the plane in which the points extend most."""
    figure = sheet()
    axes, chosen = _prepared(view, figure)
    rays = rays_of(view)
    if 0 < len(rays.frame) <= _MOST_RAYS:
        start, end = centres(view)[rays.frame][:, chosen], places(view)[rays.point][:, chosen]
        gap = np.full((len(start), 1), np.nan)
        x, y = (np.column_stack([start[:, [k]], end[:, [k]], gap]).ravel() for k in (0, 1))
        axes.plot(x, y, color=GREY, lw=0.3, alpha=0.5, label=words("rays"), zorder=1)
    draw_sights(view, axes, chosen, words)
    draw_paths(view, axes, chosen, words)
    _frames(view, axes, chosen, words)
    _points(view, axes, chosen, words)
    draw_given(view, axes, chosen, words)
    _finish(view, axes, words)
    draw_names(view, axes, chosen)
    return figure


CONFIDENCE = {"1": (1.0, "1σ"), "95": (2.4477, "95 %")}
"""Factor of ellipses in plan by what is asked for: the standard ellipse, or that in which 95 % lie (√χ²(2))."""


def ellipses(view: View, words: Words = ENGLISH, confidence: str = "1") -> Figure:
    """Error ellipses of the points, enlarged, with the bar that says how much; of heights in elevation.

    With the relative ellipses that the project asks for, and the external reliability of the points.
    """
    from matplotlib.collections import LineCollection

    figure = sheet()
    heights = not (view.points.select("sx", "sy").fill_null(0.0).to_numpy() > 0.0).any()
    axes, chosen = _prepared(view, figure, upright=heights)
    _frames(view, axes, chosen, words)
    _points(view, axes, chosen, words)
    covariance = covariances(view)[:, chosen][:, :, chosen]
    size = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0))
    extent = float(np.ptp(places(view), axis=0).max(initial=0.0)) or 1.0
    large = float(np.quantile(size[size > 0.0], 0.9)) if (size > 0.0).any() else 0.0
    if large > 0.0:
        scale = round_length(_SHARE * extent / large)
        factor, name = CONFIDENCE[confidence]
        drawn = scale * factor
        lines = ellipse_lines(places(view)[:, chosen], covariance, drawn)[size > 0.0]
        axes.add_collection(
            LineCollection(
                list(lines),
                colors=RED,
                linewidths=0.8,
                label=words("{level} ellipses × {scale}", level=name, scale=f"{scale:g}"),
            )
        )
        draw_relative(view, axes, chosen, drawn, words)
        axes.autoscale_view()
        draw_effects(view, axes, chosen, words)
        _finish(view, axes, words)
        length = round_length(0.1 * extent / scale)
        unit, finer = small_unit(view.length, length)
        scale_bar(
            axes, scale * length, words("{length} in the ellipses", length=f"{length * finer:g} {unit}")
        )
    else:
        _finish(view, axes, words)
    draw_names(view, axes, chosen)
    return figure


def ellipse_lines(centre: FloatArray, covariance: FloatArray, scale: float) -> FloatArray:
    """(n, 49, 2) standard ellipses about centres (n, 2), enlarged."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    t = np.linspace(0.0, 2.0 * np.pi, 49)
    lines: FloatArray = centre[:, None, :] + scale * np.einsum(
        "nij,tj->nti", root, np.column_stack([np.cos(t), np.sin(t)])
    )
    return lines


def _prepared(view: View, figure: Figure, upright: bool = False) -> tuple[Axes, list[int]]:
    """Axes with names, units and directions; numbers of the coordinates drawn to the right and upwards.

    In elevation where it is asked for (``upright``), or where the network is higher than deep.
    """
    axes = figure.add_subplot()
    drawn = drawn_axes(view.summary["axes"]["xy"])
    plan = ["xyz".index(drawn["right"]), "xyz".index(drawn["up"])]
    chosen = plan
    if view.points.height > 2 or upright:
        extent = np.ptp(places(view), axis=0)
        if upright or extent[2] > 2.0 * extent[plan].min():
            chosen = [plan[int(np.argmax(extent[plan]))], 2]
    names = "XYZ"
    axes.set_xlabel(f"{names[chosen[0]]} [{view.length}]")
    axes.set_ylabel(f"{names[chosen[1]]} [{view.length}]")
    backwards = {plan[0]: drawn["right_reversed"], plan[1]: drawn["up_reversed"], 2: False}
    axes.xaxis.set_inverted(backwards[chosen[0]])
    axes.yaxis.set_inverted(backwards[chosen[1]])
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.set_aspect("equal", adjustable="datalim")
    return axes, chosen


def _frames(view: View, axes: Axes, chosen: list[int], words: Words) -> None:
    for frame, name, marker, colour in (
        (view.images, words("images"), "D", ORANGE),
        (view.stations, words("stations"), "^", RED),
    ):
        if frame.height:
            xyz = frame.select("x", "y", "z").to_numpy()[:, chosen]
            axes.plot(xyz[:, 0], xyz[:, 1], marker, color=colour, ms=5, ls="none", label=name, zorder=3)


def _points(view: View, axes: Axes, chosen: list[int], words: Words) -> None:
    xyz = places(view)[:, chosen]
    axes.plot(xyz[:, 0], xyz[:, 1], "o", color=BLUE, ms=3, ls="none", label=words("points"), zorder=4)


def _finish(view: View, axes: Axes, words: Words) -> None:
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", ncols=4)
    title = view.summary["title"] or words("Network")
    axes.set_title(
        f"{title} – {words('datum')}: {datum_name(view.summary['datum'], words)}",
        fontsize=9,
        loc="left",
        pad=18,
    ).set_in_layout(False)  # it may be wider than the network, which keeps its size
