"""The one further observation that would control a weak one best.

A further observation j of the kinds at hand, with the whitened derivatives A_j and R_jj = I + A_j Q A_jᵀ, changes the
cofactors by Q' = Q − Q A_jᵀ R_jj⁻¹ A_j Q, and the redundancy number of an observation i, whitened a_i, hence by

    r_i' = r_i + hᵀ R_jj⁻¹ h,    h = A_j Q a_iᵀ.

One solution with a_i gives h of all candidates. As R_jj ≥ I, hᵀh bounds what each can gain: candidates are worked out
in its order, until none that is left can be better. What determines a movement that the datum settles controls nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.quality.assess import Quality
from mor.quality.reliability.candidate_places import CandidatePlaces, Candidates, candidate_places
from mor.quality.reliability.influence_on_unknowns import Entry, gradient
from mor.quality.reliability.local_system import LocalSystem, local_system

_AT_A_TIME = 8
_MOST = 64
"""Candidates that are worked out for one weak observation."""


class Further(NamedTuple):
    """A further observation: a row of a group, with another target."""

    group: int
    row: int
    """The row at the same place, whose σ it has; the weak observation itself where that is to be measured once more."""
    target: int
    """Point block it would be made to, −1 for the same observation once more."""
    r: float
    """Redundancy number that the weak observation would have then."""


def best_further(quality: Quality, wanted: Sequence[tuple[Entry, list[int]]]) -> list[Further]:
    """What raises the redundancy number of each of some observations most.

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
    repeated: Further
    best: Further
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
        some, self.order = self.order[:_AT_A_TIME], self.order[_AT_A_TIME:]
        some = some[self.bound[some] + self.r > self.best.r]
        ends = np.cumsum([len(one.rows) for one in self.found])
        which = np.searchsorted(ends, some, side="right")
        starts = np.concatenate([[0], ends])[which]
        self.taken = list(zip(which.tolist(), (some - starts).tolist(), strict=True))
        return bool(self.taken)

    def heed(self, gains: list[float]) -> None:
        """Keep the best of those that were worked out."""
        for (which, place), gain in zip(self.taken, gains, strict=True):
            if self.r + gain > self.best.r:
                one = self.found[which]
                self.best = Further(one.group, int(one.rows[place]), one.target, float(self.r + gain))


def _begun(quality: Quality, places: CandidatePlaces, entry: Entry, targets: list[int]) -> _Search:
    columns, values = gradient(quality.adjustment, entry)
    group = quality.adjustment.problem.groups[entry.group]
    sigma = float(group.sigma[entry.row, entry.component])
    r = float(quality.groups[entry.group].at(np.array([entry.row])).r[0, entry.component])
    again = (1.0 - r) ** 2 / (2.0 - r)
    repeated = Further(entry.group, entry.row, -1, r + again)
    found = [one for target in targets for one in places.candidates(target)]
    return _Search(columns, values * sigma, r, repeated, repeated._replace(r=r + 0.5 * again), found)


def _rank(system: LocalSystem, searches: list[_Search]) -> None:
    """Give each search h and the bounds of its candidates, and the order in which they are worked out."""
    right = np.zeros((len(system.columns), len(searches)))
    for k, one in enumerate(searches):
        np.add.at(right[:, k], np.searchsorted(system.columns, one.columns), one.whitened)
    answer = system.solve(right)
    for k, one in enumerate(searches):
        one.h = [_image(some, system, answer[:, k]) for some in one.found]
        one.bound = np.concatenate([np.sum(part**2, axis=1) for part in one.h])
        one.order = np.argsort(-one.bound, kind="stable")[:_MOST]


def _image(one: Candidates, system: LocalSystem, x: FloatArray) -> FloatArray:
    """(k, m) A_j x."""
    moved = np.where(one.columns >= 0, x[_places(system, one.columns)], 0.0)
    image: FloatArray = np.einsum("kmc,kc->km", one.jacobian, moved)
    return image


def _gains(system: LocalSystem, searches: list[_Search]) -> list[list[float]]:
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
    large, axes = tolerant.eigh(q)
    return float(np.sum((axes.T @ own) ** 2 / (1.0 + np.maximum(large, 0.0))))


def _places(system: LocalSystem, columns: IntArray) -> IntArray:
    """Places of columns among the unknowns of the system; anything where fixed."""
    return np.minimum(np.searchsorted(system.columns, columns), len(system.columns) - 1)
