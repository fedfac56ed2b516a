"""From the project to the network: blocks, observation groups, correlations, datum, start values."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.counting import counted
from mor.errors import InputError, Problem, Undeterminable
from mor.geometry.earth import LocalSphere
from mor.geometry.rotations import rotation_from_angles
from mor.observations import ObservationGroup
from mor.parameters.index import Blocks
from mor.project.axes import external
from mor.project.edge import Edge, ImageScale
from mor.project.file.model import Datum, Project
from mor.project.file.nodes import Document
from mor.project.motion.declared import read_motions
from mor.project.motion.model import Motion
from mor.project.network.cameras import hold_what_images_have, read_cameras
from mor.project.network.candidates import candidate_groups
from mor.project.network.checks import check_groups
from mor.project.network.entities import Entities, entities, unknown_name, workshop
from mor.project.network.feasibility import check_feasible
from mor.project.network.features import feature_groups
from mor.project.network.files_named_twice import refuse_files_named_twice
from mor.project.network.images import read_images
from mor.project.network.instruments import read_instruments, read_pairs
from mor.project.network.points import read_points
from mor.project.network.prior_knowledge import level_groups, prior_groups, variant_groups
from mor.project.network.reading import Reading, TableWatcher, ignore_table, table_label
from mor.project.network.stations import read_stations, read_systems
from mor.project.observations.correlations import Correlation, correlations
from mor.project.observations.direction_sets import check_direction_sets
from mor.project.observations.fixed_quantities import refuse_fixed
from mor.project.observations.groups import read_groups
from mor.project.observations.observation_rows import Group
from mor.project.observations.orientations import drop_unused_orientations
from mor.project.observations.parameters import parameter_groups
from mor.project.observations.undeclared_points import check_undeclared
from mor.project.tables.tables import Place
from mor.project.trajectories.knots import read_trajectories
from mor.project.trajectories.model import Lines, Trajectory
from mor.project.trajectories.steadiness import steadiness_groups
from mor.project.world.free_network import check_held_on_earth
from mor.project.world.world import World


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

    project: Project
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
    """Tables of points, images, pairs, systems in their order, with the number of things of each; "" is none."""
    station_tables: Mapping[str, str]
    """Table of each declared station and of its sets."""
    station_levels: Mapping[str, str]
    """Level of each declared station: fixed, free, or the σ of its observation as given."""
    notes: tuple[Problem, ...]
    """What was assumed on reading, to be said to the user."""
    file: str = ""
    """The project file, for mistakes that belong to no single place in it."""
    world: World | None = None
    """The earth under the network: its points are in the horizon of its middle."""
    sphere: LocalSphere | None = None
    """The sphere under a local network: its points are plan coordinates and heights."""
    unmeasured: tuple[str, ...] = ()
    """Tables of observations in which values are missing: they are planned."""
    candidates: tuple[ObservationGroup, ...] = ()
    """Observations that a plan might have besides; they take no part in the adjustment."""
    undeterminable: tuple[Undeterminable, ...] = ()
    """Things that nothing determines, and what was done about them."""
    original: Network | None = None
    """The network as it was read, where something was left out of it or put at infinity."""
    absent: Mapping[str, BoolArray] = field(default_factory=dict)
    """(n,) blocks of a kind that have no value: left out, or at infinity."""
    directions: Mapping[int, int] = field(default_factory=dict)
    """Rotation block of the direction of each point block that is at infinity."""
    motion: Motion = field(default_factory=Motion)
    """Epochs, and the points that move between them."""
    trajectories: Mapping[str, Trajectory] = field(default_factory=dict)
    """Trajectories by name; the part ``trajectory`` of an image is the number of one."""
    image_times: Mapping[str, float] = field(default_factory=dict)
    """Time of each image on a trajectory, of a line scanner that of its first line."""
    lines: Mapping[str, Lines] = field(default_factory=dict)
    """Times of the rows of each image of a line scanner."""
    untied: tuple[Problem, ...] = ()
    """Parts whose place among the others no start values were found for: said where there is no solution."""

    @property
    def observations(self) -> int:
        """Number of observations, checks left out: what decides whether compiling is worth it."""
        return sum(int(np.count_nonzero(group.mask)) for group in self.groups)


_READERS = {
    "camera": read_cameras,
    "instrument": read_instruments,
    "point": read_points,
    "motion": read_motions,
    "pair": read_pairs,
    "trajectory": read_trajectories,
    "image": read_images,
    "station": read_stations,
    "system": read_systems,
}
"""Readers of the namespaces; each may refer to those before it."""


def read_things(
    project: Project,
    document: Document,
    folder: Path,
    read: TableWatcher = ignore_table,
    planned: bool = False,
) -> Reading:
    """Points, images, stations and all else that a project names, before any observation; with all mistakes found."""
    edge = Edge(project.units, project.axes)
    reading = Reading(project, Place(document, (), folder), edge, workshop(), [], read, planned=planned)
    for space, reader in _READERS.items():
        before = len(reading.problems)
        reader(reading)
        if len(reading.problems) > before:
            reading.broken.add(space)
    if project.curvature:
        from mor.project.world.sphere import read_sphere  # most projects need nothing of it

        read_sphere(reading)
    return reading


def build_network(
    project: Project,
    document: Document,
    folder: Path,
    read: TableWatcher = ignore_table,
    planned: bool = False,
    elsewhere: Collection[str] = (),
) -> Network:
    """The network of a project. Raises :class:`InputError` with every mistake found.

    ``elsewhere`` are points that observations determine which are not at hand.

    Where it is ``planned``, observations need no values: what stands for them is 0.
    """
    reading = read_things(project, document, folder, read, planned)
    problems = reading.problems
    refuse_files_named_twice(reading)
    read_in = read_groups(reading)
    parameters = [(entry, _said_outside(reading, group)) for entry, group in parameter_groups(reading)]
    plain, where = _in_order(read_in, parameters)
    drop_unused_orientations(reading, plain)
    others = [
        *feature_groups(reading),
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
    checks = check_groups(reading, [*plain, *others], elsewhere)
    candidates = candidate_groups(reading)
    correlated = correlations(reading, read_in) if not problems else ()
    correlated = tuple(c._replace(groups=where[c.groups]) for c in correlated)
    datum = _datum(reading)
    _check_pairs(reading)
    if not problems and (plain or others or not elsewhere):
        check_feasible(reading, [*plain, *others], bool(datum.mask.any()) or not datum.free)
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
    """What was read, put together."""
    project, document = reading.project, reading.document
    stores = {key: store for key, store in reading.shop.stores.items() if store.ids}
    observed = {key: store.all_values() for key, store in stores.items()}
    start = {
        key: _representation(store.kind.is_rotation, store.start_values(observed[key]))
        for key, store in stores.items()
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
            name: table_label("stations", number, table)
            for number, table in enumerate(project.stations)
            for name in reading.table_ids.get(("stations", number), [])
        },
        file=document.file,
        motion=reading.motion,
        world=reading.world,
        sphere=reading.sphere,
        unmeasured=tuple(dict.fromkeys(reading.unmeasured)),
        candidates=candidates,
        station_levels={
            name: table.level
            for number, table in enumerate(project.stations)
            for name in reading.table_ids.get(("stations", number), [])
        },
        trajectories=reading.trajectories,
        image_times=reading.image_times,
        lines=reading.lines,
    )


def _in_order(
    read_in: list[Group], parameters: list[tuple[int, ObservationGroup]]
) -> tuple[list[ObservationGroup], IntArray]:
    """All groups in the order of their entries, and where (n,) each of those ``read_in`` has come to stand."""
    entries = [*((group.entry, group.group) for group in read_in), *parameters]
    order = sorted(range(len(entries)), key=lambda k: entries[k][0])
    where = np.argsort(np.array(order, dtype=np.int64), kind="stable")
    return [entries[k][1] for k in order], where


def _representation(is_rotation: bool, values: FloatArray) -> FloatArray:
    return rotation_from_angles(values) if is_rotation else values


def _said_outside(reading: Reading, group: ObservationGroup) -> ObservationGroup:
    """Groups of prior knowledge are reported in project units."""
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
    by_components = (
        chosen.free if isinstance(chosen.free, dict) else {"".join(chosen.components): list(chosen.free)}
    )
    _mark(reading, mask, by_components)
    return DatumChoice(datum_name(reading.project.datum), True, mask, at_reference)


def datum_name(datum: str | Datum) -> str:
    """What a datum is called."""
    if datum == "fixed":
        return "fixed"
    if not isinstance(datum, Datum) or (datum.minimal is None and datum.free == "all"):
        return "free, inner constraints over all points"
    if datum.minimal is not None:
        held = {key: [names] if isinstance(names, str) else names for key, names in datum.minimal.items()}
        words = ", ".join(f"{components} of {', '.join(names)}" for components, names in held.items())
        return f"minimal, {words}"
    by_components = (
        datum.free if isinstance(datum.free, dict) else {"".join(datum.components): list(datum.free)}
    )
    parts = [
        f"{', '.join(components)} of {counted(len(names), 'named point or group', 'named points or groups')}"
        for components, names in by_components.items()
    ]
    return f"free, inner constraints over {' and '.join(parts)}"


def _check_pairs(reading: Reading) -> None:
    """Names of the pairs of points that are to be reported."""
    points = reading.shop.things["point"]
    for number, pair in enumerate(reading.project.report.relative if "point" not in reading.broken else ()):
        place = reading.at("report", "relative", number)
        unknown = [name for name in pair if name not in points.numbers]
        reading.problems += [place.problem(unknown_name("point", name, points.ids)) for name in unknown]
        if pair[0] == pair[1]:
            reading.problems.append(place.problem("a pair of one point; expected two"))


def _mark(reading: Reading, mask: BoolArray, by_components: Mapping[Any, list[str]]) -> None:
    """Set the mask (points, 3) for named points, by the components of the project they carry the datum with."""
    for components, names in by_components.items():
        for name in names:
            mask[_datum_points(reading, name)] |= _internal_row(reading, components)


def _internal_row(reading: Reading, components: str) -> BoolArray:
    """(3,) the internal components behind components of the project, e.g. ``"xy"``."""
    source = np.argmax(np.abs(reading.edge.matrix), axis=1)
    chosen: BoolArray = np.array([name in components for name in "xyz"])[source]
    return chosen


def _datum_points(reading: Reading, name: str) -> IntArray:
    points = reading.shop.things["point"]
    if name in reading.groups:
        return np.array(reading.groups[name], dtype=np.int64)
    if name in points.numbers:
        return np.array([points.part(name, "position")], dtype=np.int64)
    known = [*points.ids, *reading.groups]
    if "point" in reading.broken:
        return np.zeros(0, dtype=np.int64)
    reading.problems.append(reading.at("datum").problem(unknown_name("datum point", name, known)))
    return np.zeros(0, dtype=np.int64)
