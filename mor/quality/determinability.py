"""Find unknowns that the observations do not determine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from scipy.special import chdtri, erfc

from mor.errors import Message, NoStartValuesError, UndeterminedObject, counted
from mor.model import rotations
from mor.model.contract import ObservationGroup
from mor.model.coordinates import TURNED_AXIS, can_be_at_infinity, target_slot
from mor.model.images import is_image_point
from mor.model.parameters import Values
from mor.project.entities import thing_of
from mor.project.network import (
    Network,
    nothing_marked,
    touches,
    with_points_at_infinity,
    without_blocks,
)
from mor.project.rows import rows_of_points
from mor.quality.outliers import Attempt
from mor.quality.test_statistics import robust_sigma
from mor.solve.datum import NOTHING_KNOWN, LocalDefects, beside, local_defects, weak_turns
from mor.solve.iterate import (
    A_WEAK_TURN,
    NO_DATUM,
    OPEN,
    PAST_CAMERAS,
    RAN_AWAY,
    UNSETTLED,
    Adjustment,
    Outcome,
    SolverSettings,
    adjust,
)
from mor.solve.problem import Problem, linearise, misclosures, rotation_tangents
from mor.start.points_at_infinity import RayPoints, nearly_parallel
from mor.types import BoolArray, FloatArray, IntArray, pieces

# ---- Parts of a network that no observation connects: each would need a datum of its own.


@dataclass(frozen=True)
class NetworkPart:
    """Names of the things in one part, by namespace."""

    names: dict[str, tuple[str, ...]]
    held: bool
    """True where fixed points are among them."""

    @property
    def size(self) -> int:
        """Number of things."""
        return sum(len(names) for names in self.names.values())


def connected_parts(network: Network, groups: Sequence[ObservationGroup]) -> tuple[NetworkPart, ...]:
    """Parts of the network, the largest first; fixed points are one part with all that is tied to any of them.

    So are parts with two observed points or more: they have a datum. What was left out belongs to none.
    """
    blocks = network.blocks
    first, count = {}, 1  # node 0 is the ground: everything that is fixed
    for kind in ("point", "rotation", "base"):  # a shared camera or refraction coefficient ties nothing in space
        if kind in blocks:
            first[kind] = count
            count += len(blocks[kind].ids)
    links: list[tuple[IntArray, IntArray]] = []
    timed = network.things["image"].parts["trajectory"] >= 0
    poses = network.things["image"].parts["position"][timed]
    for kind, start in first.items():
        held = np.flatnonzero(~blocks[kind].free.any(axis=1))
        held = np.setdiff1d(held, poses) if kind == "point" else held
        if kind == "point":
            links.append((np.zeros_like(held), held + start))
    links += [(ends[0], ends[1]) for ends in _on_trajectories(network, first["point"])]
    for group in groups:
        nodes = [numbers + first[slot.kind] for slot, numbers in group.blocks_by_slot if slot.kind in first]
        links += [(nodes[0], other) for other in nodes[1:]]
    ends = [np.concatenate(side) for side in zip(*links, strict=True)] if links else [np.zeros(0, dtype=int)] * 2
    # Imported here: only networks that are not determined come to this.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(ends[0])), (ends[0], ends[1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    observed = [group.blocks[0] for group in groups if group.type.key == "observed/point"]
    known = np.unique(np.concatenate([np.zeros(0, dtype=int), *observed])) + first["point"]
    labels[np.isin(labels, np.flatnonzero(np.bincount(labels[known], minlength=1) > 1))] = labels[0]
    return _parts(network, labels.astype(np.int64), first["point"])


def _on_trajectories(network: Network, first_point: int) -> Iterator[tuple[IntArray, IntArray]]:
    """Nodes of the positions of images on trajectories, each with those of all its knots: a trajectory is one thing."""
    images = network.things["image"]
    for number, trajectory in enumerate(network.trajectories.values()):
        poses = images.parts["position"][images.parts["trajectory"] == number]
        knots = trajectory.positions + first_point
        yield np.repeat(poses + first_point, len(knots)), np.tile(knots, len(poses))


_NAMED = ("image", "station", "system", "point")
"""Things that name a part, in this order."""


def _parts(network: Network, labels: IntArray, first_point: int) -> tuple[NetworkPart, ...]:
    collected: dict[int, dict[str, list[str]]] = {}
    absent = network.absent.get("point", np.zeros(len(network.blocks["point"].ids), dtype=bool))
    for space in _NAMED:
        things = network.things[space]
        for name, position in zip(things.ids, things.parts["position"], strict=True):
            if absent[position]:
                continue
            part = int(labels[first_point + int(position)])
            collected.setdefault(part, {}).setdefault(space, []).append(name)
    parts = [
        NetworkPart({space: tuple(names) for space, names in found.items()}, held=number == labels[0])
        for number, found in collected.items()
    ]
    return tuple(sorted(parts, key=lambda part: -part.size))


# ---- Things of a network that nothing determines: found one by one, or by what a null vector moves.

HANGS_ON = "it depends on other objects that are not determined"


ONE_TIE = "it shares one point or none with the others, so nothing tells its direction"


class _RigidPart(NamedTuple):
    """Sets of directions whose points have one shape."""

    polar: set[int]
    """Points that have a place in it."""
    points: set[int]
    """These and all others that are sighted."""
    rotations: list[int]
    given: bool = False
    """True if it has the points with given coordinates."""


def without_hanging(network: Network) -> Network:
    """The network without stations that can turn about the only point they share with the others.

    Sets of directions are one part if they share two points with directions and distances; the points with given
    coordinates are a part as well, and so are points with bearings and distances. The smallest part that hangs on one
    point goes first, until none does.
    """
    types = {group.type.key for group in network.groups if group.count}
    # Types of a network of levelled instruments, whose stations can turn about the vertical only.
    levelled = {
        "directions",
        "zenith_directions",
        "zenith_angle",
        "distance",
        "horizontal_distance",
        "bearing",
        "height_difference",
        "observed/point",
    }
    if not types <= levelled or not types & {"directions", "zenith_directions"}:
        return network
    if network.blocks["rotation"].free[:, :2].any():
        return network
    parts: list[_RigidPart] = []
    for part in _sets_of_directions(network):
        while joined := next((other for other in parts if len(part.polar & other.polar) > 1), None):
            parts.remove(joined)
            part = _RigidPart(
                part.polar | joined.polar,
                part.points | joined.points,
                part.rotations + joined.rotations,
                part.given or joined.given,
            )
        parts.append(part)
    hanging: list[_RigidPart] = []
    while sum(bool(part.rotations) for part in parts) > 1:
        tied = _ties(parts)
        ties = [len(part.points & tied) for part in parts]
        loose = [part for part, tie in zip(parts, ties, strict=True) if part.rotations and tie < 2]
        if not loose:
            break
        hanging.append(min(loose, key=lambda part: (part.given, len(part.points))))
        parts = [part for part in parts if part is not hanging[-1]]
    if not hanging:
        return network
    marked = nothing_marked(network)
    marked["rotation"][[number for part in hanging for number in part.rotations]] = True
    kept = set[int]().union(*(part.points for part in parts))
    alone = sorted(set[int]().union(*(part.points for part in hanging)) - kept)
    marked["point"][alone] = True
    ids = network.blocks["rotation"].ids
    stations = dict.fromkeys(thing_of("rotation", ids[number]) for part in hanging for number in part.rotations)
    things = [UndeterminedObject(*thing, ONE_TIE, "left out") for thing in stations]
    points = network.blocks["point"].ids
    things += [UndeterminedObject("point", points[point], HANGS_ON, "left out") for point in alone]
    return without_blocks(network, marked, things)


def _ties(parts: Sequence[_RigidPart]) -> set[int]:
    """Points that tie parts to each other.

    A point without a place in any part, which two of them sight, ties nothing. Those that more of them sight do, if
    the parts have as many conditions as relative movements in plan: 2 for each further place of a point, 1 for each
    direction to one with a place, and the directions but two to one without.
    """
    count = Counter(point for part in parts for point in part.points)
    places = Counter(point for part in parts for point in part.polar)
    bare = {point: n for point, n in count.items() if not places[point]}
    conditions = sum(count[point] + n - 2 for point, n in places.items()) + sum(max(n - 2, 0) for n in bare.values())
    has_scale = any(len(part.polar) > 1 for part in parts)
    enough = conditions >= 3 * len(parts) - (3 if has_scale else 4)
    return {point for point, n in count.items() if n > 1 and (point not in bare or (enough and n > 2))}


def _sets_of_directions(network: Network) -> Iterator[_RigidPart]:
    free = network.blocks["point"].free
    given = set[int]()
    lengths, bearings = set[tuple[int, int]](), set[tuple[int, int]]()
    sets: dict[int, tuple[int, set[int]]] = {}
    for group in network.groups:
        if group.type.key in ("directions", "zenith_directions"):
            rows = np.flatnonzero(group.mask[:, 0])
            for station, number, target in zip(*(group.blocks[k][rows].tolist() for k in (0, 1, 3)), strict=True):
                sets.setdefault(number, (station, set()))[1].add(target)
        elif group.type.key in ("distance", "horizontal_distance"):
            lengths.update(zip(group.blocks[0].tolist(), group.blocks[2].tolist(), strict=True))
        elif group.type.key == "bearing":
            bearings.update(zip(*(group.blocks_of("point")[k].tolist() for k in (0, 1)), strict=True))
        elif group.type.key == "observed/point":
            given.update(group.blocks[0][group.mask[:, :2].all(axis=1)].tolist())
    used = {point for station, targets in sets.values() for point in (station, *targets)}
    used |= {point for ends in bearings for point in ends}
    given = (given | set(np.flatnonzero(~free[:, :2].any(axis=1)).tolist())) & used
    oriented = _connected(ends for ends in bearings if ends in lengths)
    given |= set[int]().union(*(points for points in oriented if not points.isdisjoint(given)))
    for points in oriented:
        yield _RigidPart(points, points, [])
    if len(given) > 1 and not network.datum.free:
        yield _RigidPart(given, given, [], given=True)
    for number, (station, targets) in sets.items():
        polar = {target for target in targets if (station, target) in lengths or (target, station) in lengths}
        is_oriented = any((station, target) in bearings or (target, station) in bearings for target in targets)
        yield _RigidPart(polar | {station}, targets | {station}, [] if is_oriented else [number])
    seen = {(station, target) for station, targets in sets.values() for target in targets}
    for start, end in lengths - seen:
        if (end, start) not in seen:
            yield _RigidPart({start, end}, {start, end}, [])


def _connected(pairs: Iterable[tuple[int, int]]) -> list[set[int]]:
    """Sets of points that pairs of points connect."""
    sets: list[set[int]] = []
    for pair in pairs:
        met = [points for points in sets if not points.isdisjoint(pair)]
        sets = [points for points in sets if points not in met] + [set(pair).union(*met)]
    return sets


@dataclass(frozen=True)
class NetworkObjects:
    """All things of a network that may be left out: points, and images, stations … with all that is their own."""

    points: Sequence[str]
    """Names of the point blocks: things of their own, unless they are positions of images, stations …"""
    others: Sequence[tuple[str, str]]
    """(kind, name) of all other things, numbered after the points."""
    of_blocks: dict[str, IntArray]
    """(n,) thing of each block of a kind, −1 for what is no thing by itself (cameras, instruments)."""

    @property
    def count(self) -> int:
        """Number of things."""
        return len(self.points) + len(self.others)

    def name(self, number: int) -> tuple[str, str]:
        """(kind, name) of a thing."""
        first = len(self.points)
        return ("point", self.points[number]) if number < first else self.others[number - first]

    def marked(self, network: Network, chosen: BoolArray) -> dict[str, BoolArray]:
        """Blocks of the chosen things."""
        marked = nothing_marked(network)
        for kind, thing in self.of_blocks.items():
            marked[kind] = (thing >= 0) & chosen[thing]
        return marked


def things_of(network: Network) -> NetworkObjects:
    """The things of a network."""
    ids = network.blocks["point"].ids if "point" in network.blocks else ()
    of_blocks = {kind: np.full(len(blocks.ids), -1, dtype=np.int64) for kind, blocks in network.blocks.items()}
    plain = np.zeros(len(ids), dtype=bool)
    plain[network.things["point"].parts["position"]] = True
    if "point" in of_blocks:
        of_blocks["point"] = np.arange(len(ids))
    numbers: dict[tuple[str, str], int] = {}
    for kind, blocks in network.blocks.items():
        others = np.flatnonzero(~plain) if kind == "point" else range(len(blocks.ids))
        for k in others:
            thing = thing_of(kind, blocks.ids[k])
            if thing[0] != kind:
                of_blocks[kind][k] = numbers.setdefault(thing, len(ids) + len(numbers))
    return NetworkObjects(ids, list(numbers), of_blocks)


def without_loose(network: Network, values: Values, make: Callable[[Network, Values], Problem]) -> Network:
    """The network without things that nothing determines even where all else is known; it says which these were."""
    things = things_of(network)
    reduced = network
    while True:
        problem = make(reduced, values)
        # Beside the start values: what is singular there alone is not undetermined.
        place = beside(problem, values)
        defects = local_defects(problem, place, things.of_blocks, things.count)
        if not defects.loose.any():
            return reduced
        named = _named(things, defects, first=reduced is network)
        reduced = without_blocks(reduced, things.marked(reduced, defects.loose), named)


def _named(things: NetworkObjects, defects: LocalDefects, first: bool) -> list[UndeterminedObject]:
    named = []
    for k in np.flatnonzero(defects.loose).tolist():
        if not first:
            reason = HANGS_ON
        elif defects.rows[k] == 0:
            reason = "no observation refers to it"
        elif defects.too_few[k]:
            reason = "it has fewer observations than unknowns"
        else:
            reason = "its observations do not determine one of its directions"
        named.append(UndeterminedObject(*things.name(k), reason, "left out", int(defects.rows[k])))
    return named


def without_moved(
    network: Network, adjustment: Adjustment, values: Values, make: Callable[[Network, Values], Problem]
) -> Network | None:
    """The network without what is not determined in it, and without what is loose then.

    That is what null vectors move that are no movements of it as a whole, or what is determined too badly to be of use.
    ``None`` where there are none, or where they move what cannot be left out: cameras, or most of the network.
    """
    if adjustment.outcome is not Outcome.SINGULAR or not adjustment.defect.undetermined:
        return None
    things = things_of(network)
    numbers = {things.name(k): k for k in range(things.count)}
    touched = {
        thing_of(kind, name) for direction in adjustment.defect.undetermined for kind, name, _ in direction.unknowns
    }
    moved, reason = _apart(network, touched), "no observation connects it with the larger part of the network"
    if not moved:
        reason = (
            "its standard deviations are too large to be useful"
            if adjustment.defect.beyond_use
            else "it can move together with others, and no observation changes"
        )
        moved = touched
    chosen = np.zeros(things.count, dtype=bool)
    chosen[[numbers[thing] for thing in moved if thing in numbers]] = True
    marked = things.marked(network, chosen)
    left = sum(int(np.count_nonzero(network.blocks[k].free[m])) for k, m in marked.items())
    if not chosen.any() or 2 * left > adjustment.problem.index.count:
        return None
    rows = local_defects(adjustment.problem, adjustment.values, things.of_blocks, things.count).rows
    named = [
        UndeterminedObject(*things.name(k), reason, "left out", int(rows[k])) for k in np.flatnonzero(chosen).tolist()
    ]
    further = without_loose(without_blocks(network, marked, named), values, make)
    return further if _something_left(further) else None


def _apart(network: Network, touched: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Things of all parts but the one that is held by fixed points, or else the largest.

    If the datum is given, parts that are not ``touched`` by what is undetermined have one of their own: they stay.
    """
    parts = [part for part in connected_parts(network, network.groups) if part.size > 1]
    main = next((part for part in parts if part.held), parts[0] if parts else None)
    others = [
        {(space, name) for space, names in part.names.items() for name in names} for part in parts if part is not main
    ]
    loose = [things for things in others if network.datum.free or not things.isdisjoint(touched)]
    return set[tuple[str, str]]().union(*loose)


# ---- How well the rays of a network meet at given values, before anything is adjusted.


def misfit(network: Network, values: Values, but: IntArray) -> float:
    """Return the median distance between rays and their points in units of σ (of normal errors), at least 1.

    Rays to the points ``but`` (k,) have no say, for their places are in question.
    """
    if len(but) == 0:
        return 1.0
    apart = np.zeros(len(network.blocks["point"].ids), dtype=bool)
    apart[but] = True
    sizes = [np.zeros(0)]
    for group in network.groups:
        if can_be_at_infinity(group.type):
            rows = np.flatnonzero(~apart[group.blocks[target_slot(group.type)]])
            rows = rows[:: max(1, len(rows) // 20_000)]  # so many tell how well the values fit
            sizes.append((misclosures(group, values, rows) / group.sigma[rows]).ravel())
    sample = np.abs(np.concatenate(sizes))
    return max(1.0, robust_sigma(sample[np.isfinite(sample)]))


# ---- Whether a point at infinity has a parallax after all, when poses may give way to it: a test at the solution.
#
# A point that was put at infinity too early, with rough poses and cameras, bends these until its rays are parallel.
# Asked at the poses so bent they are; asked of the whole adjustment they are not. With B the derivative of its
# observations by the inverse distance ρ, the adjustment that had ρ as one more unknown would find
#
#     ρ = BᵀPv̄ / (BᵀP Q_v P B),   σ_ρ² = 1 / (BᵀP Q_v P B),   Q_v = P⁻¹ − A Q Aᵀ,
#
# v̄ = observed − computed at the solution without it: the test of an additional parameter (W. Baarda: A testing
# procedure for use in geodetic networks, 1968), which needs one solution of the normal equations for every point.
#
# A ρ that is significant, negative too, speaks against infinity: this point, or others there, have bent the
# network. All that are significant are then unknowns together, B with a column for each: what one of them
# alone would explain of what all have bent is told from what is its own, and they come to where the
# adjustment with all their ρ sees them. Linearised so far from the solution that may be wrong; a ρ that comes
# out negative says by how much, and all come nearer by twice that. Too near does no harm: with d' = d (2 −
# ρ/ρ₀) an iteration in coordinates at most doubles a distance, but begun at more than twice the distance it
# ends behind the cameras.

_FAR = 1e-3
"""Inverse distance, in units of its σ at given poses, at which derivatives are taken."""


def with_free_poses(
    network: Network, reduced: Network, adjustment: Adjustment, values: Values, far: RayPoints, critical: float
) -> RayPoints:
    """Inverse distances and their σ as the whole adjustment tells them.

    ``network`` has the points ``far`` as points, ``reduced`` and its ``adjustment`` as directions; ``values`` are those
    of the blocks of ``network`` at the solution; ``critical`` is the quantile of the test.
    """
    known: IntArray = np.flatnonzero([p in reduced.directions for p in far.points.tolist()])
    if not len(known):
        return far
    distance = 1.0 / (_FAR * far.sigma)
    points = values["point"].copy()
    points[far.points] = far.centres + far.directions * distance[:, None]
    places = {**values, "point": points}
    inverse, sigma = far.inverse.copy(), far.sigma.copy()
    for piece in pieces(len(known), 64):
        some = known[piece]
        size, product, through = _equations(network, reduced, adjustment, places, far, some)
        left = size - np.einsum("uk,uk->k", through, adjustment.inverse.solve(through))
        told = left > 0.0
        inverse[some[told]] = product[told] / left[told]
        sigma[some[told]] = 1.0 / np.sqrt(left[told])
    bent = np.zeros(len(inverse), dtype=bool)
    bent[known] = np.abs(inverse[known]) > critical * sigma[known]
    for some in np.array_split(np.flatnonzero(bent), 1 + np.count_nonzero(bent) // 512):
        if len(some):
            size, product, through = _equations(network, reduced, adjustment, places, far, some)
            left = np.diag(size) - through.T @ adjustment.inverse.solve(through)
            together = rotations.lstsq(left, product, rcond=None)
            inverse[some] = together + 2.0 * max(0.0, -float(together.min()))
    return far._replace(inverse=inverse, sigma=sigma)


def _equations(
    network: Network, reduced: Network, adjustment: Adjustment, places: Values, far: RayPoints, some: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """BᵀPB (k,), BᵀPv̄ (k,) and AᵀPB (u, k) of some far points."""
    index = adjustment.problem.index
    tangent = rotation_tangents(index, adjustment.values)
    number = np.full(len(network.blocks["point"].ids), -1, dtype=np.int64)
    number[far.points[some]] = np.arange(len(some))
    left_out = {
        kind: reduced.absent[kind] if kind in reduced.absent and kind != "point" else none
        for kind, none in nothing_marked(network).items()
    }
    size, product, through = np.zeros(len(some)), np.zeros(len(some)), np.zeros((index.count, len(some)))
    for group in network.groups:
        if not can_be_at_infinity(group.type):
            continue
        there = number[group.blocks[target_slot(group.type)]] >= 0
        rows = np.flatnonzero(there & ~touches(group, left_out))
        if len(rows) == 0:
            continue
        point = group.blocks[target_slot(group.type)][rows]
        k = number[point]
        # (n, m, 3) derivatives by the sighted point.
        blocks = [places[slot.kind][numbers[rows]] for slot, numbers in group.blocks_by_slot]
        computed = group.type.equation(blocks, group.constants[rows])
        by_point = computed.jacobians[target_slot(group.type)]
        away = far.directions[some[k]]
        distance = 1.0 / (_FAR * far.sigma[some[k]])
        weight = group.sigma[rows] ** -2.0
        B = -(distance**2)[:, None] * np.einsum("nmi,ni->nm", by_point, away)
        lines = linearise(group, index, places, tangent, rows)
        np.add.at(size, k, np.sum(weight * B**2, axis=1))
        np.add.at(product, k, np.sum(weight * B * lines.misclosure, axis=1))
        block = np.array([reduced.directions[int(p)] for p in point])
        D = adjustment.values["rotation"][block]
        by_turn = distance[:, None, None] * (by_point @ np.swapaxes(D, 1, 2) @ TURNED_AXIS)
        for jacobian, columns in ((lines.jacobian, lines.columns), (by_turn, index.columns["rotation"][block])):
            moved = np.einsum("nm,nmc->nc", weight * B, jacobian)
            free = columns >= 0
            np.add.at(through, (columns[free], np.broadcast_to(k[:, None], columns.shape)[free]), moved[free])
    return size, product, through


# ---- Why there is no solution: unknowns that move to and fro, or away, and what a singular place has to do with
# the data.
#
# What is said of an iteration that failed is seen from its last values: a few further steps of it, and whether the
# system is singular beside them as well.

AT_THE_START = "singular at the start values only: at other values the observations determine everything"
PUT_ANYWHERE = (
    "but parts of the network have arbitrary positions because start values "
    "are missing: the observations may still determine it"
)
"""Reasons of outcomes."""


class UnsettledUnknowns(NamedTuple):
    """Unknowns that do not come to rest, those that change the observations most first."""

    unknowns: tuple[tuple[str, str, str], ...]
    """(kind, block, component)."""
    steps: FloatArray
    """(k, s) their last steps, internal units; one alone is the step that could not be taken."""
    to_and_fro: FloatArray
    """(k,) part of the way that was taken back: 0 for one way, near 1 for an oscillation."""


def last_movements(adjustment: Adjustment) -> UnsettledUnknowns:
    """Return the unknowns that moved in further steps from the last values, or else in the step that was proposed."""
    steps = _further_steps(adjustment)
    if steps.shape[1] == 0:
        wanted = adjustment.inverse.step(adjustment.normals)
        steps = wanted[:, None]
    index = adjustment.problem.index
    way, net = np.abs(steps).sum(axis=1), np.abs(steps.sum(axis=1))
    # (u,) diagonal of the normal matrix: what one unit of each unknown does to all observations, squared.
    problem = adjustment.problem
    diagonal = np.zeros(problem.index.count + 1)
    tangent = rotation_tangents(problem.index, adjustment.values)
    for group in problem.groups:
        for rows in pieces(group.count, 50_000):
            found = linearise(group, problem.index, adjustment.values, tangent, rows)
            weight = np.where(group.mask[rows], 1.0 / group.sigma[rows], 0.0)
            squares = np.nan_to_num(np.sum((weight[:, :, None] * found.jacobian) ** 2, axis=1))
            np.add.at(diagonal, found.columns, squares)
    size = way * np.sqrt(diagonal[:-1])
    order = np.argsort(-np.nan_to_num(size), kind="stable")[:20]
    order = order[size[order] > 0.0]
    labels = tuple(index.label(int(column)) for column in order)
    return UnsettledUnknowns(labels, steps[order], 1.0 - net[order] / way[order])


def with_fitting_reason(adjustment: Adjustment, untied: bool = False) -> Adjustment:
    """The outcome with a reason that fits: of the observations, of the start values, or of an iteration gone astray.

    ``untied``: parts of the network lie anywhere, because nothing was found that ties them to the rest.
    """
    if adjustment.outcome is Outcome.NOT_CONVERGED:
        here = adjust(adjustment.problem, adjustment.values, SolverSettings(max_iterations=0))
        turns = weak_turns(here.inverse.weak, here.problem, here.values)
        if not turns or turns[0].sigma <= NOTHING_KNOWN:
            return adjustment
        return here._replace(
            outcome=Outcome.SINGULAR, reason=A_WEAK_TURN, start=adjustment.start, iterations=adjustment.iterations
        )
    if adjustment.outcome is not Outcome.SINGULAR or adjustment.reason not in (OPEN, UNSETTLED, NO_DATUM):
        return adjustment
    if not adjustment.plan.problem.index.count:
        return adjustment
    if not fits(adjustment) and _ran_away(adjustment):
        return adjustment._replace(outcome=Outcome.DIVERGED, reason=RAN_AWAY)
    if only_here(adjustment):
        return adjustment._replace(reason=AT_THE_START)
    problem = adjustment.problem
    enough = problem.observations >= problem.index.count - adjustment.defect.datum.shape[1]
    if untied and enough and adjustment.reason != NO_DATUM and not fits(adjustment):
        return adjustment._replace(reason=PUT_ANYWHERE)
    return adjustment


def _ran_away(adjustment: Adjustment) -> bool:
    """True where an iteration ends at a singular place and began at a regular one."""
    if not adjustment.iterations:
        return False
    begin = adjust(adjustment.problem, adjustment.start, SolverSettings(max_iterations=0))
    return begin.outcome is not Outcome.SINGULAR


def fits(adjustment: Adjustment) -> bool:
    """True where residuals are of the size of their σ, solution or not: vᵀPv is at most 10 for each observation."""
    return adjustment.normals.objective <= 10.0 * adjustment.problem.observations


def only_here(adjustment: Adjustment) -> bool:
    """True where the start values are singular, do not fit the observations, and beside them nothing is singular."""
    problem = adjustment.problem
    if adjustment.outcome is not Outcome.SINGULAR or adjustment.iterations:
        return False
    if fits(adjustment):
        return False
    there = adjust(problem, beside(problem, adjustment.values), SolverSettings(max_iterations=0))
    return there.outcome is not Outcome.SINGULAR


def _further_steps(adjustment: Adjustment) -> FloatArray:
    """(u, s) steps of the iteration if it went on from its last values, at most five."""
    problem, values = adjustment.problem, adjustment.values
    steps: list[FloatArray] = []
    while len(steps) < 5 and adjustment.outcome is Outcome.NOT_CONVERGED:
        after = adjust(problem, values, SolverSettings(max_iterations=1))
        if not after.iterations or after.outcome is Outcome.DIVERGED:
            break
        # (u,) the step from one place to another; of rotations the vector of the small rotation.
        index = problem.index
        step = np.zeros(index.count)
        for kind, columns in index.columns.items():
            if index.blocks[kind].kind.is_rotation:
                turn = after.values[kind] @ np.swapaxes(values[kind], 1, 2)
                # D' = (I − [δ]×) D to first order
                change = 0.5 * np.stack(
                    [turn[:, 1, 2] - turn[:, 2, 1], turn[:, 2, 0] - turn[:, 0, 2], turn[:, 0, 1] - turn[:, 1, 0]],
                    axis=1,
                )
            else:
                change = after.values[kind] - values[kind]
            step[columns[columns >= 0]] = change[columns >= 0]
        steps.append(step)
        values = after.values
        if after.outcome is not Outcome.NOT_CONVERGED:
            break
    return np.stack(steps, axis=1) if steps else np.zeros((problem.index.count, 0))


# ---- What of a network can be determined: the rest is named, put at infinity, or left out where the project wants it.
#
# Things that their own observations leave loose are found before anything is solved, and with them what hangs on them
# alone; what only moves together with others shows in the null space of the whole. Points with parallel rays become
# directions; whether their rays are parallel is asked again at the solution, where the poses are known better.

AT_INFINITY: Final = "at infinity"
PARALLEL = "its rays are parallel within their precision: it has a direction but no distance"
IN_CENTRE = "it lies in the projection centre of an image"
PASSING = "steps lead it past a camera that sees it"
BEYOND_FOLD = "an image sees it where the distortion of its camera folds the image"
ROUNDS = 6
"""Adjustments at most, until what is at infinity and what is left out stays the same."""


class Means(NamedTuple):
    """Functions that make a problem of a network and solve it, and the critical value of the test for parallel rays."""

    make: Callable[[Network, Values], Problem]
    solve: Callable[[Network, Values], Attempt]
    plainly: Callable[[Network, Values], Attempt]
    """The same of all observations alone, whether that has a solution or not."""
    critical: float


def completed(
    network: Network, start: Values, missing: Sequence[UndeterminedObject], critical: float
) -> tuple[dict[str, FloatArray], tuple[UndeterminedObject, ...]]:
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
    network: Network, start: Values, missing: Sequence[UndeterminedObject], critical: float
) -> tuple[dict[str, FloatArray], tuple[UndeterminedObject, ...]]:
    """The same with the points at infinity among what is missing, named as that."""
    values, left = completed(network, start, missing, critical)
    known: BoolArray = np.asarray(np.isfinite(values["point"]).all(axis=1))
    placed = {("point", name) for name, k in zip(network.blocks["point"].ids, known, strict=True) if k}
    far = [thing for thing in missing if thing not in left and (thing.kind, thing.name) not in placed]
    return values, (*left, *(thing._replace(reason=PARALLEL, treatment=AT_INFINITY) for thing in far))


def without_unknown(network: Network, start: Values, missing: Sequence[UndeterminedObject]) -> Network:
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
    if _leaves_out(network):
        network = _without_misplaced(network, start)
    found = nearly_parallel(network, start)
    first = _with_far_points(network, start, start, found, means)
    if found.from_one_place().all() or first[1].is_complete or first[1].adjustment.defect.is_of_cameras:
        return first
    others = without_points(network, found.points, "its rays meet at a narrow angle")
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
    solved = [attempt.adjustment.outcome.is_solution for _, attempt in (first, second)]
    better = second[1].is_complete and not _is_worse((first[1], again), (second[1], again), means.critical)
    return second if better or solved == [False, True] else first


def _without_misplaced(network: Network, start: Values) -> Network:
    """The network without unknown points that no image can show where it shows them, if they are where they begin."""
    count = len(network.blocks["point"].ids)
    in_centre, beyond_fold = np.zeros((2, count), dtype=bool)
    for group in network.groups:
        if not is_image_point(group.type) or group.type.slots[0].of != "image" or group.count == 0:
            continue
        target = group.blocks[target_slot(group.type)]
        ray = start["point"][target] - start["point"][group.blocks[0]]
        known: BoolArray = np.asarray(np.isfinite(ray).all(axis=1))
        ray = np.where(known[:, None], ray, 0.0)
        distance = np.linalg.norm(ray, axis=1)
        # So near to a projection centre N loses all digits of the image.
        in_centre[target[known & (distance < 1e-6 * np.median(distance))]] = True
        beyond_fold[target[_folded(group, start, ray, distance)]] = True
    unknown = network.blocks["point"].free.all(axis=1) & ~np.isfinite(network.sigma["point"]).any(axis=1)
    network = without_points(network, np.flatnonzero(unknown & in_centre), IN_CENTRE)
    return without_points(network, np.flatnonzero(unknown & beyond_fold & ~in_centre), BEYOND_FOLD)


def _folded(group: ObservationGroup, start: Values, ray: FloatArray, distance: FloatArray) -> BoolArray:
    """(n,) true for rays (n, 3) off the middle of their images, on the way to which the image turns over."""
    image = np.unique(group.blocks[1], return_inverse=True)[1]
    unit = ray / np.maximum(distance, 1e-300)[:, None]
    middle = np.stack([np.bincount(image, one) for one in unit.T], axis=1)[image]
    axis = middle / np.linalg.norm(middle, axis=1)[:, None]
    along = np.einsum("ni,ni->n", ray, axis)
    off = np.linalg.norm(np.cross(unit, axis), axis=1)
    outside = np.flatnonzero((off > 2.0 * np.median(off)) & (along > 0.0))
    ahead = along[outside, None] * axis[outside]
    slot, turned, sides = target_slot(group.type), np.zeros(group.count, dtype=bool), []
    blocks = [start[one.kind][own[outside]] for one, own in zip(group.type.slots, group.blocks, strict=True)]
    for share in np.linspace(0.0, 1.0, 11):
        way = ahead + share * (ray[outside] - ahead)
        blocks[slot] = start["point"][group.blocks[0][outside]] + way
        by_x, by_y = np.moveaxis(group.type.equation(blocks, group.constants[outside]).jacobians[slot], 1, 0)
        sides.append(np.einsum("ni,ni->n", np.cross(by_x, by_y), way) > 0.0)
    turned[outside] = (np.stack(sides) != sides[0]).any(axis=0)
    return turned


def _with_far_points(
    network: Network, start: Values, values: Values, found: RayPoints, means: Means
) -> tuple[Network, Attempt]:
    """The network and its adjustment begun at ``values``, with points at infinity as they show there and later.

    Points with given coordinates begin there and stay finite, unless the iteration moves them to infinity or leads
    nowhere: the given values say too little of the poses to tell which points are at infinity.
    """
    plain, doubted = network, found.points
    given: BoolArray = np.asarray(np.isfinite(start["point"]).all(axis=1))
    complete = set[tuple[int, ...]]()
    before: tuple[Network, Attempt, RayPoints] | None = None
    far = _beyond_reach(network, values, found, means)
    if given[far.points].any():
        network = _with_reference(plain, start, values, doubted)
    beyond = far
    far = far.take(~given[far.points] | _without_parallax(values, far))
    given[far.points] = False
    rounds, held = ROUNDS, far.points[:0]
    while rounds:
        rounds -= 1
        blind = found.points[found.from_one_place()]
        reduced, attempt = _adjusted(network, values, far, blind, means)
        adjustment = attempt.adjustment
        if attempt.stayed_plain:
            means = means._replace(solve=means.plainly)
        there = _values_of(network, adjustment.values, far.points)
        if adjustment.reason == PAST_CAMERAS:
            plain = without_points(plain, adjustment.gone, PASSING)
            if not _leaves_out(network):
                things = plain.undeterminable[-len(adjustment.gone) :]
                named = (*reduced.undeterminable, *(thing._replace(treatment="") for thing in things))
                return replace(reduced, undeterminable=named), attempt
            network, values, before = _with_reference(plain, start, there, doubted), there, None
            rounds += 1
            continue
        if len(adjustment.gone):
            every = nearly_parallel(network, there, contradicting=True)
            to_infinity = np.isin(every.points, np.union1d(far.points, adjustment.gone))
            gone = every.take(to_infinity | _without_parallax(there, every))
            if len(gone.points) == len(far.points):
                break
            held = gone.points
            far, values, doubted = gone, there, np.union1d(doubted, gone.points)
            network = _with_reference(plain, start, values, doubted)
            rounds += 1
            continue
        if not adjustment.outcome.is_solution:
            if not given[beyond.points].any() or adjustment.defect.is_of_cameras:
                break
            far, given[beyond.points] = beyond, False  # it may be their coordinates that lead nowhere
            continue
        if before is not None and _is_worse(before[1:], (attempt, far), means.critical):
            break
        before = before if _of_all(attempt) is None else (reduced, attempt, far)
        found = nearly_parallel(network, there)
        found = with_free_poses(network, reduced, adjustment, there, found, means.critical)
        now = _beyond_reach(network, there, found, means)
        now = found.take(np.isin(found.points, np.union1d(now.points, held)))
        if np.array_equal(np.sort(now.points), np.sort(far.points)):
            break
        if attempt.is_complete and tuple(np.sort(now.points).tolist()) in complete:
            break  # either is a solution of all observations, and leads to the other
        values = _with_coordinates(there, found.take(np.isin(found.points, far.points)))
        if attempt.is_complete:
            complete.add(tuple(np.sort(far.points).tolist()))
        far = now
        network = _with_reference(plain, start, values, doubted)
    if before is not None and _is_worse(before[1:], (attempt, far), means.critical):
        reduced, attempt, far = before
    rounds, solved = ROUNDS, attempt.adjustment.outcome.is_solution
    there = _values_of(network, attempt.adjustment.values, far.points)
    values = {**there, "point": np.where(np.isnan(there["point"]), start["point"], there["point"])} if solved else start
    while len(far.points) and _leaves_out(network) and rounds:
        # Left out only now: with them the poses are known well enough to tell which points are at infinity.
        rounds -= 1
        network = _with_reference(plain, start, there, doubted)
        smaller, then = _adjusted(network, values, far, blind, means, far_too=True)
        if then.adjustment.outcome.is_solution or not solved:
            return smaller, then
        every = nearly_parallel(network, there, contradicting=True)
        more = every.take(np.isin(every.points, np.union1d(far.points, then.adjustment.gone)))
        if len(more.points) <= len(far.points):
            break
        far = more
    return reduced, attempt


def _is_worse(before: tuple[Attempt, RayPoints], after: tuple[Attempt, RayPoints], critical: float) -> bool:
    """True where all observations fit worse than before, significantly so if more points are at infinity."""
    first, then = _of_all(before[0]), _of_all(after[0])
    if first is None or then is None:
        return first is not None
    squares = first.normals.objective
    more = max(len(after[1].points) - len(before[1].points), 0)
    factor = max(squares / max(first.problem.observations - first.problem.index.count, 1), 1.0)
    limit = float(chdtri(more, erfc(critical / np.sqrt(2.0)))) if more else 0.0
    return then.normals.objective - squares > max(factor * limit, 1e-3 * squares)


def _of_all(attempt: Attempt) -> Adjustment | None:
    """The solution of all observations, whether suspects were left out after it or not."""
    if attempt.suspects is None:
        return attempt.adjustment if attempt.is_complete else None
    plain = attempt.suspects.plain
    return plain if plain.outcome.is_solution else None


def _without_parallax(values: Values, found: RayPoints) -> BoolArray:
    """(k,) true for points so far away that vᵀPv is the same to 10⁻⁶ if they are at infinity: 1/d is below 10⁻³ σ."""
    distance = np.linalg.norm(values["point"][found.points] - found.centres, axis=1)
    return np.asarray(~found.from_one_place() & (distance * found.sigma * 1e-3 >= 1.0))


def _with_reference(network: Network, start: Values, values: Values, doubted: IntArray) -> Network:
    """The network whose datum stays the same wherever another adjustment of it begins.

    It refers to the given coordinates, for points without to their start values, and for points without these to where
    that adjustment begins. Points ``doubted``, which were at infinity, do not
    carry it as long as others do: a distance that nobody knew, on the wrong side perhaps, would outweigh all others.
    """
    datum = network.datum
    mask = datum.mask.copy()
    mask[doubted] = False
    if not datum.minimal and np.count_nonzero(mask.all(axis=1)) >= 3:  # they determine any movement of a network
        datum = datum._replace(mask=mask)
    if datum.reference is None:
        begun = np.where(np.isfinite(start["point"]), start["point"], values["point"])
        datum = datum._replace(reference=datum.reference_from(begun))
    return replace(network, datum=datum)


def with_nearer_datum(network: Network, adjustment: Adjustment, far: IntArray) -> Network | None:
    """The network whose datum all points but the ``far`` ones carry; ``None`` where not all do, or none is far off.

    What is not known of them would be part of the precision of all others.
    """
    own: IntArray = far[far < len(network.datum.mask)]
    carried = network.datum.mask[network.things["point"].parts["position"]]
    if network.datum.minimal or not network.datum.free or not carried.all() or not network.datum.mask[own].any():
        return None
    there = _values_of(network, adjustment.values, own[:0])
    nearer = _with_reference(network, network.start, there, own)
    if nearer.datum.mask[own].any():
        return None
    note = Message(
        f"{counted(len(own), 'point')} left out of the datum, being farther from the others than 10 times the median "
        "distance of points"
    )
    return replace(nearer, notes=(*network.notes, note))


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
    reduced = without_loose(
        without_points(whole, blind, "all its rays come from one place: its distance is undetermined"),
        begun,
        means.make,
    )
    loose = reduced.undeterminable[len(whole.undeterminable) :]
    named = (*whole.undeterminable, *(thing._replace(treatment="") for thing in loose))
    if loose and not leave and len(loose) <= 30:  # so few are explained by the null space of the whole network
        return replace(whole, undeterminable=named), means.solve(whole, begun)
    if not _something_left(reduced):
        raise NoStartValuesError(reduced.undeterminable, ["nothing is left to adjust"])
    attempt = means.solve(reduced, begun)
    if loose and not leave:
        reduced = replace(reduced, undeterminable=named)
        return reduced, Attempt(attempt.adjustment._replace(outcome=Outcome.SINGULAR, reason=OPEN))
    for _ in range(ROUNDS if leave else 0):
        adjustment = attempt.adjustment
        if only_here(adjustment) or (not fits(adjustment) and _ran_away(adjustment)):
            break  # the start values or gross errors are at fault
        further = without_moved(reduced, adjustment, begun, means.make)
        if further is None:
            break
        reduced, attempt = further, means.solve(further, begun)
    return reduced, attempt


def _something_left(network: Network) -> bool:
    return any(group.count for group in network.groups)


def _without_far(network: Network, start: Values, far: RayPoints, leave: bool) -> tuple[Network, dict[str, FloatArray]]:
    if len(far.points) == 0:
        return network, dict(start)
    ids = network.blocks["point"].ids
    placed = start["point"].copy()
    placed[far.points] = far.centres
    begun = {**start, "point": placed}
    if leave:
        return without_points(network, far.points, PARALLEL), begun
    rays = rows_of_points(network.groups, len(network.blocks["point"].ids))
    things = [UndeterminedObject("point", ids[p], PARALLEL, AT_INFINITY, int(rays[p])) for p in far.points.tolist()]
    # (k, 3, 3) rotations whose third rows are the directions (k, 3).
    across = rotations.svd(far.directions[:, None, :])[2][:, 1:, :]
    D = np.concatenate([across, far.directions[:, None, :]], axis=1)
    D[:, 0] *= np.linalg.det(D)[:, None]
    return with_points_at_infinity(network, begun, far.points, D, things)


def without_points(network: Network, points: IntArray, reason: str) -> Network:
    """The network without some points, all for one reason."""
    if len(points) == 0:
        return network
    marked, rays = nothing_marked(network), rows_of_points(network.groups, len(network.blocks["point"].ids))
    marked["point"][points] = True
    ids = network.blocks["point"].ids
    left = [UndeterminedObject("point", ids[p], reason, "left out", int(rays[p])) for p in points.tolist()]
    return without_blocks(network, marked, left)


def _values_of(network: Network, values: Values, far: IntArray) -> dict[str, FloatArray]:
    own = {kind: values[kind][: len(blocks.ids)] for kind, blocks in network.blocks.items()}
    points = own["point"].copy()
    points[far] = np.nan
    return {**own, "point": points}


def _with_coordinates(values: Values, found: RayPoints) -> dict[str, FloatArray]:
    points = values["point"].copy()
    near = found.inverse > 0.0
    points[found.points[near]] = found.take(near).coordinates()
    return {**values, "point": points}
