"""Explain singular normal equations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mor.errors import Placeholder
from mor.model import rotations
from mor.model.images import MOTION_SLOTS
from mor.model.parameters import IMAGE_VELOCITY, KINDS, MOTIONS, READOUT, ROTATION_RATE, moves_by_angles
from mor.model.rotations import angles_from_rotation
from mor.project.entities import thing_of
from mor.project.planned_network import image_poses
from mor.project.trajectories import TRAJECTORY
from mor.quality.determinability import NetworkPart, connected_parts, fits
from mor.quality.solution import Solved, weak_directions
from mor.solve.datum import NOTHING_KNOWN, Undetermined, similarities, weak_turns
from mor.solve.iterate import A_WEAK_TURN, Adjustment, Outcome
from mor.types import BoolArray, IntArray
from mor.units import ANGLE_UNITS, LENGTH_UNITS

# ---- How sentences are said: an English text with places, and what stands there. A report says it in its language.


class Translate(Protocol):
    """Says an English sentence with its values, in the language of the reader."""

    def __call__(self, english: str, /, **values: object) -> str:
        """The sentence."""
        ...


def english(text: str, /, **values: object) -> str:
    """The sentence as it stands."""
    return text.format(**{name: Placeholder(value) for name, value in values.items()})


def enumerated(names: Sequence[str], most: int, say: Translate) -> str:
    """The first names, and how many there are more."""
    listed = ", ".join(names[:most])
    return say("{names} and {count} more", names=listed, count=len(names) - most) if names[most:] else listed


# ---- One free movement of a network that is a rotation about some line: which line, and which points lie on it.


def tilt(adjustment: Adjustment, say: Translate = english) -> str | None:
    """Words for the only free movement of a network, where it is a rotation about a line; ``None`` otherwise.

    A movement t + ω × x with t ⊥ ω (and no change of scale) leaves the points of a line in direction ω at rest.
    """
    null = adjustment.defect.datum
    columns = adjustment.problem.index.columns["point"]
    free = columns >= 0
    if null.shape[1] != 1 or not free.any():
        return None
    points = adjustment.values["point"]
    centre = points[free.any(axis=1)].mean(axis=0)
    generators = similarities(points, centre)
    movement = rotations.lstsq(generators[free], null[columns[free], 0], rcond=1e-12)
    t, turn, scale = movement[:3], movement[3:6], movement[6]
    size = float(np.linalg.norm(turn))
    extent = float(np.ptp(points, axis=0).max())
    small = 1e-5
    if size == 0.0 or abs(scale) > small * size or abs(t @ turn) > small * size**2 * extent:
        return None
    direction, through = turn / size, centre + np.cross(turn, t) / size**2
    away = points - through
    distance = np.linalg.norm(away - np.outer(away @ direction, direction), axis=1)
    fixed = ~free.any(axis=1) & (distance < small * extent)
    ids = adjustment.problem.index.blocks["point"].ids
    names = [ids[i] for i in np.flatnonzero(fixed)]
    if names:
        return say("The network can tilt about the line through {names}.", names=enumerated(names, 4, say))
    x, y, z = (say("{amount}", amount=f"{x:.3f}") for x in direction)
    return say("The network can tilt about a line in the direction ({x}, {y}, {z}), X, Y, Z.", x=x, y=y, z=z)


# ---- Why an image, a station or a system is loose: it has no, one or two points, or a line; or φ is ±100 gon.


def why_loose(solved: Solved, space: str, name: str, say: Translate = english) -> list[str]:
    """Lines for a frame (``image``, ``station``) that its points, or its angles, cannot hold; none where they could."""
    things = solved.network.things[space]
    if name not in things.numbers:
        return []
    rotation = things.part(name, "rotation")
    return [*_too_few(solved, space, name, rotation, say), *_locked(solved, space, name, rotation, say)]


def _locked(solved: Solved, space: str, name: str, rotation: int, say: Translate) -> list[str]:
    """Angles of which some are fixed, or tied to those of others, where two of them are the same turn."""
    index = solved.adjustment.problem.index
    _, phi, _ = angles_from_rotation(solved.adjustment.values["rotation"][rotation])
    # From here on ω and κ are a thousand times less certain than the attitude: they are nearly the same turn.
    if np.cos(phi) > 1e-3 or not moves_by_angles(index.blocks["rotation"])[rotation]:
        return []
    return [
        say(
            "phi of {names} is ±100 gon: omega and kappa are the same turn there, so that no angle can be fixed, or "
            "differ exactly from another one, by itself; turn the object system, or say the relative rotation of "
            "images by a pair.",
            names=f"{say(space)} {name}",
        )
    ]


def _too_few(solved: Solved, space: str, name: str, rotation: int, say: Translate) -> list[str]:
    """Points that cannot hold a frame."""
    points = _points_seen(solved, rotation)
    names = [solved.network.blocks["point"].ids[p] for p in points]
    frame = f"{say(space)} {name}"
    if len(points) == 0:
        return [say("{names} sees no point.", names=frame)]
    if len(points) == 1:
        return [
            say(
                "{names} sees one point only, {point}: it can turn about it and move around it.",
                names=frame,
                point=names[0],
            )
        ]
    listed = enumerated(names, 4, say)
    if len(points) == 2:
        return [
            say(
                "{names} sees two points only, {place}: it can rotate about the line of its two points "
                "(measure a third point that is not on this line).",
                names=frame,
                place=listed,
            )
        ]
    spread = rotations.singular_values(
        solved.adjustment.values["point"][points] - solved.adjustment.values["point"][points].mean(axis=0)
    )
    if spread[1] <= 1e-6 * spread[0]:
        return [
            say(
                "the points of {names} ({place}) lie on one line: it can rotate about this line "
                "(measure a point beside it).",
                names=frame,
                place=listed,
            )
        ]
    return []


def held_by_an_angle(solved: Solved, say: Translate = english) -> list[str]:
    """A line for every system some of whose angles are fixed: these oppose a turn that its points may not know."""
    systems = solved.network.things["system"]
    columns = solved.adjustment.problem.index.columns
    length = solved.network.project.units.length
    lines = []
    for name in systems.ids:
        rotation = systems.part(name, "rotation")
        fixed = columns["rotation"][rotation] < 0
        points = _points_seen(solved, rotation)
        if fixed.all() or not fixed.any() or len(points) < 2:
            continue
        places = solved.adjustment.values["point"][points]
        beside = places - places.mean(axis=0)
        along = rotations.svd(beside)[2][0]
        across = float(np.linalg.norm(beside - np.outer(beside @ along, along), axis=1).max()) / LENGTH_UNITS[length]
        lines.append(
            say(
                "Only the fixed {components} of system {id} prevents it; the points of this system lie "
                "within {across} {unit} of one line. If they are meant to lie on it, use "
                "features: type: line, which needs no "
                "angle.",
                components=", ".join(np.array(KINDS["rotation"].names)[fixed]),
                id=name,
                across=f"{across:.2g}",
                unit=length,
            )
        )
    return lines


def _points_seen(solved: Solved, rotation: int) -> IntArray:
    found = [np.zeros(0, dtype=np.int64)]
    for group in solved.adjustment.problem.groups:
        slots = list(group.blocks_by_slot)
        here = [blocks for slot, blocks in slots if slot.kind == "rotation" and slot.part == "rotation"]
        targets = [blocks for slot, blocks in slots if slot.kind == "point" and slot.of in ("point", "to")]
        if here and targets:
            found.append(targets[-1][here[0] == rotation])
    return np.unique(np.concatenate(found))


# ---- Readout times that nothing tells: of images that do not move, and of motions that nobody knows.


def readout_sentences(solved: Solved, say: Translate = english) -> list[str]:
    """One line for every camera whose free readout time no image can tell; both reasons follow from the model."""
    cameras, images = solved.network.things["camera"], solved.network.things["image"]
    lines = []
    for number, name in enumerate(cameras.ids):
        block = int(cameras.parts[READOUT.key][number])
        if block < 0 or not _untold(solved, READOUT.key, np.array([block])).all():
            continue
        mine = np.asarray(images.parts[READOUT.key] == block)
        flown = mine & (images.parts[TRAJECTORY] >= 0)
        if flown.any() and (
            any(
                own.pose.velocity[flown[own.images]].any() or own.pose.rate[flown[own.images]].any()
                for own in image_poses(solved.network, solved.adjustment.start)
            )
        ):
            continue
        motions = {
            kind: np.unique(images.parts[kind][mine & ~flown]) for kind in (IMAGE_VELOCITY.key, ROTATION_RATE.key)
        }
        if flown.any() and (flown == mine).all():
            lines.append(
                say(
                    "Camera {id}: the trajectories of its images stand still at their times, so its readout time has "
                    "no effect. Fix the readout time.",
                    id=name,
                )
            )
        elif all(not solved.adjustment.start[kind][own].any() for kind, own in motions.items()):
            lines.append(
                say(
                    "Camera {id}: none of its images moves, so its readout time has no effect. Give the images their "
                    "velocity or rate of rotation, or fix the readout time.",
                    id=name,
                )
            )
        elif all(
            bool((_untold(solved, kind, own) | (solved.adjustment.start[kind][own] == 0.0)).all())
            for kind, own in motions.items()
        ):
            lines.append(
                say(
                    "Camera {id}: its readout time and the motions of its images act by their product alone. Fix or "
                    "observe the readout time, or a velocity or rate of rotation.",
                    id=name,
                )
            )
    return lines


def _untold(solved: Solved, kind: str, own: IntArray) -> BoolArray:
    """(n, k) unknowns of blocks (n,) that no observation names but image coordinates."""
    untold = solved.network.blocks[kind].free.copy()
    for group in solved.adjustment.problem.groups:
        if group.type.key in (f"observed/{kind}", f"difference/{kind}"):
            for numbers in group.blocks:
                untold[numbers] &= ~group.mask
    chosen: BoolArray = untold[own]
    return chosen


# ---- Singularities in words: which unknowns, which movement, what observation would cure it.

_CURES = {
    "point": "observe it from a second place, or fix or observe its coordinates",
    "rotation": "observe more points in it, or fix or observe its angles",
    "interior": "fix or observe the component, or measure rolled images and points in depth",
    "distance meter": "fix the component, or measure distances of different length between known points",
    "refraction": "fix the coefficient, or measure vertical angles over different distances",
    "gnss frame": "fix the component, or hold as many points as the frame has free components; vectors have no shift",
    "height": "fix or measure the height",
    "scale": "fix the scale, or give the system points of known distance",
    "eccentricity": "fix the component, or turn the frame about its rotation centre",
    "base": "fix the base, or measure a distance",
    "velocity": "observe the point in a second epoch, hold points that do not move, or fix or observe the velocity",
    "sine": "observe the point at other times of the year, or fix or observe the oscillation",
    "cosine": "observe the point at other times of the year, or fix or observe the oscillation",
    "readout": "fix or observe the readout time, or the motion of an image: points determine only their product",
    "image velocity": "fix or observe the velocity, or the readout time if that is unknown too",
    "position shift": "fix or observe the component, or points that the images see: a strip is shifted as a whole",
    "attitude shift": "fix or observe the component or the boresight: both turn the attitudes of a strip alike",
    "time offset": "fix or observe the time offset: it shows only where the motion changes",
    "rotation rate": "fix or observe the rate of rotation, or the readout time if that is unknown too",
    "knot": "observe the trajectory near it (trajectory_position, trajectory_attitude), give the trajectory a "
    "constancy or smoothness, or lay its knots further apart",
}


def explain_singularity(solved: Solved, say: Translate = english) -> list[str]:
    """One line or more for everything that the observations and the datum leave open."""
    adjustment = solved.adjustment
    if adjustment.defect.undetermined:
        parts = connected_parts(solved.network, adjustment.problem.groups)
        tied = [part for part in parts if part.size > 1]
        return [
            *readout_sentences(solved, say),
            *(
                say("No observation refers to {names}; observe it, or leave it out.", names=_things(part, say))
                for part in parts
                if part.size == 1
            ),
            *(
                [
                    say("The network falls into {count} parts that no observation connects:", count=len(tied)),
                    *(
                        say("  part {number}: {names}", number=number, names=_things(part, say))
                        for number, part in enumerate(tied, start=1)
                    ),
                    say(
                        "Remedy: observe points of one part from the other, or points that both have in common, or "
                        "adjust the parts separately."
                    ),
                ]
                if len(tied) > 1
                else []
            ),
            *_loose(solved, parts, len(tied) > 1, say),
        ]
    if adjustment.reason == A_WEAK_TURN:
        return turned_about(solved, say)
    if not adjustment.problem.datum.free:
        return _open_datum(solved, say)
    return [_unsettled(solved, say), say("Add points, or more of their components, to the datum.")]


def _unsettled(solved: Solved, say: Translate) -> str:
    """Say that the datum coordinates do not determine all movements, and whether they are too few for that."""
    problem, movements = solved.adjustment.problem, _movements(solved, say)
    free = problem.index.columns["point"] >= 0
    count = int(np.count_nonzero(problem.datum.mask["point"] & free))
    needed = len(solved.adjustment.defect.movements)
    if count < needed:
        return say(
            "The datum has {count:free coordinate|free coordinates}, and the network has "
            "{needed:free movement|free movements}: {movements}.",
            count=count,
            needed=needed,
            movements=movements,
        )
    return say("The chosen datum coordinates do not define all of these movements: {movements}.", movements=movements)


def _movements(solved: Solved, say: Translate) -> str:
    return ", ".join(say(name) for name in solved.adjustment.defect.movements)


def turned_about(solved: Solved, say: Translate = english) -> list[str]:
    """Turns of the whole network that are hardly determined, where there is no solution."""
    adjustment = solved.adjustment
    # A turn of a smaller σ is weak by the weights of the others only: it keeps no iteration from its end.
    turns = [
        turn
        for turn in weak_turns(adjustment.inverse.weak, adjustment.problem, adjustment.values)
        if turn.sigma > 0.01 * NOTHING_KNOWN
    ]
    angle = "deg" if solved.network.project.units.angle == "dms" else solved.network.project.units.angle
    unit = ANGLE_UNITS[angle]
    lines = []
    for turn in turns:
        along = int(np.argmax(np.abs(turn.axis)))
        line = "(" + ", ".join(f"{x:.3f}" for x in turn.axis) + ")"
        lines.append(
            say(
                "The rotation of the whole network about {axis} is poorly determined: its standard deviation "
                "is {sigma} {angle} (that of an unobserved angle is {nothing} {angle}).",
                axis="XYZ"[along] if abs(turn.axis[along]) > 0.999 else line,
                sigma=f"{turn.sigma / unit:.3g}",
                nothing=f"{NOTHING_KNOWN / unit:.3g}",
                angle=angle,
            )
        )
    lines += held_by_an_angle(solved, say) if lines else []
    if not _tilts_as_angles(solved):
        advice = say("Observe a bearing or a direction beside this axis, or fix a second point.")
        return [*lines, advice] if lines else []
    advice = say(
        "Tilts observed as angles omega, phi determine it only because they are small. Observe them as level, so that "
        "the rotation is free and the datum defines it; or observe a bearing, or fix a second point."
    )
    return [*lines, advice] if lines else []


def _tilts_as_angles(solved: Solved) -> bool:
    return any(
        group.type.key == "observed/rotation" and bool(group.mask[:, :2].any())
        for group in solved.adjustment.problem.groups
    )


def _open_datum(solved: Solved, say: Translate) -> list[str]:
    count = solved.adjustment.defect.datum.shape[1]
    movements = _movements(solved, say)
    lines = [
        say(
            "The observations leave {count:movement|movements} of the whole network open: {movements}.",
            count=count,
            movements=movements,
        )
    ]
    if any("combination" in name for name in solved.adjustment.defect.movements):
        index = solved.adjustment.problem.index
        moved = np.flatnonzero(np.abs(solved.adjustment.defect.datum).max(axis=1) > 1e-6)
        blocks = dict.fromkeys(index.label(int(column))[:2] for column in moved)
        lines.append(
            say(
                "The movement concerns {names}.",
                names=enumerated([_name(*block, say) for block in blocks], 6, say),
            )
        )
    about = tilt(solved.adjustment, say)
    lines += [about] if about else []
    return [
        *lines,
        say("Fix or observe coordinates (control points, a scale bar), or write datum: free for a free network."),
    ]


def _things(part: NetworkPart, say: Translate) -> str:
    return "; ".join(
        f"{say(space if len(names) == 1 else space + 's')} {enumerated(names, 6, say)}"
        for space, names in part.names.items()
    )


def _loose(solved: Solved, parts: tuple[NetworkPart, ...], separated: bool, say: Translate) -> list[str]:
    """Directions inside the network, those of one block together; none that its falling apart explains already."""
    alone = {(space, name) for part in parts if part.size == 1 for space, names in part.names.items() for name in names}
    single: dict[tuple[str, str], list[Undetermined]] = {}
    lines = []
    for direction in _unexplained(solved):
        blocks = list(dict.fromkeys((kind, block) for kind, block, _ in direction.unknowns))
        if len(blocks) == 1:
            single.setdefault(blocks[0], []).append(direction)
        elif not separated:
            lines += _together(direction, blocks, say)
    told, alike = list[str](), dict[tuple[str, str], list[str]]()
    for (kind, block), directions in single.items():
        if thing_of(kind, block) in alone:
            continue
        if _is_idle(solved, kind, block):
            told.append(
                say("No observation refers to {names}; observe it, or leave it out.", names=_name(kind, block, say))
            )
        elif len(directions) == 1 and len(directions[0].unknowns) > 1:
            told.append(_in_one_direction(kind, block, directions[0], say))
        else:
            components = ", ".join(sorted({component for d in directions for _, _, component in d.unknowns}))
            alike.setdefault((kind, components), []).append(block)
    for (kind, components), alike_blocks in alike.items():
        told += _along(kind, components, alike_blocks, say)
    return [*told, *lines, *_geometry(solved, alone, say)]


def _is_idle(solved: Solved, kind: str, block: str) -> bool:
    """True where no observation depends on a block, or on one that has a component of it; knots hang on others."""
    blocks = solved.network.blocks[kind]
    number = blocks.ids.index(block)
    return thing_of(kind, block)[0] != "knot" and not any(
        bool((blocks.owner[numbers] == number).any())
        for group in solved.adjustment.problem.groups
        for slot, numbers in group.blocks_by_slot
        if slot.kind == kind
    )


def _unexplained(solved: Solved) -> list[Undetermined]:
    # Kinds of blocks that act by their products only.
    told = {slot.kind for slot in MOTION_SLOTS} if readout_sentences(solved) else set[str]()
    return [
        direction
        for direction in solved.adjustment.defect.undetermined
        if not {kind for kind, _, _ in direction.unknowns} <= told
    ]


def _geometry(solved: Solved, alone: set[tuple[str, str]], say: Translate) -> list[str]:
    frames = dict.fromkeys(
        thing_of(kind, block) for direction in _unexplained(solved) for kind, block, _ in direction.unknowns
    )
    return [
        line
        for space, name in frames
        if space in ("image", "station") and (space, name) not in alone
        for line in why_loose(solved, space, name, say)
    ]


def weakness(solved: Solved, say: Translate = english) -> list[str]:
    """One line for every direction that is determined, but hardly; without a solution if residuals are small."""
    adjustment = solved.adjustment
    if solved.quality is None and not (adjustment.outcome is Outcome.NOT_CONVERGED and fits(adjustment)):
        return []
    units = solved.network.project.units
    image = next((scale.unit for scale in solved.network.scales.values()), "mm")
    lines = []
    for direction in weak_directions(adjustment, solved.quality):
        parts = []
        for (kind, block, component), sigma in zip(direction.unknowns, direction.sigmas, strict=True):
            quantity = KINDS[kind].components[KINDS[kind].names.index(component)].quantity
            angle = "deg" if units.angle == "dms" else units.angle
            factor = ANGLE_UNITS[angle] if quantity.angle == 1 else 1.0
            parts.append(
                say(
                    "{component} of {names} by {amount} {unit}",
                    component=component,
                    names=_name(kind, block, say),
                    amount=f"{sigma / factor:.3g}",
                    unit=quantity.unit(units.length, angle, image),
                )
            )
        lines.append(
            say(
                "These move together, within one standard deviation: {parts}. It would help to {cure}.",
                parts=", ".join(parts),
                cure=_cure(*direction.unknowns[0][:2], say),
            )
        )
    return lines


def _in_one_direction(kind: str, block: str, direction: Undetermined, say: Translate) -> str:
    return say(
        "{names} is not determined in one direction ({components} = {ratios}); {cure}.",
        names=_name(kind, block, say),
        components=" : ".join(component for _, _, component in direction.unknowns),
        ratios=" : ".join(say("{amount}", amount=f"{x:.3g}") for x in direction.amounts),
        cure=_cure(kind, block, say),
    )


def _along(kind: str, components: str, blocks: Sequence[str], say: Translate) -> list[str]:
    """A line for each block, or one for more than three with the same cure."""
    by_cure: dict[str, list[str]] = {}
    for block in blocks:
        by_cure.setdefault(_cure(kind, block, say), []).append(_name(kind, block, say))
    lines = []
    for cure, names in by_cure.items():
        if len(names) > 3:
            listed = enumerated(names, 6, say)
            words = "These are not determined along {components}: {names}; {cure}."
            lines.append(say(words, components=components, names=listed, cure=cure))
        else:
            words = "{names} is not determined along {components}; {cure}."
            lines += [say(words, names=name, components=components, cure=cure) for name in names]
    return lines


def _together(direction: Undetermined, blocks: list[tuple[str, str]], say: Translate) -> list[str]:
    named = [f"{_name(kind, block, say)} ({_components(direction, kind, block)})" for kind, block in blocks]
    firsts: dict[str, str] = {}
    for kind, block in blocks:
        firsts.setdefault(kind, block)
    cures = "; ".join(f"{_name(kind, block, say)}: {_cure(kind, block, say)}" for kind, block in firsts.items())
    names = enumerated(named, 6, say)
    return [
        say("These cannot be separated from each other: {names}.", names=names),
        say("Remedies, one of: {cures}.", cures=cures),
    ]


def _components(direction: Undetermined, kind: str, block: str) -> str:
    return ", ".join(c for k, b, c in direction.unknowns if (k, b) == (kind, block))


def _name(kind: str, block: str, say: Translate) -> str:
    space, name = thing_of(kind, block)
    if KINDS[kind] in MOTIONS:
        return say("the {part} of {names}", part=say(kind), names=f"{say('point')} {name}")
    if _is_far(kind, block):
        return say("the {part} of {names}", part=say("direction"), names=f"{say('point')} {block.partition(' ')[2]}")
    thing = f"{say(space)} {name}"
    if kind.startswith("interior/"):
        if space == "image":
            return say("the interior orientation of {names}", names=thing)
        return say("the interior orientation of camera {id}", id=block)
    if (space, name) != (kind, block):
        part = say("position" if kind == "point" else kind)
        return say("the {part} of {names}", part=part, names=thing)
    return thing


def _is_far(kind: str, block: str) -> bool:
    return kind == "rotation" and block.startswith("point ")


def _cure(kind: str, block: str, say: Translate) -> str:
    kind = "point" if _is_far(kind, block) else kind
    return say(_CURES["knot" if thing_of(kind, block)[0] == "knot" else kind.split("/")[0]])
