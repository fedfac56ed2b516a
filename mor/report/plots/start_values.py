"""The plan of what start values were found for: each part in a colour of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mor.approximate.approximation import Approximation
from mor.arrays import FloatArray, IntArray
from mor.project.network.build import Network
from mor.report.html.payload import drawn_axes
from mor.report.palette import BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from mor.report.plots.sheet import sheet
from mor.report.start_values.data import in_project_axes
from mor.report.words.language import ENGLISH, Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE)
_MOST_PARTS = 12
"""Parts that are drawn, of more the largest."""
_MOST_LABELS = 40


def parts(network: Network, approximation: Approximation, words: Words = ENGLISH) -> Figure:
    """Points, images and stations in plan, or in elevation of what is higher than deep, coloured by part."""
    figure = sheet()
    axes = figure.add_subplot()
    xyz = in_project_axes(network, approximation.start["point"])
    chosen, backwards = _plane(network, xyz)
    for k, name in enumerate("xy"):
        getattr(axes, f"set_{name}label")(f"{'XYZ'[chosen[k]]} [{network.project.units.length}]")
        getattr(axes, f"{name}axis").set_inverted(backwards[k])
    axes.set_aspect("equal", adjustable="datalim")
    home, points = _homes(approximation, len(xyz)), network.things["point"].parts["position"]
    spaces = ("image", "images", "D"), ("station", "stations", "^")
    for number, colour in _drawn(home):
        label = words("part {number}", number=number) if number else words.listed("object system")
        _marks(axes, xyz[points[home[points] == number]][:, chosen], "o", 3, colour, label)
        for space, _, marker in spaces:
            places = np.unique(network.things[space].parts["position"])
            _marks(axes, xyz[places[home[places] == number]][:, chosen], marker, 6, colour, "")
    for _, called, marker in spaces:
        _marks(axes, np.zeros((0, 2)), marker, 6, GREY, words(called))
    _labels(network, axes, xyz, chosen)
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", ncols=5)
    missing = words("{count} without start values", count=len(approximation.missing))
    title = network.project.title or words("Network")
    axes.set_title(f"{title} – {missing}" if approximation.missing else title, fontsize=9, loc="left")
    return figure


def _plane(network: Network, xyz: FloatArray) -> tuple[list[int], list[bool]]:
    """The coordinates drawn to the right and upwards, and whether they count backwards."""
    drawn = drawn_axes(network.project.axes.xy)
    right, up = "xyz".index(drawn["right"]), "xyz".index(drawn["up"])
    backwards = [drawn["right_reversed"], drawn["up_reversed"]]
    known = xyz[np.isfinite(xyz).all(axis=1)]
    extent = np.ptp(known, axis=0) if len(known) > 2 else np.zeros(3)
    if extent[2] <= 2.0 * min(extent[right], extent[up]):
        return [right, up], backwards
    wider = 0 if extent[right] >= extent[up] else 1
    return [(right, up)[wider], 2], [backwards[wider], False]


def _homes(approximation: Approximation, count: int) -> IntArray:
    """(points,) the part in which each was known first."""
    home = np.zeros(count, dtype=np.int64)
    for join in reversed(approximation.parts):
        home[join.points] = join.number
        home[[approximation.frames[number].position for number in join.frames]] = join.number
    return home


def _drawn(home: IntArray) -> list[tuple[int, str]]:
    """Parts and their colours, at most so many as can be told apart: those with most in them."""
    numbers, counts = np.unique(home, return_counts=True)
    most = sorted(numbers[np.argsort(-counts, kind="stable")][:_MOST_PARTS].tolist())
    return [(int(number), _COLOURS[k % len(_COLOURS)]) for k, number in enumerate(most)]


def _marks(axes: Axes, xy: FloatArray, marker: str, size: float, colour: str, label: str) -> None:
    if len(xy) or label:
        axes.plot(xy[:, 0], xy[:, 1], marker, color=colour, ms=size, ls="none", label=label or "_", zorder=3)


def _labels(network: Network, axes: Axes, xyz: FloatArray, chosen: list[int]) -> None:
    named = [
        (name, xyz[block][chosen])
        for space in ("point", "image", "station")
        for name, block in zip(
            network.things[space].ids, network.things[space].parts["position"], strict=True
        )
    ]
    for name, place in named if len(named) <= _MOST_LABELS else ():
        if np.isfinite(place).all():
            axes.annotate(str(name), place, (3, 3), textcoords="offset points", fontsize=7)
