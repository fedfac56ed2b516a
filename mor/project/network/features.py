"""Planes, lines and right angles: local systems whose coordinates are observed as zero (MOR 1.5)."""

from __future__ import annotations

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import Problem
from mor.geometry.rotations import angles_from_rotation, rotate
from mor.observations import ObservationGroup
from mor.observations.names import names_of, one_name
from mor.project.edge import UnitError
from mor.project.file.model import Feature
from mor.project.network.entities import unknown_name
from mor.project.network.reading import Reading
from mor.units import LENGTH

NEEDED = {"plane": 4, "line": 3, "right angle": 3}
"""Points from which on a feature says something about the object."""
_TURNS = 5
_BESIDE = 0.01
"""Distance from a line, in parts of the extent, from which on a point is beside it."""


def feature_groups(reading: Reading) -> list[ObservationGroup]:
    """One group of observed local coordinates for every feature."""
    groups = []
    for number, feature in enumerate(reading.project.features):
        group = _feature_group(reading, feature, number)
        groups += [group] if group is not None else []
    return groups


def feature_label(feature: Feature) -> str:
    """Name of the blocks and of the observation group of a feature."""
    return f"{feature.type} {feature.id}"


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

    The two residuals of a point on a line are components in axes that turn with the system. Were its turn about
    the line fixed in space, a free network could no longer turn about the line without changing them; so a point
    beside the line carries the turn: its ȳ, observed as zero, which nothing else controls (r = 0).
    """
    coordinates = reading.shop.store("point").all_values()
    D, centre = _start(coordinates, first, other, feature.type)
    members, names = np.concatenate([first, other]), [*feature.points, *feature.other]
    offsets, turns = _freedom(feature.type)
    observed = np.full((len(members), 3), np.nan)
    if feature.type == "line":
        observed[:, :2] = 0.0
        beside = _point_beside(reading, coordinates, feature, D, centre)
        if beside:
            block = reading.shop.things["point"].part(beside, "position")
            turns = np.ones_like(turns)
            if np.isfinite(coordinates[block]).all():
                D = turned_towards(coordinates[block] - centre, D)
            members, names = np.append(members, block), [*names, beside]
            observed = np.append(observed, [[np.nan, 0.0, np.nan]], axis=0)
    else:
        observed[: len(first), 2] = 0.0
        observed[len(first) :, 0] = 0.0
    label = feature_label(feature)
    system = _add_system(reading, label, centre, D, turns, offsets)
    count = len(members)
    return ObservationGroup(
        name=label,
        type=reading.types["local"],
        blocks=(*(np.full(count, block) for block in system), members),
        observed=observed,
        sigma=np.where(np.isfinite(observed), sigma, np.nan),
        constants=np.zeros((count, 0)),
        references=(one_name(label, count), names_of(names)),
    )


def _add_system(
    reading: Reading, label: str, centre: FloatArray, D: FloatArray, turns: BoolArray, offsets: BoolArray
) -> tuple[int, int, int, int]:
    """Position, rotation, scale and offset blocks of the system of a feature."""
    shop, none = reading.shop, np.full((1, 3), np.nan)
    position = shop.store("point").add_fixed(label, centre.tolist())
    rotation = int(shop.store("rotation").add([label], angles_from_rotation(D)[None], turns, none)[0])
    shop.store("rotation").about_axes.add(rotation)
    offset = int(shop.store("eccentricity").add([label], np.zeros((1, 3)), offsets, none)[0])
    return position, rotation, 0, offset


def _point_beside(
    reading: Reading, coordinates: FloatArray, line: Feature, D: FloatArray, centre: FloatArray
) -> str:
    """Name of the point that carries the turn of a line; empty if all points are on it.

    While coordinates are missing any point may be: :mod:`mor.approximate.parts.lines` knows better when there are some.
    """
    points = reading.shop.things["point"]
    positions = points.parts["position"]
    farthest = farthest_from_line(coordinates[positions], D, centre)
    if farthest >= 0:
        return points.ids[farthest]
    unknown = np.flatnonzero(~np.isfinite(coordinates[positions].sum(axis=1)))
    return next((points.ids[k] for k in unknown.tolist() if points.ids[k] not in line.points), "")


def farthest_from_line(coordinates: FloatArray, D: FloatArray, centre: FloatArray) -> int:
    """Number of the point (n, 3) farthest from a line (z axis of D through the centre); -1 where all are on it."""
    local = np.nan_to_num((coordinates - centre) @ D.T)
    away = np.hypot(local[:, 0], local[:, 1])
    farthest = int(np.argmax(away))
    return farthest if away[farthest] > _BESIDE * np.abs(local).max() else -1


def turned_towards(direction: FloatArray, D: FloatArray) -> FloatArray:
    """Rotation with the z axis of D whose x axis points to the side of a direction."""
    across = direction - D[2] * (D[2] @ direction)
    x = across / np.linalg.norm(across)
    return np.stack([x, np.cross(D[2], x), D[2]])


def _freedom(type_: str) -> tuple[BoolArray, BoolArray]:
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
    axes = _upright(np.linalg.svd(points - centre)[2])
    if type_ == "line":
        return np.stack([axes[1], np.cross(axes[0], axes[1]), axes[0]]), centre
    normal = axes[2]
    second = coordinates[other]
    second = second[np.isfinite(second).all(axis=1)]
    if type_ == "plane" or len(second) < 2:
        return np.stack([axes[0], np.cross(normal, axes[0]), normal]), centre
    x = _second_normal(second, normal)
    return _right_angle(np.stack([x, np.cross(normal, x), normal]), points, second), centre


def _right_angle(D: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Rotation whose z plane fits the first points best and at once its x plane the second (Gauss-Newton)."""
    one, other = first - first.mean(axis=0), second - second.mean(axis=0)
    for _ in range(_TURNS):
        q, p = one @ D.T, other @ D.T
        by_z = np.stack([-q[:, 1], q[:, 0], np.zeros(len(q))], axis=1)
        by_x = np.stack([np.zeros(len(p)), -p[:, 2], p[:, 1]], axis=1)
        away = np.concatenate([q[:, 2], p[:, 0]])
        turn, *_ = np.linalg.lstsq(np.concatenate([by_z, by_x]), -away, rcond=None)
        D = rotate(D[None], turn[None])[0]
    return D


def _second_normal(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Unit vector perpendicular to ``normal`` along which points (n, 3) spread least."""
    spread = points - points.mean(axis=0)
    flat = spread - np.outer(spread @ normal, normal)
    _, _, axes = np.linalg.svd(flat)
    along = axes[0] - normal * (axes[0] @ normal)
    x = np.cross(along, normal)
    unit: FloatArray = _upright((x / np.linalg.norm(x))[None])[0]
    return unit


def _upright(directions: FloatArray) -> FloatArray:
    """Directions (n, 3), each or its opposite, so that the largest component is positive: signs are nobody's choice."""
    largest = np.take_along_axis(directions, np.argmax(np.abs(directions), axis=1)[:, None], axis=1)
    upright: FloatArray = directions * np.sign(largest)
    return upright
