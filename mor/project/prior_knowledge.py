"""Prior knowledge: observed parameters, features, equal parameters."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.errors import Message, counted, nearest
from mor.model.contract import ObservationGroup, names_of, one_name
from mor.model.coordinates import OBSERVED_DIFFERENCES, OBSERVED_PARAMETERS
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import INTERIORS, KINDS, MOTIONS, SHAPE, BlockKind
from mor.model.rotations import angles_from_rotation, rotate, rotation_from_angles
from mor.model.shapes import PERPENDICULAR, PERPENDICULAR_TURNS, PERPENDICULAR_TYPES, RELATION_TYPES, SHAPE_TYPES
from mor.project.axes import SMALLEST_SIGMA, ImageScale, UnitError
from mor.project.entities import (
    BlockStore,
    ContradictionError,
    Equality,
    Reading,
    entities,
    said_thing,
    settle_equalities,
    table_label,
    unknown_name,
)
from mor.project.rows import ReadGroup, group_name, without_required
from mor.project.schema import Feature, Observations
from mor.project.shapes import FREEDOM, FittedShape, Held, fit_shape
from mor.project.tables import MOST_TOLD, Column, Rows, TableLocation, read_table, settings
from mor.types import LARGEST, BoolArray, FloatArray, IntArray
from mor.units import ANGLE, LENGTH

# ---- Prior knowledge that stands with the things themselves: observed components, levels, image-variant interiors.


def prior_groups(reading: Reading) -> list[ObservationGroup]:
    """Groups of observed parameters, called as the table (or camera, or instrument) that has their values and σ.

    One for every table and kind of block, in the order of the tables.
    """
    groups: list[tuple[int, ObservationGroup]] = []
    for kind, store in reading.shop.stores.items():
        sigma = store.all_sigma()
        rows = np.flatnonzero(np.isfinite(sigma).any(axis=1)) if len(sigma) else np.zeros(0, dtype=np.int64)
        source = reading.shop.source(kind)[rows]
        for number in np.unique(source).tolist():
            table = reading.shop.sources[number][0]
            groups.append((number, _prior_group(reading, store, rows[source == number], table)))
    return [group for _, group in sorted(groups, key=lambda numbered: numbered[0])]


def _prior_group(reading: Reading, store: BlockStore, rows: IntArray, table: str) -> ObservationGroup:
    """Observed parameters of the blocks (n,) of one kind that a table, or a camera, declares."""
    values, sigma = store.all_values()[rows], store.all_sigma()[rows]
    camera = store.ids[int(rows[0])]
    return ObservationGroup(
        name=table,
        type=OBSERVED_PARAMETERS[store.kind.key],
        blocks=(rows,),
        observed=np.where(np.isfinite(sigma), values, np.nan),
        sigma=sigma,
        constants=np.zeros((len(rows), 0)),
        references=(names_of([said_thing(store.kind.key, store.ids[row]) for row in rows]),),
        image_unit=reading.scales[camera].unit if camera in reading.scales else "mm",
    )


def level_groups(reading: Reading) -> list[ObservationGroup]:
    """Levels observed as zero tilt, in instrument axes, for the stations whose level has a σ."""
    stations = reading.shop.things["station"]
    groups = []
    for number, table in enumerate(reading.project.stations):
        if table.level in ("fixed", "free"):
            continue
        place = reading.at("stations", number)
        try:
            sigma = reading.edge.number(table.level, ANGLE)
        except UnitError as error:
            place.tell(str(error), "level")
            continue
        if sigma <= 0.0:
            place.tell("level: expected a σ > 0, or fixed", "level")
            continue
        names = [n for n in reading.table_ids.get(("stations", number), []) if n not in reading.unoriented]
        if not names:
            continue
        rows = np.array([stations.part(name, "rotation") for name in names], dtype=np.int64)
        groups.append(
            ObservationGroup(
                name=table_label("stations", number, table),
                type=PLAIN_TYPES["level"],
                blocks=(rows,),
                observed=np.zeros((len(rows), 2)),
                sigma=np.full((len(rows), 2), sigma),
                constants=np.zeros((len(rows), 0)),
                references=(names_of(names),),
            )
        )
    return groups


def variant_groups(reading: Reading, variants: dict[str, dict[int, float]]) -> list[ObservationGroup]:
    """Differences of image-variant components from their camera's, observed as zero if they have a σ."""
    groups = []
    cameras, images = reading.shop.things["camera"], reading.shop.things["image"]
    for number, name in enumerate(cameras.ids):
        sigmas = {k: s for k, s in variants.get(name, {}).items() if np.isfinite(s)}
        if not sigmas:
            continue
        kind = INTERIORS[reading.project.cameras[name].model]
        mine = np.flatnonzero(images.parts["camera"] == number)
        observed = np.full((len(mine), kind.size), np.nan)
        sigma = np.full((len(mine), kind.size), np.nan)
        for component, value in sigmas.items():
            observed[:, component], sigma[:, component] = 0.0, value
        shared = np.full(len(mine), cameras.parts["interior"][number])
        groups.append(
            ObservationGroup(
                name=f"image-variant interior of camera {name}",
                type=OBSERVED_DIFFERENCES[kind.key],
                blocks=(shared, images.parts["interior"][mine]),
                observed=observed,
                sigma=sigma,
                constants=np.zeros((len(mine), 0)),
                references=(one_name(f"camera {name}", len(mine)), names_of([f"image {images.ids[i]}" for i in mine])),
                image_unit=reading.scales[name].unit,
            )
        )
    return groups


# ---- Planes, lines and right angles: local systems whose coordinates are observed as zero (MOR 1.5).


class _System(NamedTuple):
    """The local system of a feature that was read: blocks of position, rotation and offset."""

    type: str
    position: int
    rotation: int
    offset: int
    shape: int = -1
    turn: int = -1
    """Block of E where the rotation is E D_A of another feature."""


RELATIONS: dict[str, tuple[int, ...]] = {"parallel": (), "perpendicular": (), "coaxial": (0, 1), "coplanar": (2,)}
"""Exact relations, and components of the offset that two features then share."""


def feature_groups(reading: Reading) -> list[ObservationGroup]:
    """One group of observed local coordinates, or distances from a shape, for every feature."""
    groups: list[ObservationGroup] = []
    systems: dict[str, _System] = {}
    for number, feature in enumerate(reading.project.features):
        group = _feature_group(reading, feature, number, systems)
        groups += [group] if group is not None else []
    if len(systems) < len(reading.project.features):
        reading.broken.add("feature")
    parts = {
        part: np.array([getattr(system, field) for system in systems.values()], dtype=np.int64)
        for part, field in (
            (SHAPE.key, "shape"),
            *((name, name) for name in ("position", "rotation", "offset", "turn")),
        )
    }
    if any(entry.type in RELATION_TYPES for entry in reading.project.observations):
        parts["turn"][parts["turn"] < 0] = reading.shop.neutral("rotation")
    reading.shop.things["feature"] = entities(systems, parts)
    return groups


def refuse_axes_of_spheres(reading: Reading, groups: Iterable[ReadGroup]) -> None:
    """Report observed axes of features that have none."""
    spheres = {feature.id for feature in reading.project.features if feature.type == "sphere"}
    for read in groups:
        if read.group.type.key != "axis":
            continue
        for name in sorted(spheres & {name for names in read.group.references for name in names}):
            problem = reading.at("observations", read.entry).problem(f"axis: the sphere {name!r} has no axis")
            reading.problems.append(problem)


def _relation(feature: Feature) -> tuple[str, str]:
    """The exact relation of a feature, and the name of the other one; empty if it has none."""
    return next(((key, name) for key in RELATIONS if (name := getattr(feature, key)) is not None), ("", ""))


def feature_label(feature: Feature) -> str:
    """Name of the blocks and of the observation group of a feature."""
    return f"{feature.type} {feature.id}"


def _feature_group(
    reading: Reading, feature: Feature, number: int, systems: dict[str, _System]
) -> ObservationGroup | None:
    place = reading.at("features", number)
    points = reading.shop.things["point"]
    before = len(reading.problems)
    for name in (*feature.points, *feature.other):
        if name not in points.numbers:
            place.tell(unknown_name("point", name, points.ids), "points")
    if feature.id in systems:
        place.tell(f"id: there are two features {feature.id!r}", "id")
    _check_keys(feature, place, systems)
    # Points from which on a feature says something about the object.
    enough = {"plane": 4, "line": 3, "right angle": 3}
    needed = enough[feature.type] if feature.type in enough else _needed(feature)
    if len(set(feature.points)) < needed:
        words = f"a {feature.type} observes nothing with {len(set(feature.points))} points; it needs {needed} or more"
        place.tell(words, "points")
    if (feature.type == "right angle") != bool(feature.other):
        place.tell("other: the points on the second plane belong to a right angle, which needs them")
    try:
        sigma = reading.edge.number(feature.sigma, LENGTH)
        if sigma <= 0.0:
            place.tell("sigma: expected a σ > 0", "sigma")
    except UnitError as error:
        place.tell(f"sigma: {error}", "sigma")
    if len(reading.problems) > before:
        return None
    first = np.array([points.part(name, "position") for name in feature.points], dtype=np.int64)
    other = np.array([points.part(name, "position") for name in feature.other], dtype=np.int64)
    if feature.type in FREEDOM:
        return _on_shape(reading, feature, number, first, sigma, systems)
    return _observed_zero(reading, feature, first, other, sigma, systems)


def _check_keys(feature: Feature, place: TableLocation, systems: dict[str, _System]) -> None:
    """Tell sizes that a feature does not have, and features that its axis cannot come from."""
    free = FREEDOM[feature.type].shape if feature.type in FREEDOM else np.zeros(SHAPE.size, dtype=bool)
    for name, has in zip(SHAPE.names, free.tolist(), strict=True):
        if getattr(feature, name) is not None and not has:
            place.tell(f"{name}: a {feature.type} has none", name)
    given = [key for key in RELATIONS if getattr(feature, key) is not None]
    if len(given) > 1:
        place.tell("give only one of parallel, perpendicular, coaxial and coplanar", given[1])
    round_types = ("circle", "cylinder", "cone", "torus")
    can_have = {
        "parallel": (*round_types, "plane"),
        "perpendicular": round_types,
        "coaxial": (*round_types, "sphere"),
        "coplanar": ("circle", "torus"),
    }
    # Types of features that can have a relation, and of those that it can refer to.
    can_give = {
        "parallel": (*round_types, "plane", "line", "right angle"),
        "perpendicular": (*round_types, "plane", "line", "right angle"),
        "coaxial": (*round_types, "line"),
        "coplanar": ("circle", "torus", "plane", "right angle"),
    }
    for key in given:
        name = getattr(feature, key)
        if feature.type not in can_have[key]:
            place.tell(f"{key}: a {feature.type} cannot have it", key)
        if name not in systems:
            place.tell(f"{key}: no feature {name!r} stands above this one", key)
        elif systems[name].type not in can_give[key]:
            type_ = systems[name].type
            plane = f"{key}: the {type_} {name!r} has no plane"
            axis = f"{key}: the {type_} {name!r} has no axis"
            place.tell(plane if key == "coplanar" else axis, key)
        elif key == "perpendicular" and systems[name].turn >= 0:
            place.tell(f"perpendicular: {name!r} is itself perpendicular to another feature", key)


def _needed(feature: Feature) -> int:
    """Points from which on a shape has redundancy, if all its parameters are its own unknowns."""
    free = FREEDOM[feature.type]
    own = free.unknowns
    key, _ = _relation(feature)
    if key:
        own -= int(np.count_nonzero(free.turns)) - (key == "perpendicular")
        own -= sum(bool(free.offset[k]) for k in RELATIONS[key])
    given = (getattr(feature, name) for name in SHAPE.names)
    own -= sum(isinstance(one, str) or (one is not None and one.free is None) for one in given)
    return own // len(SHAPE_TYPES[feature.type].components) + 1


def _on_shape(
    reading: Reading, feature: Feature, number: int, points: IntArray, sigma: float, systems: dict[str, _System]
) -> ObservationGroup:
    """Distances from a circle, sphere, cylinder, cone or torus, observed as zero.

    Related shapes share the rotation of the local system; coaxial and coplanar ones its origin and some of the offset.
    """
    shop, label, free = reading.shop, feature_label(feature), FREEDOM[feature.type]
    shop.begin(label)
    given = {name: one for name in SHAPE.names if (one := getattr(feature, name)) is not None}
    size = settings(given, SHAPE.components, reading.edge, reading.at("features", number))
    open_ = free.shape & np.array([name not in given for name in SHAPE.names])
    size.values[0, open_], size.free[0, open_] = np.nan, True
    known = np.where(np.isnan(size.start), size.values, size.start)[0]
    key, name = _relation(feature)
    held = _held(reading, key, systems[name]) if key else None
    coordinates = shop.store("point").all_values()[points]
    whole = np.isfinite(coordinates).all()
    fit = fit_shape(feature.type, coordinates, known, held) if whole else None
    unfitted = np.eye(3) if held is None else PERPENDICULAR @ held.rotation if held.perpendicular else held.rotation
    fit = fit or FittedShape(unfitted, np.zeros(3), np.zeros(3), size.values[0])
    unknown = size.free & np.isnan(size.values)
    size.values[unknown] = fit.shape[unknown[0]]
    system = _add_system(reading, feature, systems, fit, free.turns, free.offset)
    block = int(shop.store(SHAPE.key).add([f"feature {feature.id}"], *size)[0])
    systems[feature.id] = system._replace(shape=block)
    type_ = (SHAPE_TYPES if system.turn < 0 else PERPENDICULAR_TYPES)[feature.type]
    turn = (system.turn,) if system.turn >= 0 else ()
    if reading.sphere is not None:
        from mor.model.curvature import on_sphere  # most projects need nothing of it

        type_ = on_sphere(type_, reading.sphere, reading.edge.metres)
    count, components = len(points), len(type_.components)
    return ObservationGroup(
        name=label,
        type=type_,
        blocks=(
            *(np.full(count, one) for one in (*system[1:4], block)),
            points,
            *(np.full(count, one) for one in turn),
        ),
        observed=np.zeros((count, components)),
        sigma=np.full((count, components), sigma),
        constants=np.zeros((count, 0)),
        references=(one_name(label, count), names_of(feature.points)),
    )


def _observed_zero(
    reading: Reading, feature: Feature, first: IntArray, other: IntArray, sigma: float, systems: dict[str, _System]
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
    fit = FittedShape(D, centre, np.zeros(3), np.zeros(3))
    systems[feature.id] = system = _add_system(reading, feature, systems, fit, turns, offsets)
    count = len(members)
    return ObservationGroup(
        name=label,
        type=reading.types["local"],
        blocks=(*(np.full(count, one) for one in (system.position, system.rotation, 0, system.offset)), members),
        observed=observed,
        sigma=np.where(np.isfinite(observed), sigma, np.nan),
        constants=np.zeros((count, 0)),
        references=(one_name(label, count), names_of(names)),
    )


def _add_system(
    reading: Reading,
    feature: Feature,
    systems: dict[str, _System],
    fit: FittedShape,
    turns: BoolArray,
    offsets: BoolArray,
) -> _System:
    """The local system of a feature, with the blocks that it shares with a related one."""
    shop, none, label = reading.shop, np.full((1, 3), np.nan), feature_label(feature)
    key, name = _relation(feature)
    other, components = systems.get(name), RELATIONS.get(key, ())
    rotations = shop.store("rotation")

    def add_rotation(D: FloatArray, free: BoolArray) -> int:
        block = int(rotations.add([label], angles_from_rotation(D)[None], free[None], none)[0])
        rotations.about_axes.add(block)
        return block

    turn = other.turn if other is not None else -1
    if other is None:
        rotation = add_rotation(fit.rotation, turns)
    else:
        rotation = other.rotation
        if key == "perpendicular":
            D = rotation_from_angles(rotations.all_values()[rotation][None])[0]
            turn = add_rotation(fit.rotation @ D.T, np.array(PERPENDICULAR_TURNS))
    store = shop.store("eccentricity")
    start = fit.offset[None].copy()
    if other is not None and components:
        position = other.position
        start[0] += np.where(_shared(components), store.all_values()[other.offset], 0.0)
    else:
        position = shop.store("point").add_fixed(label, fit.origin.tolist())
    offset = int(store.add([label], start, offsets[None].copy(), none)[0])
    if other is not None:
        table = store.merged()
        for k in components:
            table.free[offset, k] = table.free[other.offset, k]
            store.shared[offset, k] = store.shared.get((other.offset, k), other.offset)
    return _System(feature.type, position, rotation, offset, turn=turn)


def _held(reading: Reading, key: str, other: _System) -> Held:
    """Return the parts that a shape shares with another feature, at their start values."""
    shop = reading.shop
    rotations, components = shop.store("rotation").all_values(), _shared(RELATIONS[key])
    D = rotation_from_angles(rotations[other.rotation][None])[0]
    if other.turn >= 0:
        D = rotation_from_angles(rotations[other.turn][None])[0] @ D
    origin = None
    if components.any():
        offset = np.where(components, shop.store("eccentricity").all_values()[other.offset], 0.0)
        origin = shop.store("point").all_values()[other.position] - offset @ D
    return Held(D, key == "perpendicular", origin, components)


def _shared(components: tuple[int, ...]) -> BoolArray:
    return np.isin(np.arange(3), components)


def _point_beside(reading: Reading, coordinates: FloatArray, line: Feature, D: FloatArray, centre: FloatArray) -> str:
    """Name of the point that carries the turn of a line; empty if all points are on it.

    While coordinates are missing any point may be: :mod:`mor.start.part` knows better when there are some.
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
    # A point is beside a line if its distance from it is more than 1 % of the extent.
    return farthest if away[farthest] > 0.01 * np.abs(local).max() else -1


def turned_towards(direction: FloatArray, D: FloatArray) -> FloatArray:
    """Rotation with the z axis of D whose x axis points to the side of a direction."""
    across = direction - D[2] * (D[2] @ direction)
    x = across / np.linalg.norm(across)
    return np.stack([x, np.cross(D[2], x), D[2]])


def _freedom(type_: str) -> tuple[BoolArray, BoolArray]:
    offsets, turns = {
        "plane": ([False, False, True], [True, True, False]),
        "line": ([True, True, False], [True, True, False]),
        "right angle": ([True, False, True], [True, True, True]),
    }[type_]
    return np.array(offsets), np.array(turns)


def _start(coordinates: FloatArray, first: IntArray, other: IntArray, type_: str) -> tuple[FloatArray, FloatArray]:
    """Rotation and origin fitted to the start coordinates of the points."""
    points = coordinates[first]
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3:
        return np.eye(3), np.zeros(3)
    centre = points.mean(axis=0)
    axes = upright(np.linalg.svd(points - centre)[2])
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
    for _ in range(5):
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
    return np.asarray(upright((x / np.linalg.norm(x))[None])[0])


def upright(directions: FloatArray) -> FloatArray:
    """Directions (n, 3), each or its opposite, so that the largest component is positive: signs are nobody's choice."""
    largest = np.take_along_axis(directions, np.argmax(np.abs(directions), axis=1)[:, None], axis=1)
    return np.asarray(directions * np.sign(largest))


# ---- What no adjustment can be computed with: σ beyond all numbers, nothing free, a datum without coordinates.


def check_feasible(
    reading: Reading, groups: Iterable[ObservationGroup], carries_datum: bool, left_out: Sequence[Message]
) -> None:
    """Tell what cannot be adjusted; ``carries_datum`` is false where the datum names no coordinates.

    ``left_out`` are the notes on what was not read of a foreign file.
    """
    groups = list(groups)
    bare = any("the points are all there is" in note.message for note in left_out)
    of_images = bool(left_out) and bool(reading.project.images)
    if not groups or ((bare or of_images) and not reading.project.observations):
        words = "there are no observations"
        if left_out:
            notes = counted(len(left_out), "note")
            words = f"there are no observations; mor convert lists what was not read ({notes})"
            if any("not read: GNSS" in note.message for note in left_out):
                words = (
                    "there are no observations: GNSS positions, as in this file, are read as points only; "
                    f"mor convert lists what was not read ({notes})"
                )
            elif bare:
                words = f"there are no observations, only points; mor convert lists what was not read ({notes})"
                lost = ("not read: sights", "not read: all sights")
                sights = [note.message for note in left_out if note.message.startswith(lost)]
                if sights:
                    words = f"there are no observations, only points; {sights[0]}"
        reading.at("observations").tell(words)
    elif not reading.shop.store("point").ids:
        reading.at("points").tell("there are no points, images or stations")
    for group in groups:
        _check_sigma(reading, group)
    if groups and not any(store.all_free().any() for store in reading.shop.stores.values() if store.ids):
        if reading.project.settings.dimensions == "xyz":
            words = "all coordinates and parameters are fixed: the residuals compare the observations with them"
            reading.notes.append(reading.at("points").problem(words))
        else:
            words = "there is nothing to adjust: all coordinates and parameters are fixed or not estimated"
            reading.at("points").tell(words)
    if not carries_datum and groups:
        none = "" if reading.shop.things["point"].ids else ": there are no points"
        reading.at("datum").tell(f"datum: names no coordinates{none}")


def _check_sigma(reading: Reading, group: ObservationGroup) -> None:
    """Squares of σ, and of residuals over σ, must be numbers."""
    wrong = group.mask & ~((group.sigma >= SMALLEST_SIGMA) & (group.sigma <= LARGEST))
    for row in np.flatnonzero(wrong.any(axis=1))[:MOST_TOLD].tolist():
        found = group.sigma[row][wrong[row]][0]
        words = f"{group.name}: found σ = {found:g}, expected one from {SMALLEST_SIGMA:g} to {LARGEST:g}"
        reading.problems.append(Message(words, group.file or reading.document.file, group.line(row)))


# ---- Observation groups of types ``parameter`` and ``difference``: any component of any block, row by row.

PARTS = {
    "camera": ("interior", "eccentricity", "readout"),
    "image": ("position", "rotation", "height", "interior", "eccentricity", "image velocity", "rotation rate"),
    "station": ("position", "rotation", "height"),
    "system": ("position", "rotation", "scale", "offset"),
    "pair": ("base", "rotation"),
    "feature": ("shape",),
    "knot": ("position", "rotation"),
    "point": ("position", "velocity", "sine", "cosine"),
    "instrument": ("distance meter", "refraction", "gnss frame", "lever arm", "boresight", "time offset"),
}
"""Namespaces a parameter can be named in (``camera C1``), and the parts that have its components."""


class _BlockComponent(NamedTuple):
    """A component of a block: internal axes, and the sign that takes project axes to them."""

    kind: str
    block: int
    component: int
    sign: float
    scale: ImageScale | None


class _Known(NamedTuple):
    """A row of a table: what its columns ``names`` are about, its value and σ in internal units and axes."""

    table: Rows
    names: tuple[str, ...]
    row: int
    kind: str
    blocks: tuple[int, ...]
    component: int
    value: float
    sigma: float

    def tell(self, words: str) -> None:
        self.table.tell(self.row, words)


def parameter_groups(reading: Reading) -> list[tuple[int, ObservationGroup]]:
    """Groups of types ``parameter`` and ``difference``, one for every kind of block and image unit of an entry.

    Each with the number of its entry.
    """
    groups: list[tuple[int, ObservationGroup]] = []
    said: list[_Known] = []
    for number, entry in enumerate(reading.project.observations):
        if entry.type not in ("parameter", "difference"):
            continue
        names = ("of",) if entry.type == "parameter" else ("from", "to")
        columns = [
            *(Column(name, required=True) for name in names),
            Column("component", required=True),
            Column("value", required=entry.type == "parameter"),
            Column("sigma", required=True),
        ]
        if reading.planned:
            columns = without_required(columns, ["value"])
        rows = read_table(entry, columns, reading.at("observations", number))
        if rows is not None:
            found = _parameter_rows(reading, entry, rows, names, said)
            groups += [(number, replace(group, name=group_name(entry, number))) for group in found]
    _take_exactly(reading, [row for row in said if row.sigma == 0.0])
    for row in said:
        if row.sigma > 0.0:
            _refuse_constant(reading, row)
    return groups


def _parameter_rows(
    reading: Reading, entry: Observations, rows: Rows, names: tuple[str, ...], said: list[_Known]
) -> list[ObservationGroup]:
    collected: dict[tuple[str, str], list[_Known]] = {}
    for i in range(rows.count):
        try:
            places = [_find(reading, rows.series(name)[i], rows.series("component")[i]) for name in names]
            known = _known(reading, entry, rows, names, i, places)
        except _UnknownThingError:
            continue
        except ValueError as error:
            rows.tell(i, str(error))
            continue
        said.append(known)
        if known.sigma == 0.0:
            continue
        unit = places[0].scale.unit if places[0].scale else "mm"
        collected.setdefault((places[0].kind, unit), []).append(known)
    return [_parameter_group(kind, unit, found) for (kind, unit), found in collected.items()]


class _UnknownThingError(Exception):
    """A name is missing from a table that has mistakes of its own."""


def _known(
    reading: Reading, entry: Observations, rows: Rows, names: tuple[str, ...], i: int, places: list[_BlockComponent]
) -> _Known:
    """A row in internal units and axes. Raises ``ValueError`` with what is wrong."""
    if len({place.kind for place in places}) > 1:
        raise ValueError("a difference needs two blocks of the same kind")
    if len(places) == 2 and places[0].block == places[1].block:
        raise ValueError("a difference needs two different blocks")
    place = places[0]
    quantity = KINDS[place.kind].components[place.component].quantity
    given = {}
    for name in ("value", "sigma"):
        text = rows.series(name)[i] or "0"
        try:
            given[name] = reading.edge.number(text, quantity, entry.unit_of(name), place.scale)
        except UnitError as error:
            raise ValueError(f"{name}: {error}") from None
    if given["sigma"] < 0.0:
        raise ValueError(f"sigma: found {rows.series('sigma')[i]}, expected a σ ≥ 0")
    blocks = tuple(one.block for one in places)
    value, sigma = given["value"] * place.sign, given["sigma"] * entry.factor
    return _Known(rows, names, i, place.kind, blocks, place.component, value, sigma)


def _find(reading: Reading, name: str, component: str) -> _BlockComponent:
    """The component behind ``camera C1`` and ``c``. Raises ``ValueError`` where there is none."""
    space, _, bare = name.partition(" ")
    if space not in PARTS:
        raise ValueError(f"found {name!r}, expected one of {', '.join(f'{s} …' for s in PARTS)}{nearest(space, PARTS)}")
    things = reading.shop.things[space]
    if bare not in things.numbers:
        if space in reading.broken:
            raise _UnknownThingError
        raise ValueError(unknown_name(space, bare, things.ids))
    if space == "image" and bare in reading.image_times:
        raise ValueError(f"{name} is on a trajectory: it has no {component} of its own; name a knot of that")
    known: list[str] = []
    # Kinds whose block number 0 is the neutral one of all that declare none.
    with_neutral = (
        *("height", "eccentricity", "distance meter", "refraction", "gnss frame", "scale"),
        *(kind.key for kind in MOTIONS),
    )
    for part in PARTS[space]:
        if part not in things.parts:
            continue  # nothing moves in this project
        camera = None
        if part == "interior":
            cameras = reading.shop.things["camera"]
            camera = bare if space == "camera" else cameras.ids[things.part(bare, "camera")]
        kind = _kind_of_part(reading, part, camera)
        known += kind.names
        if component in kind.names:
            block, k = things.part(bare, part), kind.names.index(component)
            neutral = (block == 0 and kind.key in with_neutral) or reading.shop.neutral_blocks.get(kind.key) == block
            if block < 0 or neutral:
                raise ValueError(f"{name} has no {component} of its own: give it one where it is declared")
            scale = reading.scales[camera] if camera is not None else None
            return _BlockComponent(kind.key, block, *_internal(reading, space, kind, k), scale)
    raise ValueError(f"{name} has no component {component!r}{nearest(component, known)} (known: {', '.join(known)})")


def _internal(reading: Reading, space: str, kind: BlockKind, component: int) -> tuple[int, float]:
    """Internal component and sign behind a component in project axes."""
    M = reading.edge.matrix
    if kind.in_object_axes:
        source = int(np.argmax(np.abs(M[:, component])))
        return source, float(M[source, component])
    if kind.is_rotation and space != "pair" and not np.array_equal(M, np.eye(3)):
        raise ValueError("observed ω, φ, κ need axes: {xy: en}")
    return component, 1.0


def _kind_of_part(reading: Reading, part: str, camera: str | None) -> BlockKind:
    if camera is not None:
        return INTERIORS[reading.project.cameras[camera].model]
    plain = {
        "position": "point",
        "relative rotation": "rotation",
        "offset": "eccentricity",
        "lever arm": "eccentricity",
        "boresight": "rotation",
    }
    return KINDS[plain.get(part, part)]


def _take_exactly(reading: Reading, exact: list[_Known]) -> None:
    """σ = 0: a parameter is fixed at its value; a difference makes one unknown of two components."""
    for row in exact:
        if len(row.blocks) == 1:
            reading.shop.store(row.kind).hold(row.blocks[0], row.component, row.value)
    for kind in dict.fromkeys(row.kind for row in exact):
        here = [row for row in exact if row.kind == kind]
        tied = [row for row in here if len(row.blocks) == 2]
        ties = [Equality(row.component, row.blocks[0], row.blocks[1], row.value) for row in tied]
        try:
            settle_equalities(reading.shop.store(kind), ties)
        except ContradictionError as error:
            row = tied[error.number] if error.number is not None else (tied or here)[0]
            row.tell(f"σ = 0: {error}")


def _refuse_constant(reading: Reading, row: _Known) -> None:
    """Tell a row in which nothing that is observed is an unknown."""
    free = reading.shop.store(row.kind).all_free()
    if any(free[block, row.component] for block in row.blocks):
        return
    names = " and ".join(row.table.series(name)[row.row] for name in row.names)
    verb = "is" if len(row.names) == 1 else "are"
    row.tell(
        f"{row.table.series('component')[row.row]} of {names} {verb} fixed: observing it has no effect; make it "
        "free where it is declared, or give its value and σ there"
    )


def _parameter_group(kind: str, unit: str, found: list[_Known]) -> ObservationGroup:
    rows, names = found[0].table, found[0].names
    type_ = (OBSERVED_PARAMETERS if len(names) == 1 else OBSERVED_DIFFERENCES)[kind]
    size = KINDS[kind].size
    observed, sigma = np.full((len(found), size), np.nan), np.full((len(found), size), np.nan)
    for row, known in enumerate(found):
        observed[row, known.component], sigma[row, known.component] = known.value, known.sigma
    return ObservationGroup(
        name="",
        type=type_,
        blocks=tuple(np.array([known.blocks[k] for known in found]) for k in range(len(names))),
        observed=observed,
        sigma=sigma,
        constants=np.zeros((len(found), 0)),
        references=tuple(names_of([rows.series(name)[known.row] for known in found]) for name in names),
        image_unit=unit,
        lines=rows.lines[[known.row for known in found]],
        file=rows.file,
    )
