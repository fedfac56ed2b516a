"""Gross errors as plain data: suspicious observations and what they do, what was excluded, robust comparison."""

from __future__ import annotations

from typing import Any

import numpy as np

from mor.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.quality.gross_errors.data_snooping import Snooped
from mor.quality.gross_errors.rejected_as_a_whole import TakenOut, mostly_out
from mor.quality.reliability.effects import Effect
from mor.quality.solved import Solved
from mor.quality.tests.fixed_coordinates import FixedPointTest, fixed_point_tests
from mor.quality.tests.levels import chi2_level
from mor.report.edge import said, said_differences, said_signs, said_sizes
from mor.report.tables.observations import named_places
from mor.report.tables.shared import once

_FRAMES = ("image", "station", "system")


@once
def gross_errors(solved: Solved) -> dict[str, Any]:
    """Levels, suspicious observations with their effect, steps of data snooping, robust solution."""
    quality, treatment = solved.quality, solved.treatment
    if quality is None or treatment is None:
        return {}
    limit = (
        chi2_level(quality.redundancy, quality.noncentrality, quality.levels.power)
        if quality.redundancy
        else None
    )
    return {
        "beta0": quality.levels.power,
        "noncentrality": quality.noncentrality,
        "familywise_level": quality.levels.familywise,
        "global_level_of_b_method": limit.level if limit else None,
        "suspicious": [suspicious(solved, effect) for effect in solved.effects],
        "in_common": [one._asdict() for one in solved.common],
        "snooping": _snooping(solved),
        "robust": _robust(solved),
    }


@once
def fixed_point_rows(solved: Solved) -> list[dict[str, Any]]:
    """Tests of the fixed points: would the observations rather have them elsewhere? In project axes."""
    if solved.quality is None:
        return []
    M, ids = solved.network.edge.matrix, solved.network.blocks["point"].ids
    return [
        fixed_point_row(ids[test.point], test, M)
        for test in fixed_point_tests(solved.quality)
        if test.freedom
    ]


def fixed_point_row(name: str, test: FixedPointTest, axes: FloatArray) -> dict[str, Any]:
    """The test of a point; ``axes`` (3, 3) turn its movement into those of the project."""
    return {
        "id": name,
        "movement": (test.movement @ axes).tolist(),
        "freedom": test.freedom,
        "test": test.statistic,
        "p": float(np.exp(test.log_p)),
        "test_estimated": test.ratio if np.isfinite(test.ratio) else None,
        "p_estimated": float(np.exp(test.log_p_estimated)) if np.isfinite(test.log_p_estimated) else None,
    }


def suspicious(solved: Solved, effect: Effect) -> dict[str, Any]:
    """One suspicious observation in project axes and units."""
    group = solved.adjustment.problem.groups[effect.entry.group]
    sizes = np.zeros((1, group.observed.shape[1]))

    def out(say: Any, value: float) -> float:
        internal = sizes.copy()
        internal[0, effect.entry.component] = value
        return float(say(group, internal)[0, _outside(group, effect.entry.component)])

    movement = solved.network.edge.matrix.T @ effect.movement
    return {
        **place(group, effect.entry.row, effect.entry.component),
        "w": out(said_signs, effect.test),
        "r": effect.r,
        "error": out(said_differences, effect.error),
        "nabla": out(said_sizes, effect.smallest),
        "point": solved.network.blocks["point"].ids[effect.point] if effect.point >= 0 else None,
        "movement": [float(x) for x in movement] if effect.point >= 0 and effect.tells else None,
        "flagged": abs(effect.test) > (solved.quality.critical if solved.quality else np.inf),
    }


def place(group: ObservationGroup, row: int, component: int) -> dict[str, Any]:
    """Return the names of an observation as in a row of residuals, by the references of its type."""
    outside = _outside(group, component)
    names = {
        reference.name: names[row]
        for reference, names in zip(group.type.references, group.references, strict=True)
    }
    ends = {key: column[row] for key, column in named_places(group).items()}
    return {
        "type": group.type.name,
        "group": group.name,
        "at": "",
        **ends,
        "names": names,
        "component": group.type.components[outside].name,
        "unit": said(group).external.units[outside],
    }


def _outside(group: ObservationGroup, component: int) -> int:
    """Number of the reported component behind an internal one."""
    return int(np.flatnonzero(said(group).source == component)[0])


def _snooping(solved: Solved) -> dict[str, Any] | None:
    snooping = solved.treatment.snooping if solved.treatment else None
    if snooping is None:
        return None
    return {
        "clean": snooping.clean,
        "mostly_out": [_taken_out(solved, one) for one in mostly_out(snooping)],
        "sigma0_before": snooping.sigma0_before,
        "steps": [_step(solved, step) for step in snooping.steps],
    }


def _taken_out(solved: Solved, one: TakenOut) -> dict[str, Any]:
    name = solved.network.blocks[one.kind].ids[one.block]
    space, _, own = name.partition(" ")
    of, name = (space, own) if space in _FRAMES and own else (one.kind, name)
    return {"of": of, "id": name, "excluded": one.excluded, "observations": one.observations}


def _step(solved: Solved, step: Snooped) -> dict[str, Any]:
    group = solved.adjustment.problem.groups[step.group]
    sign = float(said(group).sign[_outside(group, step.component)])
    return {
        "round": step.round,
        "action": "excluded" if step.taken_out else "put back",
        **place(group, step.row, step.component),
        "w": sign * step.test,
    }


def robust_shift(solved: Solved) -> FloatArray:
    """(n, 3) movement of the points from least squares to the robust solution, in project axes; none without one."""
    robust = solved.treatment.robust if solved.treatment else None
    if robust is None:
        return np.zeros((0, 3))
    here, there = (a.values["point"] for a in (solved.adjustment, robust.adjustment))
    points = solved.network.things["point"].parts["position"]
    return np.asarray((there - here)[points] @ solved.network.edge.matrix)


def _robust(solved: Solved) -> dict[str, Any] | None:
    robust = solved.treatment.robust if solved.treatment else None
    if robust is None:
        return None
    rejected = [
        place(group, int(row), int(component))
        for group, mask in zip(solved.adjustment.problem.groups, robust.rejected, strict=True)
        for row, component in np.argwhere(mask)
    ]
    shift = robust_shift(solved)
    return {
        "method": robust.method,
        "settled": robust.settled,
        "rejected": rejected,
        "largest_shift": float(np.abs(shift).max(initial=0.0)),
        "rms_shift": float(np.sqrt(np.mean(shift**2))) if shift.size else 0.0,
    }
