"""GeoJSON: points and projection centres as points, observed lines as lines, in the coordinates of the project.

On the earth these are those of its reference system, which the member ``crs`` names, as GDAL and QGIS read it: a
change of datum to the WGS 84 of RFC 7946 would be a guess of decimetres.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from mor.errors import Problem
from mor.formats.drawing.results import Drawing, drawing
from mor.formats.written import Written
from mor.project.file.nodes import Document


def write_geojson(document: Document, folder: Path, target: Path) -> Written:
    """A feature collection in metres. Raises :class:`InputError`."""
    shown = drawing(document, folder)
    at = dict(zip(shown.ids, shown.xyz.tolist(), strict=True))
    features = [_point(shown, k) for k in range(len(shown.ids))]
    features += [
        _feature("Point", centre, {"id": name, "kind": "image"})
        for name, centre in zip(shown.images, shown.centres.tolist(), strict=True)
    ]
    features += [
        _feature("LineString", [at[a], at[b]], {"from": a, "to": b, "kind": "observed"})
        for a, b in shown.lines
    ]
    collection: dict[str, Any] = {"type": "FeatureCollection"}
    if shown.crs:
        collection["crs"] = {"type": "name", "properties": {"name": shown.crs}}
    text = json.dumps({**collection, "features": features}, ensure_ascii=False, indent=1)
    words = "coordinates are those of the project, in metres: GeoJSON's own, longitude and latitude, are not known"
    if shown.crs or shown.degrees:
        words = "coordinates are those of the reference system of the project, which the file names (crs)"
    return Written({target: (text + "\n").encode()}, [*shown.notes, Problem(words, str(target))])


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": properties,
    }


def _point(shown: Drawing, k: int) -> dict[str, Any]:
    properties: dict[str, Any] = {"id": shown.ids[k], "kind": "point"}
    if np.isfinite(shown.sigma[k]).all():
        properties.update(zip(("sx", "sy", "sz"), shown.sigma[k].tolist(), strict=True))
    return _feature("Point", shown.xyz[k].tolist(), properties)
