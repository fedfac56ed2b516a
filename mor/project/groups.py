"""Observation groups of a project: columns, names, units, σ and correlations, the same way for every type."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mor.errors import Problem, nearest
from mor.geometry.arrays import FloatArray, IntArray
from mor.geometry.cameras import CAMERA_MODELS
from mor.observations import (
    FOLLOWER_TYPES,
    IMAGE_TYPES,
    PLAIN_TYPES,
    ObservationGroup,
    ObservationType,
    Reference,
)
from mor.project.axes import edge_transform, external, external_image
from mor.project.edge import ImageScale, UnitError
from mor.project.entities import unknown_name
from mor.project.model import Observations
from mor.project.reading import Reading
from mor.project.statuses import number_column
from mor.project.tables import Column, Place, Rows, read_table
from mor.units import IMAGE, LENGTH, Component

TYPE_NAMES = ("image", *PLAIN_TYPES)


@dataclass(frozen=True)
class Group:
    """A group as read, and what its correlations refer to."""

    group: ObservationGroup
    entry: int
    """Number of the observation entry in the project."""
    rows: IntArray
    """Rows of the entry's table."""
    transform: FloatArray
    """(m, m) from the components as given to internal ones."""
    factors: FloatArray
    """(m,) internal units per unit of the σ as given."""
    covariances: FloatArray | None = None
    """(n, m, m) covariances given row by row, internal units but project axes."""


def read_groups(reading: Reading) -> list[Group]:
    """All observation groups that are named by a type; images are split by camera model."""
    result: list[Group] = []
    for number, entry in enumerate(reading.project.observations):
        place = reading.at("observations", number)
        if entry.type in ("parameter", "difference"):
            continue
        if entry.type not in TYPE_NAMES:
            known = (*TYPE_NAMES, "parameter", "difference")
            words = f"unknown observation type {entry.type!r}{nearest(entry.type, known)} (known: {', '.join(known)})"
            reading.problems.append(place.problem(words, "type"))
            continue
        type_ = IMAGE_TYPES["mor"] if entry.type == "image" else PLAIN_TYPES[entry.type]
        if entry.type == "image":
            entry = _units_of_values(entry)
        rows = read_table(entry, _columns(type_, reading), place, reading.problems)
        if rows is None:
            continue
        if entry.type == "image":
            result += _image_groups(reading, entry, number, rows, place)
        else:
            group = _plain_group(reading, entry, number, type_, rows, place)
            result += [group] if group is not None else []
    return result


def _columns(type_: ObservationType, reading: Reading) -> list[Column]:
    """Columns of a type: its references, its components with their σ, heights, face, covariances."""
    edge = reading.edge
    columns = [Column(reference.name, required=True) for reference in type_.references]
    raw = _raw_image if type_.components[0].quantity == IMAGE else None
    for component in type_.components:
        required = len(type_.components) == 1 or raw is not None
        columns.append(
            raw(component.name, required)
            if raw
            else number_column(component.name, component.quantity, edge, required=required)
        )
        name = f"sigma_{component.name}"
        columns.append(raw(name) if raw else number_column(name, component.quantity, edge))
    common = raw("sigma") if raw else number_column("sigma", type_.components[0].quantity, edge)
    columns.append(common)
    for slot in type_.slots:
        if slot.part == "height" and slot.of != "image":
            columns.append(number_column(f"{slot.of}_height", LENGTH, edge))
    if any(constant.name == "face" for constant in type_.constants):
        columns.append(number_column("face", type_.constants[-1].quantity, edge))
    if type_.slots[0].of == "station":
        columns.append(Column("set"))
    if len(type_.components) == 3:
        columns += [_covariance_column(a, b, reading) for a, b in _upper(type_.components)]
    return columns


def _units_of_values(entry: Observations) -> Observations:
    """``values: {sigma: 0.5 um}`` as a number and a unit: image units are converted when the camera is known."""
    values, units = dict(entry.values), entry.units
    for name, text in entry.values.items():
        number, _, unit = text.strip().partition(" ")
        if unit and name.startswith("sigma") and not isinstance(units, str):
            values[name], units = number, {**units, name: unit.strip()}
    return entry.model_copy(update={"values": values, "units": units})


def _raw_image(name: str, required: bool = False) -> Column:
    """A column in the image unit of whichever camera: converted when the camera is known."""

    def plain(text: str, unit: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            raise UnitError(f"found {text!r}, expected a number")
        return value

    return Column(name, parse=plain, factor=lambda unit: 1.0, required=required)


def _upper(components: Sequence[Component]) -> Iterable[tuple[Component, Component]]:
    for i, a in enumerate(components):
        for b in components[i:]:
            yield a, b


def _covariance_column(a: Component, b: Component, reading: Reading) -> Column:
    def parse(text: str, unit: str) -> float:
        factor = reading.edge.factor(a.quantity, unit) * reading.edge.factor(b.quantity, unit)
        return float(text) * factor

    return Column(f"cov_{a.name}_{b.name}", parse=parse)


def _image_groups(
    reading: Reading, entry: Observations, number: int, rows: Rows, place: Place
) -> list[Group]:
    images, points = reading.shop.things["image"], reading.shop.things["point"]
    image = _numbers("image", rows.text("image"), images.numbers, rows, reading.problems)
    point = _numbers("point", rows.text("point"), points.numbers, rows, reading.problems)
    if (image < 0).any() or (point < 0).any():
        return []
    follows = images.parts["relative rotation"][image] >= 0
    keys = images.parts["camera"][image] * 2 + follows
    result = []
    for key in np.unique(keys):
        chosen = np.flatnonzero(keys == key)
        group = _image_group(reading, entry, number, rows, place, image[chosen], point[chosen], chosen)
        result += [group] if group is not None else []
    return result


def _image_group(
    reading: Reading,
    entry: Observations,
    number: int,
    rows: Rows,
    place: Place,
    image: IntArray,
    point: IntArray,
    chosen: IntArray,
) -> Group | None:
    images, points = reading.shop.things["image"], reading.shop.things["point"]
    camera_name = reading.shop.things["camera"].ids[images.parts["camera"][image[0]]]
    camera, scale = reading.project.cameras[camera_name], reading.scales[camera_name]
    follows = bool(images.parts["relative rotation"][image[0]] >= 0)
    type_ = (FOLLOWER_TYPES if follows else IMAGE_TYPES)[camera.model]
    try:
        observed, sigma, factors = _image_values(entry, rows, chosen, scale)
    except UnitError as error:
        reading.problems.append(place.problem(str(error), "units"))
        return None
    if not _sigma_is_good(sigma, observed, rows, chosen, reading.problems):
        return None
    constants = np.concatenate([observed, np.zeros((len(chosen), len(type_.constants) - 2))], axis=1)
    if CAMERA_MODELS[camera.model].constants and camera.r0 is not None:
        constants[:, 2] = reading.edge.number(camera.r0, IMAGE, "", scale)
    blocks = tuple(
        points.parts["position"][point] if slot.of == "point" else images.parts[slot.part][image]
        for slot in type_.slots
    )
    group = ObservationGroup(
        name=_name(entry, number),
        type=type_,
        blocks=blocks,
        observed=observed,
        sigma=sigma * entry.factor,
        constants=constants,
        references=(_chosen(rows.text("image"), chosen), _chosen(rows.text("point"), chosen)),
        external=external_image(scale),
        image_unit=scale.unit,
        lines=rows.lines[chosen],
        file=rows.file,
    )
    return Group(group, number, chosen, np.eye(2), factors)


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
        [_own(rows.number(f"sigma_{c}")[chosen] * scale.factor(unit(f"sigma_{c}")), common) for c in "xy"],
        axis=1,
    )
    factors = np.full(2, scale.factor(unit("sigma")))
    return scale.inwards(xy, unit("x")), sigma, factors


def _own(own: FloatArray, common: FloatArray) -> FloatArray:
    return np.where(np.isnan(own), common, own)


def _plain_group(
    reading: Reading, entry: Observations, number: int, type_: ObservationType, rows: Rows, place: Place
) -> Group | None:
    before = len(reading.problems)
    named = {reference.name: _resolve(reading, reference, rows) for reference in type_.references}
    _check_different(type_, rows, reading.problems)
    instrument = _instrument(reading, entry, place)
    if len(reading.problems) > before:
        return None
    blocks = tuple(
        np.full(rows.count, instrument[slot.part], dtype=np.int64)
        if slot.of == "instrument"
        else _with_own_height(reading, rows, slot.of, named[slot.of][slot.part], number)
        if slot.part == "height"
        else named[slot.of][slot.part]
        for slot in type_.slots
    )
    transform, offset = edge_transform(type_, reading.edge)
    given = np.stack([rows.number(component.name) for component in type_.components], axis=1)
    sigma = _sigma(rows, type_)
    group = ObservationGroup(
        name=_name(entry, number),
        type=type_,
        blocks=blocks,
        observed=_turn(given, transform) + offset,
        sigma=_turn(sigma * entry.factor, np.abs(transform)),
        constants=_constants(reading, type_, rows, given),
        references=tuple(tuple(rows.text(reference.name)) for reference in type_.references),
        ppm=entry.ppm * entry.factor,
        centring=_centring(reading, entry, place),
        external=external(type_, reading.edge),
        lines=rows.lines,
        file=rows.file,
    )
    everything = np.arange(rows.count)
    if not group.mask.any(axis=1).all():
        for i in np.flatnonzero(~group.mask.any(axis=1)):
            reading.problems.append(Problem("nothing is observed in this row", rows.file, int(rows.lines[i])))
    correlated = entry.covariance is not None or entry.cluster is not None or _has_covariances(rows, type_)
    if correlated:
        group = replace(group, sigma=np.where(group.mask & np.isnan(group.sigma), 1.0, group.sigma))
    elif not _sigma_is_good(group.sigma, group.observed, rows, everything, reading.problems):
        return None
    factors = np.array([_sigma_factor(reading, entry, c) for c in type_.components])
    return Group(group, number, everything, transform, factors, covariance_of_rows(rows, type_))


def _sigma_factor(reading: Reading, entry: Observations, component: Component) -> float:
    unit = (
        entry.units
        if isinstance(entry.units, str)
        else entry.units.get("sigma", entry.units.get(component.name, ""))
    )
    try:
        return reading.edge.factor(component.quantity, unit)
    except UnitError:
        return reading.edge.factor(component.quantity, "")


def _turn(values: FloatArray, transform: FloatArray) -> FloatArray:
    """Rows times a signed permutation, NaN staying where it is carried to."""
    source = np.argmax(np.abs(transform), axis=1)
    return values[:, source] * transform[np.arange(len(transform)), source]


def _sigma(rows: Rows, type_: ObservationType) -> FloatArray:
    common = rows.number("sigma")
    return np.stack([_own(rows.number(f"sigma_{c.name}"), common) for c in type_.components], axis=1)


def _has_covariances(rows: Rows, type_: ObservationType) -> bool:
    return any(name.startswith("cov_") for name in rows.numbers)


def covariance_of_rows(rows: Rows, type_: ObservationType) -> FloatArray | None:
    """(n, 3, 3) covariances given column by column, or ``None``."""
    if not _has_covariances(rows, type_):
        return None
    size = len(type_.components)
    result = np.zeros((rows.count, size, size))
    names = [component.name for component in type_.components]
    for i, a in enumerate(names):
        for j, b in enumerate(names[i:], start=i):
            result[:, i, j] = result[:, j, i] = np.nan_to_num(rows.number(f"cov_{a}_{b}"))
    return result


def _constants(reading: Reading, type_: ObservationType, rows: Rows, given: FloatArray) -> FloatArray:
    """Constants of a type: earth radius in the project's unit; the face, given or told by the vertical circle."""
    columns = []
    for constant in type_.constants:
        if constant.name == "face":
            vertical = given[:, -1]
            told = np.where(np.nan_to_num(vertical) > np.pi, 2.0, 1.0)
            columns.append(_own(rows.number("face"), told))
        else:
            columns.append(np.full(rows.count, constant.default / reading.edge.metres))
    return np.stack(columns, axis=1) if columns else np.zeros((rows.count, 0))


def _centring(reading: Reading, entry: Observations, place: Place) -> tuple[float, float]:
    if entry.centring is None:
        return 0.0, 0.0
    try:
        instrument = reading.edge.number(entry.centring.instrument, LENGTH)
        return instrument, reading.edge.number(entry.centring.target, LENGTH)
    except UnitError as error:
        reading.problems.append(place.problem(f"centring: {error}", "centring"))
        return 0.0, 0.0


def _instrument(reading: Reading, entry: Observations, place: Place) -> dict[str, int]:
    instruments = reading.shop.things["instrument"]
    if entry.instrument is None:
        return {"distance meter": 0, "refraction": 0}
    if entry.instrument not in instruments.numbers:
        words = unknown_name("instrument", entry.instrument, instruments.ids)
        reading.problems.append(place.problem(words, "instrument"))
        return {}
    return {part: instruments.part(entry.instrument, part) for part in instruments.parts}


def _resolve(reading: Reading, reference: Reference, rows: Rows) -> dict[str, IntArray]:
    """Blocks behind the names of one column, by part."""
    names = rows.text(reference.name)
    if reference.among[0] == "station":
        names = _stations_on_points(reading, names, rows)
    distinct = dict.fromkeys(names)
    found: dict[str, dict[str, int]] = {}
    for name in distinct:
        parts = _look_up(reading, reference, name)
        if parts is None:
            line = int(rows.lines[names.index(name)])
            known = [n for space in reference.among for n in reading.shop.things[space].ids]
            reading.problems.append(Problem(unknown_name(reference.name, name, known), rows.file, line))
        else:
            found[name] = parts
    if len(found) < len(distinct):
        return {}
    parts_known = found[names[0]].keys()
    return {part: np.array([found[name][part] for name in names], dtype=np.int64) for part in parts_known}


def _look_up(reading: Reading, reference: Reference, name: str) -> dict[str, int] | None:
    for space in reference.among:
        things = reading.shop.things[space]
        bare = name.removeprefix(f"{space}:")
        if bare in things.numbers:
            return {part: things.part(bare, part) for part in things.parts}
    return None


def _stations_on_points(reading: Reading, names: list[str], rows: Rows) -> list[str]:
    """Names of stations; a point (or another set on a station) becomes a levelled station of its own."""
    shop = reading.shop
    sets = rows.text("set")
    full = [f"{name}/{set_}" if set_ else name for name, set_ in zip(names, sets, strict=True)]
    stations = shop.things["station"]
    for name, complete in dict.fromkeys(zip(names, full, strict=True)):
        if complete in stations.numbers:
            continue
        source = stations if name in stations.numbers else shop.things["point"]
        if name not in source.numbers:
            continue
        label = f"station {complete}"
        kappa = np.array([[0.0, 0.0, np.nan]])
        rotation = shop.store("rotation").add(
            [label], kappa, np.array([[False, False, True]]), np.full((1, 3), np.nan)
        )
        parts = {
            "position": np.append(stations.parts["position"], source.part(name, "position")),
            "height": np.append(stations.parts["height"], source.part(name, "height")),
            "rotation": np.append(stations.parts["rotation"], rotation),
        }
        stations = replace(
            stations,
            ids=(*stations.ids, complete),
            parts=parts,
            numbers={**stations.numbers, complete: len(stations.ids)},
        )
    shop.things["station"] = stations
    return full


def _with_own_height(reading: Reading, rows: Rows, of: str, heights: IntArray, number: int) -> IntArray:
    """Height blocks, where a row says its own: one fixed block for every different value."""
    given = rows.number(f"{of}_height")
    result = heights.copy()
    known = np.flatnonzero(np.isfinite(given))
    if len(known) == 0:
        return result
    values, inverse = np.unique(given[known], return_inverse=True)
    names = [f"observations {number + 1} {of} {value:g}" for value in values]
    blocks = reading.shop.store("height").add(
        names, values[:, None], np.zeros((len(values), 1), dtype=bool), np.full((len(values), 1), np.nan)
    )
    result[known] = blocks[inverse]
    return result


def _check_different(type_: ObservationType, rows: Rows, problems: list[Problem]) -> None:
    """An observation between a place and itself, or an angle with two equal targets."""
    names = [reference.name for reference in type_.references if reference.name not in ("system", "frame")]
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            for one, other, line in zip(rows.text(a), rows.text(b), rows.lines, strict=True):
                if one == other:
                    words = f"{a} and {b} are the same: {one!r}; {type_.key} needs two different ones"
                    problems.append(Problem(words, rows.file, int(line)))


def _numbers(
    what: str, names: list[str], known: dict[str, int] | object, rows: Rows, problems: list[Problem]
) -> IntArray:
    table: dict[str, int] = known  # type: ignore[assignment]
    result = np.fromiter((table.get(name, -1) for name in names), dtype=np.int64, count=len(names))
    reported: set[str] = set()
    for i in np.flatnonzero(result < 0):
        if names[i] not in reported:
            reported.add(names[i])
            problems.append(Problem(unknown_name(what, names[i], table), rows.file, int(rows.lines[i])))
    return result


def _sigma_is_good(
    sigma: FloatArray, observed: FloatArray, rows: Rows, chosen: IntArray, problems: list[Problem]
) -> bool:
    here = np.isfinite(observed)
    bad = here & ~(sigma > 0.0)
    for i in np.flatnonzero(bad.any(axis=1)):
        value = sigma[i][bad[i]][0]
        line = int(rows.lines[chosen[i]])
        if np.isnan(value):
            words = "no σ: give a column sigma, or values: {sigma: …} for all rows"
        elif value == 0.0:
            words = "found σ = 0, expected σ > 0 (what is exactly known is fixed, not observed)"
        else:
            words = f"found σ = {value:g}, expected σ > 0"
        problems.append(Problem(words, rows.file, line))
        if np.isnan(value) and bad.all():
            break
    return not bad.any()


def _name(entry: Observations, number: int) -> str:
    return entry.name or entry.file or f"{entry.type} {number + 1}"


def _chosen(names: list[str], chosen: IntArray) -> tuple[str, ...]:
    return tuple(names[i] for i in chosen)
