"""Planes, lines and right angles: local systems whose coordinates are observed as zero (MOR 1.5)."""

from __future__ import annotations

import numpy as np

from mor.errors import Problem
from mor.geometry.arrays import FloatArray, IntArray
from mor.geometry.rotations import angles_from_rotation
from mor.observations import PLAIN_TYPES, ObservationGroup
from mor.project.edge import UnitError
from mor.project.entities import unknown_name
from mor.project.model import Feature
from mor.project.reading import Reading
from mor.units import LENGTH

NEEDED = {"plane": 4, "line": 3, "right angle": 3}
"""Points from which on a feature says something about the object."""


def feature_groups(reading: Reading) -> list[ObservationGroup]:
    """One group of observed local coordinates for every feature."""
    groups = []
    for number, feature in enumerate(reading.project.features):
        group = _feature_group(reading, feature, number)
        groups += [group] if group is not None else []
    return groups


def _feature_group(reading: Reading, feature: Feature, number: int) -> ObservationGroup | None:
    place = reading.at("features", number)
    points = reading.shop.things["point"]
    problems: list[Problem] = []
    for name in (*feature.points, *feature.other):
        if name not in points.numbers:
            problems.append(place.problem(unknown_name("point", name, points.ids), "points"))
    needed = NEEDED[feature.type]
    if len(set(feature.points)) < needed:
        words = (
            f"a {feature.type} says nothing with {len(set(feature.points))} points; it needs {needed} or more"
        )
        problems.append(place.problem(words, "points"))
    if (feature.type == "right angle") != bool(feature.other):
        problems.append(
            place.problem("other: the points on the second plane belong to a right angle, which needs them")
        )
    try:
        sigma = reading.edge.number(feature.sigma, LENGTH)
        if sigma <= 0.0:
            problems.append(place.problem("sigma: expected a σ > 0", "sigma"))
    except UnitError as error:
        problems.append(place.problem(f"sigma: {error}", "sigma"))
    reading.problems.extend(problems)
    if problems:
        return None
    first = np.array([points.part(name, "position") for name in feature.points], dtype=np.int64)
    other = np.array([points.part(name, "position") for name in feature.other], dtype=np.int64)
    return _observed_zero(reading, feature, first, other, sigma)


def _observed_zero(
    reading: Reading, feature: Feature, first: IntArray, other: IntArray, sigma: float
) -> ObservationGroup:
    """The local system of a feature, and zeros for the coordinates its points have in it.

    Plane: z̄ = 0; line: x̄ = ȳ = 0; right angle: z̄ = 0 for the first plane, x̄ = 0 for the second. The offsets of the
    observed coordinates and the turns that move them are free, all else is fixed.
    """
    coordinates = reading.shop.store("point").all_values()
    D, centre = _start(coordinates, first, other, feature.type)
    observed = np.full((len(first) + len(other), 3), np.nan)
    offsets, turns = _freedom(feature.type)
    if feature.type == "line":
        observed[:, :2] = 0.0
    else:
        observed[: len(first), 2] = 0.0
        observed[len(first) :, 0] = 0.0
    label = f"{feature.type} {feature.id}"
    shop = reading.shop
    none = np.full((1, 3), np.nan)
    position = shop.store("point").add_fixed(label, centre.tolist())
    rotation = int(shop.store("rotation").add([label], angles_from_rotation(D)[None], turns, none)[0])
    shop.store("rotation").about_axes.add(rotation)
    offset = int(shop.store("eccentricity").add([label], np.zeros((1, 3)), offsets, none)[0])
    count = len(observed)
    return ObservationGroup(
        name=label,
        type=PLAIN_TYPES["local"],
        blocks=(
            np.full(count, position),
            np.full(count, rotation),
            np.zeros(count, dtype=np.int64),
            np.full(count, offset),
            np.concatenate([first, other]),
        ),
        observed=observed,
        sigma=np.where(np.isfinite(observed), sigma, np.nan),
        constants=np.zeros((count, 0)),
        references=((label,) * count, (*feature.points, *feature.other)),
    )


def _freedom(type_: str) -> tuple[FloatArray, FloatArray]:
    """(1, 3) free offsets and free turns about the axes of the system."""
    offsets, turns = {
        "plane": ([False, False, True], [True, True, False]),
        "line": ([True, True, False], [True, True, False]),
        "right angle": ([True, False, True], [True, True, True]),
    }[type_]
    return np.array([offsets]), np.array([turns])


def _start(
    coordinates: FloatArray, first: IntArray, other: IntArray, type_: str
) -> tuple[FloatArray, FloatArray]:
    """Rotation and origin fitted to the start coordinates of the points."""
    points = coordinates[first]
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3:
        return np.eye(3), np.zeros(3)
    centre = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - centre)
    if type_ == "line":
        return np.stack([axes[1], np.cross(axes[0], axes[1]), axes[0]]), centre
    normal = axes[2]
    second = coordinates[other]
    second = second[np.isfinite(second).all(axis=1)]
    if type_ == "plane" or len(second) < 2:
        return np.stack([axes[0], np.cross(normal, axes[0]), normal]), centre
    x = _second_normal(second, normal)
    return np.stack([x, np.cross(normal, x), normal]), centre


def _second_normal(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Unit vector perpendicular to ``normal`` along which points (n, 3) spread least."""
    spread = points - points.mean(axis=0)
    flat = spread - np.outer(spread @ normal, normal)
    _, _, axes = np.linalg.svd(flat)
    along = axes[0] - normal * (axes[0] @ normal)
    x = np.cross(along, normal)
    unit: FloatArray = x / np.linalg.norm(x)
    return unit
