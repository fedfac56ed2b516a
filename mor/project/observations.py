"""Groups of observations from the tables of a project."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations_with_replacement
from typing import TypeVar

import numpy as np

from mor.errors import nearest
from mor.long_arrays import empty, kept
from mor.model.cameras import CAMERA_MODELS, CameraModel
from mor.model.contract import Names, ObservationGroup, ObservationType, SetUpSigmas, Slot
from mor.model.coordinates import to_projection_centres
from mor.model.curvature import on_sphere
from mor.model.geodetic import EARTH_TYPES, GEOID, NOT_ON_EARTH, is_open
from mor.model.images import (
    FOLLOWER_TYPES,
    IMAGE_TYPES,
    MOVING_TYPES,
    PHASE,
    line_scanner,
    phases,
    shutter_on_trajectory,
)
from mor.model.observation_types import PROJECTION_CENTRE_TYPES
from mor.model.parameters import READOUT
from mor.model.shapes import RELATION_TYPES
from mor.model.trajectory import CUBIC, on_trajectory
from mor.project.axes import ImageScale, UnitError, beyond, edge_transform, external, external_image, split
from mor.project.earth import PLANE, convergence_of_rows, known_at, needs_convergence, needs_place, place_of_observed
from mor.project.entities import Reading, Scanner
from mor.project.images import phase_constants
from mor.project.motion import EPOCH, at_their_epochs, row_epochs
from mor.project.rows import (
    CLUSTER,
    ReadGroup,
    Resolved,
    air_columns,
    check_different,
    corrected,
    group_name,
    instrument_blocks,
    named_things,
    note_points_under_instruments,
    own_or_common,
    planned_rows,
    resolve,
    sigma_is_good,
    with_own_height,
    without_required,
)
from mor.project.schema import Camera, Observations
from mor.project.tables import Column, Rows, TableLocation, number_column, read_table
from mor.project.trajectories import (
    NAVIGATION,
    TRAJECTORY,
    RowClocks,
    clocks_of_rows,
    navigation_columns,
    navigation_groups,
)
from mor.types import LARGEST, FloatArray, IntArray, SmallIntArray, pieces
from mor.units import IMAGE, LENGTH, Component, Quantity

# ---- Groups of image coordinates: split by camera model, converted when the camera is known.

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


def raw_image(name: str, required: bool) -> Column:
    """A column in the image unit of whichever camera: converted when the camera is known."""

    def plain(text: str, unit: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            raise UnitError(f"found {text!r}, expected a number (give units for the whole column: units: …)")
        if abs(value) > LARGEST:
            raise UnitError(beyond(text, value))
        return value

    return Column(name, parse=plain, factor=lambda unit: 1.0, required=required)


def image_groups(
    reading: Reading, entry: Observations, number: int, rows: Rows, place: TableLocation
) -> list[ReadGroup]:
    """One group for every camera and kind of image (single, stereo follower) of an entry."""
    images = reading.shop.things["image"]
    image, point = (named_things(reading, name, name, rows) for name in ("image", "point"))
    if (image.numbers < 0).any() or (point.numbers < 0).any():
        return []
    epochs = row_epochs(reading, rows, IMAGE_TYPES["mor"].references, (image, point))
    order = np.array([0, *(found.order for found in reading.trajectories.values())])[images.parts[TRAJECTORY] + 1]
    kinds = (images.parts["camera"] * 2 + (images.parts["relative rotation"] >= 0)) * (CUBIC + 1) + order
    keys = kinds.astype(np.int32)[image.numbers]
    result = []
    for key in np.unique(keys):
        chosen = kept(np.flatnonzero(keys == key))
        group = _image_group(reading, entry, number, rows, place, _taken(image, chosen), _taken(point, chosen), chosen)
        result += [replace(group, epochs=epochs[chosen])] if group is not None else []
    return result


def _taken(names: Names, rows: IntArray) -> Names:
    return Names(kept(names.numbers[rows]), names.known)


def _image_group(
    reading: Reading,
    entry: Observations,
    number: int,
    rows: Rows,
    place: TableLocation,
    image: Names,
    point: Names,
    chosen: IntArray,
) -> ReadGroup | None:
    images = reading.shop.things["image"]
    first = image.numbers[0]
    camera_name = reading.shop.things["camera"].ids[images.parts["camera"][first]]
    camera, scale = reading.project.cameras[camera_name], reading.scales[camera_name]
    follows = bool(images.parts["relative rotation"][first] >= 0)
    timed = bool(images.parts[TRAJECTORY][first] >= 0)
    scanner = reading.scanners.get(camera_name)
    moves = bool(images.parts["readout"][first] >= 0) and not follows
    if scanner is not None and follows:
        place.tell(f"image {image[0]!r} is of a line scanner; it cannot follow another one")
    if scanner is not None and (follows or not timed):
        return None  # its own mistake is told already
    try:
        observed, sigma, factors = _image_values(entry, rows, chosen, scale)
    except UnitError as error:
        place.tell(str(error), "units")
        return None
    if (moves or scanner is not None) and not _all_timed(camera, scanner, observed, rows, chosen):
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
    if not sigma_is_good(group, rows, chosen):
        return None
    return ReadGroup(group, number, chosen, np.eye(2), factors)


def _blocks_beside(reading: Reading, slots: Sequence[Slot], image: Names, point: Names) -> tuple[SmallIntArray, ...]:
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


def _all_timed(camera: Camera, scanner: Scanner | None, observed: FloatArray, rows: Rows, chosen: IntArray) -> bool:
    """False if a row has no coordinate along the readout, or of a line scanner lacks one; each is told."""
    missing = np.zeros(rows.count, dtype=bool)
    if scanner is not None:
        missing[chosen] = np.isnan(observed).any(axis=1)
        words = "a point in an image of a line scanner needs both coordinates: its row is its time"
    else:
        missing[chosen] = np.isnan(observed[:, int(camera.readout_direction in ("down", "up"))])
        words = "no row (or column) was measured along the readout of the camera: the point has no time"
    rows.tell_where(missing, words)
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
        return np.concatenate([observed, np.full((len(observed), len(model.constants)), r0)], axis=1)
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
        return entry.unit_of(name) or scale.coordinate_unit

    if unit("x") != unit("y"):
        raise UnitError("x and y must have the same unit")
    xy, sigma = empty((len(chosen), 2)), empty((len(chosen), 2))
    for some in pieces(len(chosen), 1_000_000):
        part = rows.take(chosen[some])
        xy[some] = scale.inwards(np.stack([part.number("x"), part.number("y")], axis=1), unit("x"))
        common = part.number("sigma") * scale.factor(unit("sigma"))
        own = (part.number(f"sigma_{c}") * scale.factor(unit(f"sigma_{c}")) for c in "xy")
        sigma[some] = np.stack([own_or_common(one, common) for one in own], axis=1)
    return xy, sigma, np.full(2, scale.factor(unit("sigma")))


# ---- Observation groups of a project: columns, names, units, σ and correlations, the same way for every type.


def read_groups(reading: Reading, of_features: bool = False) -> list[ReadGroup]:
    """Return the observation groups that are named by a type; images are split by camera model.

    Those between features are read when there are features, with ``of_features``, all others before.
    """
    result: list[ReadGroup] = []
    not_planned = "visible is for what is planned (mor design, mor simulate); here a file or rows are expected"
    no_length = (
        "found ppm for observations of type {}; ppm needs lengths between two points, as of type distance, "
        "height_difference or coordinate_difference: σ grows with the distance between them"
    )
    for number, entry in enumerate(reading.project.observations):
        place = reading.at("observations", number)
        if entry.type in ("parameter", "difference") or (entry.type in RELATION_TYPES) != of_features:
            continue
        if entry.type != "image" and entry.type not in NAVIGATION and entry.type not in reading.types:
            if reading.project.world is None or reading.world is not None or entry.type not in EARTH_TYPES:
                place.tell(_unknown_type(reading, entry.type), "type")
            continue
        if entry.type in NAVIGATION:
            columns = navigation_columns(entry.type, reading.edge)
            rows = read_table(entry, columns, place)
            result += navigation_groups(reading, entry, number, rows, place) if rows is not None else []
            reading.watch(entry.file)
            continue
        if entry.visible is not None:
            if not reading.planned or reading.section == "checks":
                place.tell(not_planned, "visible")
            continue
        type_ = IMAGE_TYPES["mor"] if entry.type == "image" else reading.types[entry.type]
        if is_open(type_) or entry.projection is not None:
            found = _in_projection(reading, entry, type_, place)
            if found is None:
                continue
            type_ = found
        if entry.ppm and not (type_.distances is not None and any(c.quantity.length == 1 for c in type_.components)):
            place.tell(no_length.format(entry.type), "ppm")
        if entry.type == "image":
            entry = units_of_values(entry)
        measured = [component.name for component in type_.components]
        columns = observation_columns(type_, reading)
        if reading.planned:
            columns = without_required(columns, measured)
        rows = read_table(entry, columns, place)
        if rows is None:
            continue
        if reading.planned:
            rows = planned_rows(rows, measured, reading, group_name(entry, number))
        if needs_convergence(type_):
            from mor.project.earth import with_convergence_at_images  # most projects need nothing of it

            in_plane = with_convergence_at_images(reading, type_, rows, place)
            if in_plane is None:
                continue
            type_ = in_plane
        if entry.type == "image":
            result += image_groups(reading, entry, number, rows, place)
        else:
            group = _plain_group(reading, entry, number, type_, rows, place)
            result += [group] if group is not None else []
        reading.watch(entry.file)
    return at_their_epochs(reading, result)


def _in_projection(
    reading: Reading, entry: Observations, type_: ObservationType, place: TableLocation
) -> ObservationType | None:
    """The type in the projection that it refers to; ``None`` if there is a mistake in that."""
    if not is_open(type_):
        place.tell(f"projection: {entry.type} refers to none; expected it with projected_bearing", "projection")
        return None
    from mor.project.earth import in_its_projection  # most projects need nothing of it

    return in_its_projection(reading, entry, place)


def _unknown_type(reading: Reading, name: str) -> str:
    known = ("image", *reading.types, *NAVIGATION, "parameter", "difference")
    if reading.world is not None and name in NOT_ON_EARTH:
        return f"{name} does not say what it refers to on the earth, expected {NOT_ON_EARTH[name]}"
    if reading.world is None and name in EARTH_TYPES:
        return f"{name} needs to know where on the earth the network is: world: {{crs: …}}"
    return f"unknown observation type {name!r}{nearest(name, known)} (known: {', '.join(known)})"


def observation_columns(type_: ObservationType, reading: Reading) -> list[Column]:
    """Return the columns of a type: its references, its components with their σ, heights, face, covariances."""
    edge = reading.edge
    columns = [Column(reference.name, required=True) for reference in type_.references]
    is_image = type_.components[0].quantity == IMAGE

    def numbers(name: str, quantity: Quantity, required: bool = False) -> Column:
        return raw_image(name, required) if is_image else number_column(name, quantity, edge, required)

    for component in type_.components:
        columns.append(numbers(component.name, component.quantity, len(type_.components) == 1 or is_image))
        columns.append(numbers(f"sigma_{component.name}", component.quantity))
    columns.append(numbers("sigma", type_.components[0].quantity))
    for slot in type_.slots:
        if slot.part == "height" and slot.of != "image":
            columns.append(number_column(f"{slot.of}_height", LENGTH, edge))
    if any(constant.name == "face" for constant in type_.constants):
        columns.append(number_column("face", type_.constants[-1].quantity, edge))
    if type_.slots[0].of == "station":
        columns.append(Column("set"))
    columns.append(EPOCH)
    if type_.through_air:
        columns += air_columns(edge)
    if type_.key in _LEVELLED:
        columns.append(number_column(_LINE, LENGTH, edge))
    if needs_place(type_):
        columns.append(number_column(GEOID, LENGTH, edge))
    if needs_convergence(type_):
        columns += [number_column(name, LENGTH, edge) for name in PLANE]
    if not is_image:
        columns.append(Column(CLUSTER))
    if len(type_.components) == 3:
        pairs = combinations_with_replacement(type_.components, 2)
        columns += [_covariance_column(a, b, reading) for a, b in pairs]
    return columns


_LEVELLED = ("height_difference", "ellipsoidal_height_difference")
_LINE = "length"
"""Column with the length of a levelling line, whose σ is then that of 1 km."""


def _covariance_column(a: Component, b: Component, reading: Reading) -> Column:
    def parse(text: str, unit: str) -> float:
        number, own = split(text)
        if own:
            raise UnitError(f"found {text!r}, expected a plain number in the square of the unit of {a.name}")
        return number * factor(unit)

    def factor(unit: str) -> float:
        return reading.edge.factor(a.quantity, unit) * reading.edge.factor(b.quantity, unit)

    return Column(f"cov_{a.name}_{b.name}", parse=parse, factor=factor)


def _plain_group(
    reading: Reading, entry: Observations, number: int, type_: ObservationType, rows: Rows, place: TableLocation
) -> ReadGroup | None:
    named = {reference.name: resolve(reading, reference, rows) for reference in type_.references}
    different = check_different(type_, rows)
    instrument = instrument_blocks(reading, entry, place)
    if not different or not instrument or not all(found.blocks for found in named.values()):
        return None
    blocks = tuple(
        np.full(rows.count, _of_instrument(reading, instrument, slot), dtype=np.int64)
        if slot.of == "instrument"
        else with_own_height(reading, rows, slot.of, named[slot.of].blocks[slot.part], number)
        if slot.part == "height"
        else named[slot.of].blocks[slot.part]
        for slot in type_.slots
    )
    note_points_under_instruments(reading, type_, named, rows)
    given = np.stack([rows.number(component.name) for component in type_.components], axis=1)
    constants = _constants_of_group(reading, type_, rows, given, named)
    if type_.through_air:
        given = corrected(reading, entry, rows, given, place)
    if any(found.at_centre.any() for found in named.values()):
        type_ = to_projection_centres(type_) if reading.world or reading.sphere else PROJECTION_CENTRE_TYPES[type_.key]
        blocks += tuple(_arm(reading, named[slot.of], slot.part) for slot in type_.slots[len(blocks) :])
    transform, offset = edge_transform(type_, reading.edge)
    for k, component in enumerate(type_.components):
        if component.name == "distance":
            rows.tell_where(given[:, k] < 0.0, "found a negative distance, expected one above 0")
    sigma = _sigma(rows, type_)
    if type_.key in _LEVELLED:
        # (n, 1) factors of σ, √(length / 1 km); 1 where no length is given.
        length = rows.number(_LINE)
        rows.tell_where(length <= 0.0, "found a length of 0 or less, expected one above 0")
        kilometres = np.where(length > 0.0, length, np.nan) * reading.edge.metres / 1000.0
        sigma = sigma * np.sqrt(np.where(np.isnan(kilometres), 1.0, kilometres))[:, None]
    group = ObservationGroup(
        name=group_name(entry, number),
        type=type_,
        blocks=blocks,
        observed=_turn(given, transform) + offset,
        sigma=_turn(sigma * entry.factor, np.abs(transform)),
        constants=constants,
        references=tuple(named[reference.name].names for reference in type_.references),
        ppm=entry.ppm * entry.factor,
        centring=_centring(reading, entry, place),
        external=external(type_, reading.edge),
        lines=rows.lines,
        file=rows.file,
    )
    everything, clusters = np.arange(rows.count), _clusters(entry, rows, place)
    rows.tell_where(~np.asarray(group.mask.any(axis=1)), "nothing is observed in this row")
    correlated = entry.covariance is not None or entry.cluster is not None or _has_covariances(rows)
    if correlated:
        group = replace(group, sigma=np.where(group.mask & np.isnan(group.sigma), 1.0, group.sigma))
    elif not sigma_is_good(group, rows, everything):
        return None
    factors = np.array([_sigma_factor(reading, entry, c) for c in type_.components])
    epochs = row_epochs(reading, rows, type_.references, group.references)
    return ReadGroup(group, number, everything, transform, factors, covariance_of_rows(rows, type_), clusters, epochs)


def _clusters(entry: Observations, rows: Rows, place: TableLocation) -> Names | None:
    if CLUSTER not in rows.texts:
        return None
    if entry.covariance is None or entry.cluster is not None:
        place.tell("column cluster: it needs the covariances of this table (key covariance), and no key cluster")
        return None
    rows.tell_where((rows.series(CLUSTER) == "").to_numpy(), "cluster is empty")
    return rows.names(CLUSTER)


def _of_instrument(reading: Reading, instrument: Mapping[str, int], slot: Slot) -> int:
    block = instrument[slot.part]
    return reading.shop.neutral(slot.kind) if block < 0 else block


def _arm(reading: Reading, found: Resolved, part: str) -> IntArray:
    neutral = 0 if part in ("height", "eccentricity") else reading.shop.neutral(part)
    own = found.blocks.get(part, np.full(len(found.at_centre), -1, dtype=np.int64))
    return np.where(found.at_centre & (own >= 0), own, neutral)


def _sigma_factor(reading: Reading, entry: Observations, component: Component) -> float:
    try:
        return reading.edge.factor(component.quantity, entry.unit_of("sigma", component.name))
    except UnitError:
        return reading.edge.factor(component.quantity, "")


def _turn(values: FloatArray, transform: FloatArray) -> FloatArray:
    """Rows times a signed permutation, NaN staying where it is carried to."""
    source = np.argmax(np.abs(transform), axis=1)
    return np.asarray(values[:, source] * transform[np.arange(len(transform)), source])


def _sigma(rows: Rows, type_: ObservationType) -> FloatArray:
    common = rows.number("sigma")
    return np.stack([own_or_common(rows.number(f"sigma_{c.name}"), common) for c in type_.components], axis=1)


def _has_covariances(rows: Rows) -> bool:
    return any(name.startswith("cov_") for name in rows.numbers)


def covariance_of_rows(rows: Rows, type_: ObservationType) -> FloatArray | None:
    """(n, 3, 3) covariances given column by column, or ``None``.

    A variance that has no column, or no value in it, is the square of the σ of its component, where that is given.
    """
    if not _has_covariances(rows):
        return None
    size = len(type_.components)
    sigma = _sigma(rows, type_)
    result = np.zeros((rows.count, size, size))
    names = [component.name for component in type_.components]
    for i, a in enumerate(names):
        for j, b in enumerate(names[i:], start=i):
            given = rows.number(f"cov_{a}_{b}")
            if i == j:
                given = np.where(np.isnan(given), sigma[:, i] ** 2, given)
            result[:, i, j] = result[:, j, i] = np.nan_to_num(given)
    return result


def _constants_of_group(
    reading: Reading, type_: ObservationType, rows: Rows, given: FloatArray, named: Mapping[str, Resolved]
) -> FloatArray:
    """Constants of a type: earth radius in the project's unit; the face, given or told by the vertical circle.

    On the earth also what is known of the places it names: deflections, geoid heights.
    """
    columns: list[FloatArray] = []
    if reading.world is not None and needs_place(type_):
        return place_of_observed(reading, reading.world, named["point"].blocks["position"], rows, given)
    if reading.world is not None and needs_convergence(type_):
        return convergence_of_rows(reading.world, rows)[:, None]
    for constant in type_.constants:
        known, _, end = constant.name.partition(" of ")
        if end and reading.world is not None:
            found = named[end]
            columns.append(known_at(reading.world, known, found.blocks["position"], rows, found.names))
        elif constant.name == "face":
            told = type_.tell_face(given[:, -1]) if type_.tell_face else np.ones(rows.count)
            columns.append(own_or_common(rows.number("face"), told))
        else:
            columns.append(np.full(rows.count, constant.default / reading.edge.metres))
    return np.stack(columns, axis=1) if columns else np.zeros((rows.count, 0))


def _centring(reading: Reading, entry: Observations, place: TableLocation) -> SetUpSigmas:
    given = entry.centring
    if given is None:
        return SetUpSigmas()
    texts = (given.instrument, given.target, given.instrument_height, given.target_height)
    try:
        return SetUpSigmas(*(reading.edge.number(text, LENGTH) for text in texts))
    except UnitError as error:
        place.tell(f"centring: {error}", "centring")
        return SetUpSigmas()


# ---- Sets of directions: what a set with an orientation of its own needs to say anything.


def check_direction_sets(reading: Reading, groups: Sequence[ObservationGroup]) -> None:
    """Report sets whose orientation is unknown and that have no horizontal target; note those that have a single one.

    Sets are counted by their rotation, over all observation groups. A single direction only determines its own
    orientation: its redundancy number is 0, and nothing else depends on it.
    """
    free = reading.shop.store("rotation").all_free()[:, 2].copy()
    for group in groups:
        if group.type.key in ("observed/rotation", "difference/rotation"):
            for blocks in group.blocks:
                free[blocks] = False
    of_directions = [group for group in groups if group.type.key in ("directions", "zenith_directions")]
    if not of_directions or not free.any():
        return
    rotation = np.concatenate([group.blocks[1] for group in of_directions])
    target = np.concatenate([group.blocks[3] for group in of_directions])
    horizontal = np.concatenate([np.isfinite(group.observed[:, 0]) for group in of_directions])
    different = np.unique(np.stack([rotation[horizontal], target[horizontal]]), axis=1)
    count = np.bincount(different[0], minlength=len(free))
    numbers, first = np.unique(rotation, return_index=True)
    poor = free[numbers] & (count[numbers] < 2)
    starts = np.cumsum([0, *(group.count for group in of_directions)])
    no_target = (
        "station {} has no horizontal direction to orient its circle; use type zenith_angle for zenith angles "
        "alone, and vertical_direction for vertical directions alone"
    )
    one_target = (
        "the set of directions at {} has only one horizontal target: it determines its own orientation and nothing else"
    )
    for place, number in sorted(zip(first[poor].tolist(), numbers[poor].tolist(), strict=True)):
        g = int(np.searchsorted(starts, place, side="right")) - 1
        group, row = of_directions[g], place - int(starts[g])
        words, told = (one_target, reading.notes) if count[number] else (no_target, reading.problems)
        told.append(group.message(row, words.format(repr(group.references[0][row]))))


# ---- Observations that a plan might have besides: they are read like all others, and take no part in the adjustment.


def candidate_groups(reading: Reading) -> tuple[ObservationGroup, ...]:
    """Groups of the section ``candidates``, whose values are planned. Correlations between them are mistakes."""
    if not reading.project.candidates:
        return ()
    for number, entry in enumerate(reading.project.candidates):
        if entry.covariance is not None or entry.cluster is not None:
            reading.at("candidates", number).tell("candidates are uncorrelated; give each a σ")
    project = reading.project.model_copy(update={"observations": reading.project.candidates})
    apart = replace(reading, project=project, section="candidates", planned=True, unmeasured=[])
    known = len(reading.problems)
    groups = [found for found in read_groups(apart) if len(reading.problems) == known]
    for found in groups:
        if found.covariances is not None:
            reading.at("candidates", found.entry).tell("candidates are uncorrelated; give each a σ, not covariances")
    return tuple(found.group for found in groups)


# ---- Check points, check distances and other observations that are kept out of the adjustment.


def check_groups(reading: Reading, groups: list[ObservationGroup]) -> tuple[ObservationGroup, ...]:
    """Groups of the section ``checks``; ``groups`` are those that take part in the adjustment.

    A point that only checks look at cannot be checked: that is a mistake.
    """
    if not reading.project.checks:
        return ()
    project = reading.project.model_copy(update={"observations": reading.project.checks})
    apart = replace(reading, project=project, section="checks")
    checks = tuple(group.group for group in read_groups(apart))
    if reading.broken:
        return checks  # what is missing may be told by what could not be read
    points = reading.shop.store("point")
    seen = np.zeros(len(points.ids), dtype=bool)
    for group in groups:
        for blocks in group.blocks_of("point"):
            seen[blocks] = True
    free = np.asarray(points.all_free().any(axis=1))
    for group in checks:
        for blocks in group.blocks_of("point"):
            for row in np.flatnonzero(free[blocks] & ~seen[blocks]).tolist():
                words = f"point {points.ids[blocks[row]]!r} is a check point, but nothing determines it"
                reading.problems.append(group.message(row, words))
    return checks
