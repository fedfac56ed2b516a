"""Observation groups of a project: columns, names, units, σ and correlations, the same way for every type."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.errors import nearest
from mor.observations import (
    IMAGE_TYPES,
    PLAIN_TYPES,
    PROJECTION_CENTRE_TYPES,
    ObservationGroup,
    ObservationType,
    SetUp,
    Slot,
    to_projection_centres,
)
from mor.observations.earth import GEOID
from mor.observations.earth.catalogue import EARTH_TYPES, NOT_ON_EARTH
from mor.observations.earth.projected_bearing import is_open
from mor.observations.names import Names
from mor.project.axes import edge_transform, external
from mor.project.edge import UnitError, split
from mor.project.file.model import Observations
from mor.project.motion.epochs import EPOCH, row_epochs
from mor.project.motion.rows import at_their_epochs
from mor.project.network.reading import Reading
from mor.project.observations.atmosphere import air_columns, corrected
from mor.project.observations.image_groups import image_groups, raw_image, units_of_values
from mor.project.observations.instrument_heights import note_points_under_instruments, with_own_height
from mor.project.observations.names import Resolved, check_different, instrument_blocks, resolve
from mor.project.observations.observation_rows import CLUSTER, Group, group_name, own_or_common, sigma_is_good
from mor.project.observations.planned_rows import planned_rows, without_required
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import number_column
from mor.project.tables.tables import Column, Place, Rows, read_table
from mor.project.trajectories.navigation import NAVIGATION, navigation_columns, navigation_groups
from mor.project.world.observed import (
    PLANE,
    convergence_of_rows,
    known_at,
    needs_convergence,
    needs_place,
    place_of_observed,
)
from mor.units import IMAGE, LENGTH, Component

TYPE_NAMES = ("image", *PLAIN_TYPES)
"""Types of a project that is nowhere on the earth."""

_NOT_PLANNED = "visible is for what is planned (mor design, mor simulate); here a file or rows are expected"


def read_groups(reading: Reading) -> list[Group]:
    """All observation groups that are named by a type; images are split by camera model."""
    result: list[Group] = []
    for number, entry in enumerate(reading.project.observations):
        place = reading.at("observations", number)
        if entry.type in ("parameter", "difference"):
            continue
        if entry.type != "image" and entry.type not in NAVIGATION and entry.type not in reading.types:
            if reading.project.world is None or reading.world is not None or entry.type not in EARTH_TYPES:
                reading.problems.append(place.problem(_unknown_type(reading, entry.type), "type"))
            continue
        if entry.type in NAVIGATION:
            columns = navigation_columns(entry.type, reading.edge)
            rows = read_table(entry, columns, place, reading.problems)
            result += navigation_groups(reading, entry, number, rows, place) if rows is not None else []
            reading.watch(entry.file)
            continue
        if entry.visible is not None:
            if not reading.planned or reading.section == "checks":
                reading.problems.append(place.problem(_NOT_PLANNED, "visible"))
            continue
        type_ = IMAGE_TYPES["mor"] if entry.type == "image" else reading.types[entry.type]
        if is_open(type_) or entry.projection is not None:
            found = _in_projection(reading, entry, type_, place)
            if found is None:
                continue
            type_ = found
        if entry.ppm and not _grows(type_):
            reading.problems.append(place.problem(_NO_LENGTH.format(entry.type), "ppm"))
        if entry.type == "image":
            entry = units_of_values(entry)
        measured = [component.name for component in type_.components]
        columns = observation_columns(type_, reading)
        if reading.planned:
            columns = without_required(columns, measured)
        rows = read_table(entry, columns, place, reading.problems)
        if rows is None:
            continue
        if reading.planned:
            rows = planned_rows(rows, measured, reading, group_name(entry, number))
        if needs_convergence(type_):
            in_plane = _with_convergence(reading, type_, rows, place)
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
    reading: Reading, entry: Observations, type_: ObservationType, place: Place
) -> ObservationType | None:
    """The type in the projection that it refers to; ``None`` if there is a mistake in that."""
    if not is_open(type_):
        words = f"projection: {entry.type} refers to none; expected it with projected_bearing"
        reading.problems.append(place.problem(words, "projection"))
        return None
    from mor.project.world.plane import in_its_projection  # most projects need nothing of it

    return in_its_projection(reading, entry, place)


def _with_convergence(
    reading: Reading, type_: ObservationType, rows: Rows, place: Place
) -> ObservationType | None:
    from mor.project.world.plane import with_convergence_at_images  # most projects need nothing of it

    return with_convergence_at_images(reading, type_, rows, place)


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
    raw = raw_image if type_.components[0].quantity == IMAGE else None
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
    columns.append(EPOCH)
    if type_.through_air:
        columns += air_columns(edge)
    if needs_place(type_):
        columns.append(number_column(GEOID, LENGTH, edge))
    if needs_convergence(type_):
        columns += [number_column(name, LENGTH, edge) for name in PLANE]
    if raw is None:
        columns.append(Column(CLUSTER))
    if len(type_.components) == 3:
        columns += [_covariance_column(a, b, reading) for a, b in _upper(type_.components)]
    return columns


def _upper(components: Sequence[Component]) -> Iterable[tuple[Component, Component]]:
    for i, a in enumerate(components):
        for b in components[i:]:
            yield a, b


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
    reading: Reading, entry: Observations, number: int, type_: ObservationType, rows: Rows, place: Place
) -> Group | None:
    named = {reference.name: resolve(reading, reference, rows) for reference in type_.references}
    different = check_different(type_, rows, reading.problems)
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
    constants = _constants(reading, type_, rows, given, named)
    if type_.through_air:
        given = corrected(reading, entry, rows, given, place)
    if any(found.at_centre.any() for found in named.values()):
        type_ = (
            to_projection_centres(type_)
            if reading.world or reading.sphere
            else PROJECTION_CENTRE_TYPES[type_.key]
        )
        blocks += tuple(_arm(reading, named[slot.of], slot.part) for slot in type_.slots[len(blocks) :])
    transform, offset = edge_transform(type_, reading.edge)
    for k, component in enumerate(type_.components):
        if component.name == "distance":
            words = "found a negative distance, expected one above 0"
            tell_rows(reading.problems, given[:, k] < 0.0, rows, words)
    sigma = _sigma(rows, type_)
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
    everything, clusters = np.arange(rows.count), _clusters(entry, rows, place, reading)
    tell_rows(reading.problems, ~np.asarray(group.mask.any(axis=1)), rows, "nothing is observed in this row")
    correlated = entry.covariance is not None or entry.cluster is not None or _has_covariances(rows, type_)
    if correlated:
        group = replace(group, sigma=np.where(group.mask & np.isnan(group.sigma), 1.0, group.sigma))
    elif not sigma_is_good(group, rows, everything, reading.problems):
        return None
    factors = np.array([_sigma_factor(reading, entry, c) for c in type_.components])
    epochs = row_epochs(reading, rows, type_.references, group.references)
    own = covariance_of_rows(rows, type_)
    return Group(group, number, everything, transform, factors, own, clusters, epochs)


def _clusters(entry: Observations, rows: Rows, place: Place, reading: Reading) -> Names | None:
    """Names of the clusters that rows belong to, where a table says them."""
    if CLUSTER not in rows.texts:
        return None
    if entry.covariance is None or entry.cluster is not None:
        words = "column cluster: it needs the covariances of this table (key covariance), and no key cluster"
        reading.problems.append(place.problem(words))
        return None
    tell_rows(reading.problems, (rows.series(CLUSTER) == "").to_numpy(), rows, "cluster is empty")
    return rows.names(CLUSTER)


def _of_instrument(reading: Reading, instrument: Mapping[str, int], slot: Slot) -> int:
    """Block of an instrument, a neutral one where nothing is said of it."""
    block = instrument[slot.part]
    return reading.shop.neutral(slot.kind) if block < 0 else block


def _arm(reading: Reading, found: Resolved, part: str) -> IntArray:
    """Blocks that lead to the projection centres of one column, neutral ones where the name is none."""
    neutral = 0 if part in ("height", "eccentricity") else reading.shop.neutral(part)
    own = found.blocks.get(part, np.full(len(found.at_centre), -1, dtype=np.int64))
    return np.where(found.at_centre & (own >= 0), own, neutral)


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
    turned: FloatArray = values[:, source] * transform[np.arange(len(transform)), source]
    return turned


def _sigma(rows: Rows, type_: ObservationType) -> FloatArray:
    common = rows.number("sigma")
    return np.stack([own_or_common(rows.number(f"sigma_{c.name}"), common) for c in type_.components], axis=1)


def _has_covariances(rows: Rows, type_: ObservationType) -> bool:
    return any(name.startswith("cov_") for name in rows.numbers)


def covariance_of_rows(rows: Rows, type_: ObservationType) -> FloatArray | None:
    """(n, 3, 3) covariances given column by column, or ``None``.

    A variance that has no column, or no value in it, is the square of the σ of its component, where that is given.
    """
    if not _has_covariances(rows, type_):
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


def _constants(
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
            columns.append(
                known_at(reading, reading.world, known, found.blocks["position"], rows, found.names)
            )
        elif constant.name == "face":
            told = type_.tell_face(given[:, -1]) if type_.tell_face else np.ones(rows.count)
            columns.append(own_or_common(rows.number("face"), told))
        else:
            columns.append(np.full(rows.count, constant.default / reading.edge.metres))
    return np.stack(columns, axis=1) if columns else np.zeros((rows.count, 0))


_NO_LENGTH = (
    "found ppm for observations of type {}, expected it where lengths are measured between two points, "
    "as of type distance, height_difference or coordinate_difference: σ grows with the distance between them"
)


def _grows(type_: ObservationType) -> bool:
    """Return True if some component is a length measured between two places."""
    return type_.distances is not None and any(c.quantity.length == 1 for c in type_.components)


def _centring(reading: Reading, entry: Observations, place: Place) -> SetUp:
    given = entry.centring
    if given is None:
        return SetUp()
    texts = (given.instrument, given.target, given.instrument_height, given.target_height)
    try:
        return SetUp(*(reading.edge.number(text, LENGTH) for text in texts))
    except UnitError as error:
        reading.problems.append(place.problem(f"centring: {error}", "centring"))
        return SetUp()
