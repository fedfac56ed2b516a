"""Read GNU Gama files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mor.errors import InputError, Message, nearest
from mor.formats.draft import Draft, Element, Row, parse_number, parse_xml
from mor.formats.networks import circle_in_face_one, zenith_in_face_one
from mor.input_files import PROJECT, read_bytes
from mor.model.contract import wrap
from mor.project.document import Document
from mor.types import FloatArray
from mor.units import ANGLE_UNITS, parse_dms

# ---- Elements and attributes of GNU Gama XML input, and the errors for others.

Check = Callable[[str], object]


def is_dms(text: str) -> bool:
    """True for angles written d-m-s; all others are gon."""
    return re.match(r"^\s*[-+]?\d+-\d+-\d+(\.\d*)?\s*$", text) is not None


def carried(text: str) -> str:
    """An angle; d-m-s whose minutes or seconds were rounded up to 60 as degrees."""
    match = re.match(r"^\s*(?P<sign>[-+]?)(?P<d>\d+)-(?P<m>\d+)-(?P<s>\d+(?:\.\d*)?)\s*$", text)
    if match is None:
        return text
    minutes, seconds = float(match["m"]), float(match["s"])
    if minutes > 60.0 or seconds > 60.0 or (minutes < 60.0 and seconds < 60.0):
        return text
    value = float(match["d"]) + minutes / 60.0 + seconds / 3600.0
    degrees = int(value)
    rest = round((value - degrees) * 60.0, 9)
    sign = "-" if match["sign"] == "-" else ""
    return f"{sign}{degrees + int(rest // 60)}-{int(rest % 60)}-0"


def _angle(text: str) -> None:
    if is_dms(text):
        parse_dms(carried(text))
        return
    try:
        parse_number(text)
    except ValueError:
        raise ValueError(f"found {text!r}, expected an angle in gon or d-m-s") from None


def _positive(text: str) -> None:
    if not parse_number(text) > 0.0:
        raise ValueError(f"found {text!r}, expected a number > 0")


def _count(text: str) -> None:
    if not text.strip().isdigit():
        raise ValueError(f"found {text!r}, expected a whole number ≥ 0")


def _distance_sigma(text: str) -> None:
    parts = [parse_number(part) for part in text.split()]
    if not 1 <= len(parts) <= 3 or not parts[0] > 0.0:
        raise ValueError(f"found {text!r}, expected a [b [c]] with a > 0, for σ = a + b·D^c")


def _identifier(text: str) -> None:
    if not text.strip():
        raise ValueError("the identifier is empty")


def _anything(text: str) -> None:
    return None


def _one_of(*choices: str) -> Check:
    def check(text: str) -> None:
        if text.strip() not in choices:
            raise ValueError(f"found {text!r}, expected {', '.join(choices)}{nearest(text, choices)}")

    return check


class ElementRule(NamedTuple):
    """Child elements and attributes, required and optional, of an element."""

    children: tuple[str, ...] = ()
    required: Mapping[str, Check] | None = None
    optional: Mapping[str, Check] | None = None

    @property
    def attributes(self) -> dict[str, Check]:
        """All attributes."""
        return {**(self.required or {}), **(self.optional or {})}


_SIGHT = {"from": _identifier, "stdev": _positive, "from_dh": parse_number, "to_dh": parse_number, "extern": _anything}
RULES = {
    "gama-local": ElementRule(("network",), {}, {"xmlns": _anything, "version": _anything}),
    "network": ElementRule(
        ("description", "parameters", "points-observations"),
        {},
        {
            "axes-xy": _one_of("ne", "sw", "es", "wn", "en", "nw", "se", "ws"),
            "angles": _one_of("left-handed", "right-handed"),
            "epoch": parse_number,
        },
    ),
    "description": ElementRule(),
    "parameters": ElementRule(
        (),
        {},
        {
            "sigma-apr": _positive,
            "conf-pr": _positive,
            "tol-abs": _positive,
            "sigma-act": _one_of("aposteriori", "apriori"),
            **dict.fromkeys(
                ("update-constrained-coordinates", "algorithm", "language", "encoding", "angles", "latitude"), _anything
            ),
            **dict.fromkeys(("ellipsoid", "cov-band", "iterations"), _anything),
        },
    ),
    "points-observations": ElementRule(
        ("point", "obs", "coordinates", "height-differences", "vectors"),
        {},
        {
            "distance-stdev": _distance_sigma,
            **dict.fromkeys(("direction-stdev", "angle-stdev", "zenith-angle-stdev", "azimuth-stdev"), _positive),
        },
    ),
    "point": ElementRule(
        (),
        {"id": _identifier},
        {
            **dict.fromkeys("xyz", parse_number),
            **dict.fromkeys(("fix", "adj"), _one_of("xy", "XY", "z", "Z", "xyz", "XYZ", "XYz", "xyZ")),
            "extern": _anything,
        },
    ),
    "obs": ElementRule(
        ("direction", "distance", "angle", "s-distance", "z-angle", "azimuth", "dh", "cov-mat"),
        {},
        {"from": _identifier, "orientation": _angle, "from_dh": parse_number, "extern": _anything},
    ),
    **dict.fromkeys(("direction", "azimuth", "z-angle"), ElementRule((), {"to": _identifier, "val": _angle}, _SIGHT)),
    **dict.fromkeys(("distance", "s-distance"), ElementRule((), {"to": _identifier, "val": _positive}, _SIGHT)),
    "angle": ElementRule(
        (),
        {"bs": _identifier, "fs": _identifier, "val": _angle},
        {
            "from": _identifier,
            "stdev": _positive,
            **dict.fromkeys(("from_dh", "bs_dh", "fs_dh"), parse_number),
            "extern": _anything,
        },
    ),
    "height-differences": ElementRule(("dh", "cov-mat"), {}, {"extern": _anything}),
    "dh": ElementRule(
        (),
        {"from": _identifier, "to": _identifier, "val": parse_number},
        {"stdev": _positive, "dist": _positive, "extern": _anything},
    ),
    "coordinates": ElementRule(("point", "cov-mat"), {}, {"extern": _anything}),
    "vectors": ElementRule(("vec", "cov-mat"), {}, {"extern": _anything}),
    "vec": ElementRule(
        (),
        {"from": _identifier, "to": _identifier, **dict.fromkeys(("dx", "dy", "dz"), parse_number)},
        {"from_dh": parse_number, "to_dh": parse_number, "extern": _anything},
    ),
    "cov-mat": ElementRule((), {"dim": _count, "band": _count}),
}


def check(element: Element, draft: Draft) -> None:
    """Report unknown elements and attributes, missing attributes and bad values, all the way down."""
    rule = RULES[element.name]
    known = rule.attributes
    for name, text in element.attributes.items():
        if name not in known:
            words = f"<{element.name}>: unknown attribute {name!r}{nearest(name, known)}"
            draft.problem(f"{words} (known here: {', '.join(known) or 'none'})", element.line)
            continue
        with draft.at(element.line, name=f"<{element.name}> {name}"):
            known[name](text)
    for name in rule.required or {}:
        if name not in element.attributes:
            draft.problem(f"<{element.name}>: attribute {name!r} is missing", element.line)
    for child in element.children:
        if child.name not in rule.children:
            words = f"unknown element <{child.name}> in <{element.name}>{nearest(child.name, rule.children)}"
            draft.problem(f"{words} (known here: {', '.join(rule.children) or 'none'})", child.line)
        else:
            check(child, draft)


# ---- Points of a GNU Gama file: coordinates and statuses accumulated over all their elements.

POINT_PARTS = ("xy", "z")


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
        for part in POINT_PARTS:
            missing = [name for name in part if name not in point.coordinates]
            if part in point.fixed and missing:
                draft.problem(f"point {point.name!r}: {', '.join(missing)} is fixed but not given", point.line)
    return points


def _accumulate(points: dict[str, GamaPoint], element: Element) -> None:
    given = element.attributes
    name = given["id"].strip()
    point = points.setdefault(name, GamaPoint(name, element.line))
    for component in "xyz":
        if component in given:
            point.coordinates[component] = given[component].strip()
    fix, adjust = given.get("fix", ""), given.get("adj", "")
    for part in POINT_PARTS:
        if part in fix.lower():
            point.fixed.add(part)
        if part in adjust.lower():
            point.adjusted.add(part)
        if part.upper() in adjust:
            point.constrained.add(part)


def dimensions(points: dict[str, GamaPoint]) -> str:
    """Coordinates that are estimated: ``xyz``, ``xy`` or ``z``."""
    used = [part for part in POINT_PARTS if any(point.is_active(part) for point in points.values())]
    return "".join(used) or "xyz"


def put_points(points: dict[str, GamaPoint], draft: Draft) -> None:
    """Tables of points, one for each combination of fixed components; parts that take no part are fixed at 0."""
    estimated = dimensions(points)
    tables: dict[tuple[str, ...], list[Row]] = {}
    for point in points.values():
        if not any(point.is_active(part) for part in POINT_PARTS):
            continue
        cells = dict(point.coordinates)
        held: list[str] = []
        for part in POINT_PARTS:
            if part not in estimated or part in point.adjusted - point.fixed:
                continue
            held += part
            if part not in point.fixed:
                cells.update(dict.fromkeys(part, "0"))
        row = Row([point.name, *(cells.get(name) for name in "xyz")], point.line)
        tables.setdefault(tuple(held), []).append(row)
    for held_components, rows in tables.items():
        draft.table("points", ("id", "x", "y", "z"), rows, fixed=list(held_components))


# ---- Observations of a GNU Gama file: what was measured, with which σ or covariances, and what is left out.


class GamaKind(NamedTuple):
    """Type, names and components of an observation element, and the point components that it needs."""

    type: str
    names: tuple[tuple[str, str], ...]
    """Attribute and column of the names."""
    components: tuple[tuple[str, str], ...]
    """Attribute and column of the values."""
    parts: tuple[str, ...]
    implicit: str = ""
    """Attribute of ``points-observations`` with the σ of observations that have none."""
    heights: bool = False


_FROM_TO = (("from", "from"), ("to", "to"))
KINDS = {
    "distance": GamaKind("horizontal_distance", _FROM_TO, (("val", "distance"),), ("xy",), "distance-stdev"),
    "s-distance": GamaKind("distance", _FROM_TO, (("val", "distance"),), ("xy", "z"), "distance-stdev", True),
    "direction": GamaKind(
        "directions", (("from", "station"), ("to", "to")), (("val", "horizontal"),), ("xy",), "direction-stdev"
    ),
    "angle": GamaKind(
        "angle", (("from", "at"), ("bs", "from"), ("fs", "to")), (("val", "angle"),), ("xy",), "angle-stdev"
    ),
    "z-angle": GamaKind("zenith_angle", _FROM_TO, (("val", "zenith_angle"),), ("xy", "z"), "zenith-angle-stdev", True),
    "azimuth": GamaKind("bearing", _FROM_TO, (("val", "bearing"),), ("xy",), "azimuth-stdev"),
    "dh": GamaKind("height_difference", _FROM_TO, (("val", "dz"),), ("z",)),
    "vec": GamaKind("vector", _FROM_TO, (("dx", "dx"), ("dy", "dy"), ("dz", "dz")), ("xy", "z")),
    "point": GamaKind("coordinates", (("id", "point"),), (("x", "x"), ("y", "y"), ("z", "z")), ()),
}
ANGULAR = ("direction", "angle", "z-angle", "azimuth")


class GamaObservation(NamedTuple):
    """One element with a measured value, or several."""

    kind: str
    names: tuple[str, ...]
    values: tuple[str | None, ...]
    """Values as written, by component of its kind; ``None`` if not observed."""
    sigma: str | None
    heights: tuple[str | None, str | None]
    line: int

    @property
    def unit(self) -> str:
        """``dms`` or ``gon`` for angles, ``m`` for all others."""
        if self.kind not in ANGULAR:
            return "m"
        return "dms" if is_dms(self.values[0] or "") else "gon"

    @property
    def entries(self) -> int:
        """Number of values observed."""
        return sum(value is not None for value in self.values)


class GamaCluster(NamedTuple):
    """Observations given together, with one covariance matrix over all their values where there is one."""

    element: str
    observations: tuple[GamaObservation, ...]
    covariance: FloatArray | None

    def keep(self, chosen: list[GamaObservation | None]) -> GamaCluster:
        """The cluster with its observations replaced; ``None`` leaves one out, with its rows and columns."""
        kept = np.array(
            [
                new is not None and new.values[k] is not None
                for old, new in zip(self.observations, chosen, strict=True)
                for k in range(len(old.values))
                if old.values[k] is not None
            ],
            dtype=bool,
        )
        covariance = None if self.covariance is None else self.covariance[np.ix_(kept, kept)]
        return self._replace(observations=tuple(o for o in chosen if o is not None), covariance=covariance)


def read_clusters(root: Element, sigma_apriori: float, draft: Draft) -> list[GamaCluster]:
    """All clusters of observations, in the order of the file."""
    clusters = []
    for element in root.children:
        if element.name == "point":
            continue
        elements = [child for child in element.children if child.name != "cov-mat"]
        observations = [_observation(child, element, root, sigma_apriori, draft) for child in elements]
        good = tuple(observation for observation in observations if observation is not None)
        covariance = _covariance(element, sum(o.entries for o in good), draft)
        clusters.append(GamaCluster(element.name, good, covariance))
    return clusters


def _observation(
    element: Element, cluster: Element, root: Element, sigma_apriori: float, draft: Draft
) -> GamaObservation | None:
    kind = KINDS[element.name]
    given = {**{k: v for k, v in cluster.attributes.items() if k in ("from", "from_dh")}, **element.attributes}
    missing = [attribute for attribute, _ in kind.names if attribute not in given]
    if missing:
        draft.problem(f"<{element.name}>: {missing[0]!r} is given neither here nor in <{cluster.name}>", element.line)
        return None
    names = tuple(given[attribute].strip() for attribute, _ in kind.names)
    if len(set(names)) < len(names):
        draft.problem(f"<{element.name}>: {names[0]!r} is given twice; different points are needed", element.line)
        return None
    values = tuple(carried(given[a].strip()) if a in given else None for a, _ in kind.components)
    heights = (given.get("from_dh"), given.get("to_dh")) if kind.heights else (None, None)
    observation = GamaObservation(element.name, names, values, None, heights, element.line)
    if cluster.all("cov-mat"):
        return observation
    sigma = _sigma(element, given, kind, root, sigma_apriori)
    if sigma is None:
        words = f"no stdev, and no {kind.implicit}" if kind.implicit else "no stdev and no cov-mat"
        draft.problem(f"<{element.name}>: {words}", element.line)
    return observation._replace(sigma=sigma)


def _sigma(element: Element, given: dict[str, str], kind: GamaKind, root: Element, sigma_apriori: float) -> str | None:
    """σ as written, or after the rules for observations that have none: mm, cc, seconds of arc."""
    if "stdev" in given:
        return given["stdev"].strip()
    if element.name == "dh" and "dist" in given:
        return repr(float(sigma_apriori * np.sqrt(float(given["dist"]))))
    implicit = root.attributes.get(kind.implicit)
    if implicit is None or kind.implicit != "distance-stdev":
        return implicit
    parts = [float(part) for part in implicit.split()]
    a, b, c = parts + [0.0, 1.0][len(parts) - 1 :]
    return repr(a + b * (float(given["val"]) / 1000.0) ** c)


def _covariance(element: Element, entries: int, draft: Draft) -> FloatArray | None:
    """Symmetric matrix from the rows of its upper band; ``None`` if there is none or a mistake was reported."""
    matrices = element.all("cov-mat")
    if not matrices:
        if element.name in ("coordinates", "vectors"):
            draft.problem(f"<{element.name}>: <cov-mat> is missing", element.line)
        return None
    matrix = matrices[0]
    size, band = int(matrix.attributes["dim"]), int(matrix.attributes["band"])
    if size != entries or len(matrices) > 1:
        words = f"found {len(matrices)} matrices" if len(matrices) > 1 else f"dim = {size}, but {entries} values"
        draft.problem(f"<cov-mat>: {words} in <{element.name}>", matrix.line)
        return None
    rows, columns = np.nonzero(np.triu(np.ones((size, size))) - np.triu(np.ones((size, size)), band + 1))
    try:
        values = [parse_number(part) for part in matrix.text.split()]
    except ValueError as error:
        draft.problem(f"<cov-mat>: {error}", matrix.line)
        return None
    if len(values) != len(rows):
        words = f"found {len(values)} numbers, expected {len(rows)} for dim = {size} and band = {band}"
        draft.problem(f"<cov-mat>: {words}", matrix.line)
        return None
    result = np.zeros((size, size))
    result[rows, columns] = result[columns, rows] = values
    return result


def without_inactive(clusters: list[GamaCluster], points: dict[str, GamaPoint], draft: Draft) -> list[GamaCluster]:
    """Clusters without what refers to points, or components of points, that take no part."""
    result = []
    for cluster in clusters:
        kept = [_active(observation, points, draft) for observation in cluster.observations]
        result.append(cluster.keep(kept))
    return result


def _active(observation: GamaObservation, points: dict[str, GamaPoint], draft: Draft) -> GamaObservation | None:
    kind = KINDS[observation.kind]
    for name in observation.names:
        point = points.get(name)
        lacking = [part for part in kind.parts if point is None or not point.is_active(part)]
        if lacking:
            words = f"point {name!r} is neither fixed nor adjusted in {', '.join(lacking)}"
            draft.note(f"<{observation.kind}> not used: {words}", observation.line)
            return None
    if observation.kind != "point":
        return observation
    point = points[observation.names[0]]
    active = [point.is_active("xy")] * 2 + [point.is_active("z")]
    values = tuple(v if use else None for v, use in zip(observation.values, active, strict=True))
    left_out = [name for name, old, new in zip("xyz", observation.values, values, strict=True) if old != new]
    if left_out:
        words = f"point {point.name!r} is neither fixed nor adjusted in {', '.join(left_out)}"
        draft.note(f"<point> in <coordinates> not used: {words}", observation.line)
    return observation._replace(values=values) if any(v is not None for v in values) else None


def without_lonely_directions(clusters: list[GamaCluster], draft: Draft) -> list[GamaCluster]:
    """Clusters without direction sets that have fewer than two targets: they determine nothing but themselves."""
    result = []
    for cluster in clusters:
        targets: dict[str, set[str]] = {}
        for observation in cluster.observations:
            if observation.kind == "direction":
                targets.setdefault(observation.names[0], set()).add(observation.names[1])
        kept: list[GamaObservation | None] = []
        for observation in cluster.observations:
            lonely = observation.kind == "direction" and len(targets[observation.names[0]]) < 2
            kept.append(None if lonely else observation)
            if lonely:
                words = f"the set at {observation.names[0]!r} has no second target"
                draft.note(f"<direction> not used: {words}", observation.line)
        result.append(cluster.keep(kept))
    return result


def leave_out_unobserved(points: dict[str, GamaPoint], clusters: list[GamaCluster], draft: Draft) -> None:
    """Adjust no position or height that no observation needs, as gama-local does; one note names all of them.

    A coordinate of ``point`` and ``vec`` that is not given needs nothing.
    """
    needed = set[tuple[str, str]]()
    for observation in (one for cluster in clusters for one in cluster.observations):
        parts: set[str] = set(KINDS[observation.kind].parts)
        if observation.kind in ("point", "vec"):
            given = [value is not None for value in observation.values]
            parts = {part for part, there in (("xy", any(given[:2])), ("z", given[2])) if there}
        needed |= {(name, part) for name in observation.names for part in parts}
    left_out = []
    for point in points.values():
        for part in POINT_PARTS:
            if part in point.adjusted - point.fixed and (point.name, part) not in needed:
                point.adjusted.discard(part)
                point.constrained.discard(part)
                left_out.append((point, part))
    if left_out:
        names = ", ".join(f"{point.name} {part}" for point, part in left_out[:5])
        more = " …" if len(left_out) > 5 else ""
        draft.note(f"not adjusted, because nothing observes it: {names}{more}", left_out[0][0].line)


# ---- GNU Gama's names and units of observation components.

GON = np.pi / 200.0
CC = GON / 1e4
"""Radians per gon and per cc; the σ of lengths are mm."""


class ElementPart(NamedTuple):
    """Element, attribute, and value in face one (internal units) of a component."""

    element: str
    attribute: str
    value: Callable[[FloatArray, FloatArray], FloatArray]
    """Of observed values (n,) and faces (n,)."""


def _same(value: FloatArray, face: FloatArray) -> FloatArray:
    return value


def _from_horizon(value: FloatArray, face: FloatArray) -> FloatArray:
    return np.pi / 2 - value


PARTS: dict[str, tuple[ElementPart, ...]] = {
    "horizontal_distance": (ElementPart("distance", "val", _same),),
    "distance": (ElementPart("s-distance", "val", _same),),
    "directions": (ElementPart("direction", "val", circle_in_face_one),),
    "zenith_directions": (
        ElementPart("direction", "val", circle_in_face_one),
        ElementPart("z-angle", "val", zenith_in_face_one),
    ),
    "angle": (ElementPart("angle", "val", _same),),
    "bearing": (ElementPart("azimuth", "val", _same),),
    "zenith_angle": (ElementPart("z-angle", "val", zenith_in_face_one),),
    "vertical_direction": (ElementPart("z-angle", "val", _from_horizon),),
    "height_difference": (ElementPart("dh", "val", _same),),
    "vector": tuple(ElementPart("vec", name, _same) for name in ("dx", "dy", "dz")),
    "coordinates": tuple(ElementPart("point", name, _same) for name in "xyz"),
}
"""Types that GNU Gama has, with their components in order."""
NAMES = {"angle": {"at": "from", "from": "bs", "to": "fs"}, "coordinates": {"point": "id"}}
"""Attributes of references that are not called as here."""


# ---- Observations of a GNU Gama file that miss the given coordinates by more than ``tol-abs``: they are not used.
#
# Distances, height differences, vectors and coordinates are compared directly, slope distances with the
# distance of the marks. Misclosures of directions and azimuths are multiplied by the horizontal distance, of
# zenith angles by the slope distance, of angles by the distance to the first target (``bs``), whatever the
# second.
#
# GNU Gama asks twice (``LocalNetwork::test_abs_term``). If no observation misses by more than the tolerance,
# all are used. Otherwise it compares again, and by then the misclosures of angles are divided by their
# standard deviations in units of the a-priori one, and decorrelated: an angle with a large standard deviation
# stays although it misses by more than the tolerance. If a point has no coordinates there is nothing to
# compare with.


def within_tolerance(
    clusters: list[GamaCluster],
    points: dict[str, GamaPoint],
    x_axis: float,
    y_sign: float,
    tolerance: float,
    sigma_apriori: float,
    draft: Draft,
) -> list[GamaCluster]:
    """Clusters without observations that are further than ``tolerance`` (m) from the given coordinates.

    ``x_axis`` is the angle (rad) that azimuths, which count from north, lack to count from the x axis.
    """
    places = {name: point.place * np.array([1.0, y_sign, 1.0]) for name, point in points.items()}
    terms = []
    for cluster in clusters:
        orientations = _orientations(cluster, places)
        terms.append([_term(o, places, orientations, x_axis, y_sign) for o in cluster.observations])
    raw = [term.missed(term.closures) for found in terms for term in found]
    if not any(missed > tolerance for missed in raw):
        return clusters
    result = []
    for cluster, found in zip(clusters, terms, strict=True):
        scaled = _decorrelated(cluster, found, sigma_apriori)
        kept: list[GamaObservation | None] = []
        first = 0
        for observation, term in zip(cluster.observations, found, strict=True):
            end = first + len(term.closures)
            missed = term.missed(scaled[first:end] if observation.kind in ANGULAR else term.closures)
            first = end
            gross = bool(missed > tolerance)
            kept.append(None if gross else observation)
            if gross:
                plain = term.missed(term.closures)
                weighted = "" if plain == missed else f" ({missed:.3f} m with its weight)"
                draft.note(
                    f"<{observation.kind}> not used: it misses the given coordinates by {plain:.3f} m{weighted}, "
                    f"more than tol-abs = {tolerance:g} m",
                    observation.line,
                )
        result.append(cluster.keep(kept))
    return result


class _Term(NamedTuple):
    """Observed minus computed values of an observation (mm, cc), and the distance that angles are multiplied by."""

    closures: FloatArray
    distance: float = 0.0

    def missed(self, closures: FloatArray) -> float:
        """Metres at the target; 0 if coordinates are missing."""
        known = np.abs(closures[np.isfinite(closures)])
        unit = self.distance * CC if self.distance else 1e-3
        return float(np.max(known, initial=0.0) * unit)


def _decorrelated(cluster: GamaCluster, terms: list[_Term], sigma_apriori: float) -> FloatArray:
    """Misclosures of a cluster divided by the Cholesky factor of its cofactor matrix."""
    closures = np.nan_to_num(np.concatenate([term.closures for term in terms] or [np.zeros(0)]))
    scale = np.concatenate(
        [
            np.full(len(term.closures), 1.0 / 0.324 if o.unit == "dms" else 1.0)
            for o, term in zip(cluster.observations, terms, strict=True)
        ]
        or [np.zeros(0)]
    )
    if cluster.covariance is None:
        sigma = [float(o.sigma) if o.sigma else np.nan for o in cluster.observations for _ in range(o.entries)]
        known = np.nan_to_num(np.array(sigma, dtype=float), nan=sigma_apriori)
        return np.asarray(closures / (known * scale) * sigma_apriori, dtype=float)
    cofactors = cluster.covariance * np.outer(scale, scale) / sigma_apriori**2
    try:
        return np.asarray(np.linalg.solve(np.linalg.cholesky(cofactors), closures), dtype=float)
    except np.linalg.LinAlgError:
        return np.asarray(closures, dtype=float)


def _value(observation: GamaObservation) -> float:
    text = observation.values[0] or "nan"
    if observation.unit == "dms":
        return parse_dms(text) * ANGLE_UNITS["dms"]
    return float(text) * (ANGLE_UNITS["gon"] if observation.unit == "gon" else 1.0)


def _bearing(start: FloatArray, end: FloatArray) -> float:
    return float(np.arctan2(end[1] - start[1], end[0] - start[0]))


def _orientations(cluster: GamaCluster, places: dict[str, FloatArray]) -> dict[str, float]:
    """Orientation of each direction set: of those its directions imply, the one the others are closest to."""
    implied: dict[str, list[float]] = {}
    for observation in cluster.observations:
        if observation.kind == "direction":
            start, end = (places[name] for name in observation.names)
            orientation = _bearing(start, end) - _value(observation)
            if np.isfinite(orientation):
                implied.setdefault(observation.names[0], []).append(orientation)
    result = {}
    for name, orientations in implied.items():
        differences = np.abs(wrap(np.subtract.outer(np.array(orientations), np.array(orientations))))
        result[name] = orientations[int(np.argmin(differences.sum(axis=1)))]
    return result


def _term(
    observation: GamaObservation,
    places: dict[str, FloatArray],
    orientations: dict[str, float],
    x_axis: float,
    y_sign: float,
) -> _Term:
    """Observed minus computed; NaN if coordinates are missing."""
    ends = [places[name] for name in observation.names]
    if observation.kind in ("point", "vec"):
        computed = ends[0] if observation.kind == "point" else ends[1] - ends[0]
        observed = np.array([np.nan if v is None else float(v) for v in observation.values])
        there = np.array([v is not None for v in observation.values])
        return _Term(((observed - computed * np.array([1.0, y_sign, 1.0])) * 1e3)[there])
    vector = ends[1] - ends[0]
    horizontal = float(np.hypot(vector[0], vector[1]))
    slope = float(np.hypot(horizontal, vector[2]))
    value = _value(observation)
    lengths = {"dh": vector[2], "distance": horizontal, "s-distance": slope}
    if observation.kind in lengths:
        return _Term(np.array([(value - lengths[observation.kind]) * 1e3]))
    if observation.kind == "z-angle":
        rise = vector[2] + float(observation.heights[1] or 0.0) - float(observation.heights[0] or 0.0)
        zenith = value if value <= np.pi else 2.0 * np.pi - value
        return _Term(np.array([zenith - np.arctan2(horizontal, rise)]) / CC, slope)
    bearing = _bearing(ends[0], ends[1])
    if observation.kind == "angle":
        computed_angle = _bearing(ends[0], ends[2]) - bearing
    elif observation.kind == "azimuth":
        computed_angle = bearing - x_axis
    else:
        computed_angle = bearing - orientations.get(observation.names[0], np.nan)
    return _Term(wrap(np.array([value - computed_angle])) / CC, horizontal)


# ---- GNU Gama XML input (``.gkf``) as a project.
#
# The physical meaning of ``axes-xy`` and ``angles`` is that of a project's axes, in all sixteen combinations:
# coordinates and results stay those of the file. Weights depend on ratios of σ only, so ``sigma-apr`` is the
# σ0 of the report.


def read_gkf(path: Path) -> Document:
    """The project a GNU Gama XML file describes. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    root = parse_xml(read_bytes(path, PROJECT), draft.file)
    if root.name != "gama-local":
        raise InputError([Message(f"found <{root.name}>, expected <gama-local>", draft.file, root.line)])
    check(root, draft)
    bodies = [body for network in root.all("network") for body in network.all("points-observations")]
    if len(bodies) != 1:
        draft.problem(f"found {len(bodies)} times <points-observations>, expected it once", root.line)
    if draft.problems:
        draft.finish()
    network = next(network for network in root.all("network") if network.all("points-observations"))
    _read_network(network, bodies[0], draft)
    return draft.finish()


def _read_network(network: Element, body: Element, draft: Draft) -> None:
    parameters = {key: value for part in network.all("parameters") for key, value in part.attributes.items()}
    axes, angles = (network.attributes.get("axes-xy", "ne").strip(), network.attributes.get("angles", "left-handed"))
    left = angles.strip() == "left-handed"
    sigma_apriori = float(parameters.get("sigma-apr", "10"))
    points = read_points(body, draft)
    clusters = read_clusters(body, sigma_apriori, draft)
    if clusters and not points:
        draft.problem("no points are given: each one needs <point id=…> with fix=… or adj=…", body.line)
    clusters = without_inactive(clusters, points, draft)
    x_axis = {"e": 300.0, "n": 0.0, "s": 200.0, "w": 100.0}[axes[0]] * (1.0 if left else -1.0) * np.pi / 200.0
    y_sign = 1.0 if left == (axes in ("ne", "sw", "es", "wn")) else -1.0
    tolerance = float(parameters.get("tol-abs", "1000")) / 1000.0
    clusters = within_tolerance(clusters, points, x_axis, y_sign, tolerance, sigma_apriori, draft)
    clusters = without_lonely_directions(clusters, draft)
    leave_out_unobserved(points, clusters, draft)
    if given := [key for key in ("ellipsoid", "latitude") if key in parameters]:
        words = (
            f"{' and '.join(given)}: gama-local reduces directions and zenith angles to the vertical of a central "
            "point with it; here verticals are parallel, and curvature: true in the project models the curvature of "
            "the earth"
        )
        draft.note(words, network.line)
    draft.put("title", _title(network))
    draft.put("units", {"length": "m", "angle": "gon"})
    draft.put("axes", {"xy": axes, "angles": "clockwise" if left else "counterclockwise", "bearings_from": "north"})
    put_points(points, draft)
    _put_observations(clusters, draft)
    # Inner constraints over the constrained coordinates, where there are any.
    carrying = {part: [p.name for p in points.values() if p.carries_datum(part)] for part in POINT_PARTS}
    free = {part: names for part, names in carrying.items() if names}
    if free:
        draft.put("datum", {"free": free})
    draft.put("settings", _settings(parameters, sigma_apriori, dimensions(points)))


def _title(network: Element) -> str:
    words = " ".join(" ".join(part.text for part in network.all("description")).split())
    return words if len(words) <= 200 else f"{words[:199]}…"


def _settings(parameters: dict[str, str], sigma_apriori: float, estimated: str) -> dict[str, Any]:
    level = 1.0 - float(parameters.get("conf-pr", "0.95"))
    return {
        "sigma0": repr(sigma_apriori),
        "dimensions": estimated,
        "sigma": parameters.get("sigma-act", "aposteriori").strip(),
        "global_level": f"{level:.10g}",
    }


def _put_observations(clusters: list[GamaCluster], draft: Draft) -> None:
    """One table for all uncorrelated observations of a kind and unit; one cluster for every covariance matrix."""
    sets: dict[str, int] = {}
    plain: dict[tuple[str, str], list[Row]] = {}
    for number, cluster in enumerate(clusters):
        names = _set_names(cluster, sets)
        tables: dict[tuple[str, str], list[Row]] = {} if cluster.covariance is not None else plain
        order: dict[tuple[str, str], list[int]] = {}
        first = 0
        for observation in cluster.observations:
            key = observation.kind, observation.unit
            set_name = (names[observation.names[0]] or None) if observation.kind == "direction" else None
            cells = [*observation.names, set_name, *observation.values, observation.sigma, *observation.heights]
            tables.setdefault(key, []).append(Row(cells, observation.line))
            order.setdefault(key, []).extend(range(first, first + observation.entries))
            first += observation.entries
        if cluster.covariance is not None:
            _put_correlated(cluster, tables, order, number, draft)
    for (kind, unit), rows in plain.items():
        _put_table(kind, unit, rows, draft)


def _set_names(cluster: GamaCluster, sets: dict[str, int]) -> dict[str, str]:
    """Name of the direction set of each station of a cluster; the first set of a station needs none."""
    stations = dict.fromkeys(o.names[0] for o in cluster.observations if o.kind == "direction")
    names = {}
    for station in stations:
        sets[station] = sets.get(station, 0) + 1
        names[station] = str(sets[station]) if sets[station] > 1 else ""
    return names


def _put_table(kind: str, unit: str, rows: list[Row], draft: Draft, **keys: Any) -> None:
    known = KINDS[kind]
    columns = [column for _, column in known.names]
    columns += ["set", *(column for _, column in known.components), "sigma", "from_height", "to_height"]
    units = {"sigma": "mm"} if kind not in ANGULAR else {"sigma": "arcsec" if unit == "dms" else "cc"}
    if unit == "dms":
        units[known.components[0][1]] = "dms"
    draft.table("observations", columns, rows, type=known.type, units=units, **keys)


def _put_correlated(
    cluster: GamaCluster,
    tables: dict[tuple[str, str], list[Row]],
    order: dict[tuple[str, str], list[int]],
    number: int,
    draft: Draft,
) -> None:
    """Groups of one cluster: the matrix goes with the first, in the order of groups, rows and components."""
    if not tables or cluster.covariance is None:
        return
    entries = [entry for entries in order.values() for entry in entries]
    matrix: list[list[str]] | None = _texts(cluster.covariance[np.ix_(entries, entries)])
    name = f"{cluster.element} {number + 1}" if len(tables) > 1 else None
    for (kind, unit), rows in tables.items():
        _put_table(kind, unit, rows, draft, cluster=name, covariance=matrix)
        matrix = None


def _texts(matrix: Iterable[Iterable[float]]) -> list[list[str]]:
    return [[repr(float(value)) for value in row] for row in matrix]
