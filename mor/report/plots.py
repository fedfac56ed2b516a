"""Plots with Matplotlib."""

from __future__ import annotations

import warnings
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import polars as pl

from mor.errors import InputError, Message, escaped, nearest, shortened
from mor.model.cameras import CAMERA_MODELS
from mor.output_files import write_file
from mor.report.figures import BESIDE, RAY_CLASSES, Overlap, camera_window, overlap
from mor.report.figures import CONFIDENCE as CAMERA_CONFIDENCE
from mor.report.language import ENGLISH, Words, datum_name
from mor.report.layout import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    at_edge,
    ellipse_lines,
    joined,
    normal_bins,
    placed,
    round_length,
    small_unit,
    with_distances,
)
from mor.report.page_data import (
    covariances,
    detectable_effects,
    image_points,
    network_frame,
    plan_axes,
    relative_ellipses,
    scale_of_effects,
    sights,
    windows,
    with_given,
)
from mor.report.view import RadialCurve, View, Window, centres, places, radial_curve, rays_of
from mor.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# ---- A sheet to draw on, and how it becomes a file: same picture, same bytes.


def style() -> AbstractContextManager[None]:
    """The look of pictures, to draw and save them in. Raises :class:`InputError` if matplotlib is missing."""
    try:
        from matplotlib import rc_context
    except ImportError:
        words = "pictures need the Python package matplotlib: pip install 'mor-adjustment[plot]'"
        raise InputError([Message(words)]) from None
    settings = {
        "svg.hashsalt": "mor",
        "font.family": "DejaVu Sans",
        "font.size": 9.0,
        "text.parse_math": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": "#dddddd",
        "grid.linewidth": 0.6,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "legend.frameon": False,
        "savefig.dpi": 150,
    }
    return rc_context(cast("Any", settings))


def sheet(width: float = 7.5, height: float = 5.0) -> Figure:
    """An empty figure, inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def scale_bar(axes: Axes, length: float, words: str) -> None:
    """A bar of a length in data units below the lower left corner, with its words."""
    from matplotlib.transforms import blended_transform_factory

    left = min(axes.get_xlim())
    place = blended_transform_factory(axes.transData, axes.transAxes)
    start = max(axes.get_xlim()) if axes.xaxis_inverted() else left
    step = -length if axes.xaxis_inverted() else length
    axes.plot([start, start + step], [1.03, 1.03], transform=place, color="black", lw=2.5, clip_on=False)
    axes.annotate(words, (start + step, 1.03), (5, 0), xycoords=place, textcoords="offset points", va="center")


def check_picture(path: Path) -> None:
    """Raise :class:`InputError` for a file whose suffix is that of no picture."""
    suffixes = ("svg", "png", "pdf")
    if path.suffix.lower().removeprefix(".") not in suffixes:
        words = f"unknown format {path.suffix!r} of a picture (known: {', '.join('.' + f for f in suffixes)})"
        raise InputError([Message(words, str(path))])


def save(figure: Figure, path: Path, force: bool) -> None:
    """Write a figure; its suffix says how. Raises :class:`InputError` for a suffix that is not known."""
    check_picture(path)
    spell_out(figure)
    write_file(path, lambda place: _draw(figure, place), force)


def _draw(figure: Figure, path: Path) -> None:
    suffix = path.suffix.lower().removeprefix(".")
    with warnings.catch_warnings():
        # Scripts that the font lacks are drawn as boxes, which can be seen in the picture.
        warnings.filterwarnings("ignore", message="Glyph")
        no_date = {
            "svg": {"Date": None, "Creator": "mor"},
            "pdf": {"CreationDate": None, "ModDate": None, "Creator": "mor", "Producer": "mor"},
            "png": {"Software": "mor"},
        }
        figure.savefig(path, format=suffix, metadata=no_date[suffix])


def spell_out(figure: Figure) -> None:
    """Names with control characters, which no picture may contain as they are, or longer than a sheet is wide."""
    from matplotlib.text import Text

    for text in cast("list[Text]", figure.findobj(Text)):
        lines = escaped(text.get_text()).split("\n")
        # Letters of a line of text: what a sheet is wide enough for.
        text.set_text("\n".join(shortened(line, 100) for line in lines))


# ---- A camera: radial distortion with its band of confidence, and the correlations of its components.


def camera(view: View, name: str | None = None, words: Words = ENGLISH) -> Figure:
    """Distortion and correlations of one camera, the first if none is named. Raises :class:`InputError`."""
    names = [camera["id"] for camera in view.cameras]
    if not names:
        raise InputError([Message("there is no camera to plot")])
    if name is not None and name not in names:
        raise InputError([Message(f"unknown camera {name!r}{nearest(name, names)}")])
    chosen = view.cameras[names.index(name) if name else 0]
    measured = image_points(view)
    unit = str(measured["unit"][0]) if measured.height else str(chosen["unit"])
    area = camera_window(chosen, windows(view, measured).get(chosen["id"]), unit)
    figure = sheet(9.0, 4.0)
    left, right = figure.subplots(1, 2)
    figure.suptitle(words("Camera {id} – model {model}", id=chosen["id"], model=chosen["model"]), fontsize=10)
    if area is not None and CAMERA_MODELS[chosen["model"]].central:
        largest = float(np.hypot(max(map(abs, area.x)), max(map(abs, area.y))))
        draw_curve(left, chosen, radial_curve(chosen, largest, 121), words)
    draw_correlations(right, chosen, words)
    return figure


def draw_curve(axes: Axes, camera: dict[str, Any], curve: RadialCurve, words: Words) -> None:
    """Radial distortion by radius with its band of confidence."""
    unit, factor = small_unit(str(camera["unit"]), float(np.abs(curve.shift).max(initial=0.0)))
    beside = BESIDE * curve.sigma
    low, high = (curve.shift - beside) * factor, (curve.shift + beside) * factor
    band = words("{share} confidence", share=f"{CAMERA_CONFIDENCE:.0%}")
    axes.fill_between(curve.radius, low, high, color=BLUE, alpha=0.3, lw=0, label=band)
    axes.plot(curve.radius, curve.shift * factor, color=BLUE, label=words("radial distortion"))
    axes.set_xlabel(words("distance from the principal point [{unit}]", unit=camera["unit"]))
    axes.set_ylabel(words("distortion [{unit}]", unit=unit))
    axes.legend()


def draw_correlations(axes: Axes, camera: dict[str, Any], words: Words) -> None:
    """Correlations of the estimated components as a matrix with its numbers."""
    names, matrix = camera["correlations"]["components"], camera["correlations"]["matrix"]
    axes.grid(False)
    if matrix is None or len(names) < 2:
        axes.set_axis_off()
        axes.text(0.5, 0.5, words("fewer than two components are estimated"), ha="center", transform=axes.transAxes)
        return
    shown = axes.imshow(np.array(matrix), cmap="PuOr", vmin=-1.0, vmax=1.0)
    axes.set_xticks(range(len(names)), names, rotation=90 if len(names) > 8 else 0)
    axes.set_yticks(range(len(names)), names)
    axes.set_title(words("Correlations [1]"), fontsize=9)
    for i, row in enumerate(matrix):
        for j, value in enumerate(row):
            colour = "white" if abs(value) > 0.6 else "black"
            axes.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=6, color=colour)
    axes.figure.colorbar(shown, ax=axes, shrink=0.8)


# ---- The test values w against the normal distribution, and the redundancy numbers.


def histogram(view: View, words: Words = ENGLISH) -> Figure:
    """Density of w with N(0, 1) and the critical values; counts of r."""
    used = view.used
    w, r = used["w"].drop_nulls().to_numpy(), used["r"].drop_nulls().to_numpy()
    bins = normal_bins(w, view.critical)
    figure = sheet(9.0, 3.8)
    left, right = figure.subplots(1, 2)
    counted = words("w ({count:observation|observations})", count=len(w))
    if bins.beyond:
        counted += "\n" + words("{count} of them beyond ±{limit}", count=bins.beyond, limit=f"{bins.limit:g}")
    left.hist(bins.w, bins=bins.edges, density=bool(len(w)), color=BLUE, label=counted)
    t = np.linspace(-bins.limit, bins.limit, 401)
    left.plot(t, np.exp(-0.5 * t**2) / np.sqrt(2.0 * np.pi), color=ORANGE, label="N(0, 1)")
    for value in (-view.critical, view.critical):
        left.axvline(value, color=RED, ls="--", lw=1.0)
    left.set_xlabel("w [1]")
    left.set_ylabel(words("density [1]"))
    left.legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    right.hist(r, bins=np.linspace(0.0, 1.0, 41), color=GREEN)
    right.set_xlabel(words("redundancy number r [1]"))
    right.set_ylabel(words("observations"))
    return figure


# ---- Names beside their points: none where another name, a point or the edge of the picture is in the way.

_SIZE = 7.0
"""Size of the letters, points."""


def draw_names(view: View, axes: Axes, chosen: list[int]) -> None:
    """Names of points, stations and images in a finished picture, given points and stations first.

    Places are worked out for the size the picture has in inches, whatever it is written as.
    """
    names, xy = _candidates(view, chosen)
    # Names beyond which none is drawn: hardly any would have room.
    if not names or len(names) > 1000:
        return
    from matplotlib.patheffects import withStroke

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
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
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
    xyz = np.concatenate(parts).astype(float)
    # Letters of a name.
    xy, names = xyz[:, chosen], [shortened(escaped(name), 30) for _, name in ranked]
    bulk = network_frame(view)
    if bulk is not None:
        low, high = bulk
        xy, distance = at_edge(xy, low[chosen], high[chosen])
        names = with_distances(names, distance, view.length)
    first = {name: k for k, (_, name) in reversed(list(enumerate(ranked)))}
    order = np.array(sorted(first.values(), key=lambda k: ranked[k][0]), dtype=np.int64)
    order = order[np.isfinite(xy[order]).all(axis=1)]
    return [names[k] for k in order], xy[order]


def _extent(name: str) -> tuple[float, float]:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    path = TextPath((0.0, 0.0), name, size=_SIZE, prop=FontProperties(family="DejaVu Sans"))
    return float(path.get_extents().x1) + 2.0, _SIZE + 1.0


# ---- Overlays of a network plot: sights by kind, scale bars, given points, relative ellipses, external reliability.


def draw_sights(view: View, axes: Axes, chosen: list[int], words: Words) -> None:
    """Lines between points and stations, by kind; kinds of very many lines would be a stain and are left out."""
    found = sights(view)
    stations = view.stations.select("x", "y", "z").to_numpy() if view.stations.height else np.zeros((0, 3))
    xyz = np.concatenate([places(view), stations])[:, chosen]
    # Heading, colour, line and width of each kind of sight.
    kinds = {
        "direction": ("directions", GREY, "-", 0.5),
        "distance": ("distances", GREEN, "--", 0.7),
        "levelling": ("levelling lines", ORANGE, ":", 1.0),
        "vector": ("vectors between points", RED, "-.", 0.7),
        "scale": ("scale bars", BLUE, "-", 2.5),
    }
    for kind, (name, colour, line, width) in kinds.items():
        pairs = found.filter(found["kind"] == kind).select("a", "b").to_numpy()
        # Sights of a kind that a picture can show.
        if 0 < len(pairs) <= 5000:
            lines = joined(xyz[pairs[:, 0]], xyz[pairs[:, 1]])
            axes.plot(*lines, line, color=colour, lw=width, label=words(name), zorder=1.5)


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
    for kind, (name, marker) in {"control": ("control points", "^"), "check": ("check points", "s")}.items():
        xyz = places(view)[given == kind][:, chosen]
        if len(xyz):
            axes.plot(
                *(xyz[:, 0], xyz[:, 1], marker), color="black", mfc="none", ms=8, ls="none", label=words(name), zorder=5
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
    axes.quiver(start[:, 0], start[:, 1], vectors[:, 0], vectors[:, 1], color=BLUE, label=label, **drawn, zorder=4)


# ---- The network in plan (or elevation): points, images, stations, rays, and error ellipses where they are asked for.


def network(view: View, words: Words = ENGLISH) -> Figure:
    """Points, images, stations and rays in the plane in which the points extend most."""
    figure = sheet()
    axes, chosen = _prepared(view, figure)
    rays = rays_of(view)
    if 0 < len(rays.frame) <= 5000:
        start, end = centres(view)[rays.frame][:, chosen], places(view)[rays.point][:, chosen]
        axes.plot(*joined(start, end), color=GREY, lw=0.3, alpha=0.5, label=words("rays"), zorder=1)
    _draw_network(view, axes, chosen, words)
    _finish(view, axes, chosen, words)
    draw_names(view, axes, chosen)
    return figure


def _draw_network(view: View, axes: Axes, chosen: list[int], words: Words) -> None:
    draw_sights(view, axes, chosen, words)
    draw_paths(view, axes, chosen, words)
    for frame, name, marker, colour in (
        (view.images, words("images"), "D", ORANGE),
        (view.stations, words("stations"), "^", RED),
    ):
        if frame.height:
            xyz = frame.select("x", "y", "z").to_numpy()[:, chosen]
            axes.plot(xyz[:, 0], xyz[:, 1], marker, color=colour, ms=5, ls="none", label=name, zorder=3)
    _points(view, axes, chosen, words)
    draw_given(view, axes, chosen, words)


def ellipses(
    view: View,
    words: Words = ENGLISH,
    confidence: str = "1",
    size: tuple[float, float] = (7.5, 5.0),
    effects: bool = True,
) -> Figure:
    """Sights and error ellipses of the points, enlarged, with the bar that says how much; of heights in elevation.

    With the relative ellipses that the project asks for, and the external reliability of the points. The median
    ellipse sets the scale; ellipses that are much larger are marked instead. ``size`` is in inches.
    """
    from matplotlib.collections import LineCollection

    figure = sheet(*size)
    heights = not (view.points.select("sx", "sy").fill_null(0.0).to_numpy() > 0.0).any()
    axes, chosen = _prepared(view, figure, upright=heights)
    _draw_network(view, axes, chosen, words)
    covariance = covariances(view.points)[:, chosen][:, :, chosen]
    axis = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0))
    frame = network_frame(view)
    extent = float(np.ptp(places(view) if frame is None else frame, axis=0).max(initial=0.0)) or 1.0
    typical = float(np.median(axis[axis > 0.0])) if (axis > 0.0).any() else 0.0
    # Share of the extent that the median ellipse is drawn with; how many times as large an ellipse may be to be drawn.
    share, too_large = 0.012, 8.0
    if typical > 0.0:
        scale = round_length(share * extent / typical)
        # Factor of ellipses in plan by what is asked for: the standard ellipse, or that in which 95 % lie (√χ²(2)).
        factor, name = {"1": (1.0, "1σ"), "95": (2.4477, "95 %")}[confidence]
        drawn, xy = scale * factor, places(view)[:, chosen]
        large = axis > too_large * typical
        lines = ellipse_lines(xy, covariance, drawn, 49)[(axis > 0.0) & ~large]
        label = words("{level} ellipses × {scale}", level=name, scale=f"{scale:g}")
        axes.add_collection(LineCollection(list(lines), colors=RED, linewidths=0.8, label=label))
        if large.any():
            label = words("ellipse too large to draw ({count})", count=int(large.sum()))
            axes.plot(*xy[large].T, "x", color=RED, ms=9, mew=1.5, ls="none", label=label, zorder=5)
        draw_relative(view, axes, chosen, drawn, words)
        axes.autoscale_view()
        if effects:
            draw_effects(view, axes, chosen, words)
        _finish(view, axes, chosen, words)
        length = round_length(0.1 * extent / scale)
        unit, finer = small_unit(view.length, length)
        scale_bar(axes, scale * length, words("{length} in the ellipses", length=f"{length * finer:g} {unit}"))
    else:
        _finish(view, axes, chosen, words)
    draw_names(view, axes, chosen)
    return figure


def _prepared(view: View, figure: Figure, upright: bool = False) -> tuple[Axes, list[int]]:
    """Axes with names, units and directions, in plan or elevation; numbers of the coordinates to the right and up."""
    axes = figure.add_subplot()
    *plan, backwards = plan_axes(view.summary["axes"]["xy"])
    chosen = plan
    if view.points.height > 2 or upright:
        frame = network_frame(view)
        extent = np.ptp(places(view) if frame is None else frame, axis=0)
        if upright or extent[2] > 2.0 * extent[plan].min():
            chosen = [plan[int(np.argmax(extent[plan]))], 2]
    names = "XYZ"
    axes.set_xlabel(f"{names[chosen[0]]} [{view.length}]")
    axes.set_ylabel(f"{names[chosen[1]]} [{view.length}]")
    axes.xaxis.set_inverted(backwards[chosen[0]])
    axes.yaxis.set_inverted(backwards[chosen[1]])
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.set_aspect("equal", adjustable="datalim")
    return axes, chosen


def _points(view: View, axes: Axes, chosen: list[int], words: Words) -> None:
    xyz = places(view)[:, chosen]
    axes.plot(xyz[:, 0], xyz[:, 1], "o", color=BLUE, ms=3, ls="none", label=words("points"), zorder=4)


def _finish(view: View, axes: Axes, chosen: list[int], words: Words) -> None:
    frame = network_frame(view)
    if frame is not None:
        low, high = frame
        _mark_outside(view, axes, low[chosen], high[chosen], chosen, words)
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", ncols=3)
    title = view.summary["title"] or words("Network")
    axes.set_title(
        f"{title} – {words('datum')}: {datum_name(view.summary['datum'], words)}", fontsize=9, loc="left", pad=18
    ).set_in_layout(False)  # it may be wider than the network, which keeps its size


def _mark_outside(view: View, axes: Axes, low: FloatArray, high: FloatArray, chosen: list[int], words: Words) -> None:
    """Limit the axes to the frame, with arrows at its edge to what stands outside."""
    frames = [view.points, *(frame for frame in (view.stations, view.images) if frame.height)]
    every = pl.concat([frame.select(pl.col("id").cast(pl.String), "x", "y", "z") for frame in frames])
    xy = every.unique("id", keep="first", maintain_order=True).select("x", "y", "z").to_numpy()[:, chosen]
    edge, distance = at_edge(xy, low, high)
    far = np.flatnonzero(distance > 0.0)
    label = words("outside the figure ({count})", count=len(far))
    signs = np.array([-1.0 if axis.get_inverted() else 1.0 for axis in (axes.xaxis, axes.yaxis)])
    for k in far:
        across, up = (xy[k] - edge[k]) * signs
        marker = (3, 0, float(np.degrees(np.arctan2(up, across))) - 90.0)
        axes.plot(*edge[k], marker=marker, color=RED, ms=9, ls="none", label=label, zorder=5)
        label = ""
    axes.dataLim.set_points(np.array([low, high]))
    axes.autoscale_view()


# ---- The overlap of images, and the rays of each point.


def overlap_and_rays(view: View, words: Words = ENGLISH) -> Figure:
    """Images over each cell, and points by the number of their rays. Raises :class:`InputError` without images."""
    found = overlap(view, rays_of(view))
    if found is None:
        raise InputError([Message("cannot plot overlap: the image points lie on a line")])
    figure = sheet(9.0, 4.6)
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    _map(left, found, words)
    rays, xy = view.points["rays"].to_numpy(), places(view)[:, found.axes]
    # Colour, mark and size of each class of rays.
    looks = ((RED, "x", 5), (RED, "P", 5), (ORANGE, "^", 5), (GREEN, "o", 3), (BLUE, "o", 3), (GREY, "o", 3))
    for (low, high), (colour, mark, size) in zip(RAY_CLASSES, looks, strict=True):
        mine = (rays >= low) & (rays <= (np.inf if high is None else high))
        if mine.any():
            name = f"≥ {low}" if high is None else str(low) if low == high else f"{low}–{high}"
            label = f"{name} ({int(mine.sum())})"
            right.plot(*xy[mine].T, mark, color=colour, ms=size, ls="none", label=label, rasterized=True)
    right.legend(title=words("rays"), loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7, title_fontsize=7)
    right.set_title(words("Points by their rays"), fontsize=9, loc="left")
    for axes in (left, right):
        axes.set_aspect("equal", adjustable="box")
        axes.ticklabel_format(useOffset=False, style="plain")
        axes.tick_params("x", rotation=30)
        axes.set_xlabel(f"{'XYZ'[found.axes[0]]} [{view.length}]")
    *_, backwards = plan_axes(view.summary["axes"]["xy"])
    left.xaxis.set_inverted(backwards[found.axes[0]])
    left.yaxis.set_inverted(backwards[found.axes[1]])
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


# ---- Residual vectors: of one image, or of all images one beside the other.


def residuals(view: View, image: str | None = None, words: Words = ENGLISH) -> Figure:
    """Residual vectors, all at one scale. Raises :class:`InputError` for an unknown image, or without images."""
    measured = image_points(view)
    if measured.height == 0:
        raise InputError([Message("cannot plot residual vectors: there are no images")])
    names = _residuals_chosen(measured, image)
    columns = min(5, len(names))
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


def _residuals_chosen(measured: pl.DataFrame, image: str | None) -> list[str]:
    known = measured["image"].unique(maintain_order=True).to_list()
    if image is not None:
        if image not in known:
            raise InputError([Message(f"unknown image {image!r}{nearest(image, known)}")])
        return [image]
    # Images that are drawn beside each other: those with the largest test values.
    most = 60
    if len(known) <= most:
        return known
    worst = measured.group_by("image", maintain_order=True).agg(pl.col("w").max())
    kept = set(worst.sort("w", descending=True, nulls_last=True, maintain_order=True).head(most)["image"])
    return [name for name in known if name in kept]


def _image(axes: Axes, rows: pl.DataFrame, area: Window, scale: float) -> None:
    xy = rows.select("x", "y").to_numpy()
    tips = xy + scale * rows.select("vx", "vy").to_numpy()
    gross = rows["flag"].str.contains("gross").to_numpy()
    for chosen, colour, width in ((~gross, BLUE, 0.9), (gross, RED, 1.8)):
        axes.plot(*joined(xy[chosen], tips[chosen]), color=colour, lw=width)
        axes.plot(
            xy[chosen, 0], xy[chosen, 1], "x" if colour == RED else ".", color=colour, ms=6 if colour == RED else 2
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
