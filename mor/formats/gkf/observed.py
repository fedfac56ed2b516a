"""Observations of a project as GNU Gama's elements, with their σ or covariance in its units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.formats.content import Content
from mor.observations import PLAIN_TYPES
from mor.project.file.model import Observations
from mor.project.tables.statuses import number_column
from mor.project.tables.tables import Column, Rows
from mor.units import LENGTH

GON = np.pi / 200.0
CC = GON / 1e4
"""Radians per gon and per cc; the σ of lengths are mm."""


class Part(NamedTuple):
    """How a component becomes an attribute: element, attribute, and the value in face one, internal units."""

    element: str
    attribute: str
    value: Callable[[FloatArray, FloatArray], FloatArray]
    """Of observed values (n,) and faces (n,)."""


def _same(value: FloatArray, face: FloatArray) -> FloatArray:
    return value


def _circle(value: FloatArray, face: FloatArray) -> FloatArray:
    return np.asarray(np.where(face == 2, value - np.pi, value) % (2 * np.pi))


def _zenith(value: FloatArray, face: FloatArray) -> FloatArray:
    return np.asarray(np.where(face == 2, 2 * np.pi - value, value))


def _from_horizon(value: FloatArray, face: FloatArray) -> FloatArray:
    return np.pi / 2 - value


PARTS: dict[str, tuple[Part, ...]] = {
    "horizontal_distance": (Part("distance", "val", _same),),
    "distance": (Part("s-distance", "val", _same),),
    "directions": (Part("direction", "val", _circle),),
    "zenith_directions": (Part("direction", "val", _circle), Part("z-angle", "val", _zenith)),
    "angle": (Part("angle", "val", _same),),
    "bearing": (Part("azimuth", "val", _same),),
    "zenith_angle": (Part("z-angle", "val", _zenith),),
    "vertical_direction": (Part("z-angle", "val", _from_horizon),),
    "height_difference": (Part("dh", "val", _same),),
    "vector": tuple(Part("vec", name, _same) for name in ("dx", "dy", "dz")),
    "coordinates": tuple(Part("point", name, _same) for name in "xyz"),
}
"""Types that GNU Gama has, with their components in order."""
NAMES = {
    "angle": {"at": "from", "from": "bs", "to": "fs"},
    "coordinates": {"point": "id"},
}
"""Attributes of references that are not called as here."""


@dataclass(frozen=True)
class Group:
    """A table of observations in internal units."""

    entry: Observations
    rows: Rows
    values: FloatArray
    """(n, components), NaN where not observed."""
    sigma: FloatArray
    covariance: FloatArray | None
    """Over all observed values, row by row; that of an entry over those of its cluster, in the units of their σ."""
    factors: FloatArray
    """(components,) internal units per unit of the σ."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """How each component is written."""
        return PARTS[self.entry.type]


def groups(content: Content) -> list[Group]:
    """All tables of types that GNU Gama has. Raises :class:`InputError`."""
    return [
        _group(content, number, entry)
        for number, entry in enumerate(content.project.observations)
        if entry.type in PARTS
    ]


def _group(content: Content, number: int, entry: Observations) -> Group:
    type_, edge = PLAIN_TYPES[entry.type], content.edge
    components = type_.components
    columns = [Column(reference.name, required=True) for reference in type_.references] + [Column("set")]
    for name, quantity in [(c.name, c.quantity) for c in components]:
        columns += [number_column(f"{p}{name}", quantity, edge) for p in ("", "sigma_")]
    columns.append(number_column("sigma", components[0].quantity, edge))
    columns += [number_column(f"{slot}_height", LENGTH, edge) for slot in ("from", "to", "station", "at")]
    columns.append(Column("face", parse=lambda text, _: float(text), factor=lambda _: 1.0))

    def squared(text: str, unit: str) -> float:
        return float(text) * edge.factor(LENGTH, unit) ** 2

    pairs = [(a, b) for i, a in enumerate(components) for b in components[i:]] if len(components) == 3 else []
    columns += [Column(f"cov_{a.name}_{b.name}", parse=squared) for a, b in pairs]
    rows = content.rows("observations", number, entry, columns)
    values = np.stack([rows.number(c.name) for c in components], axis=1)
    own = np.stack([rows.number(f"sigma_{c.name}") for c in components], axis=1)
    factors = np.array([edge.factor(c.quantity, _sigma_unit(entry, c.name)) for c in components])
    sigma = np.where(np.isnan(own), rows.number("sigma")[:, None], own) * entry.factor
    if entry.ppm:
        far = np.nan_to_num(values[:, :1]) if "distance" in entry.type else np.zeros((len(values), 1))
        sigma = np.hypot(sigma, entry.ppm * 1e-6 * far)
    return Group(entry, rows, values, sigma, _covariance(entry, rows, values, sigma), factors)


def _sigma_unit(entry: Observations, name: str) -> str:
    """Unit that the σ and covariances of a component are given in."""
    if isinstance(entry.units, str):
        return entry.units
    return entry.units.get("sigma", entry.units.get(name, ""))


def _covariance(entry: Observations, rows: Rows, values: FloatArray, sigma: FloatArray) -> FloatArray | None:
    """Covariance over the observed values of a table, in the order of its rows; ``None`` where it has only σ.

    Vectors and coordinates always have one in GNU Gama.
    """
    if isinstance(entry.covariance, list):
        return np.array(entry.covariance, dtype=float)
    if len(PARTS[entry.type]) != len(values[0]) or len(values[0]) != 3:
        return None
    matrix = np.diag(np.nan_to_num(sigma.ravel() ** 2))
    names = [part.attribute for part in PARTS[entry.type]]
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        column = rows.number(f"cov_{names[i]}_{names[j]}")
        for row in np.flatnonzero(np.isfinite(column)).tolist():
            a, b = row * 3 + i, row * 3 + j
            matrix[a, b] = matrix[b, a] = column[row]
    seen = np.flatnonzero(np.isfinite(values).ravel())
    return np.asarray(matrix[np.ix_(seen, seen)])
