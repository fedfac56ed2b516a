"""Hypotheses: changes of a project that would make its observations agree."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.diagnose.edits import Edit
from mor.observations import ObservationGroup
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.quality.solved import Amount


@dataclass(frozen=True)
class Hypothesis:
    """A mistake that may have been made, as the change of the network that undoes it."""

    cause: str
    """Key of the cause: ``names exchanged``, ``distance offset`` …"""
    things: tuple[str, ...]
    """Names of what it is about, those of points and instruments or of tables."""
    change: Callable[[Network], Network]
    line: str
    """What to write in the project to try it."""
    candidates: int = 1
    """How many of its kind were looked through."""
    parameters: int = 0
    """Additional unknowns."""
    stretch: float = 0.0
    """Σ ln |dl'/dl| of changed observations, less Σ ln (σ'/σ): densities change with the unit, as far as controlled."""
    rows: tuple[tuple[int, int], ...] = ()
    """(group, row) of the few observations it changes; none where it changes many."""
    anew: Mapping[str, IntArray] = field(default_factory=dict)
    """Blocks of each kind that begin from the given start values again; where none are given, from all else."""
    afresh: bool = False
    """True where missing start values are worth being worked out anew."""
    edits: tuple[Edit, ...] = ()
    """Edits of the files of the project; none if it cannot be expressed by any."""
    amount: Callable[[Values], Amount] | None = None
    """What its additional unknown is at a solution."""

    def amount_at(self, values: Values) -> Amount | None:
        """Its additional unknown at a solution; nothing where it has none."""
        return None if self.amount is None else self.amount(values)


class Fit(NamedTuple):
    """How well a network fits its observations."""

    values: Values
    omega: float
    """vᵀPv."""
    freedom: int
    length: float
    """Description length: see :mod:`mor.quality.gross_errors.description_length`."""
    scale: float
    """Factor of all σ by the median of the residuals."""


class Offered(NamedTuple):
    """A hypothesis that explains the observations much better than they are without it."""

    hypothesis: Hypothesis
    before: float
    """vᵀPv of the plain adjustment, or of its last iteration; not finite where there was none."""
    freedom_before: int
    after: float
    """vᵀPv with the change."""
    freedom_after: int
    gain: float
    """By how much the description of the observations becomes shorter, in units of χ²."""
    amount: Amount | None


class Before(NamedTuple):
    """vᵀPv without a hypothesis."""

    told: float
    """That of the plain adjustment, or of its last iteration; not finite where there was none."""
    compared: float
    """That which a hypothesis has to improve."""
    freedom: int


class Trial(NamedTuple):
    """A hypothesis that was adjusted."""

    hypothesis: Hypothesis
    fit: Fit | None
    """``None`` if its adjustment has no solution."""
    gain: float
    """By how much the description of the observations becomes shorter, in units of χ²."""


class Diagnosis(NamedTuple):
    """Result of a search for mistakes."""

    before: Before
    offered: tuple[Offered, ...] = ()
    """Hypotheses that are better than none by more than chance, the best first."""
    trials: tuple[Trial, ...] = ()
    """All hypotheses that were adjusted, in their order."""
    untried: int = 0
    """Hypotheses that were not tried because the time was over."""


NOTHING_FOUND = Diagnosis(Before(float("nan"), float("nan"), 0))

GoOn = Callable[[Hypothesis], bool]
"""Called before each trial; False ends the search."""


def with_group(network: Network, number: int, group: ObservationGroup) -> Network:
    """The network with another group in the place of one."""
    groups = list(network.groups)
    groups[number] = group
    return replace(network, groups=tuple(groups))


def with_observed(
    network: Network, number: int, rows: IntArray, change: Callable[[FloatArray], FloatArray]
) -> Network:
    """The network with the observed values (k, m) of some rows of a group changed; their faces are told anew.

    Of image coordinates the measured ones, before distortion, are changed as well.
    """
    group = network.groups[number]
    observed, constants = group.observed.copy(), group.constants.copy()
    observed[rows] = change(observed[rows])
    names = [constant.name for constant in group.type.constants]
    if group.type.tell_face is not None:
        constants[rows, names.index("face")] = group.type.tell_face(observed[rows, -1])
    if "measured x" in names:
        first = names.index("measured x")
        constants[rows, first : first + 2] = change(constants[rows, first : first + 2])
    return with_group(network, number, replace(group, observed=observed, constants=constants))


def with_blocks(
    network: Network, number: int, rows: Sequence[int], blocks: Mapping[int, Sequence[int]]
) -> Network:
    """The network with other blocks in some slots (by number) of some rows of a group."""
    group = network.groups[number]
    changed = list(group.blocks)
    for slot, values in blocks.items():
        own = changed[slot].copy()
        own[list(rows)] = values
        changed[slot] = own
    return with_group(network, number, replace(group, blocks=tuple(changed)))


def with_unknown(
    network: Network, kind: str, value: FloatArray, free: BoolArray, like: int = -1
) -> tuple[Network, int]:
    """The network with one more block of a kind, whose components are ``free`` (size,), and its number.

    A rotation turns as the block ``like`` does.
    """
    blocks, number = network.blocks[kind], len(network.blocks[kind].ids)
    more = np.full((1, len(value)), number, dtype=np.int64)
    nothing = np.full((1, len(value)), np.nan)
    longer = blocks._replace(
        ids=(*blocks.ids, "hypothesis"),
        free=np.concatenate([blocks.free, free[None]]),
        owner=np.concatenate([blocks.owner, more]),
        about_axes=None
        if blocks.about_axes is None
        else np.append(blocks.about_axes, blocks.about_axes[like]),
        difference=None
        if blocks.difference is None
        else np.concatenate([blocks.difference, 0.0 * value[None]]),
    )
    return replace(
        network,
        blocks={**network.blocks, kind: longer},
        start={**network.start, kind: np.concatenate([network.start[kind], value[None]])},
        observed={**network.observed, kind: np.concatenate([network.observed[kind], nothing])},
        sigma={**network.sigma, kind: np.concatenate([network.sigma[kind], nothing])},
    ), number


def with_points(network: Network, points: IntArray, change: Callable[[FloatArray], FloatArray]) -> Network:
    """The network with the given coordinates (k, 3) of some points changed, observed ones as well as start values."""
    start = network.start["point"].copy()
    start[points] = change(start[points])
    network = replace(network, start={**network.start, "point": start})
    for number, group in enumerate(network.groups):
        if group.type.key not in ("observed/point", "coordinates"):
            continue
        place = np.full(len(start), -1)
        place[points] = np.arange(len(points))
        rows = np.flatnonzero(place[group.blocks[0]] >= 0)
        if len(rows) == 0:
            continue
        observed, sigma = group.observed.copy(), group.sigma.copy()
        whole = np.full((len(points), 3), np.nan)
        whole[place[group.blocks[0][rows]]] = observed[rows]
        moved = change(whole)[place[group.blocks[0][rows]]]
        same = np.isfinite(moved) == np.isfinite(observed[rows])
        if not same.all():
            continue  # what was observed of it is not the same components
        observed[rows] = moved
        network = with_group(network, number, replace(group, observed=observed, sigma=sigma))
    return network
