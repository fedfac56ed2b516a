"""Build the network of a project: entities, observations, correlations; and reduced networks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from mor.errors import InputError, Message, UndeterminedObject, counted
from mor.input_files import read_text
from mor.model.contract import PERFECT_SET_UP, ObservationGroup, some_rows
from mor.model.coordinates import AT_INFINITY, at_infinity, target_slot
from mor.model.earth import LocalSphere
from mor.model.parameters import Blocks, Values
from mor.model.rotations import rotation_from_angles
from mor.project.axes import SMALLEST_SIGMA, Edge, ImageScale, external
from mor.project.document import Document
from mor.project.earth import check_held_on_earth
from mor.project.entities import (
    Entities,
    Reading,
    RowTimes,
    TableWatcher,
    TimeModel,
    Trajectory,
    entities,
    ignore_table,
    table_label,
    unknown_name,
    workshop,
)
from mor.project.images import hold_what_images_have, read_cameras, read_images
from mor.project.motion import read_motions
from mor.project.observations import candidate_groups, check_direction_sets, check_groups, read_groups
from mor.project.points import read_points
from mor.project.prior_knowledge import (
    check_feasible,
    feature_groups,
    level_groups,
    parameter_groups,
    prior_groups,
    refuse_axes_of_spheres,
    variant_groups,
)
from mor.project.reference_system import EarthModel
from mor.project.rows import ReadGroup, check_undeclared, drop_unused_orientations, refuse_fixed
from mor.project.schema import Datum, Observations, ProjectFile
from mor.project.stations import read_instruments, read_pairs, read_stations, read_systems
from mor.project.tables import TableLocation
from mor.project.trajectories import read_trajectories, steadiness_groups
from mor.types import LARGEST, BoolArray, FloatArray, IntArray, SmallIntArray

# ---- One file of observations in two places of a project: its observations would count twice.


def refuse_files_named_twice(reading: Reading) -> None:
    """Add a mistake for each entry of ``observations`` or ``checks`` that reads the same values of a file again.

    Links and other spellings of a path lead to the same file. Entries may read different columns of one file, as
    directions and distances of one table do.
    """
    seen: dict[tuple[object, ...], int] = {}
    for section, entries in {
        "observations": list(reading.project.observations),
        "checks": list(reading.project.checks),
    }.items():
        for number, entry in enumerate(entries):
            if entry.file is None or reading.document.frame(str(entry.file)) is not None:
                continue
            path = reading.place.folder / str(entry.file)
            try:
                status = path.stat()
            except OSError:
                continue  # it is refused where it is read
            identity = (status.st_dev, status.st_ino) if status.st_ino else (path.resolve(),)
            key = (*identity, entry.type, *_read(entry))
            place = reading.at(section, number)
            line = reading.document.line((section, number, "file"))
            if key in seen:
                words = (
                    f"file {entry.file!r} is read already in line {seen[key]}, as {entry.type}: its observations "
                    "would count twice; remove one of the two"
                )
                place.tell(words, "file")
            else:
                seen[key] = line


def _read(entry: Observations) -> tuple[object, ...]:
    """Read an entry from its file: the renamed columns, and values that name what was observed."""
    columns = entry.columns
    if isinstance(columns, Mapping):
        renamed = {(theirs, ours) for theirs, ours in columns.items() if ours and ours != theirs}
    else:
        renamed = {(str(number), name) for number, name in enumerate(columns or ()) if name}
    common = {
        (name, value)
        for name, value in entry.values.items()
        # Common values that do not say between what was observed.
        if not name.startswith("sigma") and name not in {"epoch", "time"}
    }
    return tuple(sorted(renamed)), tuple(sorted(common))


# ---- Correlated observations: covariances by row, by clusters of rows, by group, or over groups of one cluster.


class Correlation(NamedTuple):
    """Entries of observation groups and their covariance matrix, internal units and axes."""

    groups: IntArray
    rows: IntArray
    components: IntArray
    covariance: FloatArray

    def taken(self, kept: Sequence[BoolArray]) -> Correlation:
        """Return the entries in the rows (n,) of each group that are kept."""
        stays = np.array([kept[g][r] for g, r in zip(self.groups, self.rows, strict=True)], dtype=bool)
        part = self.covariance[np.ix_(stays, stays)]
        return Correlation(self.groups[stays], self.rows[stays], self.components[stays], part)


def correlations(reading: Reading, groups: list[ReadGroup]) -> tuple[Correlation, ...]:
    """All correlated clusters of the groups, checked to be positive definite."""
    result: list[Correlation] = []
    clusters: dict[str, list[int]] = {}
    for number, group in enumerate(groups):
        entry = reading.project.observations[group.entry]
        if group.covariances is not None:
            result += _by_row(reading, groups, number)
        elif group.clusters is not None:
            result += _by_cluster(reading, groups, number)
        elif entry.cluster is not None:
            clusters.setdefault(entry.cluster, []).append(number)
        elif entry.covariance is not None:
            clusters.setdefault(f"\0{number}", []).append(number)
    for members in clusters.values():
        result += _over_groups(reading, groups, members)
    return tuple(result)


def _by_row(reading: Reading, groups: list[ReadGroup], number: int) -> list[Correlation]:
    group = groups[number]
    covariances = group.covariances
    assert covariances is not None
    observed = [np.flatnonzero(row) for row in group.group.mask]
    turned = [
        (group.transform @ given @ group.transform.T)[np.ix_(components, components)]
        for components, given in zip(observed, covariances, strict=True)
    ]
    flawless, result = _are_positive_definite(turned), []
    for i, (components, covariance) in enumerate(zip(observed, turned, strict=True)):
        words = "" if flawless else _not_positive_definite(covariance)
        if words:
            reading.problems.append(group.group.message(i, words))
            continue
        size = len(components)
        result.append(Correlation(np.full(size, number), np.full(size, i), components, covariance))
    return result


def _by_cluster(reading: Reading, groups: list[ReadGroup], number: int) -> list[Correlation]:
    """A matrix for the rows of each cluster: the rows of a covariance are those of its own cluster alone."""
    found = groups[number]
    place = reading.at("observations", found.entry)
    given = rows_of_covariance(reading.project.observations[found.entry], place)
    assert found.clusters is not None
    if given is None:
        return []
    where, rows, components = _entries_of_correlation(groups, number)
    members = members_of(found.clusters.numbers[rows])
    names = [found.clusters[int(rows[own[0]])] for own in members]
    wrong = wrong_rows(given, members, names)
    if wrong:
        place.tell(wrong, "covariance")
        return []
    turned = [
        _inside(groups, where[own], rows[own], components[own], np.array([given[k] for k in own.tolist()], dtype=float))
        for own in members
    ]
    flawless, result = _are_positive_definite(turned), []
    for name, own, covariance in zip(names, members, turned, strict=True):
        words = "" if flawless else _not_positive_definite(covariance)
        if words:
            place.tell(f"cluster {name!r}: {words}", "covariance")
        result.append(Correlation(where[own], rows[own], components[own], covariance))
    return result


def members_of(clusters: IntArray | SmallIntArray) -> list[IntArray]:
    """Entries of each cluster, in their order, by the number of the cluster that each (n,) belongs to."""
    order = np.argsort(clusters, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(clusters[order])) + 1)


def wrong_rows(given: Sequence[Sequence[float]], members: list[IntArray], names: Sequence[str]) -> str:
    """Return words for wrong lengths of the rows of the matrices of clusters; empty if all are right."""
    count = sum(map(len, members))
    if len(given) != count:
        return f"covariance: found {len(given)} rows, expected {count}, one for each observation"
    for name, own in zip(names, members, strict=True):
        for k in own.tolist():
            if len(given[k]) != len(own):
                found, expected = len(given[k]), len(own)
                return (
                    f"covariance: found {found} values in row {k + 1}, expected {expected}, as many as cluster "
                    f"{name!r} has observations"
                )
    return ""


def _over_groups(reading: Reading, groups: list[ReadGroup], members: list[int]) -> list[Correlation]:
    parts = [_entries_of_correlation(groups, number) for number in members]
    where, rows, components = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    entries = [reading.project.observations[groups[number].entry] for number in members]
    with_matrix = [k for k, entry in enumerate(entries) if entry.covariance is not None]
    place = reading.at("observations", groups[members[0]].entry)
    if len(with_matrix) != 1:
        place.tell("exactly one group of a cluster must give its covariance matrix", "cluster")
        return []
    place = reading.at("observations", groups[members[with_matrix[0]]].entry)
    given = _matrix(entries[with_matrix[0]], place)
    if given is None:
        return []
    size = len(rows)
    if given.shape != (size, size):
        shape = " × ".join(map(str, given.shape))
        place.tell(f"covariance: found {shape}, expected {size} × {size}", "covariance")
        return []
    covariance = _inside(groups, where, rows, components, given)
    words = _not_positive_definite(covariance)
    if words:
        place.tell(words, "covariance")
        return []
    return [Correlation(where, rows, components, covariance)]


def _entries_of_correlation(groups: list[ReadGroup], number: int) -> tuple[IntArray, IntArray, IntArray]:
    rows, components = np.nonzero(groups[number].group.mask)
    return np.full(len(rows), number), rows.astype(np.int64), components.astype(np.int64)


def _inside(
    groups: list[ReadGroup], where: IntArray, rows: IntArray, components: IntArray, given: FloatArray
) -> FloatArray:
    """Return covariances (n, n) of entries, in the order of their groups and rows, in internal units and axes.

    ``given`` are those of the same rows in project axes and units. Where only some components of a row are observed,
    turned axes put them elsewhere: they keep their order as given.
    """
    source, factor = np.zeros(len(rows), dtype=np.int64), np.zeros(len(rows))
    for number in np.unique(where).tolist():
        own, group = where == number, groups[number]
        from_given = np.argmax(np.abs(group.transform), axis=1)[components[own]]
        source[own] = from_given
        factor[own] = group.transform[components[own], from_given] * group.factors[from_given]
    order = np.zeros(len(rows), dtype=np.int64)
    order[np.lexsort((source, rows, where))] = np.arange(len(rows))
    return np.asarray(given[np.ix_(order, order)] * np.outer(factor, factor))


def _matrix(entry: Observations, place: TableLocation) -> FloatArray | None:
    rows = rows_of_covariance(entry, place)
    if rows is None:
        return None
    if len({len(row) for row in rows}) > 1:
        place.tell("covariance: rows of different length", "covariance")
        return None
    return np.array(rows, dtype=float)


def rows_of_covariance(entry: Observations, place: TableLocation) -> Sequence[Sequence[float]] | None:
    """Rows of the matrix of a table, from the project or a file; ``None`` if mistakes were told instead."""
    if not isinstance(entry.covariance, str):
        return entry.covariance or []
    path = place.folder / entry.covariance
    if not path.is_file():
        place.tell(f"covariance: file {entry.covariance!r} does not exist", "covariance")
        return None
    try:
        # Numbers of a CSV file without header. Raises :class:`InputError`.
        rows, problems = [], []
        for number, line in enumerate(read_text(path).split("\n"), start=1):
            cells = [cell.strip() for cell in line.split(",")]
            if not line.strip():
                continue
            try:
                rows.append([float(cell) for cell in cells])
            except ValueError:
                bad = next(cell for cell in cells if not _is_number(cell))
                problems.append(Message(f"found {bad!r}, expected a number", str(path), number))
        if problems:
            raise InputError(problems)
        return rows
    except InputError as error:
        place.problems.extend(error.problems)
        return None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _are_positive_definite(matrices: Sequence[FloatArray]) -> bool:
    sizes = np.array([len(matrix) for matrix in matrices], dtype=np.int64)
    return all(
        not _not_positive_definite(np.stack([matrices[int(k)] for k in np.flatnonzero(sizes == size)]))
        for size in np.unique(sizes)
    )


def _not_positive_definite(matrix: FloatArray) -> str:
    variances = np.diagonal(matrix, axis1=-2, axis2=-1)
    if not np.isfinite(matrix).all():
        return "the covariance matrix is not complete: found NaN"
    if (np.abs(matrix - matrix.swapaxes(-2, -1)) > 1e-9 * np.abs(matrix)).any():
        return "the covariance matrix is not symmetric"
    if (variances <= 0.0).any():
        words = "a variance, or the σ instead of it, is zero, negative or missing"
        return f"the covariance matrix is not positive definite: {words}"
    if not ((variances >= SMALLEST_SIGMA**2) & (variances <= LARGEST**2)).all():
        return f"the covariance matrix has a σ outside of {SMALLEST_SIGMA:g} to {LARGEST:g}"
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return "the covariance matrix is not positive definite: its correlations contradict each other"
    return ""


# ---- From the project to the network: blocks, observation groups, correlations, datum, start values.


class DatumChoice(NamedTuple):
    """The datum as the project wants it: free or not, and over which coordinates."""

    name: str
    free: bool
    mask: BoolArray
    """(points, 3) coordinates that carry it, internal axes."""
    at_reference: bool = False
    """True if the movements of the inner constraints are taken at the reference, not the adjusted coordinates."""
    minimal: bool = False
    """True if just as many coordinates carry it as the network has free movements, and keep their start values."""
    reference: FloatArray | None = None
    """(points, 3) coordinates it refers to, internal axes; ``None``: the given ones."""
    given: FloatArray | None = None
    """(points, 3) coordinates that the project gives, internal axes, NaN if it gives none."""

    def reference_from(self, start: FloatArray) -> FloatArray:
        """Return the coordinates (points, 3) that inner constraints refer to.

        These are the given coordinates, even if the adjustment starts elsewhere because a start value was replaced.
        Only points without given coordinates refer to their start values ``start`` (points, 3).
        """
        if self.reference is not None:
            return self.reference
        return start if self.given is None else np.where(np.isfinite(self.given), self.given, start)


@dataclass(frozen=True)
class Network:
    """Everything that was read, in internal units and axes; start values may still be missing (NaN)."""

    project: ProjectFile
    edge: Edge
    scales: Mapping[str, ImageScale]
    things: Mapping[str, Entities]
    blocks: Mapping[str, Blocks]
    start: Mapping[str, FloatArray]
    """(n, size) by kind, rotations as matrices (n, 3, 3)."""
    observed: Mapping[str, FloatArray]
    """(n, size) by kind, values as given; rotations as ω, φ, κ."""
    sigma: Mapping[str, FloatArray]
    """(n, size) by kind, σ of observed components, NaN elsewhere."""
    groups: tuple[ObservationGroup, ...]
    checks: tuple[ObservationGroup, ...]
    """Observations kept out of the adjustment, to check it by."""
    correlations: tuple[Correlation, ...]
    datum: DatumChoice
    point_groups: Mapping[int, str]
    """Name of the group of points a point block was read with."""
    sets: Mapping[str, tuple[str, str]]
    """Station and set behind the names of further sets at declared stations."""
    unoriented: frozenset[str]
    """Stations at which no direction was observed."""
    tables: Mapping[str, tuple[tuple[str, int], ...]]
    """Tables of points, images and all else in their order, with the number of things of each; "" is none."""
    station_tables: Mapping[str, tuple[str, str]]
    """Table of each declared station and of its sets, and its level: fixed, free, or the σ of its observation."""
    notes: tuple[Message, ...]
    """What was assumed on reading, to be said to the user."""
    file: str = ""
    """The project file, for mistakes that belong to no single place in it."""
    world: EarthModel | None = None
    """The earth under the network: its points are in the horizon of its middle."""
    sphere: LocalSphere | None = None
    """The sphere under a local network: its points are plan coordinates and heights."""
    unmeasured: tuple[str, ...] = ()
    """Tables of observations in which values are missing: they are planned."""
    candidates: tuple[ObservationGroup, ...] = ()
    """Observations that a plan might have besides; they take no part in the adjustment."""
    undeterminable: tuple[UndeterminedObject, ...] = ()
    """Things that nothing determines, and what was done about them."""
    original: Network | None = None
    """The network as it was read, where something was left out of it or put at infinity."""
    absent: Mapping[str, BoolArray] = field(default_factory=dict)
    """(n,) blocks of a kind that have no value: left out, or at infinity."""
    directions: Mapping[int, int] = field(default_factory=dict)
    """Rotation block of the direction of each point block that is at infinity."""
    motion: TimeModel = field(default_factory=TimeModel)
    """Epochs, and the points that move between them."""
    trajectories: Mapping[str, Trajectory] = field(default_factory=dict)
    """Trajectories by name; the part ``trajectory`` of an image is the number of one."""
    image_times: Mapping[str, float] = field(default_factory=dict)
    """Time of each image on a trajectory, of a line scanner that of its first line."""
    lines: Mapping[str, RowTimes] = field(default_factory=dict)
    """Times of the rows of each image of a line scanner."""
    untied: tuple[Message, ...] = ()
    """Parts whose place among the others no start values were found for: said where there is no solution."""

    @property
    def observations(self) -> int:
        """Number of observations, checks left out: what decides whether compiling is worth it."""
        return sum(int(np.count_nonzero(group.mask)) for group in self.groups)


def read_things(
    project: ProjectFile, document: Document, folder: Path, read: TableWatcher = ignore_table, planned: bool = False
) -> Reading:
    """Points, images, stations and all else that a project names, before any observation; with all mistakes found."""
    edge = Edge(project.units, project.axes)
    reading = Reading(project, TableLocation(document, (), folder), edge, workshop(), read, planned=planned)
    # Readers of the namespaces; each may refer to those before it.
    for space, reader in {
        "camera": read_cameras,
        "instrument": read_instruments,
        "point": read_points,
        "motion": read_motions,
        "pair": read_pairs,
        "trajectory": read_trajectories,
        "image": read_images,
        "station": read_stations,
        "system": read_systems,
    }.items():
        before = len(reading.problems)
        reader(reading)
        if len(reading.problems) > before:
            reading.broken.add(space)
    if project.curvature:
        from mor.project.earth import read_sphere  # most projects need nothing of it

        read_sphere(reading)
    return reading


def build_network(
    project: ProjectFile, document: Document, folder: Path, read: TableWatcher = ignore_table, planned: bool = False
) -> Network:
    """The network of a project. Raises :class:`InputError` with every mistake found.

    Where it is ``planned``, observations need no values: what stands for them is 0.
    """
    reading = read_things(project, document, folder, read, planned)
    problems = reading.problems
    refuse_files_named_twice(reading)
    read_in = read_groups(reading)
    features = feature_groups(reading)
    between = read_groups(reading, of_features=True)
    refuse_axes_of_spheres(reading, between)
    read_in += between
    parameters = [(entry, _said_outside(reading, group)) for entry, group in parameter_groups(reading)]
    plain, where = _in_order(read_in, parameters)
    drop_unused_orientations(reading, plain)
    others = [
        *features,
        *level_groups(reading),
        *variant_groups(reading, reading.variants),
        *prior_groups(reading),
        *reading.control,
        *reading.motion_groups,
        *steadiness_groups(reading),
    ]
    hold_what_images_have(reading, [*plain, *others])
    refuse_fixed(reading, [*plain, *others])
    check_direction_sets(reading, [*plain, *others])
    check_undeclared(reading, [*plain, *others])
    checks = check_groups(reading, [*plain, *others])
    candidates = candidate_groups(reading)
    correlated = correlations(reading, read_in) if not problems else ()
    correlated = tuple(c._replace(groups=where[c.groups]) for c in correlated)
    datum = _datum(reading)
    points = reading.shop.things["point"]
    for number, pair in enumerate(reading.project.report.relative if "point" not in reading.broken else ()):
        place = reading.at("report", "relative", number)
        unknown = [name for name in pair if name not in points.numbers]
        reading.problems.extend(place.problem(unknown_name("point", name, points.ids)) for name in unknown)
        if pair[0] == pair[1]:
            place.tell("a pair of one point; expected two")
    if not problems:
        carries = bool(datum.mask.any()) or not datum.free
        check_feasible(reading, [*plain, *others], carries, document.notes)
        check_held_on_earth(reading, [*plain, *others], datum.free)
    if problems:
        raise InputError(problems)
    groups = (*plain, *(_said_outside(reading, group) for group in others))
    return _network(reading, groups, checks, candidates, correlated, datum)


def _network(
    reading: Reading,
    groups: tuple[ObservationGroup, ...],
    checks: tuple[ObservationGroup, ...],
    candidates: tuple[ObservationGroup, ...],
    correlated: tuple[Correlation, ...],
    datum: DatumChoice,
) -> Network:
    """Assemble the network from its parts."""
    project, document = reading.project, reading.document
    stores = {key: store for key, store in reading.shop.stores.items() if store.ids}
    observed = {key: store.all_values() for key, store in stores.items()}
    start = {
        key: rotation_from_angles(given) if store.kind.is_rotation else given
        for key, store in stores.items()
        for given in (store.start_values(observed[key]),)
    }
    return Network(
        project=project,
        edge=reading.edge,
        scales=reading.scales,
        things={space: entities(things.ids, things.parts) for space, things in reading.shop.things.items()},
        blocks={key: store.blocks() for key, store in stores.items()},
        start=start,
        observed=observed,
        sigma={key: store.all_sigma() for key, store in stores.items()},
        groups=groups,
        checks=checks,
        correlations=correlated,
        datum=datum._replace(given=start.get("point")),
        point_groups={block: name for name, blocks in reading.groups.items() for block in blocks},
        sets=reading.sets,
        unoriented=frozenset(reading.unoriented),
        notes=(*document.notes, *reading.notes),
        tables={space: tuple(tables) for space, tables in reading.tables.items()},
        station_tables={
            name: (table_label("stations", number, table), table.level)
            for number, table in enumerate(project.stations)
            for name in reading.table_ids.get(("stations", number), [])
        },
        file=document.file,
        motion=reading.motion,
        world=reading.world,
        sphere=reading.sphere,
        unmeasured=tuple(dict.fromkeys(reading.unmeasured)),
        candidates=candidates,
        trajectories=reading.trajectories,
        image_times=reading.image_times,
        lines=reading.lines,
    )


def _in_order(
    read_in: list[ReadGroup], parameters: list[tuple[int, ObservationGroup]]
) -> tuple[list[ObservationGroup], IntArray]:
    """All groups in the order of their entries, and where (n,) each of those ``read_in`` has come to stand."""
    entries = [*((group.entry, group.group) for group in read_in), *parameters]
    order = sorted(range(len(entries)), key=lambda k: entries[k][0])
    where = np.argsort(np.array(order, dtype=np.int64), kind="stable")
    return [entries[k][1] for k in order], where


def _said_outside(reading: Reading, group: ObservationGroup) -> ObservationGroup:
    scale = next((s for s in reading.scales.values() if s.unit == group.image_unit), None)
    return replace(group, external=external(group.type, reading.edge, scale))


def _datum(reading: Reading) -> DatumChoice:
    chosen = reading.project.datum
    points = reading.shop.things["point"]
    mask = np.zeros((len(reading.shop.store("point").ids), 3), dtype=bool)
    if chosen == "fixed":
        return DatumChoice(datum_name(chosen), False, mask)
    if chosen == "free":
        chosen = Datum()
    assert isinstance(chosen, Datum)
    at_reference = chosen.movements == "reference"
    if chosen.minimal is not None:
        held = {key: [names] if isinstance(names, str) else names for key, names in chosen.minimal.items()}
        _mark(reading, mask, held)
        return DatumChoice(datum_name(chosen), True, mask, minimal=True)
    if chosen.free == "all":
        mask[points.parts["position"]] = _internal_row(reading, "".join(chosen.components))
        return DatumChoice(datum_name(chosen), True, mask, at_reference)
    by_components = chosen.free if isinstance(chosen.free, dict) else {"".join(chosen.components): list(chosen.free)}
    _mark(reading, mask, by_components)
    return DatumChoice(datum_name(reading.project.datum), True, mask, at_reference)


def datum_name(datum: str | Datum) -> str:
    """Name of a datum."""
    if datum == "fixed":
        return "fixed"
    if not isinstance(datum, Datum) or (datum.minimal is None and datum.free == "all"):
        return "free, inner constraints over all points"
    if datum.minimal is not None:
        held = {key: [names] if isinstance(names, str) else names for key, names in datum.minimal.items()}
        words = ", ".join(f"{components} of {', '.join(names)}" for components, names in held.items())
        return f"minimal, {words}"
    by_components = datum.free if isinstance(datum.free, dict) else {"".join(datum.components): list(datum.free)}
    parts = [
        f"{', '.join(components)} of {counted(len(names), 'named point or group', 'named points or groups')}"
        for components, names in by_components.items()
    ]
    return f"free, inner constraints over {' and '.join(parts)}"


def _mark(reading: Reading, mask: BoolArray, by_components: Mapping[Any, list[str]]) -> None:
    """Set the mask (points, 3) for named points, by the components of the project they carry the datum with."""
    for components, names in by_components.items():
        for name in names:
            mask[_datum_points(reading, name)] |= _internal_row(reading, components)


def _internal_row(reading: Reading, components: str) -> BoolArray:
    """(3,) the internal components behind components of the project, e.g. ``"xy"``."""
    source = np.argmax(np.abs(reading.edge.matrix), axis=1)
    return np.asarray(np.array([name in components for name in "xyz"])[source])


def _datum_points(reading: Reading, name: str) -> IntArray:
    points = reading.shop.things["point"]
    if name in reading.groups:
        return np.array(reading.groups[name], dtype=np.int64)
    if name in points.numbers:
        return np.array([points.part(name, "position")], dtype=np.int64)
    known = [*points.ids, *reading.groups]
    if "point" in reading.broken:
        return np.zeros(0, dtype=np.int64)
    reading.at("datum").tell(unknown_name("datum point", name, known))
    return np.zeros(0, dtype=np.int64)


# ---- A network without some of its things, or with some of its points at infinity: the rest stays as it was read.
#
# Blocks keep their numbers. Those left out are held at any value, and no observation refers to them any more.

Marked: TypeAlias = Mapping[str, BoolArray]
"""(n,) blocks of each kind that are meant."""


def nothing_marked(network: Network) -> dict[str, BoolArray]:
    """No block of any kind."""
    return {kind: np.zeros(len(blocks.ids), dtype=bool) for kind, blocks in network.blocks.items()}


def touches(group: ObservationGroup, marked: Marked) -> BoolArray:
    """(n,) rows of a group that refer to a marked block."""
    touched = np.zeros(group.count, dtype=bool)
    for slot, numbers in group.blocks_by_slot:
        touched |= marked[slot.kind][numbers]
    return touched


def without_blocks(network: Network, marked: Marked, things: Sequence[UndeterminedObject]) -> Network:
    """The network without some blocks and all observations that refer to them; ``things`` says what they are."""
    kept = [~touches(group, marked) for group in network.groups]
    blocks = {kind: table._replace(free=table.free & ~marked[kind][:, None]) for kind, table in network.blocks.items()}
    checks = (some_rows(group, np.flatnonzero(~touches(group, marked))) for group in network.checks)
    return replace(
        network,
        blocks=blocks,
        start={kind: _filled(values, marked[kind]) for kind, values in network.start.items()},
        groups=tuple(_taken(group, rows) for group, rows in zip(network.groups, kept, strict=True)),
        checks=tuple(group for group in checks if group.count),
        correlations=_remaining(network.correlations, kept),
        undeterminable=(*network.undeterminable, *things),
        original=network.original or network,
        absent=_absent(network, marked),
    )


def with_blocks_held(network: Network, marked: Marked, things: Sequence[UndeterminedObject]) -> Network:
    """The network with some blocks held where they are, of which no observation that counts says anything.

    Their observations stay, for they are told. ``things`` says what they are.
    """
    if not things:
        return network
    blocks = {kind: table._replace(free=table.free & ~marked[kind][:, None]) for kind, table in network.blocks.items()}
    return replace(
        network,
        blocks=blocks,
        undeterminable=(*network.undeterminable, *things),
        original=network.original or network,
        absent=_absent(network, marked),
    )


def with_points_at_infinity(
    network: Network, start: Values, points: IntArray, directions: FloatArray, things: Sequence[UndeterminedObject]
) -> tuple[Network, dict[str, FloatArray]]:
    """The network with the rays to ``points`` (k,) as rays to directions, and its start values.

    ``directions`` (k, 3, 3) are rotations D whose third rows are the directions.
    """
    first = len(network.blocks["rotation"].ids) if "rotation" in network.blocks else 0
    number = np.full(len(network.blocks["point"].ids), -1, dtype=np.int64)
    number[points] = first + np.arange(len(points))
    far = {**nothing_marked(network), "point": number >= 0}
    kept = [~touches(group, far) for group in network.groups]
    near = [_taken(group, rows) for group, rows in zip(network.groups, kept, strict=True)]
    others = [
        _seen_far(some_rows(group, np.flatnonzero(~rows)), number)
        for group, rows in zip(network.groups, kept, strict=True)
        if not rows.all()
    ]
    point = network.blocks["point"]
    blocks = {
        **network.blocks,
        "point": point._replace(free=point.free & (number < 0)[:, None]),
        "rotation": _with_directions(network.blocks["rotation"], [f"point {point.ids[p]}" for p in points]),
    }
    empty = np.full((len(points), 3), np.nan)
    reduced = replace(
        network,
        blocks=blocks,
        start=_with_rotations(network.start, directions),
        groups=(*near, *others),
        correlations=_remaining(network.correlations, kept),
        undeterminable=(*network.undeterminable, *things),
        original=network.original or network,
        absent=_with_rotations_there(_absent(network, {"point": number >= 0}), len(points)),
        directions={int(p): first + k for k, p in enumerate(points)},
        observed=_with_rotations(network.observed, empty),
        sigma=_with_rotations(network.sigma, empty),
    )
    return reduced, _with_rotations(start, directions)


def _with_rotations(values: Values, more: FloatArray) -> dict[str, FloatArray]:
    return {**values, "rotation": np.concatenate([values["rotation"], more])}


def _with_rotations_there(absent: Mapping[str, BoolArray], more: int) -> dict[str, BoolArray]:
    if "rotation" not in absent:
        return dict(absent)
    return {**absent, "rotation": np.concatenate([absent["rotation"], np.zeros(more, dtype=bool)])}


def _absent(network: Network, marked: Marked) -> dict[str, BoolArray]:
    return {
        kind: network.absent[kind] | blocks if kind in network.absent else blocks
        for kind, blocks in {**network.absent, **marked}.items()
    }


def _seen_far(group: ObservationGroup, number: IntArray) -> ObservationGroup:
    """Rows to far points as rows to their directions, whose block numbers are ``number`` (points,)."""
    type_ = at_infinity(group.type)
    own = dict(group.blocks_by_slot)
    return replace(
        group,
        name=group.name + AT_INFINITY,
        type=type_,
        blocks=(*(own[slot] for slot in type_.slots[:-1]), number[group.blocks[target_slot(group.type)]]),
        ppm=0.0,
        centring=PERFECT_SET_UP,
    )


def _with_directions(blocks: Blocks, ids: Sequence[str]) -> Blocks:
    count, more = len(blocks.ids), len(ids)
    about = np.zeros(count, dtype=bool) if blocks.about_axes is None else blocks.about_axes
    own = np.broadcast_to(np.arange(count, count + more)[:, None], (more, 3))
    apart = blocks.difference
    free = np.array([True, True, False])  # turns about the axes of D that move u: not the one about u itself
    return blocks._replace(
        difference=None if apart is None else np.concatenate([apart, np.zeros((more, 3))]),
        ids=(*blocks.ids, *ids),
        free=np.concatenate([blocks.free, np.broadcast_to(free, (more, 3))]),
        owner=np.concatenate([blocks.owner, own]),
        about_axes=np.concatenate([about, np.ones(more, dtype=bool)]),
    )


def _taken(group: ObservationGroup, rows: BoolArray) -> ObservationGroup:
    return group if rows.all() else some_rows(group, np.flatnonzero(rows))


def _filled(values: FloatArray, marked: BoolArray) -> FloatArray:
    unknown = marked & ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    if not unknown.any():
        return values
    filled = values.copy()
    filled[unknown] = np.eye(3) if values.ndim == 3 else 0.0
    return filled


def _remaining(correlations: Sequence[Correlation], kept: Sequence[BoolArray]) -> tuple[Correlation, ...]:
    """Clusters of the rows that are kept, renumbered: of the others their covariance is left out."""
    if all(rows.all() for rows in kept):
        return tuple(correlations)
    renumbered = [np.cumsum(rows) - 1 for rows in kept]
    result = []
    for cluster in correlations:
        rest = cluster.taken(kept)
        if len(rest.rows):
            rows = [renumbered[g][r] for g, r in zip(rest.groups, rest.rows, strict=True)]
            result.append(rest._replace(rows=np.array(rows, dtype=np.int64)))
    return tuple(result)
