"""The contract of observation types: equations, derivatives, names of the ends, standard deviations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.errors import Message
from mor.model.parameters import Values
from mor.types import AnyIntArray, BoolArray, FloatArray, IntArray, SmallIntArray
from mor.units import ANGLE, Component

# ---- Names of many rows as numbers into a list of the different ones: no Python object for each row.


@dataclass(frozen=True)
class Names:
    """One name for each of n rows. It reads like a sequence of texts; arrays are what it holds."""

    numbers: SmallIntArray
    """(n,) place of each row's name in ``known``."""
    known: Sequence[str]
    """Names the numbers point into, e.g. all points of a project; shared, never copied."""

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, row: int) -> str:
        name: str = self.known[self.numbers[row]]
        return name

    def __iter__(self) -> Iterator[str]:
        return (self.known[number] for number in self.numbers)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """(n,) texts, as numpy has them: every name takes the room of the longest."""
        used, numbers = np.unique(self.numbers, return_inverse=True)
        texts = np.array([self.known[number] for number in used], dtype=dtype or str)
        return texts[numbers]

    def rows_of_each(self) -> dict[str, IntArray]:
        """Rows (k,) of each name, in the order in which the names come."""
        texts, first, numbers = np.unique(np.asarray(self), return_index=True, return_inverse=True)
        rows = np.split(np.argsort(numbers, kind="stable"), np.cumsum(np.bincount(numbers))[:-1])
        return {str(texts[k]): rows[k] for k in np.argsort(first)}

    def take(self, rows: IntArray | slice) -> Names:
        """The names of some rows."""
        return Names(self.numbers[rows], self.known)

    def texts(self) -> pl.Series:
        """(n,) texts as a column of a table."""
        return self.column().texts()

    def column(self) -> Coded:
        """The same as places in a column of names: of all that are known, or of those that are used by few rows."""
        # Names for each row from which on the others are not made texts of.
        if len(self.known) <= 50 * len(self.numbers):
            return Coded(_column_of(self.known), self.numbers)
        used, numbers = np.unique(self.numbers, return_inverse=True)
        return Coded(pl.Series([self.known[number] for number in used], dtype=pl.String), numbers)


class Coded(NamedTuple):
    """Texts (n,) as numbers into a column of different ones."""

    known: pl.Series
    numbers: IntArray | SmallIntArray

    def texts(self) -> pl.Series:
        """(n,) as a column."""
        return self.known.gather(self.numbers)

    def names(self) -> Names:
        """The same with known names that Python has as texts."""
        return Names(self.numbers.astype(np.int32, copy=False), tuple(self.known.to_list()))

    def expression(self, rows: IntArray) -> pl.Expr:
        """Some rows of it, for a table of as many."""
        return pl.lit(self.known).gather(pl.lit(pl.Series(self.numbers[rows])))


_columns: list[tuple[Sequence[str], pl.Series]] = []
"""The lists of names asked for last, as columns: a long table is made in many pieces of the same names."""


def _column_of(known: Sequence[str]) -> pl.Series:
    for own, column in _columns:
        if own is known:
            return column
    column = pl.Series(known, dtype=pl.String)
    kept = 4
    _columns[:] = [(known, column), *_columns[: kept - 1]]
    return column


def names_of(texts: Sequence[str]) -> Names:
    """Names of rows as they stand in a short list."""
    return Names(np.arange(len(texts), dtype=np.int32), tuple(texts))


def one_name(text: str, count: int) -> Names:
    """Return one name for all rows, stored once."""
    return Names(np.broadcast_to(np.zeros(1, dtype=np.int32), (count,)), (text,))


def coded(texts: pl.Series) -> Coded:
    """Texts (n,), none of them null: each different one is kept once, in the order in which it comes first."""
    known = texts.unique(maintain_order=True)
    return Coded(known, places(texts, known, unique=True))


def places(texts: pl.Series, known: pl.Series, unique: bool = False) -> SmallIntArray:
    """(n,) place of every text in a list; −1 where it is not among them, the last one where it is there twice.

    That of a ``unique`` list is not looked through for texts that are there twice.
    """
    table = pl.DataFrame({"name": known, "number": np.arange(len(known), dtype=np.int32)})
    if not unique and known.n_unique() < len(known):
        table = table.unique("name", keep="last")
    found = pl.DataFrame({"name": texts}).join(table, on="name", how="left", maintain_order="left")
    numbers: SmallIntArray = found["number"].fill_null(-1).to_numpy()
    return numbers


def places_of(names: Names, known: Sequence[str]) -> SmallIntArray:
    """(n,) place of every name in a list that has them all."""
    if names.known is known:
        return names.numbers
    there = places(pl.Series(names.known, dtype=pl.String), pl.Series(known, dtype=pl.String))
    result: SmallIntArray = there[names.numbers]
    return result


# ---- Define an observation type: components, parameter blocks, and one vectorised equation.


class Computed(NamedTuple):
    """Values and derivatives of an equation for n observations of m components."""

    values: FloatArray
    """(n, m) computed values."""
    jacobians: tuple[FloatArray, ...]
    """One (n, m, k) array per slot; k columns as the kind of block has components."""


class Reference(NamedTuple):
    """A name an observation row carries (``image``, ``from``) and the namespaces it may come from."""

    name: str
    among: tuple[str, ...]


class Slot(NamedTuple):
    """One block an observation depends on: its kind, whose it is, and which part of that one."""

    kind: str
    of: str
    part: str


Equation = Callable[[Sequence[FloatArray], FloatArray], Computed]


class ObservationType(NamedTuple):
    """An observation type.

    ``equation(blocks, constants)`` takes one array per slot, (n, size) or (n, 3, 3) for rotations, and the
    constants of each observation (n, q).
    """

    key: str
    components: tuple[Component, ...]
    references: tuple[Reference, ...]
    slots: tuple[Slot, ...]
    equation: Equation
    constants: tuple[Component, ...] = ()
    """Constants a row may carry besides, e.g. the face of the instrument."""
    distances: tuple[str, str] | None = None
    """The two references whose distance the σ model a ⊕ b·d and centring errors refer to."""
    turns: tuple[int, ...] = ()
    """Components that count in the sense of the project's horizontal angles."""
    bearings: tuple[int, ...] = ()
    """Those of them that also count from the project's zero direction."""
    tell_face: Callable[[FloatArray], FloatArray] | None = None
    """Face (1 or 2) that the reading (n,) of the last component tells, for types with a constant ``face``."""
    in_object_axes: bool = False
    """True if the components are coordinates in the axes of the object system."""
    written: str = ""
    """What a project calls it, where that is not the key."""
    about_local_vertical: bool = False
    """True if the equation turns into the horizon of the place: on the earth verticals are not parallel."""
    between_marks: bool = False
    """True if marks are observed (levelling, satellites), not sights of an instrument that stands over one."""
    through_air: bool = False
    """True if a length is measured by the time that light takes: the air makes it longer."""
    drawn: str = ""
    """Line of a network figure between its places: direction, distance, levelling, vector, or none."""
    still: ObservationType | None = None
    """Of points that move, the same observation of points that do not."""
    flat: ObservationType | None = None
    """Of a type on a sphere, the same observation with parallel verticals."""

    @property
    def name(self) -> str:
        """Name of the type in projects and reports."""
        return self.written or self.key

    @property
    def wraps(self) -> BoolArray:
        """(m,) true for angular components: their residuals wrap at the full circle."""
        return np.array([component.quantity == ANGLE for component in self.components])


class External(NamedTuple):
    """Transformation from internal to reported components: internal = T · (given · factor) + t."""

    transform: FloatArray
    """(m, m) signed permutation T."""
    offset: FloatArray
    """(m,) t."""
    factors: FloatArray
    """(m,) internal units per given unit."""
    units: tuple[str, ...]


class SetUpSigmas(NamedTuple):
    """Standard deviations of the set-up of instrument and target, length unit: of position (each way) and height."""

    instrument: float = 0.0
    target: float = 0.0
    instrument_height: float = 0.0
    target_height: float = 0.0


PERFECT_SET_UP = SetUpSigmas()


@dataclass(frozen=True)
class ObservationGroup:
    """All observations of one type that were given together."""

    name: str
    type: ObservationType
    blocks: tuple[AnyIntArray, ...]
    """One (n,) array of block numbers per slot."""
    observed: FloatArray
    """(n, m); NaN if a component was not observed."""
    sigma: FloatArray
    """(n, m) standard deviations, > 0 where observed."""
    constants: FloatArray
    """(n, q)."""
    references: tuple[Names, ...]
    """The n names per reference of the type."""
    ppm: float = 0.0
    """Part b of the σ model a ⊕ b·d, in 10⁻⁶."""
    centring: SetUpSigmas = PERFECT_SET_UP
    """Errors of the set-up of instrument and target."""
    external: External | None = None
    """How it was given; ``None`` if it is given in internal units and axes."""
    image_unit: str = "mm"
    lines: SmallIntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    """(n,) line of each row in its file, or none where the rows come from nowhere."""
    file: str = ""
    excluded: BoolArray | None = None
    """(n, m) entries kept out of the adjustment: they have next to no weight, and a residual all the same."""

    @property
    def count(self) -> int:
        """Number of rows n, each of up to m observations."""
        return len(self.observed)

    @property
    def blocks_by_slot(self) -> list[tuple[Slot, AnyIntArray]]:
        """Each slot of the type with the (n,) numbers of its blocks."""
        return list(zip(self.type.slots, self.blocks, strict=True))

    def blocks_of(self, kind: str) -> list[AnyIntArray]:
        """(n,) numbers of the blocks of each slot of a kind."""
        return [blocks for slot, blocks in self.blocks_by_slot if slot.kind == kind]

    def column(self, reference: str) -> Names:
        """The n names of a reference of the type."""
        return self.references[[own.name for own in self.type.references].index(reference)]

    def names_of(self, row: int) -> dict[str, str]:
        """Names of what a row refers to, by the references of the type."""
        return {of.name: names[row] for of, names in zip(self.type.references, self.references, strict=True)}

    def said_names(self, row: int) -> str:
        """Return the names that a row refers to, for a message: ``image 12, point A``."""
        return ", ".join(f"{key} {name}" for key, name in self.names_of(row).items())

    def message(self, row: int, words: str) -> Message:
        """A message about a row, with its file and line where it has them."""
        return Message(words, self.file, self.line(row))

    def line(self, row: int) -> int:
        """Line of a row in its file, 0 where it comes from none."""
        return int(self.lines[row]) if len(self.lines) > row else 0

    @property
    def mask(self) -> BoolArray:
        """(n, m) true where there is an observation."""
        return np.isfinite(self.observed)

    @property
    def left_out(self) -> BoolArray:
        """(n, m) true where there is an observation that is kept out of the adjustment."""
        return self.mask & self.excluded if self.excluded is not None else np.zeros(self.observed.shape, bool)

    @property
    def used(self) -> BoolArray:
        """(n, m) true where there is an observation that takes part in the adjustment."""
        return self.mask & ~self.left_out

    def used_among(self, rows: IntArray | slice) -> BoolArray:
        """(k, m) of some rows, true where there is an observation that takes part in the adjustment."""
        seen = np.isfinite(self.observed[rows])
        return seen if self.excluded is None else seen & ~self.excluded[rows]

    @property
    def given_sigma(self) -> FloatArray:
        """(n, m) standard deviations, those of excluded entries as they were before they were excluded."""
        return np.where(self.left_out, self.sigma / OUT, self.sigma)


OUT = 1e10
"""Factor on the σ of an excluded entry: its weight, 10⁻²⁰ of what it was, is below all round-off.

It stays in the system, so that its residual and the cofactors of its adjusted value come out like all others.
"""


def without(group: ObservationGroup, excluded: BoolArray) -> ObservationGroup:
    """The group with these entries (n, m) excluded, and no others."""
    sigma = np.where(group.mask & excluded, group.given_sigma * OUT, group.given_sigma)
    return replace(group, sigma=sigma, excluded=excluded if excluded.any() else None)


def some_rows(group: ObservationGroup, rows: IntArray | slice) -> ObservationGroup:
    """The group of some rows of a group."""
    return replace(
        group,
        blocks=tuple(blocks[rows] for blocks in group.blocks),
        observed=group.observed[rows],
        sigma=group.sigma[rows],
        constants=group.constants[rows],
        references=tuple(names.take(rows) for names in group.references),
        lines=group.lines[rows] if len(group.lines) else group.lines,
        excluded=group.excluded[rows] if group.excluded is not None else None,
    )


def wrap(angle: FloatArray) -> FloatArray:
    """Angles folded into [−π, π]."""
    folded: FloatArray = np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi
    return folded


# ---- The vector between two positions, with the heights of instrument and target, that the terrestrial types share.

POSITIONS = ("point", "station", "image")

FROM_TO = (Reference("from", POSITIONS), Reference("to", POSITIONS))
BETWEEN_SLOTS = (
    Slot("point", "from", "position"),
    Slot("height", "from", "height"),
    Slot("point", "to", "position"),
    Slot("height", "to", "height"),
)


def between(blocks: Sequence[FloatArray]) -> FloatArray:
    """Vectors (n, 3) from the instrument at ``from`` to the target at ``to``; blocks as in BETWEEN_SLOTS."""
    start, start_height, end, end_height = blocks
    difference = end - start
    difference[:, 2] += end_height[:, 0] - start_height[:, 0]
    return difference


def by_between(by_vector: FloatArray) -> tuple[FloatArray, ...]:
    """Chain (n, m, 3) derivatives by the vector on to the slots of BETWEEN_SLOTS."""
    vertical = by_vector[:, :, 2:]
    return -by_vector, -vertical, by_vector, vertical


def horizontal_length(vector: FloatArray) -> FloatArray:
    """√(ΔX² + ΔY²) (n,), never zero: a vertical sight keeps its derivatives finite."""
    tiny = np.finfo(float).tiny
    return np.asarray(np.maximum(np.hypot(vector[:, 0], vector[:, 1]), tiny**0.5))


def bearing(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bearings atan2(X, Y) (n,), clockwise from +Y, and their derivatives (n, 3)."""
    square = horizontal_length(vector) ** 2
    derivative = np.zeros_like(vector)
    derivative[:, 0] = vector[:, 1] / square
    derivative[:, 1] = -vector[:, 0] / square
    return np.arctan2(vector[:, 0], vector[:, 1]), derivative


def elevation(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Vertical directions atan(Z / √(X² + Y²)) (n,) and their derivatives (n, 3)."""
    horizontal = horizontal_length(vector)
    square = horizontal**2 + vector[:, 2] ** 2
    derivative = np.empty_like(vector)
    derivative[:, :2] = -(vector[:, :2] / horizontal[:, None]) * (vector[:, 2] / square)[:, None]
    derivative[:, 2] = horizontal / square
    return np.arctan2(vector[:, 2], horizontal), derivative


def spatial_length(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lengths √(X² + Y² + Z²) (n,) and their derivatives (n, 3)."""
    length = np.linalg.norm(vector, axis=1)
    return length, vector / np.maximum(length, np.finfo(float).tiny ** 0.5)[:, None]


# ---- σ models: what depends on the length of the sight is added once, at the start values.


def with_sigma_model(group: ObservationGroup, values: Values) -> ObservationGroup:
    """The group with σ² = a² + (b·d)² + centring², d the distance between its two positions at the given values.

    b·d applies to lengths. An error of the set-up is an error in the horizontal position of instrument or target,
    either way, or in its height; the instrument stands at the first reference of the type. How it acts on an
    observation is what its derivatives by these positions say, for every type: a horizontal error e acts with e on a
    distance, with e/s on a direction, not on a height difference, and with √(e_t²(1/a² + 1/b²) + e_i² c²/(ab)²) on an
    angle with legs a, b and targets c apart.
    """
    if group.ppm == 0.0 and not any(group.centring):
        return group
    variance = group.sigma**2
    if group.ppm:
        lengths = np.array([component.quantity.length == 1 for component in group.type.components])
        growing = (group.ppm * 1e-6 * lengths_of_sights(group, values)) ** 2
        variance = variance + np.where(lengths[None, :], growing[:, None], 0.0)
    return replace(group, sigma=np.sqrt(variance + _centring_variance(group, values)))


def _centring_variance(group: ObservationGroup, values: Values) -> FloatArray:
    blocks = [values[slot.kind][number] for slot, number in group.blocks_by_slot]
    jacobians = group.type.equation(blocks, group.constants).jacobians
    variance = np.zeros(group.observed.shape)
    for slot, jacobian in zip(group.type.slots, jacobians, strict=True):
        if slot.part == "position":
            at_instrument = slot.of == group.type.references[0].name
            set_up = group.centring
            across = set_up.instrument if at_instrument else set_up.target
            upwards = set_up.instrument_height if at_instrument else set_up.target_height
            variance += across**2 * np.sum(jacobian[:, :, :2] ** 2, axis=2)
            variance += (upwards * jacobian[:, :, 2]) ** 2
    return variance


def lengths_of_sights(group: ObservationGroup, values: Values) -> FloatArray:
    """Return the distances (n,) between the two ends of each row of a group that has two."""
    positions = [
        values[slot.kind][number]
        for end in group.type.distances or ()
        for slot, number in group.blocks_by_slot
        if slot.of == end and slot.part == "position"
    ]
    return np.asarray(np.linalg.norm(positions[1] - positions[0], axis=1))
