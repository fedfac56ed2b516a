"""Groups of image coordinates: split by camera model, converted when the camera is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from mor.arrays import LARGEST, FloatArray, IntArray, SmallIntArray
from mor.geometry.cameras import CAMERA_MODELS, CameraModel
from mor.long_arrays import kept
from mor.observations import (
    FOLLOWER_TYPES,
    IMAGE_TYPES,
    MOVING_TYPES,
    ObservationGroup,
    ObservationType,
    Slot,
)
from mor.observations.curvature import on_sphere
from mor.observations.names import Names
from mor.observations.time.line_scanner import line_scanner
from mor.observations.time.rolling_shutter import PHASE, phases
from mor.observations.time.shutter_on_trajectory import shutter_on_trajectory
from mor.observations.time.trajectory import CUBIC, on_trajectory
from mor.parameters.kinds import READOUT
from mor.project.axes import external_image
from mor.project.edge import ImageScale, UnitError, beyond, split
from mor.project.file.model import Camera, Observations
from mor.project.motion.epochs import row_epochs
from mor.project.network.cameras import phase_constants
from mor.project.network.reading import Reading
from mor.project.observations.names import named_things
from mor.project.observations.observation_rows import Group, group_name, own_or_common, sigma_is_good
from mor.project.tables.columns import tell_rows
from mor.project.tables.tables import Column, Place, Rows
from mor.project.trajectories.images import TRAJECTORY, RowClocks, clocks_of_rows
from mor.project.trajectories.model import Scanner
from mor.units import IMAGE

Repeated = TypeVar("Repeated", FloatArray, SmallIntArray)


def units_of_values(entry: Observations) -> Observations:
    """``values: {sigma: 0.5 um}`` as a number and a unit: image units are converted when the camera is known."""
    values, units = dict(entry.values), entry.units
    for name, text in entry.values.items():
        try:
            number, unit = split(text)
        except UnitError:
            continue  # told when the column is read
        if unit and name.startswith("sigma") and not isinstance(units, str):
            values[name], units = repr(number), {**units, name: unit}
    return entry.model_copy(update={"values": values, "units": units})


def raw_image(name: str, required: bool = False) -> Column:
    """A column in the image unit of whichever camera: converted when the camera is known."""

    def plain(text: str, unit: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            raise UnitError(f"found {text!r}, expected a number (units are said for the column: units: …)")
        if abs(value) > LARGEST:
            raise UnitError(beyond(text, value))
        return value

    return Column(name, parse=plain, factor=lambda unit: 1.0, required=required)


def image_groups(reading: Reading, entry: Observations, number: int, rows: Rows, place: Place) -> list[Group]:
    """One group for every camera and kind of image (single, stereo follower) of an entry."""
    images = reading.shop.things["image"]
    image, point = (named_things(reading, name, name, rows) for name in ("image", "point"))
    if (image.numbers < 0).any() or (point.numbers < 0).any():
        return []
    epochs = row_epochs(reading, rows, IMAGE_TYPES["mor"].references, (image, point))
    trajectory = images.parts[TRAJECTORY]
    order = np.array([0, *(found.order for found in reading.trajectories.values())])[trajectory + 1]
    follows = images.parts["relative rotation"] >= 0
    kinds = (images.parts["camera"] * 2 + follows) * (CUBIC + 1) + order
    keys = kinds.astype(np.int32)[image.numbers]
    result = []
    for key in np.unique(keys):
        chosen = np.flatnonzero(keys == key)
        group = _image_group(
            reading, entry, number, rows, place, _taken(image, chosen), _taken(point, chosen), chosen
        )
        result += [replace(group, epochs=epochs[chosen])] if group is not None else []
    return result


def _taken(names: Names, rows: IntArray) -> Names:
    return Names(kept(names.numbers[rows]), names.known)


def _image_group(
    reading: Reading,
    entry: Observations,
    number: int,
    rows: Rows,
    place: Place,
    image: Names,
    point: Names,
    chosen: IntArray,
) -> Group | None:
    images = reading.shop.things["image"]
    first = image.numbers[0]
    camera_name = reading.shop.things["camera"].ids[images.parts["camera"][first]]
    camera, scale = reading.project.cameras[camera_name], reading.scales[camera_name]
    follows = bool(images.parts["relative rotation"][first] >= 0)
    timed = bool(images.parts[TRAJECTORY][first] >= 0)
    scanner = reading.scanners.get(camera_name)
    moves = bool(images.parts["readout"][first] >= 0) and not follows
    if scanner is not None and follows:
        words = f"image {image[0]!r} is of a line scanner; it cannot follow another one"
        reading.problems.append(place.problem(words))
    if scanner is not None and (follows or not timed):
        return None  # its own mistake is told already
    try:
        observed, sigma, factors = _image_values(entry, rows, chosen, scale)
    except UnitError as error:
        reading.problems.append(place.problem(str(error), "units"))
        return None
    if (moves or scanner is not None) and not _all_timed(reading, camera, scanner, observed, rows, chosen):
        return None
    constants = _constants(
        CAMERA_MODELS[camera.model], observed, _r0(reading, camera, scale), camera if moves else None, scale
    )
    type_ = (MOVING_TYPES if moves else FOLLOWER_TYPES if follows else IMAGE_TYPES)[camera.model]
    knots: tuple[IntArray, ...] = ()
    if timed:
        own = rows.take(chosen)
        scans = scale if scanner is not None else None
        later = _read_out_later(reading, int(images.parts["readout"][first]), constants) if moves else None
        found = clocks_of_rows(reading, own, image, observed[:, 1], scans, later)
        if found is None:
            return None
        type_, knots, constants = _along(type_, camera, scanner, observed, constants, found)
    if reading.sphere is not None:
        type_ = on_sphere(type_, reading.sphere)
    group = ObservationGroup(
        name=group_name(entry, number),
        type=type_,
        blocks=(*knots, *_blocks_beside(reading, type_.slots[len(knots) :], image, point)),
        observed=kept(observed),
        sigma=_once(sigma * entry.factor),
        constants=constants,
        references=(image, point),
        external=external_image(scale),
        image_unit=scale.unit,
        lines=kept(rows.lines[chosen]),
        file=rows.file,
    )
    if not sigma_is_good(group, rows, chosen, reading.problems):
        return None
    return Group(group, number, chosen, np.eye(2), factors)


def _blocks_beside(
    reading: Reading, slots: Sequence[Slot], image: Names, point: Names
) -> tuple[SmallIntArray, ...]:
    """Blocks (n,) of the slots that are no knots: those of the image and of the point of every row."""
    images, points = reading.shop.things["image"], reading.shop.things["point"]
    return tuple(
        _blocks_of(points.parts["position"], point)
        if slot.of == "point"
        else _once(_blocks_of(images.parts[slot.part], image))
        for slot in slots
    )


def _r0(reading: Reading, camera: Camera, scale: ImageScale) -> float:
    """The radius at which the distortion of a camera is 0; its unit is checked where the camera is read."""
    if camera.r0 is None or not CAMERA_MODELS[camera.model].constants:
        return 0.0
    return reading.edge.number(camera.r0, IMAGE, "", scale)


def _along(
    type_: ObservationType,
    camera: Camera,
    scanner: Scanner | None,
    observed: FloatArray,
    constants: FloatArray,
    found: RowClocks,
) -> tuple[ObservationType, tuple[IntArray, ...], FloatArray]:
    """Type, blocks of the knots and constants of the rows of images on a trajectory."""
    count = len(found.knots) // 2
    if type_ is MOVING_TYPES[camera.model]:
        type_ = shutter_on_trajectory(camera.model, count)
    elif scanner is None:
        type_ = on_trajectory(type_, count)
    else:
        type_ = line_scanner(camera.model, count)
        crossed = np.stack([observed[:, 0], np.full(len(observed), scanner.line)], axis=1)
        constants = np.concatenate([crossed, constants[:, 2:]], axis=1)
    return type_, found.knots, np.concatenate([constants, found.constants], axis=1)


def _read_out_later(reading: Reading, readout: int, constants: FloatArray) -> FloatArray:
    """(n,) how much later than the middle of their images rows are read out, by the readout time that is given."""
    given = float(reading.shop.store(READOUT.key).all_values()[readout, 0])
    return given * phases(constants[:, :2], constants[:, -len(PHASE) :])


def _all_timed(
    reading: Reading,
    camera: Camera,
    scanner: Scanner | None,
    observed: FloatArray,
    rows: Rows,
    chosen: IntArray,
) -> bool:
    """False if a row has no coordinate along the readout, or of a line scanner lacks one; each is told."""
    missing = np.zeros(rows.count, dtype=bool)
    if scanner is not None:
        missing[chosen] = np.isnan(observed).any(axis=1)
        words = "a point in an image of a line scanner needs both coordinates: its row is its time"
    else:
        missing[chosen] = np.isnan(observed[:, int(camera.readout_direction in ("down", "up"))])
        words = "no row (or column) was measured along the readout of the camera: the point has no time"
    tell_rows(reading.problems, missing, rows, words)
    return not missing.any()


def _constants(
    model: CameraModel, observed: FloatArray, r0: float, moving: Camera | None, scale: ImageScale
) -> FloatArray:
    """Constants (n, q) of image coordinates: the measured ones where they are looked at, and those of the model.

    Of a ``moving`` camera also what makes times of them.
    """
    if moving is not None:
        known = np.array([*(r0 for _ in model.constants), *phase_constants(moving, scale)])
        return np.concatenate([np.nan_to_num(observed), np.tile(known, (len(observed), 1))], axis=1)
    if model.corrects_measured:
        own = np.full((len(observed), len(model.constants)), r0)
        return np.concatenate([observed, own], axis=1)
    row = np.array([0.0, 0.0, *(r0 for _ in model.constants)])
    return np.broadcast_to(row, (len(observed), len(row)))


def _blocks_of(blocks: IntArray, names: Names) -> SmallIntArray:
    """Blocks (n,) of the things that rows name; the numbers of the names themselves where they are the same."""
    if np.array_equal(blocks, np.arange(len(blocks))):
        return names.numbers
    return kept(blocks.astype(np.int32)[names.numbers])


def _once(array: Repeated) -> Repeated:
    """The array (n,) or (n, m), of which only one row is kept where all are the same: ten million of them add up."""
    same = len(array) > 1 and bool((array == array[0]).all())
    return np.broadcast_to(array[:1].copy(), array.shape) if same else kept(array)


def _image_values(
    entry: Observations, rows: Rows, chosen: IntArray, scale: ImageScale
) -> tuple[FloatArray, FloatArray, FloatArray]:
    def unit(name: str) -> str:
        given = entry.units if isinstance(entry.units, str) else entry.units.get(name, "")
        return given or scale.coordinate_unit

    if unit("x") != unit("y"):
        raise UnitError("x and y must have the same unit")
    xy = np.stack([rows.number("x")[chosen], rows.number("y")[chosen]], axis=1)
    common = rows.number("sigma")[chosen] * scale.factor(unit("sigma"))
    sigma = np.stack(
        [
            own_or_common(rows.number(f"sigma_{c}")[chosen] * scale.factor(unit(f"sigma_{c}")), common)
            for c in "xy"
        ],
        axis=1,
    )
    factors = np.full(2, scale.factor(unit("sigma")))
    return scale.inwards(xy, unit("x")), sigma, factors
