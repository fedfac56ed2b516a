"""Drawings of a plan (SVG): the network with its sights and ellipses, and variants side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup, escape

from mor.arrays import FloatArray
from mor.report.html.figures.labels import placed
from mor.report.html.figures.layout import round_length, small_unit
from mor.report.words.language import Words

WIDTH, _MOST, _LEAST = 960, 640, 260
_MARGIN, _LEGEND = 60, 30
_MOST_SIGHTS, _MOST_LABELS = 3_000, 400
_LETTER, _LINE = 7.2, 13.0
"""Width of a letter and height of a line of a name."""
_BAR, _GAP, _NAMES, _BARS = 11, 14, 220, 520


class Drawing(NamedTuple):
    """Points with their covariances, and where sights begin and end, in project axes."""

    names: Sequence[str]
    places: FloatArray
    """(n, 3); NaN if a point is nowhere."""
    covariances: FloatArray
    """(n, 3, 3)."""
    at: Mapping[str, FloatArray]
    """Place of everything by its name."""
    axes: tuple[int, int]
    """Axes drawn to the right and upwards."""
    signs: tuple[float, float]
    """Of the drawing, whose y counts downwards."""
    unit: str

    @property
    def ellipse_scale(self) -> float:
        """Units of the drawing per unit of σ: the largest of nearly all ellipses is a twentieth of its height."""
        axes = list(self.axes)
        sizes = np.sqrt(np.maximum(np.linalg.eigvalsh(self.covariances[:, axes][:, :, axes])[:, -1], 0.0))
        largest = float(np.quantile(sizes, 0.95)) if len(sizes) else 0.0
        return 0.05 * _MOST / largest if largest > 0.0 else 1.0


def network_drawing(found: Drawing, sights: Sequence[tuple[str, Sequence[str]]], words: Words) -> Markup:
    """The network: a path for each of the sights (kind, names of its ends), an ellipse of 1σ for each point."""
    axes, signs = list(found.axes), np.array(found.signs)
    everything = np.array([*found.places, *found.at.values()]).reshape(-1, 3)[:, axes] * signs
    everything = everything[np.isfinite(everything).all(axis=1)]
    if not len(everything):
        return Markup("")
    low, high = everything.min(axis=0), everything.max(axis=0)
    extent = np.where(high > low, high - low, 1e-300)
    room = np.array([WIDTH - 2 * _MARGIN, _MOST - 2 * _MARGIN - _LEGEND])
    factor = float((room / extent).min()) if (high > low).any() else 1.0
    height = max(float((high - low)[1]) * factor + 2 * _MARGIN + _LEGEND, _LEAST)
    shift = np.array([WIDTH / 2.0, (height - _LEGEND) / 2.0]) - factor * (low + high) / 2.0

    def on_paper(place: FloatArray) -> FloatArray:
        return np.asarray(place[..., axes] * signs * factor + shift)

    parts = []
    for number, (kind, names) in enumerate(sights[:_MOST_SIGHTS]):
        ends = [on_paper(found.at[name]) for name in names if name in found.at]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in ends)
        said = escape(" – ".join(names))
        parts.append(
            f'<polyline class="sight {kind}" data-unit="{number}" points="{path}"><title>{said}</title></polyline>'
        )
    for number, (name, place, covariance) in enumerate(
        zip(found.names, found.places, found.covariances, strict=True)
    ):
        if np.isfinite(place).all():
            parts.append(_point(number, name, on_paper(place), _drawn(found, covariance)))
    parts += _labels(found, on_paper(found.places), height)
    parts.append(_scale_bar(found, height))
    label = escape(words("The network as planned"))
    return Markup(
        f'<svg class="drawing" id="network" viewBox="0 0 {WIDTH} {height:.0f}" role="img" aria-label="{label}">'
        f"{''.join(parts)}</svg>"
    )


def _drawn(found: Drawing, covariance: FloatArray) -> FloatArray:
    """(2, 2) covariances in the axes of the drawing, in its units."""
    axes = list(found.axes)
    part = covariance[np.ix_(axes, axes)] * np.outer(found.signs, found.signs)
    return np.asarray(part * found.ellipse_scale**2)


def _point(number: int, name: str, at: FloatArray, covariance: FloatArray) -> str:
    values, vectors = np.linalg.eigh(covariance)
    b, a = np.sqrt(np.maximum(values, 0.0))
    turn = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
    place = f"translate({at[0]:.1f} {at[1]:.1f})"
    return (
        f'<g transform="{place}"><ellipse class="before" rx="{a:.2f}" ry="{b:.2f}" transform="rotate({turn:.2f})"/>'
        f'<ellipse class="now" data-point="{number}" rx="{a:.2f}" ry="{b:.2f}" transform="rotate({turn:.2f})"/>'
        f'<circle r="2.2"/><title>{escape(name)}</title></g>'
    )


def _labels(found: Drawing, xy: FloatArray, height: float) -> list[str]:
    """Names of points where nothing else is; none where there is no such place."""
    known = np.flatnonzero(np.isfinite(xy).all(axis=1))[:_MOST_LABELS].tolist()
    size = np.array([(_LETTER * len(found.names[k]), _LINE) for k in known]).reshape(-1, 2)
    edge = np.array([0.0, 0.0, WIDTH, height - _LEGEND])
    said = []
    for number, offset in placed(xy[known], size, edge):
        x, y = xy[known[number]] + offset
        said.append(
            f'<text x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle">{escape(found.names[known[number]])}</text>'
        )
    return said


def _scale_bar(found: Drawing, height: float) -> str:
    """A bar for the size of the ellipses."""
    wanted = 100.0 / found.ellipse_scale
    unit, factor = small_unit(found.unit, wanted)
    length = round_length(wanted * factor)
    drawn = length / factor * found.ellipse_scale
    y = height - 14
    return (
        f'<line class="bar" x1="{_MARGIN}" x2="{_MARGIN + drawn:.1f}" y1="{y:.0f}" y2="{y:.0f}"/>'
        f'<text x="{_MARGIN + drawn + 8:.1f}" y="{y + 4:.0f}">1σ: {length:g} {unit}</text>'
    )


def variants_drawing(rows: Sequence[Mapping[str, Any]], unit: str, words: Words) -> Markup:
    """Mean σ of x, y, z and the smallest r of each variant as bars, the plan itself first."""
    keys = ("rms_sx", "rms_sy", "rms_sz")
    largest = max([float(row[key] or 0.0) for row in rows for key in keys] + [1e-300])
    best = max([float(row["smallest_r"] or 0.0) for row in rows] + [1e-300])
    parts, y = [], 10.0
    for number, row in enumerate(rows):
        name = words.listed(row["name"]) if number == 0 else row["name"]
        verdict = "none" if row["redundancy"] is None else "good" if row["fulfilled"] else "bad"
        judged = verdict if row["require"] or verdict == "none" else "none"
        parts.append(
            f'<text class="name {judged}" x="{_NAMES - 10}" y="{y + 2 * _BAR + 4:.0f}">{escape(_cut(name))}</text>'
        )
        bars = [*((f"s{k[-1].upper()}", row[k], largest, unit, k[-1]) for k in keys)]
        bars.append(("min r", row["smallest_r"], best, "", "r"))
        for said, value, most, its_unit, kind in bars:
            length = _BARS * float(value or 0.0) / most
            number_said = words.number(f"{value:#.3g}") if value is not None else words("no solution")
            parts.append(
                f'<rect class="{kind}" x="{_NAMES}" y="{y:.1f}" width="{length:.1f}" height="{_BAR - 2}"/>'
                f'<text class="value" x="{_NAMES + length + 5:.1f}" y="{y + _BAR - 3:.1f}">'
                f"{said} {escape(number_said)} {its_unit}</text>"
            )
            y += _BAR
        y += _GAP
    label = escape(words("Variants"))
    return Markup(
        f'<svg class="drawing variants" viewBox="0 0 {WIDTH} {y:.0f}" role="img" aria-label="{label}">'
        f"{''.join(parts)}</svg>"
    )


def _cut(name: str) -> str:
    return name if len(name) <= 30 else f"{name[:29]}…"
