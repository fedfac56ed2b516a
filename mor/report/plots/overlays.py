"""Overlays of a network plot: sights by kind, scale bars, given points, relative ellipses, external reliability."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mor.arrays import FloatArray
from mor.report.html.sights import detectable_effects, relative_ellipses, scale_of_effects, sights, with_given
from mor.report.palette import BLUE, GREEN, GREY, ORANGE, RED
from mor.report.tables.rays import places
from mor.report.view import View
from mor.report.words.language import Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_KINDS = {
    "direction": ("directions", GREY, "-", 0.5),
    "distance": ("distances", GREEN, "--", 0.7),
    "levelling": ("levelling lines", ORANGE, ":", 1.0),
    "vector": ("vectors between points", RED, "-.", 0.7),
    "scale": ("scale bars", BLUE, "-", 2.5),
}
"""Heading, colour, line and width of each kind of sight."""
_MOST = 5000
"""Sights of a kind that a picture can show."""
_GIVEN = {"control": ("control points", "^"), "check": ("check points", "s")}


def draw_sights(view: View, axes: Axes, chosen: list[int], words: Words) -> None:
    """Lines between points and stations, by kind; kinds of very many lines would be a stain and are left out."""
    found = sights(view)
    stations = view.stations.select("x", "y", "z").to_numpy() if view.stations.height else np.zeros((0, 3))
    xyz = np.concatenate([places(view), stations])[:, chosen]
    for kind, (name, colour, line, width) in _KINDS.items():
        pairs = found.filter(found["kind"] == kind).select("a", "b").to_numpy()
        if 0 < len(pairs) <= _MOST:
            x, y = _lines(xyz[pairs[:, 0]], xyz[pairs[:, 1]])
            axes.plot(x, y, line, color=colour, lw=width, label=words(name), zorder=1.5)


def draw_paths(view: View, axes: Axes, chosen: list[int], words: Words) -> None:
    """Paths of instruments: knots of trajectories one after the other, a line for each stretch."""
    if not view.trajectories.height:
        return
    stretches = view.trajectories.partition_by("trajectory", "stretch", maintain_order=True)
    for number, knots in enumerate(stretches):
        xyz = knots.select("x", "y", "z").to_numpy()[:, chosen]
        label = words("trajectories") if number == 0 else None
        axes.plot(xyz[:, 0], xyz[:, 1], color=ORANGE, lw=1.2, label=label, zorder=2)


def draw_given(view: View, axes: Axes, chosen: list[int], words: Words) -> None:
    """Control points and check points, each with its mark."""
    given = with_given(view, view.points)["given"].to_numpy()
    for kind, (name, marker) in _GIVEN.items():
        xyz = places(view)[given == kind][:, chosen]
        if len(xyz):
            axes.plot(
                *(xyz[:, 0], xyz[:, 1], marker),
                color="black",
                mfc="none",
                ms=8,
                ls="none",
                label=words(name),
                zorder=5,
            )


def draw_relative(view: View, axes: Axes, chosen: list[int], scale: float, words: Words) -> None:
    """Relative ellipses of the chosen pairs in the middle between them, in plan, enlarged as those of points."""
    found = relative_ellipses(view)
    if not found.height or 2 in chosen:
        return
    xyz = places(view)
    middle = 0.5 * (xyz[found["one"].to_numpy()] + xyz[found["other"].to_numpy()])[:, :2]
    along = found.select("dx", "dy").to_numpy()
    across = np.column_stack([-along[:, 1], along[:, 0]])
    t = np.linspace(0.0, 2.0 * np.pi, 49)
    half = found.select("a", "b").to_numpy() * scale
    lines = (
        middle[:, None]
        + (half[:, :1] * np.cos(t))[:, :, None] * along[:, None]
        + (half[:, 1:] * np.sin(t))[:, :, None] * across[:, None]
    )[:, :, chosen]
    for k, line in enumerate(lines):
        label = words("relative ellipses × {scale}", scale=f"{scale:g}") if k == 0 else None
        axes.plot(line[:, 0], line[:, 1], color=GREEN, lw=0.8, label=label, zorder=3)


def draw_effects(view: View, axes: Axes, chosen: list[int], words: Words) -> None:
    """External reliability of the points: where an error that stays unseen moves them."""
    found = detectable_effects(view)
    if not found.height:
        return
    scale = scale_of_effects(view, found)
    start = places(view)[found["point"].to_numpy()][:, chosen]
    vectors = scale * found.select("dx", "dy", "dz").to_numpy()[:, chosen]
    label = words("external reliability × {scale}", scale=f"{scale:g}")
    drawn: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.002}
    axes.quiver(
        start[:, 0], start[:, 1], vectors[:, 0], vectors[:, 1], color=BLUE, label=label, **drawn, zorder=4
    )


def _lines(start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """x and y of separate lines, a gap after each."""
    gap = np.full((len(start), 1), np.nan)
    x, y = (np.column_stack([start[:, [k]], end[:, [k]], gap]).ravel() for k in (0, 1))
    return x, y
