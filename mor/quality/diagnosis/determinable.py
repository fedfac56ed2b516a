"""What of a network can be determined: the rest is named, put at infinity, or left out where the project wants it.

Things that their own observations leave loose are found before anything is solved, and with them what hangs on them
alone; what only moves together with others shows in the null space of the whole. Points with parallel rays become
directions; whether their rays are parallel is asked again at the solution, where the poses are known better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from mor.adjustment.problem import Problem
from mor.adjustment.state import Outcome
from mor.approximate.points_at_infinity import RayPoints, nearly_parallel
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import NoStartValuesError, Undeterminable
from mor.geometry import tolerant
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.project.network.entities import thing_of
from mor.project.reduction import (
    nothing_marked,
    rows_of_points,
    with_points_at_infinity,
    without_blocks,
)
from mor.quality.diagnosis.loose_things import OPEN, without_loose, without_moved
from mor.quality.diagnosis.misfit import misfit
from mor.quality.diagnosis.parallax import with_free_poses
from mor.quality.diagnosis.unsettled import only_here
from mor.quality.gross_errors.suspects import Attempt

ONE_PLACE = "all its rays come from one place: it is anywhere along them"
AT_INFINITY: Final = "at infinity"
PARALLEL = "its rays are parallel to their precision: it has a direction, and no distance"
NARROW_ANGLE = "its rays meet at a narrow angle"
ROUNDS = 6
"""Adjustments at most, until what is at infinity and what is left out stays the same."""
FAILURES = 3
"""Adjustments without a solution after which it is not points at infinity that keep it from one."""
FEWEST_OF_DATUM = 3
"""Points with all coordinates in the datum that determine any movement of a network."""
_RUN_AWAY = 1e-3
"""Inverse distance, in units of its σ, below which a point has run away: vᵀPv is the same to 1e-6 at infinity."""
EXPLAINED = 30
"""Loose things up to which the null space of the whole network is worked out to explain them."""


class Means(NamedTuple):
    """How a network becomes a problem and is solved, and the critical value of the test for parallel rays."""

    make: Callable[[Network, Values], Problem]
    solve: Callable[[Network, Values], Attempt]
    plainly: Callable[[Network, Values], Attempt]
    """The same of all observations alone, whether that has a solution or not."""
    critical: float


def completed(
    network: Network, start: Values, missing: Sequence[Undeterminable], critical: float
) -> tuple[dict[str, FloatArray], tuple[Undeterminable, ...]]:
    """Start values with the points whose rays meet at a narrow angle, and what is still missing.

    Points at infinity stay without coordinates and are not missing. Points whose rays contradict each other begin as
    far away as others are: the adjustment tells which ray is wrong.
    """
    found = nearly_parallel(network, start)
    unknown: BoolArray = np.asarray(np.isnan(start["point"][found.points]).any(axis=1))
    found = found.take(unknown)
    far = found.parallel(critical * misfit(network, start, found.points))
    points = start["point"].copy()
    points[found.points[~far]] = found.take(~far).coordinates()
    wrong = far & found.contradicting()
    points[found.points[wrong]] = _as_far_as_others(start["point"], found.take(wrong))
    ids = network.blocks["point"].ids
    known = {("point", ids[p]) for p in found.points.tolist()}
    left = tuple(thing for thing in missing if (thing.kind, thing.name) not in known)
    return {**start, "point": points}, left


def _as_far_as_others(points: FloatArray, found: RayPoints) -> FloatArray:
    """(k, 3) places between the rays of points, at the median distance of what is known."""
    known = points[np.isfinite(points).all(axis=1)]
    away = [float(np.median(np.linalg.norm(known - centre, axis=1))) for centre in found.centres]
    return np.asarray(found.centres + np.array(away)[:, None] * found.directions)


def completed_or_at_infinity(
    network: Network, start: Values, missing: Sequence[Undeterminable], critical: float
) -> tuple[dict[str, FloatArray], tuple[Undeterminable, ...]]:
    """The same with the points at infinity among what is missing, named as that."""
    values, left = completed(network, start, missing, critical)
    known: BoolArray = np.asarray(np.isfinite(values["point"]).all(axis=1))
    placed = {("point", name) for name, k in zip(network.blocks["point"].ids, known, strict=True) if k}
    far = [thing for thing in missing if thing not in left and (thing.kind, thing.name) not in placed]
    return values, (*left, *(thing._replace(reason=PARALLEL, treatment=AT_INFINITY) for thing in far))


def without_unknown(network: Network, start: Values, missing: Sequence[Undeterminable]) -> Network:
    """The network, with start values, without what has none but the points at infinity; ``missing`` says why."""
    names = {(thing.kind, thing.name) for thing in missing}
    unknown = {}
    for kind, values in start.items():
        lost: BoolArray = np.asarray(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))
        for k in np.flatnonzero(lost):
            lost[k] = thing_of(kind, network.blocks[kind].ids[k]) in names
        unknown[kind] = lost
    left = [thing._replace(treatment="left out") for thing in missing]
    return without_blocks(replace(network, start=start), unknown, left)


def adjust_determinable(network: Network, start: Values, means: Means) -> tuple[Network, Attempt]:
    """The network as far as it is adjusted, and its adjustment.

    Loose things make the outcome singular unless the project has ``undetermined: leave_out``. Points at infinity do
    not. Where there is no solution, or one that observations had to be left out for, points seen under a narrow angle
    may be at fault, whose start values are hardly better than none: it is begun once more where the others come to
    without them.
    """
    found = nearly_parallel(network, start)
    first = _with_far_points(network, start, start, found, means)
    if found.from_one_place().all() or first[1].is_complete:
        return first
    others = without_points(network, found.points, NARROW_ANGLE)
    if not any(group.count for group in others.groups):
        return first
    adjustment = means.solve(others, start).adjustment
    if not adjustment.outcome.is_solution:
        return first
    there = _values_of(network, adjustment.values, found.points)
    again = nearly_parallel(network, there)
    begun = _with_coordinates(there, again)
    begun["point"] = np.where(np.isnan(begun["point"]), start["point"], begun["point"])
    second = _with_far_points(network, start, begun, again, means)
    return second if second[1].is_complete else first


def _with_far_points(
    network: Network, start: Values, values: Values, found: RayPoints, means: Means
) -> tuple[Network, Attempt]:
    """The network and its adjustment begun at ``values``, with points at infinity as they show there and later."""
    plain, first, doubted = network, values, found.points
    failed = np.zeros(0, dtype=np.int64)
    failures = 0
    far = _beyond_reach(network, values, found, means)
    given: BoolArray = np.asarray(np.isfinite(start["point"][far.points]).all(axis=1))
    if given.any():
        begun = _from_given_places(network, start, values, found, far.take(~given), means)
        if begun is not None:
            there, met, gone = begun
            blind = met.points[met.from_one_place()]
            settled = _with_reference(plain, start, there, doubted)
            reduced, attempt = _adjusted(settled, there, gone, blind, means)
            if attempt.adjustment.outcome.is_solution and not (len(gone.points) and _leaves_out(network)):
                return reduced, attempt
    for _ in range(ROUNDS):
        blind = found.points[found.from_one_place()]
        reduced, attempt = _adjusted(network, values, far, blind, means)
        adjustment = attempt.adjustment
        there = _values_of(network, adjustment.values, far.points)
        found = nearly_parallel(network, there)
        if adjustment.outcome.is_solution:
            found = with_free_poses(network, reduced, adjustment, there, found, means.critical)
        now = _beyond_reach(network, there, found, means)
        if not adjustment.outcome.is_solution:
            failed = np.union1d(failed, far.points)
            failures += 1
            if failures == FAILURES or np.isin(now.points, failed).all():
                break
            values = first
            now = found.take(np.isin(found.points, np.union1d(now.points, failed)))
        elif np.array_equal(np.sort(now.points), np.sort(far.points)):
            break
        else:
            values = _with_coordinates(there, found.take(np.isin(found.points, far.points)))
        far = now
        network = _with_reference(plain, start, values, doubted)
    if len(far.points) and _leaves_out(network):
        # Left out only now: with them the poses are known well enough to tell which points are at infinity.
        network = _with_reference(plain, start, there, doubted)
        values = {**there, "point": np.where(np.isnan(there["point"]), start["point"], there["point"])}
        values = values if adjustment.outcome.is_solution else start
        reduced, attempt = _adjusted(network, values, far, blind, means, far_too=True)
    return reduced, attempt


def _from_given_places(
    network: Network, start: Values, values: Values, found: RayPoints, far: RayPoints, means: Means
) -> tuple[dict[str, FloatArray], RayPoints, RayPoints] | None:
    """Where an adjustment leads in which far points with given coordinates begin there, and what is far there.

    The given values say too little of the poses to tell which points are at infinity. Points under a narrow angle do
    not carry the datum. Only points that run away are far where the adjustment leads: there, infinity is as good as any
    place. ``None`` if it leads nowhere.
    """
    begun = _with_reference(network, start, values, found.points)
    blind = found.points[found.from_one_place()]
    reduced, attempt = _adjusted(begun, values, far, blind, means._replace(solve=means.plainly))
    adjustment = attempt.adjustment
    there = _values_of(network, adjustment.values, far.points)
    met = nearly_parallel(network, there)
    if adjustment.outcome.is_solution:
        met = with_free_poses(network, reduced, adjustment, there, met, means.critical)
    distance = np.linalg.norm(there["point"][met.points] - met.centres, axis=1)
    gone = ~met.from_one_place() & ~(distance * met.sigma * _RUN_AWAY < 1.0)
    if not adjustment.outcome.is_solution and not gone.any():
        return None
    return _with_coordinates(there, met.take(np.isin(met.points, far.points))), met, met.take(gone)


def _with_reference(network: Network, start: Values, values: Values, doubted: IntArray) -> Network:
    """The network whose datum stays the same wherever another adjustment of it begins.

    It refers to the given coordinates, for points without to their start values, and for points without these to where
    that adjustment begins. Points ``doubted``, which were at infinity, do not
    carry it as long as others do: a distance that nobody knew, on the wrong side perhaps, would outweigh all others.
    """
    datum = network.datum
    mask = datum.mask.copy()
    mask[doubted] = False
    if not datum.minimal and np.count_nonzero(mask.all(axis=1)) >= FEWEST_OF_DATUM:
        datum = datum._replace(mask=mask)
    if datum.reference is None:
        begun = np.where(np.isfinite(start["point"]), start["point"], values["point"])
        datum = datum._replace(reference=datum.reference_from(begun))
    return replace(network, datum=datum)


def _leaves_out(network: Network) -> bool:
    return network.project.settings.undetermined == "leave_out"


def _beyond_reach(network: Network, values: Values, found: RayPoints, means: Means) -> RayPoints:
    """Points whose rays are parallel to their precision.

    That is the precision of the rays at these values: as long as poses are rough, it is not that of the measurements.
    """
    return found.take(found.parallel(means.critical * misfit(network, values, found.points)))


def _adjusted(
    network: Network, start: Values, far: RayPoints, blind: IntArray, means: Means, far_too: bool = False
) -> tuple[Network, Attempt]:
    """One adjustment with some points at infinity, and without what is loose where that is to be left out.

    ``blind`` are the points all of whose rays come from one place; ``far_too`` leaves out the points at infinity.
    """
    leave = _leaves_out(network)
    whole, begun = _without_far(network, start, far, far_too)
    reduced = without_loose(without_points(whole, blind, ONE_PLACE), begun, means.make)
    loose = reduced.undeterminable[len(whole.undeterminable) :]
    named = (*whole.undeterminable, *(thing._replace(treatment="") for thing in loose))
    if loose and not leave and len(loose) <= EXPLAINED:
        return replace(whole, undeterminable=named), means.solve(whole, begun)
    _check_something_left(reduced)
    attempt = means.solve(reduced, begun)
    if loose and not leave:
        reduced = replace(reduced, undeterminable=named)
        return reduced, Attempt(attempt.adjustment._replace(outcome=Outcome.SINGULAR, reason=OPEN))
    for _ in range(ROUNDS if leave else 0):
        adjustment = attempt.adjustment
        further = None if only_here(adjustment) else without_moved(reduced, adjustment)
        if further is None:
            break
        reduced = without_loose(further, begun, means.make)
        _check_something_left(reduced)
        attempt = means.solve(reduced, begun)
    return reduced, attempt


def _check_something_left(network: Network) -> None:
    """Raise :class:`NoStartValuesError` where nothing of the network is determined."""
    if not any(group.count for group in network.groups):
        raise NoStartValuesError(network.undeterminable, ["nothing is left that could be adjusted"])


def _without_far(
    network: Network, start: Values, far: RayPoints, leave: bool
) -> tuple[Network, dict[str, FloatArray]]:
    """The network with points at infinity, or without them, and start values for it."""
    if len(far.points) == 0:
        return network, dict(start)
    ids = network.blocks["point"].ids
    placed = start["point"].copy()
    placed[far.points] = far.centres
    begun = {**start, "point": placed}
    if leave:
        return without_points(network, far.points, PARALLEL), begun
    rays = rows_of_points(network)
    things = [
        Undeterminable("point", ids[p], PARALLEL, AT_INFINITY, int(rays[p])) for p in far.points.tolist()
    ]
    return with_points_at_infinity(network, begun, far.points, _rotations(far.directions), things)


def without_points(network: Network, points: IntArray, reason: str) -> Network:
    """The network without some points, all for one reason."""
    if len(points) == 0:
        return network
    marked, rays = nothing_marked(network), rows_of_points(network)
    marked["point"][points] = True
    ids = network.blocks["point"].ids
    left = [Undeterminable("point", ids[p], reason, "left out", int(rays[p])) for p in points.tolist()]
    return without_blocks(network, marked, left)


def _rotations(directions: FloatArray) -> FloatArray:
    """(k, 3, 3) rotations whose third rows are the directions (k, 3)."""
    across = tolerant.svd(directions[:, None, :])[2][:, 1:, :]
    D = np.concatenate([across, directions[:, None, :]], axis=1)
    D[:, 0] *= np.linalg.det(D)[:, None]
    return D


def _values_of(network: Network, values: Values, far: IntArray) -> dict[str, FloatArray]:
    """Values of the blocks of a network, after it was adjusted with others; far points without coordinates."""
    own = {kind: values[kind][: len(blocks.ids)] for kind, blocks in network.blocks.items()}
    points = own["point"].copy()
    points[far] = np.nan
    return {**own, "point": points}


def _with_coordinates(values: Values, found: RayPoints) -> dict[str, FloatArray]:
    points = values["point"].copy()
    near = found.inverse > 0.0
    points[found.points[near]] = found.take(near).coordinates()
    return {**values, "point": points}
