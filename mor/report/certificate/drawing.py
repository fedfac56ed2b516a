"""The curve of radial distortion as a small drawing (SVG) that prints without any script, also in black and white."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup, escape

from mor.arrays import FloatArray
from mor.report.certificate.content import Certificate
from mor.report.html.figures.layout import round_length
from mor.report.words.language import ENGLISH, Words

WIDTH, HEIGHT = 460, 230
_LEFT, _RIGHT, _TOP, _BOTTOM = 58, 12, 24, 40
_BESIDE = 1.959963984540054
"""95 % of a normal distribution."""


def curve_drawing(one: Certificate, words: Words = ENGLISH) -> Markup:
    """Radial distortion by radius with its 95 % band, and where the points end that it rests on."""
    unit, factor = one.small
    radius, shift = one.curve.radius, one.curve.shift * factor
    beside = _BESIDE * one.curve.sigma * factor
    low, high = float((shift - beside).min()), float((shift + beside).max())
    low, high = (low, high) if high > low else (low - 1.0, high + 1.0)
    x = _LEFT + (WIDTH - _LEFT - _RIGHT) * radius / radius[-1]
    scale = (HEIGHT - _TOP - _BOTTOM) / (high - low)

    def level(values: FloatArray) -> FloatArray:
        return np.asarray(HEIGHT - _BOTTOM - scale * (values - low))

    band = [
        *zip(x, level(shift + beside), strict=True),
        *zip(x[::-1], level((shift - beside)[::-1]), strict=True),
    ]
    end = _LEFT + (WIDTH - _LEFT - _RIGHT) * min(one.covered / float(radius[-1]), 1.0)
    parts = [
        *_levels(low, high, level, words),
        *_radii(float(radius[-1]), words),
        f'<polygon class="band" points="{_points(band)}"/>',
        f'<polyline class="curve" points="{_points(list(zip(x, level(shift), strict=True)))}"/>',
        f'<line class="covered" x1="{end:.1f}" y1="{_TOP}" x2="{end:.1f}" y2="{HEIGHT - _BOTTOM}"/>',
        _text(
            WIDTH - _RIGHT,
            HEIGHT - 6,
            words("distance from the principal point [{unit}]", unit=one.unit),
            "end",
        ),
        _text(_LEFT - 30, _TOP - 10, words("distortion [{unit}]", unit=unit), "start"),
    ]
    label = escape(words("Radial distortion, mean over all directions"))
    return Markup(
        f'<svg class="drawing" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">{"".join(parts)}</svg>'
    )


def _levels(low: float, high: float, level: object, words: Words) -> list[str]:
    step = round_length((high - low) / 3.0)
    values = np.arange(np.ceil(low / step), np.floor(high / step) + 0.5) * step
    lines = []
    for value, y in zip(values.tolist(), level(values).tolist(), strict=True):  # type: ignore[operator]
        lines.append(f'<line class="grid" x1="{_LEFT}" y1="{y:.1f}" x2="{WIDTH - _RIGHT}" y2="{y:.1f}"/>')
        lines.append(_text(_LEFT - 5, y + 4, words.number(f"{value + 0.0:g}").replace("-", "−"), "end"))
    return lines


def _radii(largest: float, words: Words) -> list[str]:
    step = round_length(largest / 4.0)
    lines = []
    for value in (np.arange(0.0, np.floor(largest / step) + 0.5) * step).tolist():
        x = _LEFT + (WIDTH - _LEFT - _RIGHT) * value / largest
        lines.append(f'<line class="grid" x1="{x:.1f}" y1="{_TOP}" x2="{x:.1f}" y2="{HEIGHT - _BOTTOM}"/>')
        lines.append(_text(x, HEIGHT - _BOTTOM + 15, words.number(f"{value:g}"), "middle"))
    return lines


def _text(x: float, y: float, said: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(said)}</text>'


def _points(pairs: list[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in pairs)
