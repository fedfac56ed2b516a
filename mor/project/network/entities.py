"""What a project names: points, images, stations, systems … and the blocks that stand behind each name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import nearest
from mor.parameters.index import Blocks
from mor.parameters.kinds import KINDS, BlockKind
from mor.project.tables.statuses import Statuses


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
        owner: IntArray = np.broadcast_to(
            np.arange(len(self.ids), dtype=np.int64)[:, None], (len(self.ids), size)
        )
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
        source: IntArray = np.searchsorted(first, np.arange(len(self.stores[kind].ids)), side="right") - 1
        return source

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


FRAMES = ("image", "station", "system", "pair", "knot")
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
    return f"{_DECLARED_AS.get(space, space)} {name}"


_DECLARED_AS = dict.fromkeys(
    ("distance meter", "refraction", "gnss frame", "position shift", "attitude shift", "time offset"),
    "instrument",
)


def unknown_name(what: str, name: str, known: Iterable[str]) -> str:
    """Words for a name that nothing has."""
    return f"{what} {name!r} does not exist{nearest(name, known)}"
