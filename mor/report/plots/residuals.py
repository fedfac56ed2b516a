"""Residual vectors: of one image, or of all images one beside the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from mor.errors import InputError, Problem, nearest
from mor.report.html.derived import image_points, windows
from mor.report.html.figures.layout import round_length, small_unit
from mor.report.palette import BLUE, GREY, RED
from mor.report.plots.sheet import scale_bar, sheet
from mor.report.tables.rays import Window
from mor.report.view import View
from mor.report.words.language import ENGLISH, Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 5
_MOST = 60
"""Images that are drawn beside each other: those with the largest test values."""


def residuals(view: View, image: str | None = None, words: Words = ENGLISH) -> Figure:
    """Residual vectors, all at one scale. Raises :class:`InputError` for an unknown image, or without images."""
    measured = image_points(view)
    if measured.height == 0:
        raise InputError([Problem("there are no images, so there are no residual vectors to draw")])
    names = _chosen(view, measured, image)
    columns = min(_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    wide = len(names) == 1
    figure = sheet(7.5, 5.5 if wide else 0.6 + 1.3 * rows)
    areas = windows(view, measured)
    camera_of = dict(zip(view.images["id"], view.images["camera"], strict=True))
    sizes = measured.select((pl.col("vx") ** 2 + pl.col("vy") ** 2).sqrt()).to_series().drop_nulls()
    typical = float(sizes.quantile(0.9) or 0.0)
    for number, name in enumerate(names):
        axes = figure.add_subplot(rows, columns, number + 1)
        area = areas[camera_of[name]]
        share = 0.05 if wide else 0.1
        scale = round_length(share * (area.x[1] - area.x[0]) / typical) if typical > 0.0 else 1.0
        _image(axes, measured.filter(pl.col("image") == name), area, scale)
        _dress(axes, name, str(measured["unit"][0]), wide)
        if number == 0:
            length = round_length(0.2 * (area.x[1] - area.x[0]) / scale)
            unit, factor = small_unit(str(measured["unit"][0]), length)
            said = f"{length * factor:g} {unit}"
            wide_said = words("{length} in the vectors", length=said) + f" (× {scale:g})"
            scale_bar(axes, scale * length, wide_said if wide else said)
    return figure


def _chosen(view: View, measured: pl.DataFrame, image: str | None) -> list[str]:
    known = measured["image"].unique(maintain_order=True).to_list()
    if image is not None:
        if image not in known:
            raise InputError([Problem(f"unknown image {image!r}{nearest(image, known)}")])
        return [image]
    if len(known) <= _MOST:
        return known
    worst = measured.group_by("image", maintain_order=True).agg(pl.col("w").max())
    kept = set(worst.sort("w", descending=True, nulls_last=True, maintain_order=True).head(_MOST)["image"])
    return [name for name in known if name in kept]


def _image(axes: Axes, rows: pl.DataFrame, area: Window, scale: float) -> None:
    xy = rows.select("x", "y").to_numpy()
    tips = xy + scale * rows.select("vx", "vy").to_numpy()
    gross = rows["flag"].str.contains("gross").to_numpy()
    for chosen, colour, width in ((~gross, BLUE, 0.9), (gross, RED, 1.8)):
        gap = np.full((int(chosen.sum()), 1), np.nan)
        x, y = (np.column_stack([xy[chosen, k], tips[chosen, k], gap[:, 0]]).ravel() for k in (0, 1))
        axes.plot(x, y, color=colour, lw=width)
        axes.plot(
            xy[chosen, 0],
            xy[chosen, 1],
            "x" if colour == RED else ".",
            color=colour,
            ms=6 if colour == RED else 2,
        )
    corners = [area.x[k] for k in (0, 1, 1, 0, 0)], [area.y[k] for k in (0, 0, 1, 1, 0)]
    axes.plot(*corners, color=GREY, lw=0.8, ls="-" if area.known else ":")
    axes.set_aspect("equal")
    axes.set_xlim(area.x)
    axes.set_ylim(area.y[::-1] if area.down else area.y)


def _dress(axes: Axes, name: str, unit: str, wide: bool) -> None:
    axes.set_title(name, fontsize=9 if wide else 7, loc="right")
    if wide:
        axes.set_xlabel(f"x [{unit}]")
        axes.set_ylabel(f"y [{unit}]")
        return
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
