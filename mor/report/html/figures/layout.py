"""Charts as plain data: a chart is its traces and a layout whose axes carry names and units."""

from __future__ import annotations

from typing import Any

import numpy as np

from mor.arrays import FloatArray

Figure = dict[str, Any]
DIGITS = 6


def figure(traces: list[dict[str, Any]], x: str, y: str, **layout: Any) -> Figure:
    """A chart with named axes."""
    axes = {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}}}
    for name in axes:
        axes[name] |= layout.pop(name, {})
    return {"data": traces, "layout": {**axes, **layout}}


def numbers(values: FloatArray) -> list[float | None]:
    """Numbers with six significant digits, ``None`` if there is none."""
    return [float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None for value in values.tolist()]


def joined(start: FloatArray, end: FloatArray) -> tuple[list[float | None], list[float | None]]:
    """x and y of separate lines from start to end (n, 2)."""
    gap = np.full((len(start), 1), np.nan)
    x = np.column_stack([start[:, 0], end[:, 0], gap]).ravel()
    y = np.column_stack([start[:, 1], end[:, 1], gap]).ravel()
    return numbers(x), numbers(y)


def round_length(value: float) -> float:
    """The largest of 1, 2, 5 · 10ᵏ that does not exceed a positive value; 1 for anything else."""
    if not np.isfinite(value) or value <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value * (1.0 + 1e-12)))


def small_unit(unit: str, size: float) -> tuple[str, float]:
    """Unit and factor in which a size in ``unit`` reads well: µm instead of 0.0004 mm."""
    if unit == "mm" and size < 0.05:
        return "µm", 1e3
    if unit == "m" and size < 0.1:
        return ("mm", 1e3) if size >= 1e-4 else ("µm", 1e6)
    return unit, 1.0
