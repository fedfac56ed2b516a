"""Entities of a network while it is read: parameter blocks, motions, trajectories."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from mor.errors import Message, nearest
from mor.model.contract import ObservationGroup, ObservationType
from mor.model.earth import LocalSphere
from mor.model.motion import cubic_weights, linear_weights
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import KINDS, BlockKind, Blocks
from mor.model.trajectory import CUBIC, LINEAR
from mor.project.axes import Edge, ImageScale
from mor.project.document import Document
from mor.project.reference_system import EarthModel
from mor.project.schema import ProjectFile, TableEntry
from mor.project.tables import Statuses, TableLocation
from mor.types import BoolArray, FloatArray, IntArray

# ---- What a project names: points, images, stations, systems … and the blocks that stand behind each name.


@dataclass
class BlockStore:
    """Blocks of one kind while a network is put together."""

    kind: BlockKind
    ids: list[str] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)
    free: list[BoolArray] = field(default_factory=list)
    sigma: list[FloatArray] = field(default_factory=list)
    start: list[FloatArray] = field(default_factory=list)
    about_axes: set[int] = field(default_factory=set)
    shared: dict[tuple[int, int], int] = field(default_factory=dict)
    """Block whose component another one has: (block, component) → owner."""
    differences: dict[tuple[int, int], float] = field(default_factory=dict)
    """By how much a shared component exceeds that of its owner, where it does."""

    def add(
        self,
        ids: Sequence[str],
        values: FloatArray,
        free: BoolArray,
        sigma: FloatArray,
        start: FloatArray | None = None,
    ) -> IntArray:
        """Add n blocks; ``values`` (n, size), rotations as ω, φ, κ. Returns their numbers.

        ``start`` holds start values that differ from the (observed) values, NaN if they do not.
        """
        first = len(self.ids)
        self.ids.extend(ids)
        self.values.append(values)
        self.free.append(free)
        self.sigma.append(sigma)
        self.start.append(np.full(values.shape, np.nan) if start is None else start)
        return np.arange(first, first + len(ids), dtype=np.int64)

    def add_fixed(self, name: str, values: Sequence[float]) -> int:
        """Add one block of constants. Returns its number."""
        row = np.array([values], dtype=float)
        return int(self.add([name], row, np.zeros(row.shape, dtype=bool), np.full(row.shape, np.nan))[0])

    def hold(self, block: int, component: int, value: float) -> None:
        """Fix one component of one block at a value."""
        table = self.merged()
        table.values[block, component] = value
        table.free[block, component] = False
        table.sigma[block, component] = table.start[block, component] = np.nan

    def put(self, block: int, statuses: Statuses) -> None:
        """Replace what one block is by statuses (1, size)."""
        for column, row in zip(self.merged(), statuses, strict=True):
            column[block] = row[0]

    def merged(self) -> Statuses:
        """Values, free flags, σ and start values of all blocks, (n, size) each, to be changed in place."""
        table = Statuses(self.all_values(), self.all_free(), self.all_sigma(), self.all_start())
        self.values, self.free = [table.values], [table.free]
        self.sigma, self.start = [table.sigma], [table.start]
        return table

    def blocks(self) -> Blocks:
        """The finished table of blocks."""
        size = self.kind.size
        owner: IntArray = np.broadcast_to(np.arange(len(self.ids), dtype=np.int64)[:, None], (len(self.ids), size))
        if self.shared:
            owner = owner.copy()
        for (block, component), other in self.shared.items():
            owner[block, component] = other
        about_axes = np.isin(np.arange(len(self.ids)), list(self.about_axes)) if self.about_axes else None
        difference = None
        if any(self.differences.values()):
            difference = np.zeros(owner.shape)
            for node, apart in self.differences.items():
                difference[node] = apart
        return Blocks(self.kind, tuple(self.ids), self.all_free(), owner, about_axes, difference)

    def all_values(self) -> FloatArray:
        """(n, size) values, NaN if not given."""
        return np.concatenate(self.values) if self.values else np.zeros((0, self.kind.size))

    def all_start(self) -> FloatArray:
        """(n, size) start values that differ from the values, NaN elsewhere."""
        return np.concatenate(self.start) if self.start else np.zeros((0, self.kind.size))

    def start_values(self, values: FloatArray) -> FloatArray:
        """(n, size) what the adjustment starts from, NaN if there is nothing yet: ``values``, or others.

        The same array where no start value differs.
        """
        start = self.all_start()
        missing = np.isnan(start)
        return values if missing.all() else np.where(missing, values, start)

    def all_free(self) -> BoolArray:
        """(n, size) true where free or observed."""
        return np.concatenate(self.free) if self.free else np.zeros((0, self.kind.size), dtype=bool)

    def all_sigma(self) -> FloatArray:
        """(n, size) σ of observed components, NaN elsewhere."""
        return np.concatenate(self.sigma) if self.sigma else np.zeros((0, self.kind.size))


@dataclass(frozen=True)
class Entities:
    """Named things of one namespace; ``parts[part]`` (n,) are the numbers of their blocks."""

    ids: tuple[str, ...]
    parts: Mapping[str, IntArray]

    @cached_property
    def numbers(self) -> Mapping[str, int]:
        """Number of each thing by its name; of things of one name the last."""
        return {name: number for number, name in enumerate(self.ids)}

    def part(self, name: str, part: str) -> int:
        """Block number of a part of a named thing."""
        return int(self.parts[part][self.numbers[name]])


def entities(ids: Iterable[str], parts: Mapping[str, IntArray]) -> Entities:
    """Entities with their names looked up."""
    return Entities(tuple(ids), parts)


@dataclass
class Workshop:
    """Everything known while a network is put together: blocks by kind, things by namespace."""

    stores: dict[str, BlockStore]
    things: dict[str, Entities]
    neutral_blocks: dict[str, int] = field(default_factory=dict)
    sources: list[tuple[str, dict[str, int]]] = field(default_factory=list)
    """Tables of the project in the order they were read, and how many blocks of each kind there were before."""

    def store(self, kind: str) -> BlockStore:
        """Store of a kind."""
        return self.stores[kind]

    def begin(self, table: str) -> None:
        """Blocks that are added from now on come from this table."""
        self.sources.append((table, {kind: len(store.ids) for kind, store in self.stores.items()}))

    def source(self, kind: str) -> IntArray:
        """(n,) number of the table that each block of a kind comes from, −1 where it comes from none."""
        first = np.array([counts[kind] for _, counts in self.sources], dtype=np.int64)
        return np.asarray(np.searchsorted(first, np.arange(len(self.stores[kind].ids)), side="right") - 1)

    def neutral(self, kind: str) -> int:
        """The block of zeros of a kind, for what has none of its own; added where nothing has asked for it yet."""
        store = self.stores[kind]
        if kind not in self.neutral_blocks:
            self.neutral_blocks[kind] = store.add_fixed("none", [0.0] * store.kind.size)
        return self.neutral_blocks[kind]


def workshop() -> Workshop:
    """An empty workshop with the neutral blocks (number 0) of the kinds an observation may do without."""
    stores = {key: BlockStore(kind) for key, kind in KINDS.items()}
    stores["height"].add_fixed("none", [0.0])
    stores["eccentricity"].add_fixed("none", [0.0, 0.0, 0.0])
    stores["distance meter"].add_fixed("none", [1.0, 0.0])
    stores["refraction"].add_fixed("none", [0.0])
    stores["scale"].add_fixed("none", [1.0])
    stores["gnss frame"].add_fixed("none", [0.0] * 6 + [1.0])
    return Workshop(stores, {})


FRAMES = ("image", "station", "system", "feature", "pair", "knot")
"""Namespaces whose things have blocks that are called after them: ``image 1``."""


def thing_of(kind: str, block: str) -> tuple[str, str]:
    """Namespace and name of the thing that a block belongs to: image 1 for the position called ``image 1``."""
    space, _, name = block.partition(" ")
    return (space, name) if space in FRAMES and name else (kind, block)


def said_thing(kind: str, block: str) -> str:
    """The thing a block belongs to, as a project names it: ``camera K``, ``instrument edm``, ``image 1``."""
    space, name = thing_of(kind, block)
    if block.partition(" ")[0] in ("camera", kind):
        return block
    if kind.startswith("interior/") and space == kind:
        space = "camera"
    declared_as = dict.fromkeys(
        ("distance meter", "refraction", "gnss frame", "position shift", "attitude shift", "time offset"), "instrument"
    )
    return f"{declared_as.get(space, space)} {name}"


def set_name(station: str, set_: str) -> str:
    """Name of a set of directions; a station without sets is its own."""
    return f"{station}/{set_}" if set_ else station


def unknown_name(what: str, name: str, known: Iterable[str]) -> str:
    """Words for a name that nothing has."""
    return f"{what} {name!r} does not exist{nearest(name, known)}"


# ---- Components that are equal, or differ by a known amount: they are one unknown.

Node = tuple[int, int]
"""Number of a block, number of a component."""


class Equality(NamedTuple):
    """One component of two blocks of a kind: that of ``second`` is that of ``first`` plus ``difference``, exactly."""

    component: int
    first: int
    second: int
    difference: float


class ContradictionError(ValueError):
    """Values declared equal differ; ``number`` is that of the equality, if it is one of them."""

    def __init__(self, words: str, number: int | None = None) -> None:
        super().__init__(words)
        self.number = number


@dataclass
class _Classes:
    """Components tied to each other, each by its difference from the one that is the unknown (union-find)."""

    above: dict[Node, tuple[Node, float]] = field(default_factory=dict)

    def find(self, node: Node) -> tuple[Node, float]:
        """The component that stands for all that are tied to this one, and how much this one exceeds it."""
        total = 0.0
        while node in self.above:
            node, apart = self.above[node]
            total += apart
        return node, total

    def tie(self, first: Node, second: Node, difference: float) -> float:
        """Tie two components; returned is by how much this contradicts what was tied before."""
        (one, of_one), (other, of_other) = self.find(first), self.find(second)
        apart = of_one + difference - of_other
        if one == other:
            return apart
        if one < other:
            self.above[other] = (one, apart)
        else:
            self.above[one] = (other, -apart)
        return 0.0

    def members(self) -> Mapping[Node, list[tuple[Node, float]]]:
        found: dict[Node, list[tuple[Node, float]]] = {}
        for node in sorted(self.above):
            root, apart = self.find(node)
            found.setdefault(root, [(root, 0.0)]).append((node, apart))
        return found


def settle_equalities(store: BlockStore, equalities: Iterable[Equality]) -> None:
    """Make one unknown of all components of a kind that are tied to each other, with one status and start value.

    One that is fixed fixes all. What is observed of any of them stays observed. Components that are shared already
    (image-variant interiors) are tied too. Raises :class:`ContradictionError`.
    """
    classes = _Classes()
    for (block, component), owner in store.shared.items():
        apart = store.differences.get((block, component), 0.0)
        classes.tie((owner, component), (block, component), apart)
    full = 2.0 * np.pi if store.kind.is_rotation else np.inf
    for number, tie in enumerate(equalities):
        over = classes.tie((tie.first, tie.component), (tie.second, tie.component), tie.difference)
        if not _nothing(over, tie.difference, full):
            raise ContradictionError(f"this contradicts other exact differences, by {abs(over):g}", number)
    for root, members in classes.members().items():
        _settle(store, members, full)
        for (block, component), apart in members[1:]:
            store.shared[block, component] = root[0]
            store.differences[block, component] = apart


def _nothing(value: float, scale: float, full: float) -> bool:
    """Return True if a value is zero but for round-off, and for whole turns."""
    rest = float(np.remainder(value + 0.5 * full, full) - 0.5 * full) if np.isfinite(full) else value
    return abs(rest) <= 1e-9 * max(abs(scale), 1e-3)


def _settle(store: BlockStore, members: list[tuple[Node, float]], full: float) -> None:
    """One status and one start value, but for their differences, for components that are one unknown."""
    table = store.merged()
    known = [(node, table.values[node] - apart) for node, apart in members if not table.free[node]]
    for node, value in known[1:]:
        if not _nothing(value - known[0][1], value, full):
            names = f"{store.ids[known[0][0][0]]} and {store.ids[node[0]]}"
            raise ContradictionError(f"this contradicts the fixed values of {names}")
    starts = [
        (table.values[node] if np.isnan(table.start[node]) else table.start[node]) - apart for node, apart in members
    ]
    value = known[0][1] if known else next((start for start in starts if np.isfinite(start)), np.nan)
    for node, apart in members:
        observed = np.isfinite(table.sigma[node])
        if known and observed:
            fixed, seen = store.ids[known[0][0][0]], store.ids[node[0]]
            raise ContradictionError(f"{fixed} is fixed; {seen}, which equals it, cannot be observed")
        (table.start if observed else table.values)[node] = value + apart
        table.free[node] = not known
        if not observed:
            table.start[node] = np.nan


# ---- Times as people write them, in years.


def decimal_year(text: str) -> float:
    """Year and part of that year behind 2015-05-12, 2015-05-12T14:30, 2015-05 (its first day) or 2015.36.

    Raises ``ValueError`` with what was found and what was expected.
    """
    if re.fullmatch(r"[12]\d{3}(\.\d+)?", text):
        return float(text)
    try:
        moment = datetime.fromisoformat(f"{text}-01" if re.fullmatch(r"[12]\d{3}-\d{2}", text) else text).replace(
            tzinfo=None
        )
    except ValueError:
        raise ValueError(f"found {text!r}, expected a date such as 2015-05-12, or a year such as 2015.36") from None
    begin = datetime(moment.year, 1, 1)
    whole = datetime(moment.year + 1, 1, 1) - begin
    return moment.year + (moment - begin) / whole


# ---- Which points move, and how: blocks behind a point at a time.

AT = "@"
"""Between the name of a point and the time from which coordinates of its own hold."""


@dataclass
class MovingPoint:
    """A point that moves: its coordinates by stretches of time, and what moves it all the time."""

    name: str
    steps: list[tuple[float, int]]
    """Start times of other coordinates, ascending, and their blocks; before the first the point's own."""
    block: int
    """Its own block: before all steps, or in its first epoch."""
    own_epochs: bool = False
    """True if every epoch has coordinates of its own."""
    by_epoch: dict[int, int] = field(default_factory=dict)
    """Block of each epoch of those."""
    motions: dict[str, int] = field(default_factory=dict)
    """Block of each kind of movement it has."""
    epochs: set[int] = field(default_factory=set)
    """Epochs in which it was observed."""

    def at(self, epoch: int, time: float) -> int:
        """Block of its coordinates at an epoch. Raises ``KeyError`` where it has none of its own there."""
        if self.own_epochs:
            return self.by_epoch[epoch]
        number = bisect_right([step for step, _ in self.steps], time)
        return self.steps[number - 1][1] if number else self.block


@dataclass
class TimeModel:
    """Everything about time in a project."""

    labels: list[str] = field(default_factory=list)
    """Epochs as they were first written."""
    times: list[float] = field(default_factory=list)
    """The same in years."""
    reference: float = 0.0
    """t0, in years."""
    points: dict[int, MovingPoint] = field(default_factory=dict)
    """Moving points by their own blocks."""
    stands_for: dict[int, int] = field(default_factory=dict)
    """Point whose coordinates at some time a block has, by that block."""
    epoch_of: dict[str, dict[str, int]] = field(default_factory=dict)
    """Epoch of the images and stations that have one, by namespace and name."""
    tables: list[tuple[str, list[str]]] = field(default_factory=list)
    """Model of each declared table, and the points in it."""

    def epoch(self, text: str) -> int:
        """Number of the epoch behind a text, the same for texts of one time. Raises ``ValueError``."""
        time = decimal_year(text)
        if time not in self.times:
            self.labels.append(text)
            self.times.append(time)
        return self.times.index(time)

    def label_of(self, space: str, name: str) -> str:
        """Epoch of an image or a station as it was written; nothing if it has none."""
        epoch = self.epoch_of.get(space, {}).get(name)
        return "" if epoch is None else self.labels[epoch]

    @property
    def in_order(self) -> list[int]:
        """Numbers of the epochs, the first in time first."""
        return sorted(range(len(self.times)), key=self.times.__getitem__)


# ---- A trajectory: times and blocks of its knots, and which of them a pose at a time depends on.


class Clock(NamedTuple):
    """n times on a trajectory, each from its k knots."""

    knots: IntArray
    """(n, k) numbers of the knots in the trajectory, first the one before the time."""
    constants: FloatArray
    """(n, 1 + k²) time since that knot, and the weights as polynomials of it."""
    inside: BoolArray
    """(n,) false where the trajectory is not known: before, behind, in a gap."""


class Scanner(NamedTuple):
    """A camera that is a line scanner."""

    line_time: float
    """Seconds from one line to the next; NaN if its images have tables of their times."""
    line: float
    """y of the line in the axes of the camera, image unit."""


class RowTimes(NamedTuple):
    """Row times of an image of a line scanner, from its upper edge; linear in between."""

    rows: FloatArray
    times: FloatArray
    steady: bool = False
    """True if they say a rate that goes on before and behind."""


class Trajectory(NamedTuple):
    """Knots of a trajectory, in the order of their times."""

    name: str
    times: FloatArray
    """(k,) ascending."""
    stretch: IntArray
    """(k,) number of the stretch a knot belongs to; between stretches there is nothing."""
    positions: IntArray
    """(k,) point blocks."""
    rotations: IntArray
    """(k,) rotation blocks."""
    cubic: bool

    @property
    def order(self) -> int:
        """Knots that a pose depends on."""
        return CUBIC if self.cubic else LINEAR

    def clock(self, times: FloatArray, later: FloatArray | None = None) -> Clock:
        """Places of times (n,) on the trajectory; outside of it any finite value.

        Where something is seen so much ``later`` (n,), or before, the knots are those about then, within the stretch.
        """
        before = self._before(times)
        whole = self.stretch[before] == self.stretch[before + 1]
        inside = whole & (times >= self.times[before]) & (times <= self.times[before + 1])
        if later is not None:
            here = self.stretch[before]
            first, last = (np.searchsorted(self.stretch, here, side=side) for side in ("left", "right"))
            before = np.clip(self._before(times + later), first, np.maximum(last - LINEAR, first))
        if not self.cubic:
            knots = before[:, None] + np.arange(LINEAR)
            weights = linear_weights(self.times[before + 1] - self.times[before])
        else:
            knots, weights = self._four(before)
        since = (times - self.times[before])[:, None]
        return Clock(knots, np.concatenate([since, weights.reshape(len(times), -1)], axis=1), np.asarray(inside))

    def _before(self, times: FloatArray) -> IntArray:
        """(n,) the knots before times; the last of a stretch belongs to the interval that it ends."""
        before = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        ends = (self.stretch[before] != self.stretch[before + 1]) & (times == self.times[before])
        return np.asarray(np.maximum(before - ends, 0))

    def _four(self, before: IntArray) -> tuple[IntArray, FloatArray]:
        """The knots about intervals that begin at ``before`` (n,), that knot first, and their weights."""
        count = np.bincount(self.stretch)
        first = (np.cumsum(count) - count)[self.stretch[before]]
        last = first + count[self.stretch[before]] - CUBIC
        begin = np.clip(before - 1, first, np.maximum(last, first))
        place = np.minimum(before - begin, CUBIC - 2)
        four = np.minimum(begin[:, None] + np.arange(CUBIC), len(self.times) - 1)
        order = np.stack([(place + k) % CUBIC for k in range(CUBIC)], axis=1)
        weights = np.take_along_axis(cubic_weights(self.times[four], place), order[:, :, None], axis=1)
        return np.take_along_axis(four, order, axis=1), weights

    def blocks(self, clock: Clock) -> IntArray:
        """(2k, n) blocks of the knots, positions first."""
        return np.concatenate([self.positions[clock.knots].T, self.rotations[clock.knots].T])

    def outside(self, time: float) -> str:
        """Words for a time at which the trajectory is not known."""
        known = f"it is known from {said_time(self.times[0])} to {said_time(self.times[-1])}"
        gaps = np.flatnonzero(np.diff(self.stretch))
        here = gaps[(self.times[gaps] < time) & (time < self.times[gaps + 1])]
        if len(here):
            a, b = (said_time(self.times[here[0] + k]) for k in (0, 1))
            known = f"it has a gap from {a} to {b}"
        return f"the time {said_time(time)} is outside the trajectory {self.name!r}: {known}"


def said_time(time: float) -> str:
    """A time in words, seconds."""
    return f"{time:.12g} s"


def knot_name(trajectory: str, time: float) -> str:
    """Name of a knot in reports."""
    return f"{trajectory}@{time:.12g}"


# ---- What the steps of reading a project share.

TableWatcher: TypeAlias = Callable[[str | None], None]
"""Told the file of a table when it has been read."""
SetUp: TypeAlias = tuple[FloatArray, ...]
"""Value, σ, start and freedom of a shared constant, (1, size) each, as far as rows have said them."""


def ignore_table(file: str | None) -> None:
    """Nobody watches."""


def table_label(section: str, number: int, table: TableEntry) -> str:
    """Name of a table in reports."""
    return table.name or table.file or f"{section} {number + 1}"


@dataclass
class Reading:
    """State shared by the steps of reading: the project, its folder, and the mistakes found."""

    project: ProjectFile
    place: TableLocation
    edge: Edge
    shop: Workshop
    watch: TableWatcher
    """Told each long table that has been read."""
    sets: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Station and set behind the names of further sets at declared stations."""
    unoriented: set[str] = field(default_factory=set)
    """Stations without an orientation: no direction was observed at them."""
    broken: set[str] = field(default_factory=set)
    """Namespaces that could not be read completely: a name missing from them may be no mistake of its own."""
    notes: list[Message] = field(default_factory=list)
    """Assumptions to report."""
    scales: dict[str, ImageScale] = field(default_factory=dict)
    shared_set_ups: dict[str, dict[str, SetUp]] = field(default_factory=dict)
    """Constants shared by name, by kind."""
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
    world: EarthModel | None = None
    """The earth under the network, where the project has one."""
    sphere: LocalSphere | None = None
    """The sphere under a local network, where the project models the curvature of the earth."""
    types: Mapping[str, ObservationType] = field(default_factory=lambda: PLAIN_TYPES)
    """Observation types of the project, besides image coordinates."""
    control: list[ObservationGroup] = field(default_factory=list)
    """Observed points on the earth."""
    motion: TimeModel = field(default_factory=TimeModel)
    """Epochs, and the points that move between them."""
    trajectories: dict[str, Trajectory] = field(default_factory=dict)
    """Trajectories by name."""
    image_times: dict[str, float] = field(default_factory=dict)
    """Time of each image on a trajectory; of a line scanner that of its first line."""
    scanners: dict[str, Scanner] = field(default_factory=dict)
    """Cameras that are line scanners."""
    lines: dict[str, RowTimes] = field(default_factory=dict)
    """Row times of images of line scanners: from tables, and for all images once they are read."""
    strips: dict[tuple[str, str], tuple[int, float]] = field(default_factory=dict)
    """Block of shift and drift of each strip, by kind and name, and the time that its drift counts from."""
    motion_groups: list[ObservationGroup] = field(default_factory=list)
    """Steps of points that are observed."""

    def begin(self, section: str, number: int, table: TableEntry) -> None:
        """Blocks that are added from now on come from this table of a section."""
        self.shop.begin(table_label(section, number, table))

    def end(self, space: str, count: int) -> None:
        """So many things of a namespace were read from the table that was begun last."""
        self.tables.setdefault(space, []).append((self.shop.sources[-1][0], count))

    def at(self, *path: str | int) -> TableLocation:
        """The place of a part of the project file."""
        if path[:1] == ("observations",):
            path = (self.section, *path[1:])
        return self.place.at(*path)

    @property
    def problems(self) -> list[Message]:
        """All mistakes found."""
        return self.place.problems

    @property
    def document(self) -> Document:
        """The project file itself."""
        return self.place.document
