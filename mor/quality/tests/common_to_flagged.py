"""What flagged observations have in common: a point, image, camera, station, set, instrument or table.

A row of observations counts as flagged if the test of single observations flags it, or if mor left it out. Checks do
not count: the project keeps them out. If flagged rows fell on all rows alike, their number among the n rows of a point
would be at most binomial with the share of flagged rows. The thing with the smallest probability is named. Without its
rows the next one is looked for, as long as the family-wise level is kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import betainc

from mor.arrays import BoolArray, FloatArray, IntArray, SmallIntArray
from mor.observations import ObservationGroup
from mor.project.network.build import Network
from mor.project.network.entities import thing_of
from mor.quality.assess import Quality
from mor.quality.tests.partitions import partitions, sets_beside_others

LEVEL = 1e-3
"""Family-wise level."""
NAMED = 3
_AT_LEAST = 2


class CommonToFlagged(NamedTuple):
    """A thing that many of the flagged rows refer to."""

    of: str
    """``group``, ``image``, ``camera``, ``station``, ``set``, ``instrument``, ``system`` or ``point``."""
    name: str
    flagged: int
    """Number of its flagged rows."""
    rows: int
    all_flagged: int
    """Number of all flagged rows."""


class _Membership(NamedTuple):
    """Which rows refer to the things of one kind."""

    of: str
    names: Sequence[str]
    rows: SmallIntArray
    """(k,) rows, counted through all groups."""
    classes: SmallIntArray
    """(k,)"""


def common_to_flagged(quality: Quality, network: Network) -> tuple[CommonToFlagged, ...]:
    """Return up to three things that more flagged rows refer to than chance explains, the clearest first."""
    groups = quality.adjustment.problem.groups
    used = [group.mask & (k < len(network.groups)) for k, group in enumerate(groups)]  # the last are checks
    parts = zip(quality.flagged, groups, used, strict=True)
    flagged = np.concatenate([np.zeros(0, bool), *(((f | g.left_out) & u).any(axis=1) for f, g, u in parts)])
    if np.count_nonzero(flagged) < _AT_LEAST:
        return ()
    counted: BoolArray = np.concatenate([np.zeros(0, bool), *(u.any(axis=1) for u in used)])
    memberships = list(_memberships(quality, network))
    found: list[CommonToFlagged] = []
    for _ in range(NAMED):
        best = _clearest(memberships, flagged & counted, counted)
        if best is None:
            break
        one, number, rows = best
        mine = one.rows[one.classes == number]
        hit = int(np.count_nonzero(flagged[mine] & counted[mine]))
        of, name = one.of, one.names[number]
        if of == "point":  # or a projection centre
            of, name = thing_of(of, name)
        found.append(CommonToFlagged(of, name, hit, rows, int(np.count_nonzero(flagged))))
        counted = counted.copy()
        counted[mine] = False
    return tuple(found)


def _memberships(quality: Quality, network: Network) -> Iterator[_Membership]:
    problem = quality.adjustment.problem
    first = np.concatenate([[0], np.cumsum([group.count for group in problem.groups])])
    several = sets_beside_others(network)
    for partition in partitions(problem, network):
        # the only set of a station is that station
        counted = np.array([partition.of != "set" or name in several for name in partition.names], dtype=bool)
        rows, classes = [np.zeros(0, np.int32)], [np.zeros(0, np.int32)]
        for k in range(len(problem.groups)):
            own = partition.of_rows(k, slice(None))
            if own is not None:
                here = np.flatnonzero((own >= 0) & counted[own])
                rows.append((first[k] + here).astype(np.int32))
                classes.append(own[here].astype(np.int32))
        yield _Membership(partition.of, partition.names, np.concatenate(rows), np.concatenate(classes))
    if "point" in problem.index.blocks:
        yield _of_points(problem.groups, first, problem.index.blocks["point"].ids)


def _of_points(groups: Sequence[ObservationGroup], first: IntArray, ids: Sequence[str]) -> _Membership:
    rows, classes = [np.zeros(0, np.int32)], [np.zeros(0, np.int32)]
    for k, group in enumerate(groups):
        points = [
            blocks
            for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
            if slot.kind == "point"
        ]
        for i, blocks in enumerate(points):
            new = np.ones(group.count, dtype=bool)  # a row counts once for each point
            for before in points[:i]:
                new &= before != blocks
            rows.append((first[k] + np.flatnonzero(new)).astype(np.int32))
            classes.append(blocks[new].astype(np.int32))
    return _Membership("point", ids, np.concatenate(rows), np.concatenate(classes))


def _clearest(
    memberships: Sequence[_Membership], flagged: BoolArray, counted: BoolArray
) -> tuple[_Membership, int, int] | None:
    """The thing whose flagged rows are least likely, with its number and its number of rows."""
    whole, hits = int(np.count_nonzero(counted)), int(np.count_nonzero(flagged))
    best: tuple[float, int, _Membership, int] | None = None
    tests = 0
    for one in memberships:
        n = np.bincount(one.classes, weights=counted[one.rows], minlength=len(one.names))
        k = np.bincount(one.classes, weights=flagged[one.rows], minlength=len(one.names))
        tests += int(np.count_nonzero(n))
        some = np.flatnonzero((k >= _AT_LEAST) & (n < whole))
        if not len(some):
            continue
        p = _tail(np.asarray(k[some], float), np.asarray(n[some], float), hits / whole)
        place = int(np.lexsort((n[some], p))[0])
        ranked = float(p[place]), int(n[some][place])
        if best is None or ranked < best[:2]:
            best = (*ranked, one, int(some[place]))
    if best is None or best[0] * tests >= LEVEL:
        return None
    return best[2], best[3], best[1]


def _tail(k: FloatArray, n: FloatArray, share: float) -> FloatArray:
    """Probability that a binomial number out of n is k or larger."""
    return np.asarray(betainc(k, n - k + 1.0, share), dtype=np.float64)
