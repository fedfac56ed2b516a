"""A camera: radial distortion with its band of confidence, and the correlations of its components."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mor.errors import InputError, Problem, nearest
from mor.geometry.cameras import CAMERA_MODELS
from mor.report.html.derived import image_points, windows
from mor.report.html.figures.camera import CONFIDENCE, camera_window
from mor.report.html.figures.layout import small_unit
from mor.report.palette import BLUE
from mor.report.plots.sheet import sheet
from mor.report.tables.distortion import radial_curve
from mor.report.tables.rays import Window
from mor.report.view import View
from mor.report.words.language import ENGLISH, Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BESIDE = 1.959963984540054


def camera(view: View, name: str | None = None, words: Words = ENGLISH) -> Figure:
    """Distortion and correlations of one camera, the first if none is named. Raises :class:`InputError`."""
    chosen = _chosen(view, name)
    measured = image_points(view)
    unit = str(measured["unit"][0]) if measured.height else str(chosen["unit"])
    area = camera_window(chosen, windows(view, measured).get(chosen["id"]), unit)
    figure = sheet(9.0, 4.0)
    left, right = figure.subplots(1, 2)
    title = words("Camera {id} – model {model}", id=chosen["id"], model=chosen["model"])
    figure.suptitle(title, fontsize=10)
    if area is not None and CAMERA_MODELS[chosen["model"]].central:
        _curve(left, chosen, area, words)
    _matrix(right, chosen, words)
    return figure


def _chosen(view: View, name: str | None) -> dict[str, Any]:
    names = [camera["id"] for camera in view.cameras]
    if not names:
        raise InputError([Problem("there is no camera to draw")])
    if name is not None and name not in names:
        raise InputError([Problem(f"unknown camera {name!r}{nearest(name, names)}")])
    return view.cameras[names.index(name) if name else 0]


def _curve(axes: Axes, camera: dict[str, Any], area: Window, words: Words) -> None:
    largest = float(np.hypot(max(map(abs, area.x)), max(map(abs, area.y))))
    curve = radial_curve(camera, largest, 121)
    unit, factor = small_unit(str(camera["unit"]), float(np.abs(curve.shift).max(initial=0.0)))
    beside = _BESIDE * curve.sigma
    low, high = (curve.shift - beside) * factor, (curve.shift + beside) * factor
    band = words("{share} confidence", share=f"{CONFIDENCE:.0%}")
    axes.fill_between(curve.radius, low, high, color=BLUE, alpha=0.3, lw=0, label=band)
    axes.plot(curve.radius, curve.shift * factor, color=BLUE, label=words("radial distortion"))
    axes.set_xlabel(words("distance from the principal point [{unit}]", unit=camera["unit"]))
    axes.set_ylabel(words("distortion [{unit}]", unit=unit))
    axes.legend()


def _matrix(axes: Axes, camera: dict[str, Any], words: Words) -> None:
    names, matrix = camera["correlations"]["components"], camera["correlations"]["matrix"]
    axes.grid(False)
    if matrix is None or len(names) < 2:
        axes.set_axis_off()
        said = words("fewer than two components are estimated")
        axes.text(0.5, 0.5, said, ha="center", transform=axes.transAxes)
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
