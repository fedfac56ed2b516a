"""Movements of a point against time as a small drawing (SVG): its coordinates since the first epoch, with σ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup, escape

from mor.arrays import FloatArray

WIDTH, HEIGHT = 300, 170
_LEFT, _RIGHT, _TOP, _BOTTOM = 44, 12, 24, 22
_AXES = ("x", "y", "z")


def series_drawing(
    name: str, years: FloatArray, moved: FloatArray, sigma: FloatArray, unit: str, labels: Sequence[str]
) -> Markup:
    """Movements (n, 3) with σ (n, 3) at years (n,), in ``unit``; ``labels`` of the three coordinates."""
    reach = np.nan_to_num(np.abs(moved) + 2.0 * sigma)
    most = float(reach.max(initial=0.0)) or 1.0
    first, last = float(years.min()), float(years.max())
    x = _LEFT + (years - first) / max(last - first, 1e-9) * (WIDTH - _LEFT - _RIGHT)
    middle = (_TOP + HEIGHT - _BOTTOM) / 2.0
    per = (HEIGHT - _BOTTOM - _TOP) / 2.0 / most
    parts = [
        f'<line class="zero" x1="{_LEFT}" y1="{middle:.1f}" x2="{WIDTH - _RIGHT}" y2="{middle:.1f}"/>',
        f'<text class="title" x="{_LEFT}" y="14">{escape(name)}</text>',
        *(
            f'<text x="{_LEFT - 5}" y="{middle - sign * most * per + 4:.1f}" text-anchor="end">'
            f"{'−' if sign < 0 else ''}{most if sign else 0:.2g}</text>"
            for sign in (1, 0, -1)
        ),
        f'<text x="{_LEFT}" y="{HEIGHT - 6}">{first:.1f}</text>',
        f'<text x="{WIDTH - _RIGHT}" y="{HEIGHT - 6}" text-anchor="end">{last:.1f}</text>',
    ]
    for k, axis in enumerate(_AXES):
        if not (sigma[:, k] > 0.0).any():
            continue
        y = middle - moved[:, k] * per
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        parts.append(f'<polyline class="{axis}" points="{points}"/>')
        parts += [
            f'<line class="{axis}" x1="{a + k - 1:.1f}" x2="{a + k - 1:.1f}" y1="{b - s:.1f}" y2="{b + s:.1f}"/>'
            f'<circle class="{axis}" cx="{a + k - 1:.1f}" cy="{b:.1f}" r="2"/>'
            for a, b, s in zip(x, y, 2.0 * sigma[:, k] * per, strict=True)
        ]
    shown = WIDTH - _RIGHT
    for k, axis in reversed(list(enumerate(_AXES))):
        parts.append(f'<text class="{axis}" x="{shown}" y="14" text-anchor="end">{escape(labels[k])}</text>')
        shown -= 24
    about = escape(f"{name} [{unit}]")
    return Markup(
        f'<svg class="series" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{about}">{"".join(parts)}</svg>'
    )
