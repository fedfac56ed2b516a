"""Cameras, points, images, stations, systems and pairs of a project, as blocks and names."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mor.errors import Problem
from mor.geometry.arrays import FloatArray, IntArray
from mor.geometry.cameras import CAMERA_MODELS
from mor.parameters.kinds import BASE, ECCENTRICITY, HEIGHT, INTERIORS, POINT, ROTATION, SCALE
from mor.project.edge import Edge, ImageScale, UnitError, image_scale
from mor.project.entities import Workshop, entities, unknown_name
from mor.project.model import Camera, Images, Instrument, Pairs, Points, Project, Stations, Systems
from mor.project.nodes import Document, Path
from mor.project.statuses import component_columns, component_rows, number_column, settings
from mor.project.tables import Column, Place, Rows, read_table
from mor.units import ANGLE, LENGTH


@dataclass
class Reading:
    """What the steps of reading share: the project, where it stands, what was found wrong."""

    project: Project
    place: Place
    edge: Edge
    shop: Workshop
    problems: list[Problem]
    scales: dict[str, ImageScale] = field(default_factory=dict)
    groups: dict[str, list[int]] = field(default_factory=dict)
    """Point groups by name: block numbers."""
    table_ids: dict[tuple[str, int], list[str]] = field(default_factory=dict)
    """Names read from a table, by section and number of the table."""
    variants: dict[str, dict[int, float]] = field(default_factory=dict)
    """Image-variant components of each camera, with the σ of their difference (NaN: none)."""

    def at(self, *path: str | int) -> Place:
        """The place of a part of the project file."""
        return Place(self.place.document, path, self.place.folder)

    @property
    def document(self) -> Document:
        """The project file itself."""
        return self.place.document


_POSE_NAMES = (*POINT.names, *ROTATION.names)


def read_cameras(reading: Reading) -> None:
    """Interior orientations, and how image coordinates come in."""
    ids, blocks, eccentricities, models = [], [], [], []
    for name, camera in reading.project.cameras.items():
        at = reading.at("cameras", name)
        try:
            scale = image_scale(camera, reading.project.units)
        except UnitError as error:
            reading.problems.append(at.problem(str(error), "image"))
            continue
        reading.scales[name] = scale
        blocks.append(_interior(reading, name, camera, scale))
        ids.append(name)
        models.append(list(CAMERA_MODELS).index(camera.model))
        eccentricities.append(_eccentricity(reading, name, camera))
    reading.shop.things["camera"] = entities(
        ids,
        {
            "interior": np.array(blocks, dtype=np.int64),
            "model": np.array(models, dtype=np.int64),
            "eccentricity": np.array(eccentricities, dtype=np.int64),
        },
    )


def _interior(reading: Reading, name: str, camera: Camera, scale: ImageScale) -> int:
    model = CAMERA_MODELS[camera.model]
    path: Path = ("cameras", name, "interior")
    given = dict(camera.interior)
    place = reading.at(*path)
    if model.components[0].name not in given:
        reading.problems.append(
            reading.at("cameras", name).problem(f"interior: {model.components[0].name} (camera constant) is required")
        )
    values, free, sigma = settings(
        given, model.components, reading.edge, place, path, reading.problems, scale
    )
    if values[0, 0] <= 0.0 and model.components[0].name in given:
        reading.problems.append(
            place.problem(f"{model.components[0].name}: found {values[0, 0]:g}, expected a camera constant > 0")
        )
    if camera.coordinates == "corner" and camera.model in ("opencv", "fisheye"):
        values[0, 2:4] -= np.array(scale.centre) * scale.factor("px")
    return int(reading.shop.store(f"interior/{camera.model}").add([name], values, free, sigma)[0])


def _eccentricity(reading: Reading, name: str, camera: Camera) -> int:
    if not camera.eccentricity:
        return 0
    path: Path = ("cameras", name, "eccentricity")
    values, free, sigma = settings(
        dict(camera.eccentricity), ECCENTRICITY.components, reading.edge, reading.at(*path), path, reading.problems
    )
    return int(reading.shop.store("eccentricity").add([f"camera {name}"], values, free, sigma)[0])


def read_points(reading: Reading) -> None:
    """Object points; coordinates go into internal axes."""
    ids: list[str] = []
    numbers: list[IntArray] = []
    lines: dict[str, tuple[str, int]] = {}
    for k, table in enumerate(reading.project.points):
        found = _read_points_table(reading, table, reading.at("points", k), lines)
        if found is None:
            continue
        names, blocks = found
        ids += names
        numbers.append(blocks)
        if table.group:
            reading.groups.setdefault(table.group, []).extend(blocks.tolist())
    position = np.concatenate(numbers) if numbers else np.zeros(0, dtype=np.int64)
    reading.shop.things["point"] = entities(ids, {"position": position, "height": np.zeros_like(position)})


def _read_points_table(
    reading: Reading, table: Points, place: Place, lines: dict[str, tuple[str, int]]
) -> tuple[list[str], IntArray] | None:
    columns = [Column("id", required=True), *component_columns(POINT.components, reading.edge)]
    columns.append(number_column("sigma", LENGTH, reading.edge))
    rows = read_table(table, columns, place, reading.problems)
    if rows is None:
        return None
    names = rows.text("id")
    _check_unique("point", names, rows, lines, reading.problems)
    values, free, sigma = component_rows(
        rows, POINT.components, table.fixed, reading.problems, rows.number("sigma")
    )
    absent = [c for c in "xyz" if c not in reading.project.settings.dimensions]
    for k, component in enumerate("xyz"):
        if component in absent:
            values[:, k], free[:, k], sigma[:, k] = np.nan_to_num(values[:, k]), False, np.nan
    return names, reading.shop.store("point").add(names, *_inwards(reading.edge, values, free, sigma))


def _inwards(edge: Edge, values: FloatArray, free: FloatArray, sigma: FloatArray) -> tuple[FloatArray, ...]:
    """Coordinates, flags and σ from project axes to internal ones."""
    M = edge.matrix
    source = np.argmax(np.abs(M), axis=1)
    return values[:, source] * M[np.arange(3), source], free[:, source], sigma[:, source]


def _check_unique(
    what: str, names: list[str], rows: Rows, lines: dict[str, tuple[str, int]], problems: list[Problem]
) -> None:
    for name, line in zip(names, rows.lines, strict=True):
        if name in lines:
            file, first = lines[name]
            problems.append(Problem(f"{what} {name!r} is given twice (first in {file}:{first})", rows.file, int(line)))
        else:
            lines[name] = (rows.file, int(line))


def read_images(reading: Reading) -> None:
    """Images: positions, rotations, heights, cameras; followers refer to their leading image and their pair."""
    collected: dict[str, list[IntArray]] = {}
    ids: list[str] = []
    lines: dict[str, tuple[str, int]] = {}
    leaders: list[tuple[int, str, str, str, int]] = []
    for k, table in enumerate(reading.project.images):
        _read_images_table(reading, table, reading.at("images", k), ids, collected, lines, leaders)
    parts = {part: np.concatenate(arrays) for part, arrays in collected.items()}
    if not parts:
        parts = {part: np.zeros(0, dtype=np.int64) for part in _IMAGE_PARTS}
    reading.shop.things["image"] = entities(ids, parts)
    _follow(reading, leaders)


_IMAGE_PARTS = (
    "position",
    "rotation",
    "height",
    "eccentricity",
    "interior",
    "model",
    "camera",
    "relative rotation",
    "base",
)


def _read_images_table(
    reading: Reading,
    table: Images,
    place: Place,
    ids: list[str],
    collected: dict[str, list[IntArray]],
    lines: dict[str, tuple[str, int]],
    leaders: list[tuple[int, str, str, str, int]],
) -> None:
    edge, shop = reading.edge, reading.shop
    columns = [
        Column("id", required=True),
        Column("camera", required=True),
        *(Column(name) for name in ("position", "leader", "pair")),
        *component_columns((*POINT.components, *ROTATION.components, *HEIGHT.components), edge),
    ]
    rows = read_table(table, columns, place, reading.problems)
    if rows is None:
        return
    names = rows.text("id")
    _check_unique("image", names, rows, lines, reading.problems)
    if not edge.right_handed:
        reading.problems.append(place.problem(f"images need right-handed axes; {edge.axes.xy} is left-handed"))
        return
    cameras = _camera_numbers(reading, rows)
    if cameras is None:
        return
    camera = shop.things["camera"]
    position = _positions(reading, rows, [f"image {name}" for name in names], table.fixed)
    rotation = _rotations(reading, rows, [f"image {name}" for name in names], table.fixed)
    height = _heights(reading, rows, [f"image {name}" for name in names], table.fixed)
    zero = np.full(len(names), -1, dtype=np.int64)
    found = {
        "position": position,
        "rotation": rotation,
        "height": height,
        "eccentricity": camera.parts["eccentricity"][cameras],
        "interior": _interiors(reading, names, cameras),
        "model": camera.parts["model"][cameras],
        "camera": cameras,
        "relative rotation": zero,
        "base": zero,
    }
    for i, (leader, pair) in enumerate(zip(rows.text("leader"), rows.text("pair"), strict=True)):
        if leader or pair:
            leaders.append((len(ids) + i, leader, pair, rows.file, int(rows.lines[i])))
    for part, array in found.items():
        collected.setdefault(part, []).append(array)
    ids += names


def _camera_numbers(reading: Reading, rows: Rows) -> IntArray | None:
    known = reading.shop.things["camera"].numbers
    result = np.array([known.get(name, -1) for name in rows.text("camera")], dtype=np.int64)
    for i in np.flatnonzero(result < 0):
        name = rows.text("camera")[i]
        if name in reading.project.cameras:
            continue  # its own mistake is reported already
        reading.problems.append(Problem(unknown_name("camera", name, known), rows.file, int(rows.lines[i])))
    return None if (result < 0).any() else result


def _interiors(reading: Reading, names: list[str], cameras: IntArray) -> IntArray:
    """Interior block of every image: its camera's, or one of its own where components vary from image to image."""
    shop = reading.shop
    result = shop.things["camera"].parts["interior"][cameras].copy()
    for number, camera_name in enumerate(shop.things["camera"].ids):
        camera = reading.project.cameras[camera_name]
        if not camera.image_variant:
            continue
        store = shop.store(f"interior/{camera.model}")
        mine = np.flatnonzero(cameras == number)
        shared = int(shop.things["camera"].parts["interior"][number])
        row = slice(shared, shared + 1)
        variant = reading.variants[camera_name] = _variant(reading, camera_name, camera)
        values = np.repeat(store.all_values()[row], len(mine), axis=0)
        free = np.repeat(store.all_free()[row], len(mine), axis=0)
        free[:, list(variant)] = True
        added = store.add([f"image {names[i]}" for i in mine], values, free, np.full(values.shape, np.nan))
        for block in added:
            for component in range(store.kind.size):
                if component not in variant:
                    store.shared[int(block), component] = shared
        result[mine] = added
    return result


def _variant(reading: Reading, name: str, camera: Camera) -> dict[int, float]:
    """Numbers of the image-variant components of a camera, with the σ of their difference from the camera's."""
    kind = INTERIORS[camera.model]
    result: dict[int, float] = {}
    given = camera.image_variant if isinstance(camera.image_variant, dict) else dict.fromkeys(camera.image_variant)
    for component, text in given.items():
        at = reading.at("cameras", name, "image_variant")
        if component not in kind.names:
            words = unknown_name("component", component, kind.names)
            reading.problems.append(at.problem(words))
            continue
        k = kind.names.index(component)
        try:
            quantity = kind.components[k].quantity
            result[k] = float("nan") if text is None else reading.edge.number(text, quantity, "", reading.scales[name])
        except UnitError as error:
            reading.problems.append(at.problem(f"{component}: {error}"))
    return result


def _positions(reading: Reading, rows: Rows, labels: list[str], fixed: list[str]) -> IntArray:
    """Position block of every row: its own, or that of the point or shared position it names."""
    shop = reading.shop
    values, free, sigma = component_rows(rows, POINT.components, fixed, reading.problems)
    named = rows.text("position") if "position" in rows.texts else rows.text("point")
    points = shop.things["point"]
    shared = shop.things.setdefault("position", entities((), {"position": np.zeros(0, dtype=np.int64)}))
    known = {name: shared.part(name, "position") for name in shared.ids}
    result = np.full(len(labels), -1, dtype=np.int64)
    new: dict[str, int] = {}
    for i, name in enumerate(named):
        if name in points.numbers:
            result[i] = points.part(name, "position")
        elif name in known:
            result[i] = known[name]
        elif name:
            new.setdefault(name, i)
    own = np.array([not name for name in named])
    first = np.array(sorted(new.values()), dtype=np.int64)
    chosen = np.concatenate([np.flatnonzero(own), first])
    block_ids = [labels[i] if own[i] else f"position {named[i]}" for i in chosen]
    added = shop.store("point").add(
        block_ids, *_inwards(reading.edge, values[chosen], free[chosen], sigma[chosen])
    )
    result[chosen] = added
    for i in first:
        known[named[i]] = int(result[i])
    for i, name in enumerate(named):
        if name and result[i] < 0:
            result[i] = known[name]
    shop.things["position"] = entities(known, {"position": np.array(list(known.values()), dtype=np.int64)})
    return result


def _rotations(
    reading: Reading,
    rows: Rows,
    labels: list[str],
    fixed: list[str],
    level: bool = False,
) -> IntArray:
    values, free, sigma = component_rows(rows, ROTATION.components, fixed, reading.problems)
    if level:
        values[:, :2] = 0.0
        free[:, :2], sigma[:, :2] = False, np.nan
    turned = not np.array_equal(reading.edge.matrix, np.eye(3))
    if turned and not level and (np.isfinite(sigma).any() or not free.all()):
        reading.problems.append(
            Problem("fixed or observed ω, φ, κ need axes: {xy: en}", rows.file, int(rows.lines[0]))
        )
    if turned and not level:
        values = _turned_angles(values, reading.edge.matrix)
    return reading.shop.store("rotation").add(labels, values, free, sigma)


def _turned_angles(values: FloatArray, M: FloatArray) -> FloatArray:
    """ω, φ, κ that refer to project axes, for internal axes: D ← D Mᵀ."""
    from mor.geometry.rotations import angles_from_rotation, rotation_from_angles

    result = values.copy()
    known = np.isfinite(values).all(axis=1)
    result[known] = angles_from_rotation(rotation_from_angles(values[known]) @ M.T)
    return result


def _heights(reading: Reading, rows: Rows, labels: list[str], fixed: list[str]) -> IntArray:
    """Height block of every row: none, or its own; a plain height is fixed."""
    height = rows.number("height")
    sigma = rows.number("sigma_height")
    given = np.flatnonzero(np.isfinite(height))
    result = np.zeros(len(labels), dtype=np.int64)
    for i in np.flatnonzero(sigma < 0.0):
        reading.problems.append(
            Problem(f"sigma_height: found {sigma[i]:g}, expected a σ ≥ 0", rows.file, int(rows.lines[i]))
        )
    observed = (sigma > 0.0) & ("height" not in fixed)
    result[given] = reading.shop.store("height").add(
        [labels[i] for i in given],
        height[given, None],
        observed[given, None],
        np.where(observed, sigma, np.nan)[given, None],
    )
    return result


def _follow(reading: Reading, leaders: list[tuple[int, str, str, str, int]]) -> None:
    """Tie followers to their leading image: its frame, and the relative orientation of their pair."""
    images, pairs = reading.shop.things["image"], reading.shop.things["pair"]
    followers = {number for number, *_ in leaders}
    for number, leader, pair, file, line in leaders:
        if leader not in images.numbers:
            reading.problems.append(Problem(unknown_name("leader: image", leader, images.ids), file, line))
        elif pair not in pairs.numbers:
            reading.problems.append(Problem(unknown_name("pair", pair, pairs.ids), file, line))
        elif images.numbers[leader] == number:
            reading.problems.append(Problem(f"image {leader!r} cannot be its own leader", file, line))
        elif images.numbers[leader] in followers:
            words = f"leader {leader!r} is itself a follower; a leader must be an image of its own"
            reading.problems.append(Problem(words, file, line))
        else:
            for part in ("position", "rotation", "height", "eccentricity"):
                images.parts[part][number] = images.part(leader, part)
            images.parts["relative rotation"][number] = pairs.part(pair, "rotation")
            images.parts["base"][number] = pairs.part(pair, "base")


def read_pairs(reading: Reading) -> None:
    """Relative orientations of stereo pairs: base in the leading image's system, and rotation."""
    ids: list[str] = []
    base: list[IntArray] = []
    rotation: list[IntArray] = []
    lines: dict[str, tuple[str, int]] = {}
    for k, table in enumerate(reading.project.pairs):
        columns = [Column("id", required=True), *component_columns((*BASE.components, *ROTATION.components), reading.edge)]
        rows = read_table(table, columns, reading.at("pairs", k), reading.problems)
        if rows is None:
            continue
        names = rows.text("id")
        _check_unique("pair", names, rows, lines, reading.problems)
        labels = [f"pair {name}" for name in names]
        base.append(
            reading.shop.store("base").add(labels, *component_rows(rows, BASE.components, table.fixed, reading.problems))
        )
        rotation.append(
            reading.shop.store("rotation").add(
                labels, *component_rows(rows, ROTATION.components, table.fixed, reading.problems)
            )
        )
        ids += names
    none = [np.zeros(0, dtype=np.int64)]
    reading.shop.things["pair"] = entities(
        ids, {"base": np.concatenate(base or none), "rotation": np.concatenate(rotation or none)}
    )


def read_instruments(reading: Reading) -> None:
    """Distance meters and refraction coefficients."""
    ids, meters, refractions = [], [], []
    for name, instrument in reading.project.instruments.items():
        ids.append(name)
        meters.append(_instrument(reading, name, instrument, "distance meter", ("scale", "offset")))
        refractions.append(_instrument(reading, name, instrument, "refraction", ("refraction",)))
    reading.shop.things["instrument"] = entities(
        ids,
        {
            "distance meter": np.array(meters, dtype=np.int64),
            "refraction": np.array(refractions, dtype=np.int64),
        },
    )


def _instrument(
    reading: Reading, name: str, instrument: Instrument, kind: str, components: tuple[str, ...]
) -> int:
    given = {key: getattr(instrument, key) for key in components if getattr(instrument, key) is not None}
    if not given:
        return 0
    store = reading.shop.store(kind)
    path: Path = ("instruments", name)
    row = settings(given, store.kind.components, reading.edge, reading.at(*path), path, reading.problems)
    return int(store.add([name], *row)[0])


def read_stations(reading: Reading) -> None:
    """Theodolite stations: a position (usually a point), a height, a rotation with its level."""
    ids: list[str] = []
    collected: dict[str, list[IntArray]] = {"position": [], "height": [], "rotation": []}
    lines: dict[str, tuple[str, int]] = {}
    for k, table in enumerate(reading.project.stations):
        _read_stations_table(reading, table, reading.at("stations", k), ids, collected, lines)
    none = [np.zeros(0, dtype=np.int64)]
    reading.shop.things["station"] = entities(
        ids, {part: np.concatenate(arrays or none) for part, arrays in collected.items()}
    )


def _read_stations_table(
    reading: Reading,
    table: Stations,
    place: Place,
    ids: list[str],
    collected: dict[str, list[IntArray]],
    lines: dict[str, tuple[str, int]],
) -> None:
    edge = reading.edge
    columns = [
        Column("id", required=True),
        Column("point"),
        *component_columns((*POINT.components, *ROTATION.components, *HEIGHT.components), edge),
        number_column("orientation", ANGLE, edge),
    ]
    rows = read_table(table, columns, place, reading.problems)
    if rows is None:
        return
    names = rows.text("id")
    _check_unique("station", names, rows, lines, reading.problems)
    labels = [f"station {name}" for name in names]
    if "orientation" in rows.numbers:
        rows.numbers["kappa"] = -(edge.zero_azimuth + edge.sense * rows.numbers["orientation"])
    collected["position"].append(_positions(reading, rows, labels, table.fixed))
    collected["height"].append(_heights(reading, rows, labels, table.fixed))
    levelled = table.level == "fixed"
    if not levelled:
        for name in ROTATION.names[:2]:
            rows.numbers.setdefault(name, np.zeros(rows.count))
    collected["rotation"].append(_rotations(reading, rows, labels, table.fixed, level=levelled))
    reading.table_ids["stations", int(place.path[-1])] = names
    ids += names


def read_systems(reading: Reading) -> None:
    """Local systems: origin, rotation, scale."""
    ids: list[str] = []
    collected: dict[str, list[IntArray]] = {"position": [], "rotation": [], "scale": [], "offset": []}
    lines: dict[str, tuple[str, int]] = {}
    for k, table in enumerate(reading.project.systems):
        _read_systems_table(reading, table, reading.at("systems", k), ids, collected, lines)
    none = [np.zeros(0, dtype=np.int64)]
    reading.shop.things["system"] = entities(
        ids, {part: np.concatenate(arrays or none) for part, arrays in collected.items()}
    )


def _read_systems_table(
    reading: Reading,
    table: Systems,
    place: Place,
    ids: list[str],
    collected: dict[str, list[IntArray]],
    lines: dict[str, tuple[str, int]],
) -> None:
    kinds = (*POINT.components, *ROTATION.components, *SCALE.components)
    columns = [Column("id", required=True), Column("point"), *component_columns(kinds, reading.edge)]
    rows = read_table(table, columns, place, reading.problems)
    if rows is None:
        return
    names = rows.text("id")
    _check_unique("system", names, rows, lines, reading.problems)
    labels = [f"system {name}" for name in names]
    scale, free, sigma = component_rows(rows, SCALE.components, table.fixed, reading.problems)
    collected["position"].append(_positions(reading, rows, labels, table.fixed))
    collected["rotation"].append(_rotations(reading, rows, labels, table.fixed))
    collected["scale"].append(reading.shop.store("scale").add(labels, np.nan_to_num(scale, nan=1.0), free, sigma))
    collected["offset"].append(np.zeros(len(names), dtype=np.int64))
    ids += names


__all__ = [
    "Reading",
    "read_cameras",
    "read_images",
    "read_instruments",
    "read_pairs",
    "read_points",
    "read_stations",
    "read_systems",
]
