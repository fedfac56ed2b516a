"""Points of a GNU Gama file: coordinates and statuses accumulated over all their elements."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mor.arrays import FloatArray
from mor.formats.draft import Draft, Row
from mor.formats.xml import Element

PARTS = ("xy", "z")


@dataclass
class GamaPoint:
    """A point: its coordinates as written, and the statuses of its position and its height."""

    name: str
    line: int
    coordinates: dict[str, str] = field(default_factory=dict)
    fixed: set[str] = field(default_factory=set)
    adjusted: set[str] = field(default_factory=set)
    constrained: set[str] = field(default_factory=set)

    def is_active(self, part: str) -> bool:
        """Return True if a part (``xy`` or ``z``) is fixed or adjusted; all others take no part."""
        return part in self.fixed or part in self.adjusted

    def carries_datum(self, part: str) -> bool:
        """Return True if a part is adjusted and constrained; fixed wins."""
        return part in self.constrained and part not in self.fixed

    @property
    def place(self) -> FloatArray:
        """(3,) coordinates given, NaN if not."""
        return np.array([float(self.coordinates.get(name, "nan")) for name in "xyz"])


def read_points(root: Element, draft: Draft) -> dict[str, GamaPoint]:
    """All points by name, those of observed coordinates included. Fixed points must have coordinates."""
    points: dict[str, GamaPoint] = {}
    for element in root.all("point"):
        _accumulate(points, element)
    for cluster in root.all("coordinates"):
        for element in cluster.all("point"):
            _accumulate(points, element)
    for point in points.values():
        for part in PARTS:
            missing = [name for name in part if name not in point.coordinates]
            if part in point.fixed and missing:
                draft.problem(
                    f"point {point.name!r}: {', '.join(missing)} is fixed but not given", point.line
                )
    return points


def _accumulate(points: dict[str, GamaPoint], element: Element) -> None:
    given = element.attributes
    name = given["id"].strip()
    point = points.setdefault(name, GamaPoint(name, element.line))
    for component in "xyz":
        if component in given:
            point.coordinates[component] = given[component].strip()
    fix, adjust = given.get("fix", ""), given.get("adj", "")
    for part in PARTS:
        if part in fix.lower():
            point.fixed.add(part)
        if part in adjust.lower():
            point.adjusted.add(part)
        if part.upper() in adjust:
            point.constrained.add(part)


def dimensions(points: dict[str, GamaPoint]) -> str:
    """Coordinates that are estimated: ``xyz``, ``xy`` or ``z``."""
    used = [part for part in PARTS if any(point.is_active(part) for point in points.values())]
    return "".join(used) or "xyz"


def put_points(points: dict[str, GamaPoint], draft: Draft) -> None:
    """Tables of points, one for each combination of fixed components; parts that take no part are fixed at 0."""
    estimated = dimensions(points)
    tables: dict[tuple[str, ...], list[Row]] = {}
    for point in points.values():
        if not any(point.is_active(part) for part in PARTS):
            continue
        cells = dict(point.coordinates)
        held: list[str] = []
        for part in PARTS:
            if part not in estimated or part in point.adjusted - point.fixed:
                continue
            held += part
            if part not in point.fixed:
                cells.update(dict.fromkeys(part, "0"))
        row = Row([point.name, *(cells.get(name) for name in "xyz")], point.line)
        tables.setdefault(tuple(held), []).append(row)
    for held_components, rows in tables.items():
        draft.table("points", ("id", "x", "y", "z"), rows, fixed=list(held_components))


def put_datum(points: dict[str, GamaPoint], draft: Draft) -> None:
    """Inner constraints over the constrained coordinates, where there are any."""
    carrying = {part: [p.name for p in points.values() if p.carries_datum(part)] for part in PARTS}
    free = {part: names for part, names in carrying.items() if names}
    if free:
        draft.put("datum", {"free": free})
