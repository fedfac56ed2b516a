"""Singularities in words: which unknowns, which movement, what observation would cure it."""

from __future__ import annotations

import numpy as np

from mor.adjustment.undetermined import Undetermined
from mor.parameters.kinds import KINDS
from mor.quality.loose_frames import why_loose
from mor.quality.parts import Part, connected_parts
from mor.quality.solved import Solved
from mor.quality.tilt import tilt
from mor.quality.weak import weak_directions
from mor.units import ANGLE_UNITS

_CURES = {
    "point": "observe it from a second place, or fix or observe its coordinates",
    "rotation": "observe more points in it, or fix or observe its angles",
    "interior": "fix or observe the component, or measure rolled images and points in depth",
    "distance meter": "fix the component, or measure distances of different length between known points",
    "refraction": "fix the coefficient, or measure vertical angles over different distances",
    "height": "fix or measure the height",
    "scale": "fix the scale, or give the system points of known distance",
    "eccentricity": "fix the component, or turn the frame about its rotation centre",
    "base": "fix the base, or measure a distance",
}
_FRAMES = ("image", "station", "system", "pair")
_STILL = 1e-6
"""Part of a movement of unit length below which nothing moves."""
_SHOWN = 6
"""Names told of one part or direction."""


def explain_singularity(solved: Solved) -> list[str]:
    """One line or more for everything that the observations and the datum leave open."""
    adjustment = solved.adjustment
    if adjustment.defect.undetermined:
        parts = connected_parts(solved)
        tied = [part for part in parts if part.size > 1]
        return [
            *(
                f"No observation refers to {_things(part)}; observe it, or leave it out."
                for part in parts
                if part.size == 1
            ),
            *(_separated(tied) if len(tied) > 1 else []),
            *_loose(solved, parts, separated=len(tied) > 1),
        ]
    if not adjustment.problem.datum.free:
        return _open_datum(solved)
    return [
        f"The chosen datum coordinates do not settle these movements: {', '.join(adjustment.defect.movements)}.",
        "Let more points, or more of their components, carry the datum.",
    ]


def _open_datum(solved: Solved) -> list[str]:
    movements = solved.adjustment.defect.movements
    count = solved.adjustment.defect.datum.shape[1]
    return [
        f"The observations leave {count} {'movement' if count == 1 else 'movements'} of the whole network open: "
        f"{', '.join(movements)}.",
        *(
            ["What moves is " + _moved(solved) + "."]
            if any("combination" in name for name in movements)
            else []
        ),
        *([about] if (about := tilt(solved.adjustment)) else []),
        "Fix or observe coordinates (control points, a scale bar), or write datum: free for a free network.",
    ]


def _moved(solved: Solved) -> str:
    """Names of the blocks that the open movements move."""
    index = solved.adjustment.problem.index
    moved = np.flatnonzero(np.abs(solved.adjustment.defect.datum).max(axis=1) > _STILL)
    names = list(dict.fromkeys(_name(*index.label(int(column))[:2]) for column in moved))
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def _separated(parts: list[Part]) -> list[str]:
    return [
        f"The network falls into {len(parts)} parts that no observation connects:",
        *(f"  part {number}: {_things(part)}" for number, part in enumerate(parts, start=1)),
        "To cure it: observe points of one part from the other, or points that both have in common, "
        "or adjust the parts one by one.",
    ]


def _things(part: Part) -> str:
    words = []
    for space, names in part.names.items():
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        words.append(f"{space if len(names) == 1 else space + 's'} {', '.join(names[:_SHOWN])}{more}")
    return "; ".join(words)


def _loose(solved: Solved, parts: tuple[Part, ...], separated: bool) -> list[str]:
    """Directions inside the network, those of one block together; none that its falling apart explains already."""
    alone = {
        (space, name)
        for part in parts
        if part.size == 1
        for space, names in part.names.items()
        for name in names
    }
    single: dict[tuple[str, str], list[Undetermined]] = {}
    lines = []
    for direction in solved.adjustment.defect.undetermined:
        blocks = list(dict.fromkeys((kind, block) for kind, block, _ in direction.unknowns))
        if len(blocks) == 1:
            single.setdefault(blocks[0], []).append(direction)
        elif not separated:
            lines += _together(direction, blocks)
    told = [
        _one_block(kind, block, directions)
        for (kind, block), directions in single.items()
        if _owner(kind, block) not in alone
    ]
    return [*told, *lines, *_geometry(solved, alone)]


def _geometry(solved: Solved, alone: set[tuple[str, str]]) -> list[str]:
    """Images and stations among what is loose that see too few points, or all on one line."""
    frames = dict.fromkeys(
        _owner(kind, block)
        for direction in solved.adjustment.defect.undetermined
        for kind, block, _ in direction.unknowns
    )
    return [
        line
        for space, name in frames
        if space in ("image", "station") and (space, name) not in alone
        for line in why_loose(solved, space, name)
    ]


def weakness(solved: Solved) -> list[str]:
    """One line for every direction that is determined, but hardly."""
    if solved.quality is None:
        return []
    units = solved.network.project.units
    image = next((scale.unit for scale in solved.network.scales.values()), "mm")
    lines = []
    for direction in weak_directions(solved.quality):
        parts = []
        for (kind, block, component), sigma in zip(direction.unknowns, direction.sigmas, strict=True):
            quantity = KINDS[kind].components[KINDS[kind].names.index(component)].quantity
            angle = "deg" if units.angle == "dms" else units.angle
            factor = ANGLE_UNITS[angle] if quantity.angle == 1 else 1.0
            amount = f"{sigma / factor:.3g} {quantity.unit(units.length, angle, image)}"
            parts.append(f"{component} of {_name(kind, block)} by {amount}")
        cure = _cure(direction.unknowns[0][0])
        lines.append(
            f"These move together, within one standard deviation: {', '.join(parts)}. It would help to {cure}."
        )
    return lines


def _one_block(kind: str, block: str, directions: list[Undetermined]) -> str:
    components = ", ".join(sorted({component for d in directions for _, _, component in d.unknowns}))
    words = f"{_name(kind, block)} is not determined along {components}"
    if len(directions) == 1 and len(directions[0].unknowns) > 1:
        names = " : ".join(component for _, _, component in directions[0].unknowns)
        ratios = " : ".join(f"{amount:.3g}" for amount in directions[0].amounts)
        words = f"{_name(kind, block)} is not determined in one direction ({names} = {ratios})"
    return f"{words}; {_cure(kind)}."


def _together(direction: Undetermined, blocks: list[tuple[str, str]]) -> list[str]:
    names = ", ".join(
        f"{_name(kind, block)} ({_components(direction, kind, block)})" for kind, block in blocks[:_SHOWN]
    )
    more = f" and {len(blocks) - _SHOWN} more" if len(blocks) > _SHOWN else ""
    kinds = dict.fromkeys(kind for kind, _ in blocks)
    cures = "; ".join(
        f"{_name(kind, next(b for k, b in blocks if k == kind))}: {_cure(kind)}" for kind in kinds
    )
    return [
        f"These cannot be separated from each other: {names}{more}.",
        f"To cure it, one of: {cures}.",
    ]


def _components(direction: Undetermined, kind: str, block: str) -> str:
    return ", ".join(c for k, b, c in direction.unknowns if (k, b) == (kind, block))


def _owner(kind: str, block: str) -> tuple[str, str]:
    """Namespace and name of the thing that a block belongs to: image 1 for the position called ``image 1``."""
    space, _, name = block.partition(" ")
    return (space, name) if space in _FRAMES and name else (kind, block)


def _name(kind: str, block: str) -> str:
    if kind.startswith("interior/"):
        owner = block if block.startswith("image ") else f"camera {block}"
        return f"the interior orientation of {owner}"
    if _owner(kind, block) != (kind, block):
        return f"the {'position' if kind == 'point' else kind} of {block}"
    return f"{kind} {block}"


def _cure(kind: str) -> str:
    return _CURES[kind.split("/")[0]]
