"""Observations of a GNU Gama file: what was measured, with which σ or covariances, and what is left out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.formats.draft import Draft, number
from mor.formats.gkf.grammar import carried, is_dms
from mor.formats.gkf.points import GamaPoint
from mor.formats.xml import Element


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
        "directions",
        (("from", "station"), ("to", "to")),
        (("val", "horizontal"),),
        ("xy",),
        "direction-stdev",
    ),
    "angle": GamaKind(
        "angle", (("from", "at"), ("bs", "from"), ("fs", "to")), (("val", "angle"),), ("xy",), "angle-stdev"
    ),
    "z-angle": GamaKind(
        "zenith_angle", _FROM_TO, (("val", "zenith_angle"),), ("xy", "z"), "zenith-angle-stdev", True
    ),
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
    line: int

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
        clusters.append(GamaCluster(element.name, good, covariance, element.line))
    return clusters


def _observation(
    element: Element, cluster: Element, root: Element, sigma_apriori: float, draft: Draft
) -> GamaObservation | None:
    kind = KINDS[element.name]
    given = {
        **{k: v for k, v in cluster.attributes.items() if k in ("from", "from_dh")},
        **element.attributes,
    }
    missing = [attribute for attribute, _ in kind.names if attribute not in given]
    if missing:
        draft.problem(
            f"<{element.name}>: {missing[0]!r} is given neither here nor in <{cluster.name}>", element.line
        )
        return None
    names = tuple(given[attribute].strip() for attribute, _ in kind.names)
    if len(set(names)) < len(names):
        draft.problem(
            f"<{element.name}>: {names[0]!r} is given twice; different points are needed", element.line
        )
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


def _sigma(
    element: Element, given: dict[str, str], kind: GamaKind, root: Element, sigma_apriori: float
) -> str | None:
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
        words = (
            f"found {len(matrices)} matrices" if len(matrices) > 1 else f"dim = {size}, but {entries} values"
        )
        draft.problem(f"<cov-mat>: {words} in <{element.name}>", matrix.line)
        return None
    rows, columns = np.nonzero(np.triu(np.ones((size, size))) - np.triu(np.ones((size, size)), band + 1))
    try:
        values = [number(part) for part in matrix.text.split()]
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


def without_inactive(
    clusters: list[GamaCluster], points: dict[str, GamaPoint], draft: Draft
) -> list[GamaCluster]:
    """Clusters without what refers to points, or components of points, that take no part."""
    result = []
    for cluster in clusters:
        kept = [_active(observation, points, draft) for observation in cluster.observations]
        result.append(cluster.keep(kept))
    return result


def _active(
    observation: GamaObservation, points: dict[str, GamaPoint], draft: Draft
) -> GamaObservation | None:
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
