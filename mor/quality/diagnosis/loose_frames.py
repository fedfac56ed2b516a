"""Why an image, a station or a system is loose: it has no, one or two points, or a line; or φ is ±100 gon."""

from __future__ import annotations

import numpy as np

from mor.arrays import IntArray
from mor.geometry import tolerant
from mor.geometry.rotations import angles_from_rotation
from mor.parameters.index import moves_by_angles
from mor.parameters.kinds import KINDS
from mor.quality.diagnosis.sentences import Say, english, enumerated
from mor.quality.solved import Solved
from mor.units import LENGTH_UNITS

_ON_LINE = 1e-6
"""Spread of points beside a line, as part of that along it, below which they are on it."""
_LOCKED = 1e-3
"""cos φ from which down ω and κ are a thousand times less certain than the attitude: they are nearly the same turn."""
_SHOWN = 4


def why_loose(solved: Solved, space: str, name: str, say: Say = english) -> list[str]:
    """Lines for a frame (``image``, ``station``) that its points, or its angles, cannot hold; none where they could."""
    things = solved.network.things[space]
    if name not in things.numbers:
        return []
    rotation = things.part(name, "rotation")
    return [*_too_few(solved, space, name, rotation, say), *_locked(solved, space, name, rotation, say)]


def _locked(solved: Solved, space: str, name: str, rotation: int, say: Say) -> list[str]:
    """Angles of which some are fixed, or tied to those of others, where two of them are the same turn."""
    index = solved.adjustment.problem.index
    _, phi, _ = angles_from_rotation(solved.adjustment.values["rotation"][rotation])
    if np.cos(phi) > _LOCKED or not moves_by_angles(index.blocks["rotation"])[rotation]:
        return []
    return [
        say(
            "phi of {names} is ±100 gon: omega and kappa are the same turn there, so that no angle can be fixed, or "
            "differ exactly from another one, by itself; turn the object system, or say the relative rotation of "
            "images by a pair.",
            names=f"{say(space)} {name}",
        )
    ]


def _too_few(solved: Solved, space: str, name: str, rotation: int, say: Say) -> list[str]:
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
    listed = enumerated(names, _SHOWN, say)
    if len(points) == 2:
        return [
            say(
                "{names} sees two points only, {place}: it can rotate about the line of its two points "
                "(measure a third point that is not on this line).",
                names=frame,
                place=listed,
            )
        ]
    spread = tolerant.singular_values(
        solved.adjustment.values["point"][points] - solved.adjustment.values["point"][points].mean(axis=0),
    )
    if spread[1] <= _ON_LINE * spread[0]:
        return [
            say(
                "the points of {names} ({place}) lie on one line: it can rotate about this line "
                "(measure a point beside it).",
                names=frame,
                place=listed,
            )
        ]
    return []


def held_by_an_angle(solved: Solved, say: Say = english) -> list[str]:
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
        across = _across_a_line(solved, points) / LENGTH_UNITS[length]
        lines.append(
            say(
                "The fixed {components} of system {id} opposes it; the points of this system lie within "
                "{across} {unit} of one line. Where they are meant to lie on it, describe it as features: "
                "type: line, which needs no angle.",
                components=", ".join(np.array(KINDS["rotation"].names)[fixed]),
                id=name,
                across=f"{across:.2g}",
                unit=length,
            )
        )
    return lines


def _across_a_line(solved: Solved, points: IntArray) -> float:
    """Largest distance of points from the line that fits them best."""
    places = solved.adjustment.values["point"][points]
    beside = places - places.mean(axis=0)
    along = tolerant.svd(beside)[2][0]
    return float(np.linalg.norm(beside - np.outer(beside @ along, along), axis=1).max())


def _points_seen(solved: Solved, rotation: int) -> IntArray:
    """Point blocks that rays and directions of a frame with this rotation refer to."""
    found = [np.zeros(0, dtype=np.int64)]
    for group in solved.adjustment.problem.groups:
        slots = list(zip(group.type.slots, group.blocks, strict=True))
        here = [blocks for slot, blocks in slots if slot.kind == "rotation" and slot.part == "rotation"]
        targets = [blocks for slot, blocks in slots if slot.kind == "point" and slot.of in ("point", "to")]
        if here and targets:
            found.append(targets[-1][here[0] == rotation])
    return np.unique(np.concatenate(found))
