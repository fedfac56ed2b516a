"""The reliability map, and observations that would improve it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mor.model import rotations
from mor.model.contract import ObservationGroup, some_rows
from mor.model.parameters import Values
from mor.project.network import Network
from mor.quality.assessment import Quality
from mor.quality.external_reliability import NormalEquationSolver, ObservationComponent, gradient, local_system
from mor.quality.group_tests import Partition, partitions
from mor.quality.redundancy import OF_IMAGES, Reliability
from mor.quality.test_statistics import ROWS_AT_A_TIME, in_pieces
from mor.solve.problem import Linearised, linearise, rotation_tangents
from mor.types import BoolArray, FloatArray, IntArray, across, pieces

# ---- The reliability map: for every point, image, station and set how well its observations control each other.
#
# Of each thing it is known which of its observations has the smallest redundancy number, the smallest error ∇
# that would be found there, and how far an error that is not found can move it. With δ̄0 the external
# reliability of an observation (W. Baarda, 1968), no function f of the unknowns moves by more than δ̄0 σ_f;
# the position of a thing hence by no more than the largest δ̄0 of its observations times the longest
# semi-axis of its error ellipsoid.


class Controlled(NamedTuple):
    """Control of k things: arrays (k,), NaN and −1 for things without observations."""

    of: str
    """``point``, ``image``, ``station`` or ``set``."""
    names: tuple[str, ...]
    observations: IntArray
    """Number of its observations: a ray is two of them."""
    smallest_r: FloatArray
    weakest: IntArray
    """(k, 3) group, row and component of the observation with the smallest redundancy number."""
    shift: FloatArray
    """Bound of what an undetected error moves its position by; infinite where something is not controlled at all."""

    def entry(self, k: int) -> ObservationComponent:
        """The weakest observation of one of them."""
        return ObservationComponent(*(int(number) for number in self.weakest[k]))

    def worst(self, count: int) -> IntArray:
        """Numbers of the things with the smallest redundancy numbers, the worst first."""
        seen = np.flatnonzero(np.isfinite(self.smallest_r))
        return seen[np.argsort(self.smallest_r[seen].round(9), kind="stable")[:count]]


class _RowClasses(NamedTuple):
    """Classes (k,) of some rows of a group, and what is known of these."""

    number: int
    rows: slice
    classes: IntArray
    tests: Reliability

    def external(self) -> FloatArray:
        """δ̄0 (k, m): infinite where an observation is not controlled, NaN where there is none."""
        r, known = self.tests.quality.r, self.tests.external
        external = np.where(np.isfinite(r) & ~np.isfinite(known), np.inf, known)
        return np.where(np.isfinite(r), external, np.nan)


def uncontrolled(quality: Quality, number: int) -> BoolArray:
    """(n, m) observations of a group whose redundancy number is below the least one."""
    one, least = quality.groups[number], quality.levels.least_redundancy

    def of_rows(rows: slice) -> BoolArray:
        return np.asarray(np.nan_to_num(one.at(rows).r, nan=1.0) < least)

    return in_pieces(one.v.shape, of_rows)


def uncontrolled_count(quality: Quality) -> int:
    """Number of observations whose redundancy number is below the least one."""
    return int(sum(np.count_nonzero(uncontrolled(quality, k)) for k in range(len(quality.groups))))


def reliability_map(quality: Quality, network: Network) -> list[Controlled]:
    """Points first, then images, stations and sets."""
    problem = quality.adjustment.problem
    axes = quality.longest_axes
    points = network.things["point"]
    blocks = points.parts["position"]
    place = np.full(len(axes), -1)
    place[blocks] = np.arange(len(blocks))
    found = [_of_points(quality, points.ids, place, axes[blocks])]
    for partition in partitions(problem, network):
        if partition.of in ("image", "station", "set"):
            # (k,) longest semi-axes of the positions of images and stations.
            things = network.things["image" if partition.of == "image" else "station"]
            numbers = [things.numbers[name] for name in partition.names]
            found.append(_of_partition(quality, partition, axes[things.parts["position"][numbers]]))
    return found


def _of_points(quality: Quality, names: tuple[str, ...], place: IntArray, axes: FloatArray) -> Controlled:
    def seen() -> Iterator[_RowClasses]:
        for number, group in enumerate(quality.adjustment.problem.groups):
            named = [
                blocks
                for slot, blocks in group.blocks_by_slot
                if slot.kind == "point" and slot.of not in ("image", "station", "system")
            ]
            for rows in pieces(group.count, ROWS_AT_A_TIME):
                some = quality.reliability[number].at(rows)
                for blocks in named:
                    yield _RowClasses(number, rows, place[blocks[rows]], some)

    return _gathered("point", names, seen, axes)


def _of_partition(quality: Quality, partition: Partition, axes: FloatArray) -> Controlled:
    def seen() -> Iterator[_RowClasses]:
        for number, tests in enumerate(quality.reliability):
            for rows in pieces(len(tests.quality.v), ROWS_AT_A_TIME):
                classes = partition.of_rows(number, rows)
                if classes is not None:
                    yield _RowClasses(number, rows, classes, tests.at(rows))

    return _gathered(partition.of, tuple(partition.names), seen, axes)


def _gathered(
    of: str, names: tuple[str, ...], seen: Callable[[], Iterator[_RowClasses]], axes: FloatArray
) -> Controlled:
    """Return the smallest r of each class, and in a second pass the row that has it."""
    count = len(names)
    observations = np.zeros(count, dtype=np.int64)
    smallest, largest = np.full(count, np.inf), np.zeros(count)
    for one in seen():
        inside = one.classes >= 0
        classes, r = one.classes[inside], np.nan_to_num(one.tests.quality.r[inside], nan=np.inf)
        known = across(np.add, np.isfinite(r).astype(np.int64))
        observations += np.bincount(classes, known, count).astype(np.int64)
        np.minimum.at(smallest, classes, across(np.minimum, r))
        external = np.nan_to_num(one.external()[inside], posinf=np.inf)
        np.maximum.at(largest, classes, across(np.maximum, external))
    weakest = np.full((count, 3), -1, dtype=np.int64)
    for one in seen():
        wanted = np.where(one.classes >= 0, smallest[one.classes], np.nan)
        # Of observations that are equally weak, to round-off, the first: the same ones in every run.
        row, component = np.nonzero(one.tests.quality.r <= wanted[:, None] * (1.0 + 1e-9) + 1e-9)
        classes, first = np.unique(one.classes[row], return_index=True)
        new = weakest[classes, 0] < 0
        classes, first = classes[new], first[new]
        weakest[classes] = np.stack(
            [np.full(len(first), one.number), row[first] + (one.rows.start or 0), component[first]], axis=1
        )
    smallest = np.where(np.isfinite(smallest), smallest, np.nan)
    with np.errstate(invalid="ignore"):
        shift = np.where(np.isfinite(smallest), np.where(axes > 0.0, largest * axes, 0.0), np.nan)
    return Controlled(of, names, observations, smallest, weakest, shift)


def detectable(quality: Quality, entries: IntArray) -> FloatArray:
    """(k,) ∇ of observations (k, 3), in internal units; infinite where nothing controls them."""
    found = np.full(len(entries), np.inf)
    for number in np.unique(entries[:, 0]):
        here = np.flatnonzero(entries[:, 0] == number)
        smallest = quality.reliability[number].at(entries[here, 1]).smallest
        found[here] = smallest[np.arange(len(here)), entries[here, 2]]
    return np.where(np.isfinite(found), found, np.inf)


# ---- Further observations that could be made: of every table that sees points, from each of its places to another
# point.
#
# A candidate has the σ and the constants of the most complete row that its table has from that place; an
# image shows a point only where it lies before the camera and inside of what the camera has measured so far.


class Candidates(NamedTuple):
    """Observations that could be made to one target."""

    group: int
    rows: IntArray
    """(k,) row of the same place whose σ each has."""
    target: int
    jacobian: FloatArray
    """(k, m, K) whitened."""
    columns: IntArray


class CandidatePlaces(NamedTuple):
    """The places of all tables from which further points can be observed."""

    quality: Quality
    tangent: FloatArray | None
    tables: tuple[_Table, ...]

    def candidates(self, target: int) -> Iterator[Candidates]:
        """Candidates to a point block from every place that does not see it yet and could, and is of some use."""
        adjustment = self.quality.adjustment
        index, values = adjustment.problem.index, adjustment.values
        for table in self.tables:
            rows = table.places_without(target)
            if not len(rows):
                continue
            further = aimed_at(table.group, rows, target)
            part = linearise(further, index, values, self.tangent, slice(None))
            seen = table.in_view(further, part, values) & _estimable(part, adjustment.inverse.null)
            if seen.any():
                weight = np.where(further.mask, 1.0 / further.sigma, 0.0)
                jacobian = part.jacobian * weight[:, :, None]
                yield Candidates(table.number, rows[seen], target, jacobian[seen], part.columns[seen])


def candidate_places(quality: Quality) -> CandidatePlaces:
    """Gather the places once, for any number of targets."""
    problem = quality.adjustment.problem
    tables = (
        _table(number, group)
        for number, group in enumerate(problem.groups)
        if group.count
        and _target_slot(group) >= 0
        and len(group.type.references) == 2
        and group.type.references[-1].name != "system"
    )
    tangent = rotation_tangents(problem.index, quality.adjustment.values)
    return CandidatePlaces(quality, tangent, tuple(tables))


def aimed_at(group: ObservationGroup, rows: IntArray, target: int) -> ObservationGroup:
    """The rows of a group with a point block as their target; what would be observed is set to 0."""
    further, place = some_rows(group, rows), _target_slot(group)
    aimed = np.full(len(rows), target)
    return replace(
        further,
        blocks=tuple(aimed if k == place else own for k, own in enumerate(further.blocks)),
        observed=np.where(further.mask, 0.0, np.nan),
        sigma=further.given_sigma,
        excluded=None,
    )


class _Table(NamedTuple):
    """A group of observations from places to points."""

    number: int
    group: ObservationGroup
    rows: IntArray
    """The most complete row of each place, in ascending order of the places."""
    measured: dict[int, tuple[FloatArray, FloatArray]]
    """What each camera has measured: the smallest and the largest coordinates; empty where it is no table of images."""

    def places_without(self, target: int) -> IntArray:
        """One row for each place that does not see the target, the most complete one, in ascending order."""
        group, rows, slot = self.group, self.rows, _target_slot(self.group)
        standpoint = group.references[0].numbers
        seeing = np.flatnonzero(group.blocks[slot] == target)
        usable = ~np.isin(standpoint[rows], standpoint[seeing[group.used_among(seeing).any(axis=1)]])
        for k, other in enumerate(group.type.slots):
            if other.kind == "point" and k != slot:
                usable &= group.blocks[k][rows] != target
        return np.sort(rows[usable])

    def in_view(self, further: ObservationGroup, part: Linearised, values: Values) -> BoolArray:
        """True (k,) where an image would show the target: before it, and inside what its camera has measured."""
        seen: BoolArray = np.ones(further.count, dtype=bool)
        if not self.measured:
            return seen
        slots = {(slot.of, slot.part): k for k, slot in enumerate(further.type.slots)}
        computed = -part.misclosure  # of an observation that is 0
        interior = further.blocks[slots["image", "interior"]]
        for camera in np.unique(interior):
            here, (low, high) = interior == camera, self.measured[int(camera)]
            seen[here] = ~((computed[here] < low) | (computed[here] > high)).any(axis=1)
        if ("image", "base") in slots:
            return seen
        D = values["rotation"][further.blocks[slots["image", "rotation"]]]
        centre = values["point"][further.blocks[slots["image", "position"]]]
        sight = values["point"][further.blocks[-1]] - centre
        before: BoolArray = np.einsum("kj,kj->k", D[:, 2], sight) < 0.0
        return seen & before


def _table(number: int, group: ObservationGroup) -> _Table:
    measured = {}
    if group.type.key in OF_IMAGES:
        slots = {(slot.of, slot.part): k for k, slot in enumerate(group.type.slots)}
        interior = group.blocks[slots["image", "interior"]]
        for camera in np.unique(interior).tolist():
            own = (interior == camera)[:, None]
            low, high = (smallest.reduce(group.observed, where=own, initial=np.nan) for smallest in (np.fmin, np.fmax))
            measured[camera] = low, high
    return _Table(number, group, _most_complete_rows(group), measured)


def _most_complete_rows(group: ObservationGroup) -> IntArray:
    complete = np.where(group.used.any(axis=1), across(np.add, group.mask.astype(np.int8)), np.int8(0))
    standpoint = group.references[0].numbers
    most = np.zeros(int(standpoint.max()) + 1, dtype=np.int8)
    np.maximum.at(most, standpoint, complete)
    rows = np.flatnonzero((complete > 0) & (complete == most[standpoint]))[::-1]
    first = np.full(len(most), -1)
    first[standpoint[rows]] = rows  # of several the last that is written: the first row
    return first[first >= 0]


def _target_slot(group: ObservationGroup) -> int:
    """Slot of the position of the last thing a type refers to, −1 where it is no point that is looked at."""
    last = group.type.references[-1].name if len(group.type.references) > 1 else ""
    for k, slot in enumerate(group.type.slots):
        if slot.of == last and slot.kind == "point" and slot.part == "position":
            return k
    return -1


def _estimable(part: Linearised, null: FloatArray) -> BoolArray:
    """True (k,) for rows that no movement left open by the observations changes."""
    if null.shape[1] == 0:
        return np.ones(len(part.jacobian), dtype=bool)
    moved = np.where((part.columns >= 0)[:, :, None], null[part.columns], 0.0)
    image = np.abs(part.jacobian @ moved)
    size = np.abs(part.jacobian) @ np.abs(moved)
    # Part of a candidate's derivatives along a movement that nothing determines, from which on it is no control.
    return np.asarray((image <= 1e-6 * np.maximum(size, 1e-300)).all(axis=(1, 2)))


# ---- The one further observation that would control a weak one best.
#
# A further observation j of the kinds at hand, with the whitened derivatives A_j and R_jj = I + A_j Q A_jᵀ,
# changes the cofactors by Q' = Q − Q A_jᵀ R_jj⁻¹ A_j Q, and the redundancy number of an observation i,
# whitened a_i, hence by
#
#     r_i' = r_i + hᵀ R_jj⁻¹ h,    h = A_j Q a_iᵀ.
#
# One solution with a_i gives h of all candidates. As R_jj ≥ I, hᵀh bounds what each can gain: candidates are
# worked out in its order, until none that is left can be better. What determines a movement that the datum
# settles controls nothing.


class CandidateObservation(NamedTuple):
    """A further observation: a row of a group, with another target."""

    group: int
    row: int
    """The row at the same place, whose σ it has; the weak observation itself where that is to be measured once more."""
    target: int
    """Point block it would be made to, −1 for the same observation once more."""
    r: float
    """Redundancy number that the weak observation would have then."""


def best_further(
    quality: Quality, wanted: Sequence[tuple[ObservationComponent, list[int]]]
) -> list[CandidateObservation]:
    """Return the further observation that raises the redundancy number of each of some observations most.

    Each comes with the free point blocks it refers to. The same observation once more controls it, but repeats what is
    wrong with its place: it is taken where none from another place does half as much. All are looked for together: a
    solution for many right-hand sides takes hardly longer than one for a few.
    """
    places = candidate_places(quality)
    searches = [_begun(quality, places, entry, targets) for entry, targets in wanted]
    open_ = [one for one in searches if one.found]
    if open_:
        used = [one.columns for one in open_] + [f.columns.ravel() for one in open_ for f in one.found]
        system = local_system(quality.adjustment, np.concatenate(used))
        _rank(system, open_)
        while open_ := [one for one in open_ if one.take()]:
            for one, gains in zip(open_, _gains(system, open_), strict=True):
                one.heed(gains)
    return [one.best if one.best.target >= 0 else one.repeated for one in searches]


@dataclass
class _Search:
    """The search for the best further observation of one."""

    columns: IntArray
    """(k,) unknowns that the observation depends on."""
    whitened: FloatArray
    """(k,) a_i."""
    r: float
    repeated: CandidateObservation
    best: CandidateObservation
    found: list[Candidates]
    h: list[FloatArray] = field(default_factory=list)
    """(k, m) of each of the candidates."""
    bound: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(n,) hᵀh of all of them, one after the other."""
    order: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    taken: list[tuple[int, int]] = field(default_factory=list)
    """Those that are worked out now: which of the candidates, and its row."""

    def take(self) -> bool:
        """Take the next ones that may be better than the best so far; false where there are none."""
        at_a_time = 8
        some, self.order = self.order[:at_a_time], self.order[at_a_time:]
        some = some[self.bound[some] + self.r > self.best.r]
        ends = np.cumsum([len(one.rows) for one in self.found])
        which = np.searchsorted(ends, some, side="right")
        starts = np.concatenate([[0], ends])[which]
        self.taken = list(zip(which.tolist(), (some - starts).tolist(), strict=True))
        return bool(self.taken)

    def heed(self, gains: list[float]) -> None:
        for (which, place), gain in zip(self.taken, gains, strict=True):
            if self.r + gain > self.best.r:
                one = self.found[which]
                self.best = CandidateObservation(one.group, int(one.rows[place]), one.target, float(self.r + gain))


def _begun(quality: Quality, places: CandidatePlaces, entry: ObservationComponent, targets: list[int]) -> _Search:
    columns, values = gradient(quality.adjustment, entry)
    sigma = float(quality.adjustment.problem.groups[entry.group].sigma[entry.row, entry.component])
    r = float(quality.groups[entry.group].at(np.array([entry.row])).r[0, entry.component])
    again = (1.0 - r) ** 2 / (2.0 - r)
    repeated = CandidateObservation(entry.group, entry.row, -1, r + again)
    found = [one for target in targets for one in places.candidates(target)]
    return _Search(columns, values * sigma, r, repeated, repeated._replace(r=r + 0.5 * again), found)


def _rank(system: NormalEquationSolver, searches: list[_Search]) -> None:
    right = np.zeros((len(system.columns), len(searches)))
    for k, one in enumerate(searches):
        np.add.at(right[:, k], np.searchsorted(system.columns, one.columns), one.whitened)
    answer = system.solve(right)
    for k, one in enumerate(searches):
        one.h = [_image(some, system, answer[:, k]) for some in one.found]
        one.bound = np.concatenate([np.sum(part**2, axis=1) for part in one.h])
        one.order = np.argsort(-one.bound, kind="stable")[:64]  # so many are worked out for one weak observation


def _image(one: Candidates, system: NormalEquationSolver, x: FloatArray) -> FloatArray:
    """(k, m) A_j x."""
    moved = np.where(one.columns >= 0, x[_places(system, one.columns)], 0.0)
    return np.asarray(np.einsum("kmc,kc->km", one.jacobian, moved))


def _gains(system: NormalEquationSolver, searches: list[_Search]) -> list[list[float]]:
    """hᵀ R_jj⁻¹ h of the candidates that are taken, those of all searches solved for together."""
    rows = [
        (one.found[which].jacobian[place], one.found[which].columns[place], one.h[which][place])
        for one in searches
        for which, place in one.taken
    ]
    right = np.zeros((len(system.columns), sum(len(jacobian) for jacobian, _, _ in rows)))
    at = 0
    for jacobian, columns, _ in rows:
        free = columns >= 0
        for component in jacobian:
            np.add.at(right[:, at], _places(system, columns[free]), component[free])
            at += 1
    answer, at, gains = system.solve(right), 0, []
    for jacobian, columns, h in rows:
        m, free = len(jacobian), columns >= 0
        q = jacobian[:, free] @ answer[_places(system, columns[free]), at : at + m]
        at += m
        gains.append(_gain(h, 0.5 * (q + q.T)))
    ends = np.cumsum([len(one.taken) for one in searches]).tolist()
    return [gains[end - len(one.taken) : end] for one, end in zip(searches, ends, strict=True)]


def _gain(own: FloatArray, q: FloatArray) -> float:
    """hᵀ (I + q)⁻¹ h of one candidate (m,), (m, m); nothing where its cofactors cannot be computed.

    By eigenvalues, none below 0: the cofactors of what hardly anything determines are large, and of less than full rank
    to their last digit.
    """
    if not np.isfinite(q).all():
        return 0.0
    large, axes = rotations.eigh(q)
    return float(np.sum((axes.T @ own) ** 2 / (1.0 + np.maximum(large, 0.0))))


def _places(system: NormalEquationSolver, columns: IntArray) -> IntArray:
    """Places of columns among the unknowns of the system; anything where fixed."""
    return np.minimum(np.searchsorted(system.columns, columns), len(system.columns) - 1)
