"""Define an observation type: components, parameter blocks, and one vectorised equation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mor.arrays import AnyIntArray, BoolArray, FloatArray, IntArray, SmallIntArray
from mor.observations.names import Names
from mor.units import ANGLE, Component


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


class SetUp(NamedTuple):
    """Standard deviations of the set-up of instrument and target, length unit: of position (each way) and height."""

    instrument: float = 0.0
    target: float = 0.0
    instrument_height: float = 0.0
    target_height: float = 0.0


PERFECT_SET_UP = SetUp()


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
    centring: SetUp = PERFECT_SET_UP
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
    def mask(self) -> BoolArray:
        """(n, m) true where there is an observation."""
        return np.isfinite(self.observed)

    @property
    def left_out(self) -> BoolArray:
        """(n, m) true where there is an observation that is kept out of the adjustment."""
        return self.mask & self.excluded if self.excluded is not None else np.zeros(self.observed.shape, bool)

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
