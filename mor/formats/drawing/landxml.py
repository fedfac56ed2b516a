"""LandXML 1.2: points as CgPoints, north, east and elevation."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from mor.errors import Problem
from mor.formats.drawing.results import drawing_in_metres
from mor.formats.written import Written
from mor.project.edge import Edge
from mor.project.file.model import Axes, Units
from mor.project.file.nodes import Document


def write_landxml(document: Document, folder: Path, target: Path) -> Written:
    """Points in metres. Raises :class:`InputError`."""
    shown = drawing_in_metres(document, folder)
    east_north = shown.xyz @ Edge(Units(), Axes(xy=shown.axes)).matrix.T
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">',
        '<Units><Metric areaUnit="squareMeter" linearUnit="meter" volumeUnit="cubicMeter" '
        'temperatureUnit="celsius" pressureUnit="HPA"/></Units>',
        f"<Project name={quoteattr(shown.title)}/>",
        "<CgPoints>",
    ]
    for name, (east, north, up) in zip(shown.ids, np.asarray(east_north).tolist(), strict=True):
        lines.append(f"<CgPoint name={quoteattr(name)}>{escape(f'{north!r} {east!r} {up!r}')}</CgPoint>")
    text = "\n".join([*lines, "</CgPoints>", "</LandXML>"]) + "\n"
    notes = [
        *shown.notes,
        Problem("LandXML has points only here: no σ, no images, no observations", str(target)),
    ]
    return Written({target: text.encode()}, notes)
