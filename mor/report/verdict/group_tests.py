"""The verdict as plain data: tests of groups, what would explain those that reject, what is chosen and not measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mor.quality.reliability.reliability_map import uncontrolled_count
from mor.quality.solved import Solved
from mor.quality.tests.common_effects import CommonEffect
from mor.quality.tests.group_tests import GroupTest
from mor.quality.verdict import LARGEST_SIGMA, Determined, Explained, Verdict
from mor.report.edge import said, said_differences
from mor.report.tables.shared import once
from mor.units import LENGTH_UNITS

MOST = 10_000
"""Tests that are listed; of more only those that reject."""
NAMED = 5
"""Ill-determined points that are named."""


@once
def verdict_rows(solved: Solved) -> dict[str, Any] | None:
    """Accepted or not, tests of groups, explanations; nothing without a solution."""
    judged = solved.verdict
    if solved.quality is None or judged is None:
        return None
    accepted = solved.accepted if solved.quality.redundancy > 0 else None
    explanations = [_explanation(solved, one) for one in judged.explained]
    if solved.possible_causes and solved.possible_causes[0].cause == "curvature":
        explanations = [one for one in explanations if not _is_like_curvature(one["effect"])]
    return rows_of_verdict(
        judged,
        accepted,
        uncontrolled_count(solved.quality),
        explanations,
        solved.adjustment.defect.movements,
        LENGTH_UNITS[solved.network.project.units.length],
    )


def _is_like_curvature(effect: dict[str, Any] | None) -> bool:
    """True for an offset of vertical angles, which the curvature of the earth looks like over similar distances."""
    vertical = ("zenith", "zenith_angle", "vertical", "vertical_direction")
    return effect is not None and effect["kind"] == "offset" and effect["component"] in vertical


def rows_of_verdict(
    judged: Verdict,
    accepted: bool | None,
    uncontrolled: int,
    explanations: list[dict[str, Any]],
    movements: Sequence[str],
    length: float = 1.0,
) -> dict[str, Any]:
    """A verdict with its explanations; ``accepted`` is nothing without redundancy, ``length`` the unit of lengths."""
    tests = judged.tests
    listed = tests.tests if len(tests.tests) <= MOST else tuple(tests.rejected)
    found = judged.determined
    return {
        "accepted": accepted,
        "says": _says(accepted, uncontrolled, found),
        "uncontrolled": uncontrolled,
        "level_of_groups": tests.level,
        "level_of_each_group": tests.level_of_each,
        "tests": len(tests.tests),
        "rejected": len(tests.rejected),
        "all_alike": judged.all_alike,
        "groups": [group_test_row(test) for test in listed],
        "explanations": explanations,
        "conventions": {
            "movements": list(movements),
            "scale": "scale" in movements,
            "fixed_coordinates_uncontrolled": judged.chosen_only,
        },
        "determined": _determined(found, length) if found is not None else None,
    }


def _determined(found: Determined, length: float) -> dict[str, Any]:
    """Determination of the result, lengths in units of the project."""
    return {
        "as_a_whole": found.as_a_whole,
        "everywhere": found.everywhere,
        "size": found.size / length,
        "limit": LARGEST_SIGMA,
        "points": found.points,
        "largest_sigma": found.largest / length,
        "median_sigma": found.median / length,
        "beyond": len(found.beyond),
        "worst": [
            {"kind": kind, "id": name, "sigma": sigma / length} for kind, name, sigma in found.beyond[:NAMED]
        ],
        "directions": found.directions,
    }


def _says(accepted: bool | None, uncontrolled: int, found: Determined | None) -> str:
    if found is not None and not found.as_a_whole:
        return "not determined"
    if accepted is None:
        return "not tested"
    if not accepted:
        return "not accepted"
    if found is not None and not found.everywhere:
        return "accepted, partly ill-determined"
    return "accepted, observations uncontrolled" if uncontrolled else "accepted"


def group_test_row(test: GroupTest) -> dict[str, Any]:
    """One test."""
    return {
        "of": test.of,
        "name": test.name,
        "also": [{"of": of, "name": name} for of, name in test.also],
        "observations": test.count,
        "redundancy": test.redundancy,
        "vtpv": test.omega,
        "sigma_factor": test.factor,
        "freedom": test.freedom,
        "p": float(np.exp(test.log_p)),
        "rejected": test.rejected,
    }


def _explanation(solved: Solved, one: Explained) -> dict[str, Any]:
    return {
        "of": one.test.of,
        "name": one.test.name,
        "sigma_factor": one.test.factor,
        "flagged": one.flagged,
        "share_of_flagged": one.share_of_flagged,
        "effect": _effect(solved, one.effect, one.suffices) if one.effect is not None else None,
    }


def _effect(solved: Solved, effect: CommonEffect, suffices: bool) -> dict[str, Any]:
    """An effect in project axes and units."""
    group = solved.adjustment.problem.groups[effect.group]
    out = said(group)
    outside = int(np.flatnonzero(out.source == effect.component)[0])
    size, sigma, unit = effect.size, effect.sigma, "1"
    if effect.kind == "offset":
        internal = np.zeros((1, group.observed.shape[1]))
        internal[0, effect.component] = 1.0
        unit = out.external.units[outside]
        in_unit = float(said_differences(group, internal)[0, outside])
        size, sigma = size * in_unit, sigma * abs(in_unit)
    return {
        "kind": effect.kind,
        "group": group.name,
        "type": group.type.name,
        "component": group.type.components[outside].name,
        "size": float(size),
        "sigma": float(sigma),
        "unit": unit,
        "w": float(abs(effect.test)),
        "vtpv_falls_by": float(effect.test**2),
        "sigma_factor_left": effect.factor if np.isfinite(effect.factor) else None,
        "suffices": suffices,
    }
