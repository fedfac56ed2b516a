"""Observations of a GNU Gama file that miss the given coordinates by more than ``tol-abs``: they are not used.

Distances, height differences, vectors and coordinates are compared directly, slope distances with the distance of the
marks. Misclosures of directions and azimuths are multiplied by the horizontal distance, of zenith angles by the slope
distance, of angles by the distance to the first target (``bs``), whatever the second.

GNU Gama asks twice (``LocalNetwork::test_abs_term``). If no observation misses by more than the tolerance, all are
used. Otherwise it compares again, and by then the misclosures of angles are divided by their standard deviations in
units of the a-priori one, and decorrelated: an angle with a large standard deviation stays although it misses by more
than the tolerance. If a point has no coordinates there is nothing to compare with.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.formats.draft import Draft
from mor.formats.gkf.clusters import ANGULAR, GamaCluster, GamaObservation
from mor.formats.gkf.observed import CC
from mor.formats.gkf.points import GamaPoint
from mor.observations import wrap
from mor.units import ANGLE_UNITS, parse_dms


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
        sigma = [
            float(o.sigma) if o.sigma else np.nan for o in cluster.observations for _ in range(o.entries)
        ]
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
