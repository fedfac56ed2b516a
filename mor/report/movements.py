"""Drawings of movements (SVG)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import polars as pl
from markupsafe import Markup, escape
from scipy.special import chdtri

from mor.report.language import Words
from mor.report.layout import NO_MARKS, at_edge, frame_of, placed, round_length, small_unit, with_distances
from mor.report.page_data import covariances, plan_axes
from mor.types import BoolArray, FloatArray, IntArray

# ---- Movements between two epochs as a drawing (SVG): vectors from ellipses of confidence, labels that do not overlap.

DRAWING_WIDTH = 960
_LEAST, _MOST = 260, 560
"""Heights between which the drawing has that of its network."""
MARGIN, LEGEND = 60, 30
_AROUND = float(np.sqrt(chdtri(2, 0.05)))
"""Semi-axes of an ellipse of 95 % in units of those of 1σ."""


class PointMovements(NamedTuple):
    """Points of both epochs: names, places, movements (n, 3) and their covariances (n, 3, 3), in project axes."""

    names: tuple[str, ...]
    places: FloatArray
    movements: FloatArray
    covariances: FloatArray
    moved: BoolArray
    unit: str
    reversed: tuple[bool, bool, bool]
    """Axes that count to the left or downwards in a plan."""
    right: int
    """Which axis is drawn to the right in a plan: 0 or 1."""


def moved_points(points: pl.DataFrame, last: pl.DataFrame, xy: str, unit: str) -> PointMovements:
    """Movements of points to their last epoch, ``last``, at the places of the table of points; ``xy``: the axes."""
    placed = last.join(
        points.select(pl.col("id").cast(pl.String), *(pl.col(a).alias(f"at_{a}") for a in "xyz")),
        left_on="point",
        right_on="id",
        maintain_order="left",
    )
    right, _, backwards = plan_axes(xy)
    return PointMovements(
        names=tuple(placed["point"]),
        places=placed.select("at_x", "at_y", "at_z").to_numpy(),
        movements=placed.select("x", "y", "z").to_numpy(),
        covariances=covariances(placed),
        moved=placed["moved"].to_numpy(),
        unit=unit,
        reversed=backwards,
        right=right,
    )


def widest_view(places: FloatArray, right: int) -> tuple[int, int]:
    """Axes to the right and upwards: in plan, or in elevation where that shows more of the network."""
    up = 1 - right
    extent = np.ptp(places, axis=0) if len(places) else np.zeros(3)
    if extent[2] <= min(extent[right], extent[up]):
        return right, up
    return (right if extent[right] >= extent[up] else up), 2


def movement_drawing(found: PointMovements, words: Words) -> Markup:
    """Points, their movements and ellipses at one scale, with a bar for it; what has moved thick, with its name."""
    frame = frame_of(found.places)
    axes = widest_view(found.places if frame is None else np.array(frame), found.right)
    xy, away, factor, height = _on_paper(found, axes)
    found = found._replace(names=tuple(with_distances(found.names, away, found.unit)))
    signs = np.array([-1.0 if found.reversed[k] else 1.0 for k in axes]) * (1.0, -1.0)
    vectors = found.movements[:, axes] * signs
    covariances = found.covariances[:, axes][:, :, axes] * np.outer(signs, signs)
    around = _AROUND * np.sqrt(np.maximum(np.trace(covariances, axis1=1, axis2=2), 0.0))
    sizes = np.maximum(np.hypot(vectors[:, 0], vectors[:, 1]), around)
    largest = float(np.quantile(sizes, 0.95)) if len(sizes) else 0.0
    scale = 0.1 * _MOST / largest if largest > 0.0 else 1.0
    parts = [_ellipse(p, c * scale**2) for p, c in zip(xy, covariances, strict=True)]
    parts += [_vector(p, p + scale * v, m) for p, v, m in zip(xy, vectors, found.moved, strict=True)]
    order = np.argsort(~found.moved, kind="stable")
    others = np.concatenate([np.delete(xy, order[:400], axis=0), (xy + scale * vectors)[found.moved]])
    parts += labels(found.names, xy, order, height, 6.6, others, found.moved)
    parts += [_bar(scale, found.unit, height, words), *_axes(axes, signs, factor, found.unit, height)]
    tip = (
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="6" refY="4" markerWidth="4.5" markerHeight="4.5" orient="auto">'
        '<path class="tip" d="M0 0 8 4 0 8z"/></marker></defs>'
    )
    return drawing([tip, *parts], DRAWING_WIDTH, height, words("Movements between the epochs"))


def drawing(
    parts: Sequence[str], width: float, height: float, label: str, kind: str = "drawing", name: str = ""
) -> Markup:
    """A drawing (SVG) of its parts, with a label for those who do not see it; ``kind`` and ``name``: class and id."""
    named = f'{kind}" id="{name}' if name else kind
    head = f'<svg class="{named}" viewBox="0 0 {width} {height:.0f}" role="img" aria-label="{escape(label)}">'
    return Markup(f"{head}{''.join(parts)}</svg>")


def _on_paper(found: PointMovements, axes: tuple[int, int]) -> tuple[FloatArray, FloatArray, float, float]:
    """Places on the drawing (n, 2), how far each stands outside, units per unit of the project, and the height."""
    signs = np.array([-1.0 if found.reversed[k] else 1.0 for k in axes]) * (1.0, -1.0)
    xy = found.places[:, axes] * signs
    low, high = frame_of(xy) or (xy.min(axis=0), xy.max(axis=0))
    xy, away = at_edge(xy, low, high)
    factor, height, middle = fitted(low, high, _MOST)
    return (xy - (low + high) / 2.0) * factor + middle, away, factor, height


def fitted(low: FloatArray, high: FloatArray, most: float) -> tuple[float, float, FloatArray]:
    """Units of a drawing per unit of its frame, its height (``most`` at most), and the middle of its frame."""
    room = np.array([DRAWING_WIDTH - 2 * MARGIN, most - 2 * MARGIN - LEGEND], dtype=float)
    extent = np.where(high > low, high - low, 1e-300)
    factor = float((room / extent).min()) if (high > low).any() else 1.0
    height = max(float(high[1] - low[1]) * factor + 2 * MARGIN + LEGEND, _LEAST)
    return factor, height, np.array([DRAWING_WIDTH / 2.0, (height - LEGEND) / 2.0])


def _ellipse(centre: FloatArray, covariance: FloatArray) -> str:
    values, axes = np.linalg.eigh(covariance)
    a, b = _AROUND * np.sqrt(np.maximum(values[::-1], 0.0))
    turn = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    return (
        f'<ellipse cx="{centre[0]:.1f}" cy="{centre[1]:.1f}" rx="{a:.2f}" ry="{b:.2f}" '
        f'transform="rotate({turn:.1f} {centre[0]:.1f} {centre[1]:.1f})"/>'
    )


def _vector(start: FloatArray, end: FloatArray, moved: bool) -> str:
    kind = "moved" if moved else "stable"
    dot = f'<circle class="{kind}" cx="{start[0]:.1f}" cy="{start[1]:.1f}" r="2.2"/>'
    line = f'<line class="{kind}" x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}"'
    return dot + line + (' marker-end="url(#tip)"/>' if moved else "/>")


def labels(
    names: Sequence[str],
    xy: FloatArray,
    order: IntArray,
    height: float,
    letter: float,
    others: FloatArray = NO_MARKS,
    strong: BoolArray | None = None,
) -> list[str]:
    """The first 400 names in an order, each where nothing else is; none where there is no such place.

    ``letter`` is the width of a letter, ``others`` are places (m, 2) of further marks, ``strong`` (n,) names in bold.
    """
    some = order[:400].tolist()
    size = np.array([(letter * len(names[k]), 13.0) for k in some]).reshape(-1, 2)
    said = []
    for number, offset in placed(xy[some], size, np.array([0.0, 0.0, DRAWING_WIDTH, height - LEGEND]), others):
        k = some[number]
        (x, y), weight = xy[k] + offset, ' class="strong"' if strong is not None and strong[k] else ""
        said.append(f'<text{weight} x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle">{escape(names[k])}</text>')
    return said


def _bar(scale: float, unit: str, height: float, words: Words) -> str:
    length = round_length(0.12 * DRAWING_WIDTH / scale)
    said, factor = small_unit(unit, length)
    y = height - LEGEND / 2
    text = escape(words("{length} in movements and ellipses (95 %)", length=f"{length * factor:g} {said}"))
    return (
        f'<line class="bar" x1="{MARGIN}" y1="{y}" x2="{MARGIN + scale * length:.1f}" y2="{y}"/>'
        f'<text x="{MARGIN + scale * length + 8:.1f}" y="{y + 4}">{text}</text>'
    )


def _axes(axes: tuple[int, int], signs: FloatArray, factor: float, unit: str, height: float) -> list[str]:
    length = round_length(0.2 * DRAWING_WIDTH / factor)
    x, y = DRAWING_WIDTH - MARGIN - factor * length, height - LEGEND / 2
    names = ["XYZ"[k] for k in axes]
    arrows = ("→" if signs[0] > 0 else "←"), ("↑" if signs[1] < 0 else "↓")
    return [
        f'<line class="bar" x1="{x:.1f}" y1="{y}" x2="{DRAWING_WIDTH - MARGIN}" y2="{y}"/>',
        f'<text x="{x - 8:.1f}" y="{y + 4}" text-anchor="end">{names[0]} {arrows[0]} {names[1]} {arrows[1]}, '
        f"{length:g} {unit}</text>",
    ]


# ---- Movements of a point against time as a small drawing (SVG): its coordinates since the first epoch, with σ.


def series_drawing(
    name: str, years: FloatArray, moved: FloatArray, sigma: FloatArray, unit: str, labels: Sequence[str]
) -> Markup:
    """Movements (n, 3) with σ (n, 3) at years (n,), in ``unit``; ``labels`` of the three coordinates."""
    reach = np.nan_to_num(np.abs(moved) + 2.0 * sigma)
    most = float(reach.max(initial=0.0)) or 1.0
    first, last = float(years.min()), float(years.max())
    left, right, top, bottom = 44, 12, 24, 22
    width, height = 300, 170
    x = left + (years - first) / max(last - first, 1e-9) * (width - left - right)
    middle = (top + height - bottom) / 2.0
    per = (height - bottom - top) / 2.0 / most
    parts = [
        f'<line class="zero" x1="{left}" y1="{middle:.1f}" x2="{width - right}" y2="{middle:.1f}"/>',
        f'<text class="title" x="{left}" y="14">{escape(name)}</text>',
        *(
            f'<text x="{left - 5}" y="{middle - sign * most * per + 4:.1f}" text-anchor="end">'
            f"{'−' if sign < 0 else ''}{most if sign else 0:.2g}</text>"
            for sign in (1, 0, -1)
        ),
        f'<text x="{left}" y="{height - 6}">{first:.1f}</text>',
        f'<text x="{width - right}" y="{height - 6}" text-anchor="end">{last:.1f}</text>',
    ]
    coordinates = ("x", "y", "z")
    # Marks of the coordinates, told apart without colours: diamond, square, triangle.
    marks = ("M-2.5 0 0-2.5 2.5 0 0 2.5z", "M-2-2H2V2H-2z", "M0-3 2.8 2H-2.8z")
    for k, axis in enumerate(coordinates):
        if not (sigma[:, k] > 0.0).any():
            continue
        y = middle - moved[:, k] * per
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        parts.append(f'<polyline class="{axis}" points="{points}"/>')
        parts += [
            f'<line class="{axis}" x1="{a + k - 1:.1f}" x2="{a + k - 1:.1f}" y1="{b - s:.1f}" y2="{b + s:.1f}"/>'
            f'<path class="{axis}" transform="translate({a + k - 1:.1f} {b:.1f})" d="{marks[k]}"/>'
            for a, b, s in zip(x, y, 2.0 * sigma[:, k] * per, strict=True)
        ]
    shown = width - right
    for k, axis in reversed(list(enumerate(coordinates))):
        parts.append(f'<text class="{axis}" x="{shown}" y="14" text-anchor="end">{escape(labels[k])}</text>')
        parts.append(f'<path class="{axis}" transform="translate({shown - 13} 10.5)" d="{marks[k]}"/>')
        shown -= 28
    return drawing(parts, width, height, f"{name} [{unit}]", "series")
