"""Join two parts where what ties them determines the movement between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from mor.approximate.parts.frames import Frame
from mor.approximate.parts.history import Join, Tie
from mor.approximate.parts.level_and_scale import forget_marks, make_upright
from mor.approximate.parts.movement import PRECISION, Movement, Ties, Turn, movement
from mor.approximate.parts.part import Part
from mor.approximate.parts.platform import tie_by_platform
from mor.approximate.parts.scene import Scene
from mor.approximate.similarity import Similarity, SimilarityOutcome, congruence, similarity
from mor.arrays import FloatArray
from mor.geometry import tolerant

FEWEST_POSITIONS = 8
"""Given positions from which a part that is still growing may be tied to them."""
TURN = 0.01
"""σ of the turn (radians) up to which given positions tie a part while it is still growing."""
FITS = 0.03
"""Misfit, in parts of the size of what is common, beyond which two parts do not belong together."""
ALIKE = 3.0
"""Factor of the misfits from which on a shape is told from its mirrored one."""
ALL_OPEN = 7
"""Movements between two parts that nothing ties."""
MOST_TRIED = 6
"""Movements that fit alike of which another one may be taken where what the first leads to does not agree."""
MANY = 400
"""Common points of which the movement is worked out, at the most."""


def join(target: Part, source: Part, scene: Scene, ambiguous: bool = False) -> bool:
    """Carry ``source`` into the system of ``target``, which takes over what it knows; true where that was possible.

    A movement that is not unique is taken only where ``ambiguous`` allows it: the one with the cameras above.
    """
    spread_positions(source, scene.frames)
    spread_positions(target, scene.frames)
    found = _tie_of_either_hand(target, source, scene)
    if found is None or found.open:
        found = tie_by_platform(target, source, scene) or found
    if found is None or found.open or (found.redundancy > 0 and found.misfit > FITS):
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
    fit, mirrored = (
        np.inf if one is None or one.open else max(one.misfit, PRECISION) for one in (found, other)
    )
    if mirrored * ALIKE < fit:
        return other
    _mirror(loose)
    if fit * ALIKE < mirrored or fit == mirrored == np.inf or not (target.handed or source.handed):
        return found
    return found._replace(alternatives=(*found.alternatives, found.similarity))


def open_movements(target: Part, source: Part, scene: Scene) -> int:
    """How many movements nothing determines between two parts."""
    found = tie(target, source, scene)
    return ALL_OPEN if found is None else found.open


def free_movements(target: Part, source: Part) -> int:
    """How many movements two parts make against each other where nothing ties them."""
    turns = (
        3 if not (target.levelled and source.levelled) else 0 if target.oriented and source.oriented else 1
    )
    return 3 + turns + (not (target.scaled and source.scaled))


def lay_upon(part: Part, places: FloatArray, turn: Turn, scaled: bool) -> None:
    """Carry a part as near as possible to where some points (points, 3) are said to be.

    Args:
        part: keeps its shape.
        places: given coordinates, NaN for points without.
        turn: the turns that the observations leave free.
        scaled: true if the observations determine the size.
    """
    rows = np.flatnonzero(np.isfinite(places).all(axis=1) & np.isfinite(part.points).all(axis=1))
    none = np.zeros((0, 3))
    found = (
        movement(Ties(part.points[rows], places[rows], none, none), turn, scaled) if len(rows) > 2 else None
    )
    if found is not None:
        part.transform(found.similarity)


def _mirror(part: Part) -> None:
    part.points[:, 0] *= -1.0


def carry(target: Part, source: Part, scene: Scene, found: Movement | None) -> None:
    """Carry a part over; what only it knew of vertical, direction and scale the target learns from it.

    Where nothing was ``found`` that ties the two it stays where it is.
    """
    _remember(target, source, found)
    bare = not target.lifts, not source.lifts
    target.handed |= source.handed
    moved = _as_it_is() if found is None else _likelier(found, source, scene)
    if target.scaled and not source.scaled:
        forget_marks(source, scene)
    if source.scaled and not target.scaled:
        forget_marks(target, scene)
        target.transform(_inverse_scale(moved.scale))
        moved = _times(moved, 1.0 / moved.scale)
        target.scaled = True
    source.transform(moved)
    taken = np.isnan(target.points).any(axis=1) & np.isfinite(source.points).any(axis=1)
    take_over(target, source)
    if source.levelled and not target.levelled:
        make_upright(target, moved.rotation[:, 2])
    if target.lifts and any(bare):
        target.lower_to_marks(scene.target_heights, np.where(taken, bare[1], bare[0]))
    target.place_sigma = max(target.place_sigma, _disagreement(target, source, scene.frames))
    spread_positions(target, scene.frames)


def _as_it_is() -> Similarity:
    return Similarity(SimilarityOutcome.DETERMINED, 1.0, np.eye(3), np.zeros(3), np.zeros((0, 3)), 0.0)


def _remember(target: Part, source: Part, found: Movement | None) -> None:
    """Keep in ``target`` what ``source`` is, and what ties the two, before it is carried over."""
    tied = None if found is None else Tie(found.open, found.redundancy, found.misfit, len(found.alternatives))
    known = np.flatnonzero(np.isfinite(source.points).any(axis=1))
    poses, kappas = tuple(sorted(source.poses)), tuple(sorted(source.kappas))
    knows = source.levelled, source.oriented, source.scaled
    one = Join(source.number, source.began, target.number, known, poses, kappas, *knows, tied)
    target.joined += [*source.joined, one]


def tie(target: Part, source: Part, scene: Scene) -> Movement | None:
    """The movement from source to target by their common points, centres and attitudes."""
    both = source.levelled and target.levelled
    turn = (Turn.NONE if source.oriented and target.oriented else Turn.VERTICAL) if both else Turn.ANY
    points, goals = _common_points(target, source, scene, both)
    centres, places = _common_centres(target, source, scene)
    axes, goal_axes = _common_attitudes(target, source, scene)
    ties = Ties(
        np.concatenate([points, centres]),
        np.concatenate([goals, places]),
        *((axes[:0], goal_axes[:0]) if turn is Turn.NONE else (axes, goal_axes)),
    )
    found = movement(ties, turn, source.scaled and target.scaled)
    if found is None or not (both and found.open == 1 and not np.isfinite(ties.target[:, 2]).any()):
        return found
    # Two levelled parts that have no height in common: the plan joins them, and the heights stay unknown. Where the
    # target has none at all, those of the source are as good as any.
    if np.isfinite(target.points[:, 2]).any() or target.poses:
        source.points[:, 2] = np.nan
        source.poses.clear()
    return Movement(
        found.scale, found.rotation, found.shift, 0, found.misfit, found.redundancy, found.alternatives
    )


def _common_points(target: Part, source: Part, scene: Scene, both: bool) -> tuple[FloatArray, FloatArray]:
    """Points known in both; where one part has targets in place of marks, those of the other are raised to them."""
    ours, theirs = np.isfinite(source.points), np.isfinite(target.points)
    known = ours & theirs if both else theirs & np.asarray(ours.all(axis=1))[:, None]
    rows = np.flatnonzero(known.any(axis=1))
    full = rows[known[rows].all(axis=1)]
    if len(full) > MANY:
        rows = full[np.linspace(0, len(full) - 1, MANY).astype(int)]
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
    """Of movements that fit alike the one that leaves the cameras above what they see, where no other is wanted.

    Of those that leave something open the best.
    """
    if not found.alternatives:
        return found.similarity
    both = [found.similarity, *found.alternatives][:MOST_TRIED]
    known = source.points[np.isfinite(source.points).all(axis=1)]
    if source.poses and len(known) and not found.open:
        centres = np.array([centre for centre, _ in source.poses.values()]).mean(axis=0)
        seen = known.mean(axis=0)
        both.sort(key=lambda one: -float((one.rotation @ (centres - seen))[2]))
    return both[scene.choices.take(len(both))]


def _inverse_scale(scale: float) -> Similarity:
    return Similarity(
        SimilarityOutcome.DETERMINED, 1.0 / scale, np.eye(3), np.zeros(3), np.zeros((0, 3)), 0.0
    )


def _times(moved: Similarity, factor: float) -> Similarity:
    return Similarity(
        moved.outcome,
        moved.scale * factor,
        moved.rotation,
        moved.translation * factor,
        moved.residuals,
        moved.sigma0,
    )


def _disagreement(system: Part, part: Part, frames: Sequence[Frame]) -> float:
    """Root mean square difference of a coordinate between given positions of frames and those of the joined part."""
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
    if 2 * len(given) < len(blocks) or len(given) < FEWEST_POSITIONS:
        return False
    spread_positions(part, frames)
    given = given[part.known(given)]
    source, target = part.points[given], system.points[given]
    found = (congruence if part.scaled else similarity)(source, target)
    if found.outcome is not SimilarityOutcome.DETERMINED:
        return False
    spread = tolerant.singular_values(target - target.mean(axis=0))
    return bool(found.sigma0 < TURN * np.hypot(spread[1], spread[2]))


def take_over(system: Part, part: Part) -> None:
    """Add to a part what another one in the same system knows besides."""
    fresh = np.isnan(system.points) & np.isfinite(part.points)
    system.points[fresh] = part.points[fresh]
    for number, pose in part.poses.items():
        system.poses.setdefault(number, pose)
    for number, kappa in part.kappas.items():
        system.kappas.setdefault(number, kappa)
    for name, how in part.how.items():
        system.how.setdefault(name, how)
    system.slack = max(system.slack, part.slack)


def spread_positions(part: Part, frames: Sequence[Frame]) -> None:
    """Positions of posed frames as points of the part, X0 = O − h e_Z + Dᵀ r0*.

    Heights act along the vertical and in the length unit: only in a part that has both.
    """
    for number, (centre, rotation) in part.poses.items():
        frame = frames[number]
        missing = np.isnan(part.points[frame.position])
        if missing.any() and frame.stands and (frame.offset[0] == 0.0 or (part.levelled and part.scaled)):
            part.points[frame.position, missing] = place_of(frame, centre, rotation)[missing]


def stand_on_marks(part: Part, scene: Scene) -> None:
    """Several frames over one mark stand exactly over it: short bases between them are as they were measured."""
    over = Counter(scene.frames[n].position for n in part.poses if scene.frames[n].stands)
    for number, (_, D) in list(part.poses.items()):
        frame = scene.frames[number]
        mark = part.points[frame.position]
        if frame.stands and over[frame.position] > 1 and np.isfinite(mark).all():
            lift = np.array([0.0, 0.0, frame.offset[0]])
            part.poses[number] = (mark + lift - D.T @ frame.offset[1:], D)


def place_of(frame: Frame, centre: FloatArray, rotation: FloatArray) -> FloatArray:
    """(3,) where the position of a frame is, of its projection centre and rotation D: X0 = O − h e_Z + Dᵀ r0*."""
    place: FloatArray = centre - np.array([0.0, 0.0, frame.offset[0]]) + rotation.T @ frame.offset[1:]
    return place
