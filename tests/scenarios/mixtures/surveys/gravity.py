"""Deflections of the vertical and a geoid of a survey on the earth: in columns of its points, or in grids.

Each is bilinear in latitude and longitude over the whole survey, so that a grid of a few nodes is exact.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyproj import Transformer

from mor.types import FloatArray
from tests.scenarios.mixtures.surveys.survey import Survey

_TO_GEOGRAPHIC = Transformer.from_crs("EPSG:25832", "EPSG:4258", always_xy=True)
_NODES = 3
_STEP = 0.25
"""Degrees between nodes; a survey of 10 km fits into one mesh or four."""
_ARCSEC = np.pi / 648000.0


@dataclass
class Gravity:
    """N in metres, ξ and η in arc seconds: a + b u + c v + d u v, degrees u and v from the corner of the grid."""

    corner: FloatArray
    """Latitude, longitude."""
    of: dict[str, FloatArray]
    keys: dict[str, Any]
    """What the section ``world`` says of grids; nothing where columns have it."""

    def at(self, name: str, survey: Survey, mark: str) -> float:
        """Of a mark."""
        longitude, latitude = _TO_GEOGRAPHIC.transform(*(survey.origin + survey.marks[mark].xyz)[:2])
        return float(self.there(name, np.array([latitude, longitude]) - self.corner))

    def there(self, name: str, uv: FloatArray) -> FloatArray:
        """At (…, 2) degrees from the corner."""
        a, b, c, d = self.of[name]
        return np.asarray(a + b * uv[..., 0] + c * uv[..., 1] + d * uv[..., 0] * uv[..., 1])

    def columns(self, survey: Survey, mark: str) -> dict[str, Any]:
        """What a table of points has of a mark."""
        if self.keys:
            return {}
        xi, eta = (survey.in_angle(self.at(name, survey, mark) * _ARCSEC) for name in ("xi", "eta"))
        return {"geoid": self.at("N", survey, mark), "deflection_north": xi, "deflection_east": eta}

    def gtx(self, name: str) -> bytes:
        """A grid as a file."""
        nodes = np.stack(np.meshgrid(*[_STEP * np.arange(_NODES)] * 2, indexing="ij"), axis=2)
        head = struct.pack(">ddddii", *self.corner, _STEP, _STEP, _NODES, _NODES)
        return head + self.there(name, nodes).astype(">f4").tobytes()


def gravity_field(survey: Survey) -> Gravity | None:
    """Of half of all surveys; the others have ellipsoidal heights, and plumb lines along normals."""
    if not survey.chance(0.5, "deflections and geoid"):
        return None
    longitude, latitude = _TO_GEOGRAPHIC.transform(*survey.origin[:2])
    corner = np.array([latitude, longitude]) - _STEP * survey.draw.uniform(0.5, 1.5, 2)
    of = {"N": survey.draw.normal(0.0, [40.0, 2.0, 2.0, 1.0])}
    of |= {name: survey.draw.normal(0.0, [8.0, 6.0, 6.0, 3.0]) for name in ("xi", "eta")}
    # what a file holds in four bytes is what is true
    of = {name: values.astype(">f4").astype(float) for name, values in of.items()}
    found = Gravity(corner, of, {})
    if survey.chance(0.4, "grids"):
        found.keys = {"geoid": "n.gtx", "deflections": {"north": "xi.gtx", "east": "eta.gtx"}}
        survey.files = {f"{name.lower()}.gtx": found.gtx(name) for name in of}
    return found


def deflection(survey: Survey, gravity: Gravity | None, mark: str) -> tuple[float, float]:
    """ξ, η at a mark, radians."""
    if gravity is None:
        return 0.0, 0.0
    return gravity.at("xi", survey, mark) * _ARCSEC, gravity.at("eta", survey, mark) * _ARCSEC


def height(survey: Survey, gravity: Gravity | None, mark: str) -> float:
    """The height of a mark as a project gives it, above ellipsoid or geoid."""
    ellipsoidal = float(survey.origin[2] + survey.marks[mark].xyz[2])
    return ellipsoidal - (gravity.at("N", survey, mark) if gravity else 0.0)
