"""What the steps of reading a project share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from mor.arrays import FloatArray
from mor.errors import Problem
from mor.geometry.earth import LocalSphere
from mor.observations import PLAIN_TYPES, ObservationGroup, ObservationType
from mor.project.edge import Edge, ImageScale
from mor.project.file.model import Project
from mor.project.file.nodes import Document
from mor.project.file.table import Table
from mor.project.motion.model import Motion
from mor.project.network.entities import Workshop
from mor.project.tables.tables import Place
from mor.project.trajectories.model import Lines, Scanner, Trajectory
from mor.project.world.world import World

TableWatcher: TypeAlias = Callable[[str | None], None]
"""Told the file of a table when it has been read."""
SetUp: TypeAlias = tuple[FloatArray, ...]
"""Value, σ, start and freedom of a shared constant, (1, size) each, as far as rows have said them."""


def ignore_table(file: str | None) -> None:
    """Nobody watches."""


def table_label(section: str, number: int, table: Table) -> str:
    """Name of a table in reports."""
    return table.name or table.file or f"{section} {number + 1}"


@dataclass
class Reading:
    """What the steps of reading share: the project, where it stands, what was found wrong."""

    project: Project
    place: Place
    edge: Edge
    shop: Workshop
    problems: list[Problem]
    watch: TableWatcher
    """Told each long table that has been read."""
    sets: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Station and set behind the names of further sets at declared stations."""
    unoriented: set[str] = field(default_factory=set)
    """Stations without an orientation: no direction was observed at them."""
    broken: set[str] = field(default_factory=set)
    """Namespaces that could not be read completely: a name missing from them may be no mistake of its own."""
    notes: list[Problem] = field(default_factory=list)
    """What was assumed, to be said to the user."""
    scales: dict[str, ImageScale] = field(default_factory=dict)
    shared_set_ups: dict[str, dict[str, SetUp]] = field(default_factory=dict)
    """What was said of constants that are shared by name, by kind."""
    groups: dict[str, list[int]] = field(default_factory=dict)
    """Point groups by name: block numbers."""
    table_ids: dict[tuple[str, int], list[str]] = field(default_factory=dict)
    """Names read from a table, by section and number of the table."""
    section: str = "observations"
    """Section that observation groups are read from: ``observations``, or ``checks``."""
    tables: dict[str, list[tuple[str, int]]] = field(default_factory=dict)
    """Tables that the things of a namespace come from, in their order, and how many things each has."""
    undeclared: dict[str, tuple[str, int]] = field(default_factory=dict)
    """Points that only observations name, with file and line where they come first."""
    planned: bool = False
    """True if observations need no values: they are planned, not measured."""
    unmeasured: list[str] = field(default_factory=list)
    """Tables of observations in which values are missing, where they may be."""
    variants: dict[str, dict[int, float]] = field(default_factory=dict)
    """Image-variant components of each camera, with the σ of their difference (NaN: none)."""
    world: World | None = None
    """The earth under the network, where the project has one."""
    sphere: LocalSphere | None = None
    """The sphere under a local network, where the project models the curvature of the earth."""
    types: Mapping[str, ObservationType] = field(default_factory=lambda: PLAIN_TYPES)
    """Observation types of the project, besides image coordinates."""
    control: list[ObservationGroup] = field(default_factory=list)
    """Observed points on the earth."""
    motion: Motion = field(default_factory=Motion)
    """Epochs, and the points that move between them."""
    trajectories: dict[str, Trajectory] = field(default_factory=dict)
    """Trajectories by name."""
    image_times: dict[str, float] = field(default_factory=dict)
    """Time of each image on a trajectory; of a line scanner that of its first line."""
    scanners: dict[str, Scanner] = field(default_factory=dict)
    """Cameras that are line scanners."""
    lines: dict[str, Lines] = field(default_factory=dict)
    """Times of the rows of images of line scanners, as far as tables give them; of all when images are read."""
    strips: dict[tuple[str, str], tuple[int, float]] = field(default_factory=dict)
    """Block of shift and drift of each strip, by kind and name, and the time that its drift counts from."""
    motion_groups: list[ObservationGroup] = field(default_factory=list)
    """Steps of points that are observed."""

    def begin(self, section: str, number: int, table: Table) -> None:
        """Blocks that are added from now on come from this table of a section."""
        self.shop.begin(table_label(section, number, table))

    def end(self, space: str, count: int) -> None:
        """So many things of a namespace were read from the table that was begun last."""
        self.tables.setdefault(space, []).append((self.shop.sources[-1][0], count))

    def at(self, *path: str | int) -> Place:
        """The place of a part of the project file."""
        if path[:1] == ("observations",):
            path = (self.section, *path[1:])
        return Place(self.place.document, path, self.place.folder)

    @property
    def document(self) -> Document:
        """The project file itself."""
        return self.place.document
