"""The overlap of images, and the rays of each point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mor.errors import InputError, Problem
from mor.report.html.figures.overlap import RAY_CLASSES, Overlap, overlap
from mor.report.html.payload import drawn_axes
from mor.report.palette import BLUE, GREEN, GREY, ORANGE, RED
from mor.report.plots.sheet import sheet
from mor.report.tables.rays import places, rays_of
from mor.report.view import View
from mor.report.words.language import ENGLISH, Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LOOKS = ((RED, "x", 5), (RED, "P", 5), (ORANGE, "^", 5), (GREEN, "o", 3), (BLUE, "o", 3), (GREY, "o", 3))
"""Colour, mark and size of each class of rays."""


def overlap_and_rays(view: View, words: Words = ENGLISH) -> Figure:
    """Images over each cell, and points by the number of their rays. Raises :class:`InputError` without images."""
    found = overlap(view, rays_of(view))
    if found is None:
        raise InputError([Problem("what images measured spans no area, so there is no overlap to draw")])
    figure = sheet(9.0, 4.6)
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    _map(left, found, words)
    _rays(right, view, found, words)
    for axes in (left, right):
        axes.set_aspect("equal", adjustable="box")
        axes.ticklabel_format(useOffset=False, style="plain")
        axes.tick_params("x", rotation=30)
        axes.set_xlabel(f"{'XYZ'[found.axes[0]]} [{view.length}]")
    drawn = drawn_axes(view.summary["axes"]["xy"])
    backwards = {"xyz".index(drawn[key]): drawn[f"{key}_reversed"] for key in ("right", "up")}
    left.xaxis.set_inverted(backwards.get(found.axes[0], False))
    left.yaxis.set_inverted(backwards.get(found.axes[1], False))
    left.set_ylabel(f"{'XYZ'[found.axes[1]]} [{view.length}]")
    return figure


def _map(axes: Axes, found: Overlap, words: Words) -> None:
    from matplotlib.ticker import MaxNLocator

    rows, columns = found.images.shape
    low = found.first - 0.5 * found.step
    high = low + found.step * np.array([columns, rows])
    drawn = axes.imshow(
        np.where(found.images > 0, found.images, np.nan),
        origin="lower",
        extent=(low[0], high[0], low[1], high[1]),
        vmin=1,
        cmap="viridis",
        interpolation="nearest",
        zorder=1,
    )
    bar = axes.figure.colorbar(drawn, ax=axes, shrink=0.7, format="%d", ticks=MaxNLocator(integer=True))
    bar.set_label(words("images"))
    margin = 0.03 * (high - low).max()
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_title(words("Images that measured points in each cell"), fontsize=9, loc="left")


def _rays(axes: Axes, view: View, found: Overlap, words: Words) -> None:
    rays, xy = view.points["rays"].to_numpy(), places(view)[:, found.axes]
    for (low, high), (colour, mark, size) in zip(RAY_CLASSES, _LOOKS, strict=True):
        mine = (rays >= low) & (rays <= (np.inf if high is None else high))
        if mine.any():
            name = f"≥ {low}" if high is None else str(low) if low == high else f"{low}–{high}"
            label = f"{name} ({int(mine.sum())})"
            axes.plot(*xy[mine].T, mark, color=colour, ms=size, ls="none", label=label, rasterized=True)
    axes.legend(
        title=words("rays"), loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7, title_fontsize=7
    )
    axes.set_title(words("Points by their rays"), fontsize=9, loc="left")
