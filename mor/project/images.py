"""Cameras and images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from math import hypot, inf, isnan

import numpy as np

from mor.model.cameras import CAMERA_MODELS
from mor.model.contract import ObservationGroup
from mor.model.coordinates import OBSERVED_DIFFERENCES, OBSERVED_PARAMETERS
from mor.model.parameters import (
    ECCENTRICITY,
    HEIGHT,
    IMAGE_VELOCITY,
    INTERIORS,
    POINT,
    READOUT,
    ROTATION,
    ROTATION_RATE,
)
from mor.project.axes import ImageScale, UnitError, image_scale, split
from mor.project.entities import Reading, entities, unknown_name
from mor.project.motion import EPOCH, remember_epochs
from mor.project.points import Blocks, position_columns, positions, read_named, rotations
from mor.project.schema import Camera, Images, Setting, Value
from mor.project.stations import eccentricities, heights, motions, set_up_columns, shared_column
from mor.project.tables import Column, Rows, component_columns, settings
from mor.project.trajectories import (
    TRAJECTORY,
    check_line_times,
    pose_blocks,
    put_on_trajectories,
    read_line_times,
    read_scanner,
    trajectory_columns,
)
from mor.types import BoolArray, IntArray
from mor.units import IMAGE, NUMBER, Component

# ---- Cameras of a project: interior orientations, image scales, image-variant components.


def read_cameras(reading: Reading) -> None:
    """Interior orientations, and how image coordinates come in."""
    ids, blocks, eccentricities, models, readouts = [], [], [], [], []
    for name, camera in reading.project.cameras.items():
        at = reading.at("cameras", name)
        reading.shop.begin(f"camera {name}")
        try:
            scale = image_scale(camera)
        except UnitError as error:
            at.tell(str(error), "image")
            continue
        if not _r0_is_good(reading, name, camera, scale):
            continue
        reading.scales[name] = scale
        blocks.append(_interior(reading, name, camera, scale))
        ids.append(name)
        models.append(list(CAMERA_MODELS).index(camera.model))
        eccentricities.append(_eccentricity(reading, name, camera))
        readouts.append(_readout(reading, name, camera, scale))
        read_scanner(reading, name, camera, scale)
    parts = {"interior": blocks, "model": models, "eccentricity": eccentricities, "readout": readouts}
    arrays = {part: np.array(numbers, dtype=np.int64) for part, numbers in parts.items()}
    reading.shop.things["camera"] = entities(ids, arrays)


def _r0_is_good(reading: Reading, name: str, camera: Camera, scale: ImageScale) -> bool:
    try:
        r0 = reading.edge.number(camera.r0 or "0", IMAGE, "", scale)
    except UnitError as error:
        reading.at("cameras", name).tell(f"r0: {error}", "r0")
        return False
    if r0 < 0.0:
        reading.at("cameras", name).tell("r0: expected a radius, 0 or more", "r0")
    return r0 >= 0.0


def _interior(reading: Reading, name: str, camera: Camera, scale: ImageScale) -> int:
    model = CAMERA_MODELS[camera.model]
    place = reading.at("cameras", name, "interior")
    given = {**_first_guess(reading, name, camera, scale), **camera.interior}
    before = len(reading.problems)
    statuses = settings(given, model.components, reading.edge, place, scale)
    values = statuses.values
    if values[0, 0] <= 0.0 and model.components[0].name in given and len(reading.problems) == before:
        place.tell(f"{model.components[0].name}: found {values[0, 0]:g}, expected a camera constant > 0")
    if camera.medium and len(reading.problems) == before:
        found = dict(zip((c.name for c in model.components), values[0].tolist(), strict=True))
        reading.problems.extend(place.problem(words) for words in _impossible(camera.medium, found))
    return int(reading.shop.store(f"interior/{camera.model}").add([name], *statuses)[0])


def _impossible(medium: str, port: dict[str, float]) -> Iterator[str]:
    """Words for what no port can be, by the values of its components; NaN is missing."""
    least = {"distance": 0.0, "glass": 0.0, "n_air": 1.0, "n_glass": 1.0, "n_water": 1.0}
    for name, value in port.items():
        if isnan(value):
            yield f"{name} is required for a {medium}"
        elif value < least.get(name, value):
            yield f"{name}: found {value:g}, expected {least[name]:g} or more"
    off = hypot(*(port.get(f"centre_{axis}", 0.0) for axis in "xyz"))
    if port.get("radius", inf) <= off:
        yield f"radius: found {port['radius']:g}, but the centre is {off:g} from the projection centre"


def _first_guess(reading: Reading, name: str, camera: Camera, scale: ImageScale) -> dict[str, Setting]:
    """Free camera constant (fx and fy alike) from EXIF-like entries or the image size, where interior gives none."""
    names = [c.name for c in CAMERA_MODELS[camera.model].components if c.name in ("c", "fx", "fy", "f")]
    if any(constant in camera.interior for constant in names):
        return {}
    at = reading.at("cameras", name)
    try:
        guess, words = _guessed_constant(camera, scale)
    except UnitError as error:
        at.tell(f"interior: {names[0]} (camera constant) is required; {error}")
        return {}
    reading.notes.append(at.problem(f"camera {name}: {names[0]} = {guess:.6g} {scale.unit}, free, {words}"))
    return {constant: Value(free=repr(guess)) for constant in names}


def _guessed_constant(camera: Camera, scale: ImageScale) -> tuple[float, str]:
    """Camera constant in camera units, and where it comes from. Raises :class:`UnitError`."""
    if camera.focal_length is not None:
        number, unit = split(camera.focal_length)
        return number * scale.factor(unit or "mm"), "from focal_length"
    if camera.image is None:
        raise UnitError("or give focal_length, or image: {width, height, pixel} for a first guess")
    width, height = (split(text)[0] * scale.factor("px") for text in (camera.image.width, camera.image.height))
    if camera.focal_length_35mm is not None:
        diagonal = float(np.hypot(width, height))
        full_frame = float(np.hypot(36.0, 24.0))  # diagonal of the format that 35 mm equivalents refer to
        return camera.focal_length_35mm * diagonal / full_frame, "from focal_length_35mm"
    # Camera constant in longer sides of the image where nothing is known: a lens of 53 degrees.
    guessed_constant = 1.0
    return guessed_constant * max(width, height), f"a first guess: {guessed_constant:g} x the longer side of the image"


def _eccentricity(reading: Reading, name: str, camera: Camera) -> int:
    if not camera.eccentricity:
        return 0
    place = reading.at("cameras", name, "eccentricity")
    statuses = settings(dict(camera.eccentricity), ECCENTRICITY.components, reading.edge, place)
    return int(reading.shop.store("eccentricity").add([f"camera {name}"], *statuses)[0])


def _readout(reading: Reading, name: str, camera: Camera, scale: ImageScale) -> int:
    """Block of the readout time, −1 where all rows are exposed at once: none given, or exactly 0."""
    if camera.readout is None:
        return -1
    at = reading.at("cameras", name)
    before = len(reading.problems)
    statuses = settings({READOUT.key: camera.readout}, READOUT.components, reading.edge, at)
    if len(reading.problems) > before:
        return -1
    value, free = float(statuses.values[0, 0]), bool(statuses.free[0, 0])
    if value < 0.0:
        at.tell(f"readout: found {value:g} s, expected 0 or more; readout_direction says where it goes", "readout")
    if value == 0.0 and not free:
        return -1
    if np.isnan(scale.pixel) or camera.image is None:
        at.tell("readout needs image: {width, height, pixel}: the row of a point is its time", "readout")
        return -1
    return int(reading.shop.store(READOUT.key).add([f"camera {name}"], *statuses)[0])


def phase_constants(camera: Camera, scale: ImageScale) -> tuple[float, float, float]:
    """Return the readout per image unit in x and in y, and at 0, 0, less 1/2."""
    assert camera.image is not None
    width, height = (split(text)[0] * scale.pixel for text in (camera.image.width, camera.image.height))
    along = {"down": (0.0, -1.0 / height), "up": (0.0, 1.0 / height)}
    along |= {"right": (1.0 / width, 0.0), "left": (-1.0 / width, 0.0)}
    by_x, by_y = along[camera.readout_direction]
    x, y = 0.0, 0.0  # the middle of the image, from the origin inside
    if scale.corner:
        x, y = 0.5 * width - scale.centre[0] * scale.pixel, scale.centre[1] * scale.pixel - 0.5 * height
    return by_x, by_y, -by_x * x - by_y * y


def image_variant(reading: Reading, name: str, camera: Camera) -> dict[int, float]:
    """Numbers of the image-variant components of a camera, with the σ of their difference from the camera's."""
    kind = INTERIORS[camera.model]
    result: dict[int, float] = {}
    given = camera.image_variant if isinstance(camera.image_variant, dict) else dict.fromkeys(camera.image_variant)
    for component, text in given.items():
        at = reading.at("cameras", name, "image_variant")
        if component not in kind.names:
            at.tell(unknown_name("component", component, kind.names))
            continue
        k = kind.names.index(component)
        try:
            sigma = _variant_sigma(reading, text, kind.components[k], reading.scales[name])
        except UnitError as error:
            at.tell(f"{component}: {error}")
            continue
        if sigma != 0.0:  # no difference at all: every image has the component of the camera
            result[k] = sigma
    return result


def _variant_sigma(reading: Reading, text: str | None, component: Component, scale: ImageScale) -> float:
    """σ of the difference of each image from its camera, NaN if there is none. Raises :class:`UnitError`."""
    if text is None:
        return float("nan")
    sigma = reading.edge.number(text, component.quantity, "", scale)
    if sigma < 0.0:
        raise UnitError(f"found a negative σ ({text}), expected a σ ≥ 0")
    return sigma


def variant_columns(reading: Reading) -> list[Column]:
    """Columns an image table may have for the start values of image-variant components, in the unit of the camera."""
    cameras = [camera for camera in reading.project.cameras.values() if camera.image_variant]
    names = dict.fromkeys(c for camera in cameras for c in camera.image_variant if c in INTERIORS[camera.model].names)
    return [Column(name, parse=lambda text, unit: reading.edge.number(text, NUMBER, unit)) for name in names]


def interiors(reading: Reading, rows: Rows, cameras: IntArray) -> IntArray:
    """Interior block of every image: its camera's, or one of its own where components vary from image to image."""
    shop, names = reading.shop, rows.text("id")
    result = shop.things["camera"].parts["interior"][cameras].copy()
    for number, camera_name in enumerate(shop.things["camera"].ids):
        camera = reading.project.cameras[camera_name]
        if not camera.image_variant:
            continue
        store = shop.store(f"interior/{camera.model}")
        mine = np.flatnonzero(cameras == number)
        shared = int(shop.things["camera"].parts["interior"][number])
        row = slice(shared, shared + 1)
        variant = reading.variants[camera_name] = image_variant(reading, camera_name, camera)
        if not variant:
            continue
        values = np.repeat(store.all_values()[row], len(mine), axis=0)
        free = np.repeat(store.all_free()[row], len(mine), axis=0)
        free[:, list(variant)] = True
        for component in variant:
            own = rows.number(store.kind.names[component])[mine]
            values[:, component] = np.where(np.isnan(own), values[:, component], own)
        added = store.add([f"image {names[i]}" for i in mine], values, free, np.full(values.shape, np.nan))
        for block in added:
            for component in range(store.kind.size):
                if component not in variant:
                    store.shared[int(block), component] = shared
        result[mine] = added
    return result


def hold_what_images_have(reading: Reading, groups: Sequence[ObservationGroup]) -> None:
    """A component that every image has of its own is none of the camera: its value is where those of the images start.

    Unless something says how they differ: a σ of the variation, or an observed or exact difference.
    """
    for name, variant in reading.variants.items():
        kind = INTERIORS[reading.project.cameras[name].model]
        store, block = reading.shop.store(kind.key), reading.shop.things["camera"].part(name, "interior")
        told = [k for other, k in store.shared if other == block]
        told += [k for (_, k), owner in store.shared.items() if owner == block]
        for group in groups:
            if group.type in (OBSERVED_PARAMETERS[kind.key], OBSERVED_DIFFERENCES[kind.key]):
                rows = np.any([blocks == block for blocks in group.blocks], axis=0)
                told += np.flatnonzero(group.mask[rows].any(axis=0)).tolist()
        for component in variant:
            if store.all_free()[block, component] and component not in told:
                store.hold(block, component, float(store.all_values()[block, component]))


# ---- Images of a project: frames with a camera; followers refer to their leading image and their pair.


def read_images(reading: Reading) -> None:
    """Images: positions, rotations, heights, cameras; followers refer to their leading image and their pair."""
    leaders: list[tuple[int, str, str, Rows, int]] = []
    read_line_times(reading)
    parts = ["position", "rotation", "height", "eccentricity", "interior", "model", "camera"]
    parts += ["relative rotation", "base", "image velocity", "rotation rate", "readout", TRAJECTORY]
    read_named(reading, "image", parts, image_columns(reading), partial(_images_of_table, leaders))
    _follow(reading, leaders)
    check_line_times(reading, reading.shop.things["image"].ids)


_MOTION = (IMAGE_VELOCITY, ROTATION_RATE)
_POSE = (*POINT.names, *ROTATION.names, *HEIGHT.names, *ECCENTRICITY.names, *IMAGE_VELOCITY.names, *ROTATION_RATE.names)


def _images_of_table(
    leaders: list[tuple[int, str, str, Rows, int]], reading: Reading, table: Images, rows: Rows, names: list[str]
) -> Blocks | None:
    remember_epochs(reading, "image", names, rows)
    if not reading.edge.right_handed:
        number = next(k for k, one in enumerate(reading.project.images) if one is table)
        reading.at("images", number).tell(f"images need right-handed axes; {reading.edge.axes.xy} is left-handed")
        return None
    cameras = _camera_numbers(reading, rows)
    if cameras is None:
        reading.broken.add("image")
        return None
    camera, first = reading.shop.things["camera"], len(reading.shop.things["image"].ids)
    own = camera.parts["eccentricity"][cameras]
    trajectory = put_on_trajectories(reading, rows, names, table.free)
    position, rotation, height, eccentricity = _own_poses(reading, rows, trajectory >= 0, table, own)
    none = np.full(len(names), -1, dtype=np.int64)
    readout = camera.parts["readout"][cameras]
    velocity, rate = _motions(reading, rows, names, table, readout, trajectory >= 0)
    for i, (leader, pair) in enumerate(zip(rows.text("leader"), rows.text("pair"), strict=True)):
        if leader or pair:
            leaders.append((first + i, leader, pair, rows, i))
    return {
        "position": position,
        "rotation": rotation,
        "height": height,
        "eccentricity": eccentricity,
        "interior": interiors(reading, rows, cameras),
        "model": camera.parts["model"][cameras],
        "camera": cameras,
        "relative rotation": none,
        "base": none.copy(),
        "image velocity": velocity,
        "rotation rate": rate,
        "readout": readout,
        TRAJECTORY: trajectory,
    }


def image_columns(reading: Reading) -> list[Column]:
    """Return the columns that a table of images may have."""
    return [
        Column("id", required=True),
        Column("camera", required=True),
        *(Column(name) for name in ("position", "leader", "pair")),
        EPOCH,
        *trajectory_columns(reading),
        *component_columns((*POINT.components, *ROTATION.components), reading.edge),
        *position_columns(reading),
        *set_up_columns(reading, HEIGHT),
        *set_up_columns(reading, ECCENTRICITY),
        *(column for kind in _MOTION for column in set_up_columns(reading, kind)),
        *variant_columns(reading),
    ]


def _own_poses(
    reading: Reading, rows: Rows, on_trajectory: BoolArray, table: Images, eccentricity: IntArray
) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Position, rotation, height and eccentricity blocks; those of followers come from their leading images.

    ``eccentricity`` (n,) are the blocks of the cameras. Images ``on_trajectory`` (n,) have the pose of a time.
    """
    names = rows.text("id")
    follows = np.array([bool(a or b) for a, b in zip(rows.text("leader"), rows.text("pair"), strict=True)])
    shared = ("position", *(shared_column(kind) for kind in (HEIGHT, ECCENTRICITY, *_MOTION)))
    for i in np.flatnonzero(follows).tolist():
        given = any(np.isfinite(rows.number(name)[i]) for name in _POSE)
        if given or any(rows.text(name)[i] for name in shared):
            rows.tell(i, f"image {names[i]!r} follows another one: it has no position or attitude of its own")
    position, rotation, height = (np.full(len(names), -1, dtype=np.int64) for _ in range(3))
    eccentricity = eccentricity.copy()
    labels = [f"image {name}" for name in names]
    fixed, free = table.fixed, table.free
    own = np.flatnonzero(~follows & ~on_trajectory)
    if len(own):
        mine, called = rows.take(own), [labels[i] for i in own]
        position[own] = positions(reading, mine, called, fixed)
        rotation[own] = rotations(reading, mine, called, fixed)
    timed = np.flatnonzero(on_trajectory & ~follows)
    if len(timed):
        position[timed], rotation[timed] = pose_blocks(reading, [labels[i] for i in timed])
    set_up = np.flatnonzero(~follows)
    if len(set_up):
        mine, called = rows.take(set_up), [labels[i] for i in set_up]
        height[set_up] = heights(reading, mine, called, fixed, free)
        eccentricity[set_up] = eccentricities(reading, mine, called, fixed, free, eccentricity[set_up])
    return position, rotation, height, eccentricity


def _motions(
    reading: Reading, rows: Rows, names: list[str], table: Images, readout: IntArray, on_trajectory: BoolArray
) -> tuple[IntArray, IntArray]:
    """Velocity and rotation rate of images whose cameras have a readout time (n,); a motion without one is noted.

    Images ``on_trajectory`` (n,) move as that does.
    """
    labels = [f"image {name}" for name in names]
    follows = np.array([bool(a or b) for a, b in zip(rows.text("leader"), rows.text("pair"), strict=True)])
    moving = (readout >= 0) & ~follows & ~on_trajectory
    words = "image {0!r} follows another one; a stereo follower with a readout time is not supported"
    rows.tell_where((readout >= 0) & follows, lambda row: words.format(names[row]))
    still = np.flatnonzero(readout < 0)
    given = [c for kind in _MOTION for c in kind.names if np.isfinite(rows.number(c)[still]).any()]
    if given or (len(still) and any(c in table.free for kind in _MOTION for c in kind.names)):
        camera = rows.text("camera")[int(still[0])]
        said = f"camera {camera} has no readout time: the motion of its images has no effect and is left out"
        reading.notes.append(rows.problem(int(still[0]), said))
    return motions(reading, rows, labels, table.fixed, table.free, moving)


def _camera_numbers(reading: Reading, rows: Rows) -> IntArray | None:
    known = reading.shop.things["camera"].numbers
    result = np.array([known.get(name, -1) for name in rows.text("camera")], dtype=np.int64)
    names = rows.text("camera")
    for name in dict.fromkeys(names[i] for i in np.flatnonzero(result < 0)):
        if name in reading.project.cameras or "camera" in reading.broken:
            continue  # its own mistake is told already
        rows.tell(names.index(name), unknown_name("camera", name, known))
    return None if (result < 0).any() else result


def _follow(reading: Reading, leaders: list[tuple[int, str, str, Rows, int]]) -> None:
    images, pairs = reading.shop.things["image"], reading.shop.things["pair"]
    followers = {number for number, *_ in leaders}
    for number, leader, pair, rows, row in leaders:
        if not leader or not pair:
            have, lack = ("pair", "leader") if pair else ("leader", "pair")
            rows.tell(row, f"image {images.ids[number]!r} has a {have} but no {lack}; a stereo follower needs both")
        elif leader not in images.numbers:
            rows.tell(row, unknown_name("leader: image", leader, images.ids))
        elif pair not in pairs.numbers and "pair" in reading.broken:
            continue
        elif pair not in pairs.numbers:
            rows.tell(row, unknown_name("pair", pair, pairs.ids))
        elif images.numbers[leader] == number:
            rows.tell(row, f"image {leader!r} is its own leader; a stereo follower follows another image")
        elif images.numbers[leader] in followers:
            rows.tell(row, f"leader {leader!r} is itself a follower; a leader must have its own position and attitude")
        else:
            if leader in reading.image_times:
                reading.image_times[images.ids[number]] = reading.image_times[leader]
            for part in ("position", "rotation", "height", "eccentricity", TRAJECTORY):
                images.parts[part][number] = images.part(leader, part)
            images.parts["relative rotation"][number] = pairs.part(pair, "rotation")
            images.parts["base"][number] = pairs.part(pair, "base")
