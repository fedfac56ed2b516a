"""The network of one domain: that of a project with its rows only, what belongs to another domain counted there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.arrays import BoolArray, IntArray
from mor.observations import OBSERVED_DIFFERENCES, OBSERVED_PARAMETERS, ObservationGroup
from mor.parameters.index import Index
from mor.project.domains.parts import OWNED, SHARED, Parts, Section, datum_points, group_names
from mor.project.domains.refusals import is_divided
from mor.project.domains.undeclared import point_tables
from mor.project.file.model import Datum, Project
from mor.project.file.model import Report as NoReport
from mor.project.file.nodes import Document
from mor.project.network.build import Network, build_network
from mor.project.network.reading import table_label

_PRIOR = frozenset(
    kind.key for kinds in (OBSERVED_PARAMETERS, OBSERVED_DIFFERENCES) for kind in kinds.values()
)


class PartNetwork(NamedTuple):
    """A domain's network, and which of its things other domains have, too."""

    network: Network
    foreign: Mapping[str, frozenset[str]]
    """Names of points and images that this domain is not the first to have: by ``point``, ``image``."""
    shared: Mapping[str, frozenset[str]]
    """Names of points and images that several domains have."""
    first: bool
    """True for the domain that counts what all have, the cameras."""
    tables: Mapping[str, tuple[int, ...]]
    """Numbers in the project of its tables of ``points`` and ``images``."""
    places: tuple[int, ...]
    """Of its groups of observations among those of the project."""

    def without_observations(self) -> PartNetwork:
        """The same with no rows: where the plan has them nobody asks the network for them."""
        return self._replace(network=replace(self.network, groups=()))

    def common(self, index: Index) -> BoolArray:
        """(u,) unknowns that other domains have, too."""
        found = np.zeros(index.count, dtype=bool)
        for kind, blocks in index.blocks.items():
            mine = np.array([self.is_common(kind, name) for name in blocks.ids], dtype=bool)
            columns = index.columns[kind][mine]
            found[columns[columns >= 0]] = True
        return found

    def shares_fixed_coordinates(self, index: Index) -> bool:
        """True where a point that other domains have, too, has a coordinate that is not free."""
        points = index.blocks["point"]
        partly = np.flatnonzero(~points.free.all(axis=1))
        return any(self.is_common("point", points.ids[k]) for k in partly.tolist())

    def is_common(self, kind: str, name: str) -> bool:
        """True where other domains have a block, too."""
        if name.startswith("image "):
            return name[6:] in self.shared["image"]
        if kind == "point":
            return name in self.shared["point"]
        return self._is_of_camera(name)

    def counts(self, group: ObservationGroup) -> bool | IntArray:
        """Rows of a group that this domain counts; ``True`` where it counts all."""
        if len(group.lines) or group.type.key not in _PRIOR:
            return True
        kind, ids = group.type.slots[-1].kind, self.network.blocks[group.type.slots[-1].kind].ids
        mine = [self.owns(kind, ids[block]) for block in group.blocks[-1].tolist()]
        return True if all(mine) else np.flatnonzero(mine)

    def owns(self, kind: str, name: str) -> bool:
        """True where this domain is the first to have a block."""
        if name.startswith("image "):
            return name[6:] not in self.foreign["image"]
        if kind == "point":
            return name not in self.foreign["point"]
        return self.first or not self._is_of_camera(name)

    def _is_of_camera(self, name: str) -> bool:
        """Interior orientations have the names of their cameras; eccentricities and readout times are ``camera …``."""
        cameras = self.network.project.cameras
        return name in cameras or name.removeprefix("camera ") in cameras


def read_part(project: Project, document: Document, parts: Parts, domain: int, source: Path) -> PartNetwork:
    """Read the network of a domain; what is not divided is found from ``source``. Raises :class:`InputError`."""
    frames: dict[str, pl.DataFrame] = {}
    lonely = domain in (parts.ground, 0 if parts.ground < 0 else -1)
    things = {section: _tables(project, parts, domain, section, frames) for section in ("images", "points")}
    marks = {space: _marks(frames, things[f"{space}s"]) for space in ("image", "point")}
    observations = []
    for k, entry in enumerate(project.observations):
        if not is_divided(entry):
            observations += [(entry, k)] if lonely else []
        elif (frame := _frame(parts, ("observations", k), domain)) is not None:
            observations.append((_standing_in(entry, ("observations", k), frame, frames), k))
    named = [
        entry.model_copy(update={"name": entry.name or project.observations[k].file})
        for entry, k in observations
    ]
    changed: dict[str, Any] = {
        "observations": named,
        "report": NoReport(),
        "require": type(project.require)(),
    }
    changed |= {section: list(tables.values()) for section, tables in things.items()}
    changed |= {"candidates": [], "variants": {}}
    if not lonely:
        changed |= {"checks": [], "stations": [], "systems": [], "features": [], "instruments": {}}
    changed["datum"] = _datum(project, {name for space in marks.values() for name in space["all"]}, things)
    own = replace(document, frames={**document.frames, **frames}, problems=(), notes=())
    others = frozenset(marks["point"]["shared"])
    network = build_network(project.model_copy(update=changed), own, source, elsewhere=others)
    foreign = {space: frozenset(mark["foreign"]) for space, mark in marks.items()}
    shared = {space: frozenset(mark["shared"]) for space, mark in marks.items()}
    numbers = {section: tuple(tables) for section, tables in things.items()}
    found = PartNetwork(network, foreign, shared, domain == 0, numbers, ())
    groups = _counted(found)
    order = group_names(project)
    places = tuple(order.index(group.name) if group.name in order else len(order) for group in groups)
    return found._replace(network=replace(network, groups=groups), places=places)


def _counted(part: PartNetwork) -> tuple[ObservationGroup, ...]:
    groups = []
    for group in part.network.groups:
        rows = part.counts(group)
        if rows is True:
            groups.append(group)
        elif len(rows):  # type: ignore[arg-type]
            groups.append(_rows_of(group, rows))  # type: ignore[arg-type]
    return tuple(groups)


def _rows_of(group: ObservationGroup, rows: IntArray) -> ObservationGroup:
    return replace(
        group,
        blocks=tuple(blocks[rows] for blocks in group.blocks),
        observed=group.observed[rows],
        sigma=group.sigma[rows],
        constants=group.constants[rows],
        references=tuple(names.take(rows) for names in group.references),
        lines=group.lines[rows] if len(group.lines) else group.lines,
    )


def _frame(parts: Parts, section: Section, domain: int) -> pl.DataFrame | None:
    files = parts.files(section, domain)
    return pl.concat([pl.read_parquet(file) for file in files]) if files else None


def _tables(
    project: Project, parts: Parts, domain: int, section: str, frames: dict[str, pl.DataFrame]
) -> dict[int, Any]:
    """Tables of images, or of points, that have rows in the domain, by their number in the project."""
    found = {}
    tables = point_tables(project) if section == "points" else getattr(project, section)
    for k, table in enumerate(tables):
        frame = _frame(parts, (section, k), domain)
        if frame is not None:
            frame = frame.unique("id", maintain_order=True) if k >= len(getattr(project, section)) else frame
            name = table_label(section, k, table)
            found[k] = _standing_in(table, (section, k), frame, frames).model_copy(update={"name": name})
    return found


def _standing_in(table: Any, section: Section, frame: pl.DataFrame, frames: dict[str, pl.DataFrame]) -> Any:
    """The table with its rows in a frame, which is kept under a name that stands for it."""
    name = table.file or f"{section[0]} {section[1] + 1}"
    frames[name] = frame
    left = {key: value for key, value in table.values.items() if key not in frame.columns}
    return table.model_copy(update={"file": name, "rows": None, "columns": None, "values": left})


def _marks(frames: dict[str, pl.DataFrame], tables: dict[int, Any]) -> dict[str, list[str]]:
    """Names of all things of the domain, of those it is not the first to have, and of those that several have."""
    found: dict[str, list[str]] = {"all": [], "foreign": [], "shared": []}
    for table in tables.values():
        frame = frames[table.file]
        found["all"] += frame["id"].to_list()
        found["foreign"] += frame.filter(~pl.col(OWNED))["id"].to_list()
        found["shared"] += frame.filter(pl.col(SHARED))["id"].to_list()
        frames[table.file] = frame.drop(OWNED, SHARED)
    return found


def _datum(project: Project, names: set[str], things: dict[str, dict[int, Any]]) -> Any:
    """The datum over what the domain has of it; fixed where that is nothing."""
    datum, every = project.datum, datum_points(project.datum)
    if not every or not isinstance(datum, Datum):
        return datum
    key = "free" if datum.minimal is None else "minimal"
    known = names | {table.group for table in things["points"].values() if table.group}
    left = {axes: [name for name in some if name in known] for axes, some in every.items()}
    left = {axes: some for axes, some in left.items() if some}
    return datum.model_copy(update={key: left}) if left else "fixed"
