"""Singularities in words: which unknowns, which movement, what observation would cure it."""

from __future__ import annotations

from mor.adjustment.defect import Undetermined
from mor.quality.solved import Solved

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


def explain_singularity(solved: Solved) -> list[str]:
    """One line or more for every direction that the observations and the datum leave open."""
    adjustment = solved.adjustment
    lines = [line for direction in adjustment.defect.undetermined for line in _loose(direction)]
    if adjustment.defect.undetermined:
        return lines
    movements = ", ".join(adjustment.defect.movements)
    if not adjustment.problem.datum.free:
        return [
            f"The observations leave {adjustment.defect.datum.shape[1]} movements of the whole network open: {movements}.",
            "Fix or observe coordinates (control points, a scale bar), or write datum: free for a free network.",
        ]
    return [
        f"The chosen datum coordinates do not settle these movements: {movements}.",
        "Let more points, or more of their components, carry the datum.",
    ]


def _loose(direction: Undetermined) -> list[str]:
    unknowns = direction.unknowns
    blocks = list(dict.fromkeys((kind, block) for kind, block, _ in unknowns))
    if len(blocks) == 1:
        kind, block = blocks[0]
        components = ", ".join(component for _, _, component in unknowns)
        first = f"{_name(kind, block)} is not determined along {components}"
        if len(unknowns) > 1:
            ratios = " : ".join(f"{amount:.3g}" for amount in direction.amounts)
            first += f" (it can move in the proportion {ratios})"
        return [f"{first}; {_cure(kind)}."]
    names = ", ".join(
        f"{_name(kind, block)} ({_components(direction, kind, block)})" for kind, block in blocks[:6]
    )
    more = f" and {len(blocks) - 6} more" if len(blocks) > 6 else ""
    return [
        f"These cannot be separated from each other: {names}{more}.",
        f"To cure it: {_cure(blocks[0][0])}.",
    ]


def _components(direction: Undetermined, kind: str, block: str) -> str:
    return ", ".join(c for k, b, c in direction.unknowns if (k, b) == (kind, block))


def _name(kind: str, block: str) -> str:
    if kind.startswith("interior/"):
        return f"interior orientation of camera {block}"
    return f"{kind} {block}"


def _cure(kind: str) -> str:
    return _CURES[kind.split("/")[0]]
