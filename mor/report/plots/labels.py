"""Names beside their points: none where another name, a point or the edge of the picture is in the way."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from mor.arrays import FloatArray
from mor.escapes import escaped, shortened
from mor.report.html.figures.labels import placed
from mor.report.html.sights import with_given
from mor.report.plots.sheet import spell_out
from mor.report.tables.rays import places
from mor.report.view import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE = 7.0
"""Size of the letters, points."""
_MOST = 1000
"""Names beyond which none is drawn: hardly any would have room."""
_LONGEST = 30
"""Letters of a name."""


def draw_names(view: View, axes: Axes, chosen: list[int]) -> None:
    """Names of points, stations and images in a finished picture, given points and stations first.

    Places are worked out for the size the picture has in inches, whatever it is written as.
    """
    names, xy = _candidates(view, chosen)
    if not names or len(names) > _MOST:
        return
    figure = cast("Figure", axes.figure)
    spell_out(figure)
    figure.draw_without_rendering()  # from here on the picture keeps its layout
    per_point = figure.dpi / 72.0
    marks = axes.transData.transform(xy) / per_point
    edge = np.array(axes.get_window_extent().extents) / per_point
    size = np.array([_extent(name) for name in names])
    for k, offset in placed(marks, size, edge):
        axes.annotate(
            names[k],
            xy[k],
            offset,
            textcoords="offset points",
            fontsize=_SIZE,
            ha="center",
            va="center",
            zorder=6,
        ).set_in_layout(False)


def _candidates(view: View, chosen: list[int]) -> tuple[list[str], FloatArray]:
    """Names and places (n, 2), the most important first; a name once, for stations bear those of their points."""
    given = with_given(view, view.points)["given"].to_list() if view.points.height else []
    ranked = [(0 if kind else 2, str(name)) for kind, name in zip(given, view.points["id"], strict=True)]
    parts = [places(view)]
    for rank, frame in ((1, view.stations), (3, view.images)):
        if frame.height:
            ranked += [(rank, str(name)) for name in frame["id"]]
            parts.append(frame.select("x", "y", "z").to_numpy())
    xy = np.concatenate(parts)[:, chosen]
    first = {name: k for k, (_, name) in reversed(list(enumerate(ranked)))}
    order = np.array(sorted(first.values(), key=lambda k: ranked[k][0]), dtype=np.int64)
    order = order[np.isfinite(xy[order]).all(axis=1)]
    return [shortened(escaped(ranked[k][1]), _LONGEST) for k in order], xy[order]


def _extent(name: str) -> tuple[float, float]:
    """Width and height of a name, points."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    path = TextPath((0.0, 0.0), name, size=_SIZE, prop=FontProperties(family="DejaVu Sans"))
    return float(path.get_extents().x1) + 2.0, _SIZE + 1.0
