"""Observations of a GNU Gama file that miss the coordinates given by more than ``tol-abs``: they are not used.

Distances, height differences, vectors and coordinates are compared directly, directions, azimuths and zenith angles
times their horizontal distance, angles times the longer of their legs (GNU Gama manual, "Gross absolute terms").
Where a point has no coordinates there is nothing to compare with.
"""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.formats.draft import Draft
from mor.formats.gkf.clusters import GamaCluster, GamaObservation
from mor.formats.gkf.points import GamaPoint
from mor.observations import wrap
from mor.units import ANGLE_UNITS, parse_dms


def within_tolerance(
    clusters: list[GamaCluster],
    points: dict[str, GamaPoint],
    x_axis: float,
    y_sign: float,
    tolerance: float,
    draft: Draft,
) -> list[GamaCluster]:
    """Clusters without observations that are further than ``tolerance`` (m) from the given coordinates.

    ``x_axis`` is the angle (rad) that azimuths, which count from north, lack to count from the x axis.
    """
    places = {name: point.place * np.array([1.0, y_sign, 1.0]) for name, point in points.items()}
    result = []
    for cluster in clusters:
        orientations = _orientations(cluster, places)
        kept: list[GamaObservation | None] = []
        for observation in cluster.observations:
            missed = _missed(observation, places, orientations, x_axis, y_sign)
            gross = bool(missed > tolerance)
            kept.append(None if gross else observation)
            if gross:
                words = (
                    f"it misses the given coordinates by {missed:.3f} m, more than tol-abs = {tolerance:g} m"
                )
                draft.note(f"<{observation.kind}> not used: {words}", observation.line)
        result.append(cluster.keep(kept))
    return result


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


def _missed(
    observation: GamaObservation,
    places: dict[str, FloatArray],
    orientations: dict[str, float],
    x_axis: float,
    y_sign: float,
) -> float:
    """Observed minus computed at the target, in metres; NaN where coordinates are missing."""
    ends = [places[name] for name in observation.names]
    if observation.kind in ("point", "vec"):
        computed = ends[0] if observation.kind == "point" else ends[1] - ends[0]
        observed = np.array([np.nan if v is None else float(v) for v in observation.values])
        missed = np.abs(observed * np.array([1.0, y_sign, 1.0]) - computed)
        return float(np.max(missed[np.isfinite(missed)], initial=0.0))
    vector = ends[1] - ends[0]
    horizontal = float(np.hypot(vector[0], vector[1]))
    rise = vector[2] + float(observation.heights[1] or 0.0) - float(observation.heights[0] or 0.0)
    value = _value(observation)
    if observation.kind == "dh":
        return float(abs(value - vector[2]))
    if observation.kind == "distance":
        return abs(value - horizontal)
    if observation.kind == "s-distance":
        return float(abs(value - np.hypot(horizontal, rise)))
    if observation.kind == "z-angle":
        zenith = value if value <= np.pi else 2.0 * np.pi - value
        return float(abs(zenith - np.arctan2(horizontal, rise)) * horizontal)
    bearing = _bearing(ends[0], ends[1])
    if observation.kind == "angle":
        horizontal = max(horizontal, float(np.hypot(*(ends[2] - ends[0])[:2])))
        computed_angle = _bearing(ends[0], ends[2]) - bearing
    elif observation.kind == "azimuth":
        computed_angle = bearing - x_axis
    else:
        computed_angle = bearing - orientations.get(observation.names[0], np.nan)
    return float(np.abs(wrap(np.array(value - computed_angle))) * horizontal)
