"""DXF: points, names, projection centres, observed lines and error ellipses, each on a layer of its own."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from mor.errors import InputError, Problem
from mor.formats.drawing.results import Drawing, drawing_in_metres
from mor.formats.written import Written
from mor.project.file.nodes import Document

LAYERS = {"points": 7, "names": 7, "images": 5, "observations": 8, "ellipses": 1}
"""Layers and their colours (AutoCAD colour index)."""
_LARGEST_ELLIPSE = 0.05
"""Longest semi-axis of the error ellipses as they are drawn, of the extent of the network."""


def write_dxf(document: Document, folder: Path, target: Path) -> Written:
    """A drawing in metres. Raises :class:`InputError`, also where ezdxf, of the extra ``formats``, is missing."""
    try:
        from ezdxf.filemanagement import new
    except ImportError:
        words = "DXF needs the extra formats: pip install 'mor-adjustment[formats]'"
        raise InputError([Problem(words, str(target))]) from None
    shown = drawing_in_metres(document, folder)
    sheet = new("R2010", setup=False)
    sheet.header["$INSUNITS"] = 6
    for name, colour in LAYERS.items():
        sheet.layers.add(name, color=colour)
    space = sheet.modelspace()
    extent = float(np.ptp(shown.xyz[:, :2], axis=0).max()) or 1.0
    at = dict(zip(shown.ids, shown.xyz.tolist(), strict=True))
    for name, place in at.items():
        space.add_point(place, dxfattribs={"layer": "points"})
        _text(space, name, place, extent)
    for name, place in zip(shown.images, shown.centres.tolist(), strict=True):
        space.add_point(place, dxfattribs={"layer": "images"})
        _text(space, name, place, extent)
    for a, b in shown.lines:
        space.add_line(at[a], at[b], dxfattribs={"layer": "observations"})
    scale = _ellipses(space, shown, extent)
    text = io.StringIO()
    sheet.write(text)
    said = (
        f"error ellipses are enlarged {scale:.3g} times"
        if scale
        else "there are no results, hence no ellipses"
    )
    words = f"DXF has no observed values; {said}"
    return Written({target: text.getvalue().encode()}, [*shown.notes, Problem(words, str(target))])


def _text(space: object, name: str, place: list[float], extent: float) -> None:
    attributes = {"layer": "names", "height": extent / 100.0, "insert": place}
    space.add_text(name, dxfattribs=attributes)  # type: ignore[attr-defined]


def _ellipses(space: object, shown: Drawing, extent: float) -> float:
    """Draw them, enlarged so that the largest is seen; the factor, 0 without any."""
    known = np.isfinite(shown.ellipses).all(axis=1) & (shown.ellipses[:, 0] > 0.0)
    if not known.any():
        return 0.0
    scale = _LARGEST_ELLIPSE * extent / float(shown.ellipses[known, 0].max())
    for (a, b, bearing), place in zip(shown.ellipses[known].tolist(), shown.xyz[known].tolist(), strict=True):
        major = (a * scale * np.cos(bearing), a * scale * np.sin(bearing), 0.0)
        attributes = {"layer": "ellipses"}
        space.add_ellipse(place, major, max(b / a, 1e-6), dxfattribs=attributes)  # type: ignore[attr-defined]
    return scale
