"""Join parts by similarity transformations and by rays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mor.errors import CONTRADICTED, UndeterminedObject
from mor.model import rotations
from mor.model.contract import ObservationType
from mor.model.coordinates import target_slot
from mor.model.rotations import angles_from_rotation, nearest_rotation, rotation_from_angles
from mor.model.shapes import SHAPE_TYPES
from mor.model.terrestrial import HEIGHT_DIFFERENCE
from mor.project.entities import thing_of
from mor.project.network import Network
from mor.project.shapes import Held, fit_shape
from mor.start.bundle import Similarity, SimilarityOutcome, congruence, evenly, movement_by, similarity
from mor.start.intersection import posed_frames
from mor.start.movement import OPEN, PRECISION, FreeRotation, Movement, Ties, movement
from mor.start.part import SLACKS, Frame, Join, Part, Phrase, Tie, empty_part, given_pose, misses
from mor.start.scene import Scene, StereoPair, forget_marks, make_upright
from mor.start.sights import Terrestrial, frame_verticals
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import ANGLE_UNITS

# ---- A part of cameras on a platform whose poses are known: boresight and lever arm come out with the movement.
#
# Leader D_l, O_l are known in the target, followers D_f, O_f in the source, and one turn T and base b for all:
#
#     D_f = T D_l R,    s R O_f + t = O_l + D_lᵀ b    for the movement X = s R x + t
#
# The relative turns D_f,i D_f,jᵀ = T D_l,i D_l,jᵀ Tᵀ have parallel axes under T (Kabsch), where the attitudes
# turn about more than one axis; a base that is short beside the network leaves T to the positions as well.
# Both are tried.


def tie_by_platform(target: Part, source: Part, scene: Scene) -> Movement | None:
    """The movement that a pair tells whose followers only the source knows, and whose leaders are given."""
    for pair in scene.pairs if target.given else ():
        followers = [n for n in pair.known if n in source.poses and n not in target.poses]
        if len(followers) < 3:
            continue
        found = _tie(pair, followers, source)
        if found is not None:
            return found
    return None


def _tie(pair: StereoPair, followers: list[int], source: Part) -> Movement | None:
    O_l, D_l = (np.array([pair.known[n][k] for n in followers]) for k in (0, 1))
    O_f, D_f = (np.array([source.poses[n][k] for n in followers]) for k in (0, 1))
    poses = O_l, D_l, O_f, D_f
    found = [_with_turn(T, *poses, source.scaled, pair.base) for T in _turns(*poses, pair.turn)]
    return min((one for one in found if one is not None), key=lambda one: one.misfit, default=None)


def _turns(O_l: FloatArray, D_l: FloatArray, O_f: FloatArray, D_f: FloatArray, given: FloatArray) -> list[FloatArray]:
    """Candidates of the turn from leader to follower."""
    if np.isfinite(given).all():
        return [given]
    from scipy.spatial.transform import Rotation  # no network without such pairs waits for it

    i, j = np.triu_indices(len(D_l), 1)
    relative = (Rotation.from_matrix(D[i] @ np.swapaxes(D[j], 1, 2)) for D in (D_l, D_f))
    here, there = (one.as_rotvec() for one in relative)
    turns = [nearest_rotation(there.T @ here)]
    by_places = similarity(O_f, O_l)
    if by_places.outcome is SimilarityOutcome.DETERMINED:
        turns.append(nearest_rotation((D_f @ by_places.rotation.T @ np.swapaxes(D_l, 1, 2)).sum(axis=0)))
    return turns


def _with_turn(
    T: FloatArray, O_l: FloatArray, D_l: FloatArray, O_f: FloatArray, D_f: FloatArray, scaled: bool, base: FloatArray
) -> Movement | None:
    """Rotation, scale, shift and base that go with a turn; the shortest base where several do."""
    R = nearest_rotation((np.swapaxes(D_l, 1, 2) @ T.T @ D_f).sum(axis=0))
    size = float(np.sqrt(np.mean(np.sum((O_l - O_l.mean(axis=0)) ** 2, axis=1))))
    spread = float(np.sqrt(np.mean(np.sum((O_f - O_f.mean(axis=0)) ** 2, axis=1))))
    if not (size > 0.0 and spread > 0.0):
        return None
    turned, places = (O_f - O_f.mean(axis=0)) @ R.T / spread, (O_l - O_l.mean(axis=0)) / size
    n, arm = len(places), np.nan_to_num(base) / size
    columns = [turned.reshape(-1, 1), np.tile(np.eye(3), (n, 1)), -np.swapaxes(D_l, 1, 2).reshape(-1, 3)]
    A, right = np.concatenate(columns, axis=1), places.ravel()
    if scaled:
        right, A = right - A[:, 0] * spread / size, np.delete(A, 0, axis=1)
    known = bool(np.isfinite(base).all())
    if known:
        right, A = right - A[:, -3:] @ arm, A[:, :-3]
    unknowns = rotations.lstsq(A, right, rcond=1e-6)
    factor = spread / size if scaled else float(unknowns[0])
    shift, b = unknowns[int(not scaled) :][:3], arm if known else unknowns[-3:]
    # Base, in parts of the extent of the leaders, beyond which it is none of a platform.
    if factor <= 0.0 or np.linalg.norm(b) > 3.0:
        return None
    off = np.concatenate([(A @ unknowns - right), (T @ D_l @ R - D_f).ravel()])
    values = rotations.singular_values(A[:, : 4 - int(scaled)])
    scale = factor * size / spread
    moved = O_l.mean(axis=0) + size * shift - scale * R @ O_f.mean(axis=0)
    misfit = float(np.sqrt(np.mean(off**2)))
    redundancy = len(off) - 6 - A.shape[1]
    return Movement(scale, R, moved, int(np.count_nonzero(values * OPEN < misfit)), misfit, redundancy)


# ---- Join two parts where what ties them determines the movement between them.


def join(target: Part, source: Part, scene: Scene, ambiguous: bool = False) -> bool:
    """Carry ``source`` into the system of ``target``, which takes over what it knows; true where that was possible.

    A movement that is not unique is taken only where ``ambiguous`` allows it: the one with the cameras above.
    """
    spread_positions(source, scene.frames)
    spread_positions(target, scene.frames)
    found = _tie_of_either_hand(target, source, scene)
    if found is None or found.open:
        found = tie_by_platform(target, source, scene) or found
    # Misfit, in parts of the size of what is common, beyond which two parts do not belong together.
    if found is None or found.open or (found.redundancy > 0 and found.misfit > 0.03):
        return False
    if found.alternatives and not ambiguous:
        return False
    carry(target, source, scene, found)
    return True


def _tie_of_either_hand(target: Part, source: Part, scene: Scene) -> Movement | None:
    """The tie of two parts; one of distances alone is mirrored where it fits better so.

    Where both fit alike the mirrored movement is an alternative.
    """
    found = tie(target, source, scene)
    if found is None or (target.handed and source.handed):
        return found
    loose = target if source.handed else source
    _mirror(loose)
    other = tie(target, source, scene)
    fit, mirrored = (np.inf if one is None or one.open else max(one.misfit, PRECISION) for one in (found, other))
    # A shape is told from its mirrored one where it misfits three times less.
    if mirrored * 3.0 < fit:
        return other
    _mirror(loose)
    if fit * 3.0 < mirrored or fit == mirrored == np.inf or not (target.handed or source.handed):
        return found
    return found._replace(alternatives=(*found.alternatives, found.similarity))


def open_movements(target: Part, source: Part, scene: Scene) -> int:
    """Return the number of movements between two parts that nothing determines."""
    found = tie(target, source, scene)
    # Movements between two parts that nothing ties.
    return 7 if found is None else found.open


def free_movements(target: Part, source: Part) -> int:
    """Return the number of movements of two parts against each other if nothing ties them."""
    return 3 + turn_between(target, source).count + (not (target.scaled and source.scaled))


def turn_between(target: Part, source: Part) -> FreeRotation:
    """Return the turns of two parts against each other that their verticals and directions leave free."""
    if not (target.levelled and source.levelled):
        return FreeRotation.ANY
    return FreeRotation.NONE if source.oriented and target.oriented else FreeRotation.VERTICAL


def lay_upon(part: Part, places: FloatArray, turn: FreeRotation, scaled: bool) -> None:
    """Carry a part as near as possible to where some points (points, 3) are said to be.

    Args:
        part: keeps its shape.
        places: given coordinates, NaN for points without.
        turn: the turns that the observations leave free.
        scaled: true if the observations determine the size.
    """
    rows = np.flatnonzero(np.isfinite(places).all(axis=1) & np.isfinite(part.points).all(axis=1))
    none = np.zeros((0, 3))
    found = movement(Ties(part.points[rows], places[rows], none, none), turn, scaled) if len(rows) > 2 else None
    if found is not None:
        part.transform(found.similarity)


def _mirror(part: Part) -> None:
    part.points[:, 0] *= -1.0


def carry(target: Part, source: Part, scene: Scene, found: Movement | None) -> None:
    """Carry a part over; what only it knew of vertical, direction and scale the target learns from it.

    Where nothing was ``found`` that ties the two it stays where it is.
    """
    # Keep in ``target`` what ``source`` is, and what ties the two, before it is carried over.
    tied = None if found is None else Tie(found.open, found.redundancy, found.misfit, len(found.alternatives))
    known = np.flatnonzero(np.isfinite(source.points).any(axis=1))
    poses, kappas = tuple(sorted(source.poses)), tuple(sorted(source.kappas))
    knows = source.levelled, source.oriented, source.scaled
    one = Join(source.number, source.began, target.number, known, poses, kappas, *knows, tied)
    target.joined += [*source.joined, one]
    bare = not target.lifts, not source.lifts
    target.handed |= source.handed
    moved = movement_by() if found is None else _likelier(found, source, scene)
    if target.scaled and not source.scaled:
        forget_marks(source, scene)
    if source.scaled and not target.scaled:
        forget_marks(target, scene)
        target.transform(movement_by(1.0 / moved.scale))
        moved = moved.times(1.0 / moved.scale)
        target.scaled = True
    source.transform(moved)
    taken = np.isnan(target.points).any(axis=1) & np.isfinite(source.points).any(axis=1)
    fresh = np.isnan(target.points) & np.isfinite(source.points)
    target.points[fresh] = source.points[fresh]
    for number, pose in source.poses.items():
        target.poses.setdefault(number, pose)
    for number, kappa in source.kappas.items():
        target.kappas.setdefault(number, kappa)
    for name, how in source.how.items():
        target.how.setdefault(name, how)
    target.slack = max(target.slack, source.slack)
    if source.levelled and not target.levelled:
        make_upright(target, moved.rotation[:, 2])
    if target.lifts and any(bare):
        target.lower_to_marks(scene.target_heights, np.where(taken, bare[1], bare[0]))
    target.place_sigma = max(target.place_sigma, _disagreement(target, source, scene.frames))
    spread_positions(target, scene.frames)


def tie(target: Part, source: Part, scene: Scene) -> Movement | None:
    """The movement from source to target by their common points, centres and attitudes."""
    both = source.levelled and target.levelled
    turn = turn_between(target, source)
    points, goals = _common_points(target, source, scene, both)
    centres, places = _common_centres(target, source, scene)
    axes, goal_axes = _common_attitudes(target, source, scene)
    ties = Ties(
        np.concatenate([points, centres]),
        np.concatenate([goals, places]),
        *((axes[:0], goal_axes[:0]) if turn is FreeRotation.NONE else (axes, goal_axes)),
    )
    found = movement(ties, turn, source.scaled and target.scaled)
    if found is None or not (both and found.open == 1 and not np.isfinite(ties.target[:, 2]).any()):
        return found
    # Two levelled parts that have no height in common: the plan joins them, and the heights stay unknown. Where the
    # target has none at all, those of the source are as good as any.
    if np.isfinite(target.points[:, 2]).any() or target.poses:
        source.points[:, 2] = np.nan
        source.poses.clear()
    return Movement(found.scale, found.rotation, found.shift, 0, found.misfit, found.redundancy, found.alternatives)


def _common_points(target: Part, source: Part, scene: Scene, both: bool) -> tuple[FloatArray, FloatArray]:
    ours, theirs = np.isfinite(source.points), np.isfinite(target.points)
    known = ours & theirs if both else theirs & np.asarray(ours.all(axis=1))[:, None]
    rows = np.flatnonzero(known.any(axis=1))
    full = rows[known[rows].all(axis=1)]
    if len(full) > 400:
        rows = evenly(full, 400)
    goals = np.where(known[rows], target.points[rows], np.nan)
    points = np.where(ours[rows], source.points[rows], 0.0)
    if target.lifts is not source.lifts:
        (goals if target.lifts else points)[:, 2] += scene.target_heights[rows]
    return points, goals


def _common_centres(target: Part, source: Part, scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Projection centres of frames posed in both, or on tripods whose place and height the target knows."""
    centres, places = [], []
    for number, (centre, _) in source.poses.items():
        frame = scene.frames[number]
        place = target.points[frame.position] + [0.0, 0.0, frame.offset[0]]
        if number in target.poses:
            centres.append(centre)
            places.append(target.poses[number][0])
        elif (
            frame.stands
            and frame.offset[0] != 0.0
            and target.levelled
            and target.scaled
            and not (source.levelled and source.scaled)
        ):
            centres.append(centre)
            places.append(place)
    return np.array(centres).reshape(-1, 3), np.array(places).reshape(-1, 3)


def _common_attitudes(target: Part, source: Part, scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Axes of frames that are posed in both, or whose attitude is given: D in the source, D in the target."""
    axes, goals = [], []
    for number, (_, D) in source.poses.items():
        other = target.poses[number][1] if number in target.poses else None
        if other is None and target.given:
            other = scene.attitudes.get(number)
        if other is not None:
            axes.append(D)
            goals.append(other)
    return np.array(axes).reshape(-1, 3), np.array(goals).reshape(-1, 3)


def _likelier(found: Movement, source: Part, scene: Scene) -> Similarity:
    """Return the movement, of those that fit alike, that puts the cameras above their points.

    Of those that leave something open the best.
    """
    if not found.alternatives:
        return found.similarity
    # Movements that fit alike of which another one may be taken where what the first leads to does not agree.
    both = [found.similarity, *found.alternatives][:6]
    known = source.points[np.isfinite(source.points).all(axis=1)]
    if source.poses and len(known) and not found.open:
        centres = np.array([centre for centre, _ in source.poses.values()]).mean(axis=0)
        seen = known.mean(axis=0)
        both.sort(key=lambda one: -float((one.rotation @ (centres - seen))[2]))
    return both[scene.choices.take(len(both))]


def _disagreement(system: Part, part: Part, frames: Sequence[Frame]) -> float:
    off = []
    for number, (centre, D) in part.poses.items():
        frame = frames[number]
        if frame.stands and system.fixed[frame.position]:
            off.append(system.points[frame.position] - place_of(frame, centre, D))
    return float(np.sqrt(np.mean(np.square(off)))) if off else 0.0


def tied_by_positions(system: Part, part: Part, frames: Sequence[Frame]) -> bool:
    """True where given positions of most of the frames of a part determine its place and its turns well."""
    standing = {frames[number].position for number in part.poses if frames[number].stands}
    blocks = np.array(sorted(standing), dtype=np.int64)
    given = blocks[system.fixed[blocks]]
    # Given positions from which a part that is still growing may be tied to them.
    if 2 * len(given) < len(blocks) or len(given) < 8:
        return False
    spread_positions(part, frames)
    given = given[part.known(given)]
    source, target = part.points[given], system.points[given]
    found = (congruence if part.scaled else similarity)(source, target)
    if found.outcome is not SimilarityOutcome.DETERMINED:
        return False
    spread = rotations.singular_values(target - target.mean(axis=0))
    # σ of the turn (radians) up to which given positions tie a part while it is still growing.
    return bool(found.sigma0 < 0.01 * np.hypot(spread[1], spread[2]))


def spread_positions(part: Part, frames: Sequence[Frame]) -> None:
    """Positions of posed frames as points of the part, X0 = O − h e_Z + Dᵀ r0*.

    Heights act along the vertical and in the length unit: only in a part that has both.
    """
    for number, (centre, rotation) in part.poses.items():
        frame = frames[number]
        missing = np.isnan(part.points[frame.position])
        if missing.any() and frame.stands and (frame.offset[0] == 0.0 or (part.levelled and part.scaled)):
            part.points[frame.position, missing] = place_of(frame, centre, rotation)[missing]


def place_of(frame: Frame, centre: FloatArray, rotation: FloatArray) -> FloatArray:
    """(3,) where the position of a frame is, of its projection centre and rotation D: X0 = O − h e_Z + Dᵀ r0*."""
    place: FloatArray = centre - np.array([0.0, 0.0, frame.offset[0]]) + rotation.T @ frame.offset[1:]
    return place


# ---- Start values of local systems and features from the points that were measured in them.


class _Measured(NamedTuple):
    """Measurements in one local system, from all tables."""

    origin: int
    rotation: int
    scale: int
    offset: int
    points: IntArray
    local: FloatArray
    """(n, 3) NaN where not observed."""


def fill_systems(network: Network, start: dict[str, FloatArray]) -> None:
    """Compute missing origin, attitude, scale and offset of local systems, (X̄, Ȳ, Z̄) = λ D (X − X0) + r̄.

    Of features whose points had no coordinates when the project was read, all are made again.
    """
    turned: set[int] = set()
    for one in _systems(network):
        about = network.blocks["rotation"].about_axes
        recomputed = (
            about is not None and bool(about[one.rotation]) and bool(np.isnan(network.start["point"][one.points]).any())
        )
        known = np.isfinite(start["point"][one.points]).all(axis=1)
        lacking = np.isnan(start["rotation"][one.rotation]).any() or np.isnan(start["point"][one.origin]).any()
        if (lacking or recomputed) and np.isfinite(one.local[known]).any():
            one = one._replace(points=one.points[known], local=one.local[known])
            _fill(network, start, one, recomputed, one.rotation in turned)
        turned.add(one.rotation)
    _fill_shapes(network, start, turned)


def _fill_shapes(network: Network, start: dict[str, FloatArray], turned: set[int]) -> None:
    """The local systems and sizes of shapes whose points had no coordinates when the project was read.

    ``turned`` are attitudes that are known already: those of features to which shapes are parallel.
    """
    placed: set[int] = set()
    for group in network.groups:
        if group.type.name not in SHAPE_TYPES:
            continue
        position, rotation, offset, shape, *turn = (int(block[0]) for block in (*group.blocks[:4], *group.blocks[5:]))
        points = group.blocks[4]
        if np.isnan(network.start["point"][points]).any():
            held = None
            shared = network.blocks["eccentricity"].owner[offset] != offset
            if rotation in turned:
                D, perpendicular = start["rotation"][rotation], bool(turn) and turn[0] not in turned
                if turn and not perpendicular:
                    D = start["rotation"][turn[0]] @ D
                origin = None
                if position in placed:
                    owner = start["eccentricity"][network.blocks["eccentricity"].owner[offset], np.arange(3)]
                    origin = start["point"][position] - np.where(shared, owner, 0.0) @ D
                held = Held(D, perpendicular, origin, shared)
            known = network.start["shape"][shape]
            fit = fit_shape(group.type.name, start["point"][points], known, held)
            if fit is None:
                continue
            if held is None:
                start["rotation"][rotation] = fit.rotation
            elif held.perpendicular:
                start["rotation"][turn[0]] = fit.rotation @ held.rotation.T
            if held is None or held.origin is None:
                start["point"][position] = fit.origin
            start["eccentricity"][offset] = np.where(shared, start["eccentricity"][offset], fit.offset)
            start["shape"][shape] = fit.shape
        turned.update((rotation, *turn))
        placed.add(position)


def _systems(network: Network) -> Iterator[_Measured]:
    groups = [group for group in network.groups if group.type.key == "local" and group.count]
    if not groups:
        return
    blocks = [np.concatenate([group.blocks[slot] for group in groups]).astype(np.int64) for slot in range(5)]
    local = np.concatenate([group.observed for group in groups])
    for rotation, own in np.unique(np.stack([blocks[1], blocks[3]]), axis=1).T:
        rows = np.flatnonzero((blocks[1] == rotation) & (blocks[3] == own))
        origin, _, scale, offset = (int(blocks[slot][rows[0]]) for slot in range(4))
        yield _Measured(origin, int(rotation), scale, offset, blocks[4][rows], local[rows])


def _fill(network: Network, start: dict[str, FloatArray], one: _Measured, recomputed: bool, turned: bool) -> None:
    points = start["point"][one.points]
    free = bool(network.blocks["scale"].free[one.scale, 0])
    scale = 1.0 if free else float(start["scale"][one.scale, 0])
    D = start["rotation"][one.rotation]
    if not turned and (recomputed or np.isnan(D).any()):
        found = movement(_ties(network, start, one, scale), FreeRotation.ANY, not free)
        if found is None:
            return
        scale = scale * found.scale
        if recomputed:
            start["rotation"][one.rotation] = found.rotation
        else:
            put_rotation(network, start["rotation"], one.rotation, found.rotation)
        D = start["rotation"][one.rotation]
        if free:
            start["scale"][one.scale, 0] = scale
    # Mean of what shift and offset have to make up for; a component that was not observed asks for nothing.
    seen = np.isfinite(one.local)
    away = np.where(seen, one.local - scale * points @ D.T, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    _put_origin(network, start, one, recomputed, scale * D, away, np.asarray(seen.any(axis=0)), points.mean(axis=0))


def _ties(network: Network, start: dict[str, FloatArray], one: _Measured, scale: float) -> Ties:
    """The points, where they are few the origin if the offset is not free, and the vertical, as far as known."""
    blocks = np.append(one.points, one.origin)
    local = np.vstack([one.local, start["eccentricity"][one.offset]])
    known = np.isfinite(start["point"][blocks]).all(axis=1)
    known[-1] &= len(one.points) < 3 and not network.blocks["eccentricity"].free[one.offset].any()
    up = frame_verticals(network)[[one.rotation]]
    told = np.isfinite(up).all(axis=1)
    vertical = np.array([[0.0, 0.0, 1.0]])[told]
    return Ties(scale * start["point"][blocks[known]], local[known], vertical, up[told])


def _put_origin(
    network: Network,
    start: dict[str, FloatArray],
    one: _Measured,
    recomputed: bool,
    turned: FloatArray,
    away: FloatArray,
    seen: BoolArray,
    centre: FloatArray,
) -> None:
    """Origin and offset with r̄ − λ D X0 = ``away`` in the components that were observed."""
    origin, offset = start["point"][one.origin], start["eccentricity"][one.offset]
    missing = np.isnan(origin) | recomputed
    origin[missing] = centre[missing]
    gap = away - (np.nan_to_num(offset) - turned @ origin)
    gap[~seen] = 0.0
    if missing.any() and not recomputed:
        origin[missing] -= rotations.lstsq(turned[np.ix_(seen, missing)], gap[seen], rcond=None)
        return
    loose = network.blocks["eccentricity"].free[one.offset]
    offset[loose] += gap[loose]


# ---- Between the network's blocks and a part: what is given goes in, what was found comes out.


def with_observed(network: Network) -> dict[str, FloatArray]:
    """Start values, those not given taken from observed parameters."""
    start = {kind: values.copy() for kind, values in network.start.items()}
    for group in network.groups:
        prefix, _, kind = group.type.key.partition("/")
        kind = "point" if prefix == "coordinates" else kind
        if prefix not in ("observed", "coordinates") or kind == "rotation":
            continue
        rows, components = np.nonzero(group.mask)
        blocks = group.blocks[0][rows]
        missing = np.isnan(start[kind][blocks, components])
        start[kind][blocks[missing], components[missing]] = group.observed[rows, components][missing]
    return start


def starting_part(network: Network, frames: Sequence[Frame]) -> Part:
    """The object system with everything that is given."""
    start = network.start
    part = empty_part(len(network.blocks["point"].ids))
    part.points[:] = start["point"]
    part.fixed = np.asarray(np.isfinite(start["point"]).all(axis=1))
    part.sigma = network.sigma["point"]
    part.levelled = part.oriented = part.scaled = part.given = True
    for number, frame in enumerate(frames):
        if frame.relative is not None:
            turn, base = start["rotation"][frame.relative[0]], start["base"][frame.relative[1]]
            leader = given_pose(network, frame)
            if leader is not None and np.isfinite(turn).all() and np.isfinite(base).all():
                part.poses[number] = leader[0] + leader[1].T @ base, turn @ leader[1]
        else:
            given = given_pose(network, frame)
            if given is not None:
                part.poses[number] = given
    return part


def fill_in(
    network: Network, part: Part, frames: Sequence[Frame], measured: Terrestrial
) -> tuple[dict[str, FloatArray], dict[str, Phrase], tuple[UndeterminedObject, ...]]:
    """Start values of all blocks, how they were obtained, and what is missing."""
    start = {kind: values.copy() for kind, values in network.start.items()}
    points = start["point"]
    unknown = np.isnan(points)
    points[unknown] = part.points[unknown]
    rotations = start.get("rotation", np.zeros((0, 3, 3)))
    for number, (centre, D) in part.poses.items():
        frame = frames[number]
        if frame.relative is None:
            put_rotation(network, rotations, frame.rotation, D)
            missing = np.isnan(points[frame.position])
            points[frame.position, missing] = place_of(frame, centre, D)[missing]
    for number, kappa in part.kappas.items():
        block = measured.sights[number].rotation
        if block >= 0:
            put_rotation(network, rotations, block, rotation_from_angles(np.array([[0.0, 0.0, kappa]]))[0])
    _fill_pairs(network, start, part, frames)
    fill_systems(network, start)
    how = _named(network, part)
    return start, how, missing_start_values(network, start)


def put_rotation(network: Network, rotations: FloatArray, block: int, D: FloatArray) -> None:
    """An attitude where there is none; angles that are fixed or observed stay as they are."""
    if np.isfinite(rotations[block]).all():
        return
    given = network.observed["rotation"][block]
    held = np.isfinite(given) & (
        ~network.blocks["rotation"].free[block] | np.isfinite(network.sigma["rotation"][block])
    )
    rotations[block] = D
    if held.any():
        rotations[block] = rotation_from_angles(np.where(held, given, angles_from_rotation(D[None])[0])[None])[0]


def _fill_pairs(network: Network, start: dict[str, FloatArray], part: Part, frames: Sequence[Frame]) -> None:
    """Relative orientations from the poses of both images; leaders from their followers."""
    leaders = {frame.rotation: n for n, frame in enumerate(frames) if frame.relative is None}
    for number, frame in enumerate(frames):
        if frame.relative is None or number not in part.poses:
            continue
        leader = part.poses.get(leaders.get(frame.rotation, -1)) or given_pose(network, frame)
        if leader is None:
            continue
        (O_a, D_a), (O_b, D_b) = leader, part.poses[number]
        turn, base = frame.relative
        put_rotation(network, start["rotation"], turn, D_b @ D_a.T)
        if np.isnan(start["base"][base]).any():
            start["base"][base] = D_a @ (O_b - O_a)


def _named(network: Network, part: Part) -> dict[str, Phrase]:
    ids = network.blocks["point"].ids
    named = {}
    for name, how in part.how.items():
        kind, _, rest = name.partition(" ")
        named[f"point {ids[int(rest)]}" if kind == "point" and rest.isdigit() else name] = how
    return named


def missing_start_values(network: Network, start: Mapping[str, FloatArray]) -> tuple[UndeterminedObject, ...]:
    """Name each thing without a value once, with the likely reason."""
    found: dict[tuple[str, str], UndeterminedObject] = {}
    contradicted = _contradicted(network, start)
    # Why things stay without start values.
    reasons = {
        "point": "seen from too few known stations: it needs two rays, or a direction and a distance",
        "image": "it shares too few points with others that have coordinates",
        "station": "too few points with coordinates are sighted from it",
        "system": "too few points with known coordinates have coordinates in it",
        "feature": "too few of its points are known, or they lie on no such shape",
        "pair": "one of its two images could not be oriented",
    }
    for kind, values in start.items():
        lost = np.asarray(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))
        if not lost.any():
            continue
        rows = _rows_of(network, kind)
        levelled = _rows_of(network, kind, HEIGHT_DIFFERENCE)
        tied = _tied_in_height(network, ~lost) if kind == "point" else lost
        for number in np.flatnonzero(lost).tolist():
            thing = thing_of(kind, network.blocks[kind].ids[number])
            reason = reasons.get(thing[0], "no start value is given")
            if levelled[number] == rows[number]:
                reason = "no height difference ties it to a point with a height"
                if tied[number]:
                    reason = "height differences tell its height, and nothing its position in plan"
            reason = CONTRADICTED if thing in contradicted else reason
            reason = reason if rows[number] else "no observation refers to it"
            found.setdefault(thing, UndeterminedObject(*thing, reason, "", int(rows[number])))
    return tuple(found.values())


def _tied_in_height(network: Network, known: BoolArray) -> BoolArray:
    """Points (n,) that a height difference ties to a known one."""
    tied = np.zeros_like(known)
    for group in network.groups:
        if group.type is HEIGHT_DIFFERENCE:
            ends = [n for slot, n in zip(group.type.slots, group.blocks, strict=True) if slot.kind == "point"]
            for one, other in (ends[:2], ends[1::-1]):
                tied[one] |= known[other]
    return tied


def _contradicted(network: Network, start: Mapping[str, FloatArray]) -> set[tuple[str, str]]:
    """Images and sets without attitude that see points enough whose place is known, in plan at least."""
    if "rotation" not in start or "point" not in start:
        return set()
    known = np.asarray(np.isfinite(start["point"][:, :2]).all(axis=1))
    lost = np.asarray(~np.isfinite(start["rotation"]).all(axis=(1, 2)))
    seen = [np.zeros((0, 2), dtype=np.int64)]
    for group in network.groups:
        rotations = [
            numbers for slot, numbers in zip(group.type.slots, group.blocks, strict=True) if slot.kind == "rotation"
        ]
        positions = [slot.kind == "point" for slot in group.type.slots]
        if len(rotations) == 1 and sum(positions) > 1:
            target = group.blocks[target_slot(group.type)]
            chosen = lost[rotations[0]] & known[target]
            seen.append(np.stack([rotations[0][chosen], target[chosen]], axis=1))
    pairs = np.unique(np.concatenate(seen), axis=0)
    things: set[tuple[str, str]] = set()
    for number, count in zip(*np.unique(pairs[:, 0], return_counts=True), strict=True):
        thing = thing_of("rotation", network.blocks["rotation"].ids[number])
        # An image needs four points of known place for its attitude, a set two.
        if (thing[0] == "image" and count >= 4) or (thing[0] == "station" and count >= 2):
            things.add(thing)
    return things


def _rows_of(network: Network, kind: str, only: ObservationType | None = None) -> IntArray:
    """(n,) rows of observations, perhaps of one type, that refer to each block of a kind."""
    rows = np.zeros(len(network.blocks[kind].ids), dtype=np.int64)
    for group in network.groups:
        if only is not None and group.type is not only:
            continue
        for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind == kind:
                rows += np.bincount(numbers, minlength=len(rows))
    return rows


# ---- Start values that the observations contradict: frames whose rays pass by what they see, points that rays pass by.

MOST = 0.5
"""Part of the rays of a frame that must agree with what they see."""
AGREES = 3.0 * SLACKS[-1]
"""Radians within which a ray agrees with a start value."""


class Contradiction(NamedTuple):
    """A frame or a point whose given values do not agree with the rays."""

    number: int
    """Of the frame, or the block of the point."""
    name: str
    off: float
    """Median difference of unit vectors, of the rays and where they should go: 2 sin(α/2)."""
    is_point: bool = False

    def __str__(self) -> str:
        angle = 2.0 * float(np.arcsin(min(0.5 * self.off, 1.0)))
        # Radians beyond which it is no small angle, and said in gon.
        if angle > 0.1:
            return f"{self.name}: the observations contradict it by {angle / ANGLE_UNITS['gon']:.0f} gon"
        return f"{self.name}: the observations contradict it by {1e3 * angle:.3g} mrad"


def contradicting_frames(network: Network, system: Part, scene: Scene) -> list[Contradiction]:
    """Frames whose start values do not agree with the rest.

    Of a pose most rays pass by the points they see, as far as these are known; an attitude alone is another one than
    that which was found.
    """
    given, found = starting_part(network, scene.frames).poses, []
    for number, frame in enumerate(scene.frames):
        if not _only_started(network, frame) or number not in system.poses:
            continue
        if number in given:
            off = misses(system, frame, *given[number])[1]
            doubtful = len(off) >= 3 and np.mean(off < AGREES) < MOST
        else:
            turn = network.start["rotation"][frame.rotation] @ system.poses[number][1].T
            off = np.array([float(np.linalg.norm(turn - np.eye(3))) / np.sqrt(2.0)])
            doubtful = off[0] > AGREES
        if doubtful:
            found.append(Contradiction(number, frame.name, float(np.median(off))))
    return found


def contradicting_points(network: Network, system: Part, scene: Scene) -> list[Contradiction]:
    """Points given as start values and no more that most rays from posed frames pass by."""
    point, off = _rays_past_points(network, system, scene)
    rays = np.bincount(point, minlength=scene.points)
    agreeing = np.bincount(point[off < AGREES], minlength=scene.points)
    doubtful = np.flatnonzero((rays >= 2) & (agreeing < MOST * rays))
    ids = network.blocks["point"].ids
    return [Contradiction(p, f"point {ids[p]}", float(np.median(off[point == p])), True) for p in doubtful.tolist()]


def _rays_past_points(network: Network, system: Part, scene: Scene) -> tuple[IntArray, FloatArray]:
    """Return the point of each ray from a posed frame, and the angle (radians) by which the ray misses it."""
    seen, given = scene.seen, network.start["point"]
    loose = network.blocks["point"].free & np.isnan(network.sigma["point"])
    tested = np.asarray(loose.all(axis=1) & np.isfinite(given).all(axis=1))
    rays = np.flatnonzero(tested[seen.point])
    if len(rays) == 0 or not system.poses:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    posed = posed_frames(system.poses, seen.frames)
    rays = rays[np.isfinite(posed.centres[seen.frame[rays], 0])]
    frame, point = seen.frame[rays], seen.point[rays]
    away = given[point] + np.outer(seen.height[rays], [0.0, 0.0, 1.0]) - posed.centres[frame]
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
    there = np.einsum("nij,nj->ni", posed.turns[frame], away)
    return point, np.asarray(np.linalg.norm(there - seen.rays[rays], axis=1))


def _only_started(network: Network, frame: Frame) -> bool:
    """True where the attitude of a frame is given, as a start value and no more."""
    given = np.isfinite(network.start["rotation"][frame.rotation]).all()
    return frame.relative is None and bool(given and _loose(network, "rotation", frame.rotation)[2])


def _loose(network: Network, kind: str, block: int) -> BoolArray:
    return np.asarray(network.blocks[kind].free[block] & np.isnan(network.sigma[kind][block]))


def put_back(network: Network, scene: Scene, start: dict[str, FloatArray], found: list[Contradiction]) -> None:
    """Give some frames the poses, and some points the coordinates, of the project again."""
    for one in found:
        if one.is_point:
            start["point"][one.number] = network.start["point"][one.number]
            continue
        frame = scene.frames[one.number]
        start["rotation"][frame.rotation] = network.start["rotation"][frame.rotation]
        given = network.start["point"][frame.position]
        start["point"][frame.position] = np.where(np.isnan(given), start["point"][frame.position], given)


def without(network: Network, scene: Scene, found: list[Contradiction]) -> dict[str, FloatArray]:
    """Start values without those of some poses and points; what is fixed or observed stays."""
    start = {kind: values.copy() for kind, values in network.start.items()}
    for one in found:
        if one.is_point:
            start["point"][one.number] = np.nan
            continue
        frame = scene.frames[one.number]
        if np.isnan(network.sigma["rotation"][frame.rotation]).all():
            start["rotation"][frame.rotation] = np.nan
        start["point"][frame.position, _loose(network, "point", frame.position)] = np.nan
    return start
