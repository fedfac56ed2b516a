"""Tables of observations: residuals, tests, reliability, suspects."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.diagnose.hypothesis import Diagnosis, as_diff
from mor.model.contract import Coded, Names, ObservationGroup, one_name, places_of, some_rows
from mor.model.images import is_image_point
from mor.project.document import Document
from mor.project.network import Network
from mor.quality.assessment import Quality
from mor.quality.external_reliability import PointEffect
from mor.quality.global_tests import check_outcome, fixed_point_tests
from mor.quality.redundancy import Reliability, student_square
from mor.quality.reliability_map import uncontrolled
from mor.quality.snooping import Snooped, TakenOut, mostly_out
from mor.quality.solution import AddedParameter, Solved
from mor.quality.test_statistics import (
    ROWS_AT_A_TIME,
    ObservationQuality,
    chi2_level,
    comparable,
    largest_entries,
    least_alike,
    log_p_chi2,
    log_p_normal,
    log_p_student,
    normalised_residuals,
)
from mor.report.schema import data_types
from mor.report.units import (
    ends_of_group,
    once,
    reported_component,
    said_differences,
    said_numbers,
    said_one,
    said_signs,
    said_sizes,
    said_values,
)
from mor.solve.problem import misclosures
from mor.types import AnyIntArray, BoolArray, FloatArray, IntArray

# ---- Some observations of one group with all that is known of their quality: what tables are made of, piece by piece.

PIECE = 8_192
"""Rows of a group that are looked at together: bounds the memory, whatever the size of the problem."""


class AssessedRows(NamedTuple):
    """Rows of a group, all arrays (k, m) in internal units; without a solution there is no quality."""

    group: ObservationGroup
    is_check: bool
    """True if the group was kept out to check the adjustment by."""
    whole: Quality | None
    one: ObservationQuality
    tests: Reliability
    test: FloatArray
    """Test values w_B, those of ``tests``."""
    w: FloatArray

    @property
    def flagged(self) -> BoolArray:
        """Observations whose test value exceeds the critical value; excluded ones are not among them."""
        if self.whole is None:
            return np.zeros(self.group.observed.shape, dtype=bool)
        beyond: BoolArray = np.abs(self.test) > self.whole.critical
        return beyond & ~self.group.left_out

    @property
    def uncontrolled(self) -> BoolArray:
        """Observations that hardly anything controls: their redundancy number is below the least one."""
        if self.whole is None:
            return np.zeros(self.group.observed.shape, dtype=bool)
        loose: BoolArray = np.nan_to_num(self.one.r, nan=1.0) < self.whole.levels.least_redundancy
        return loose & ~self.group.left_out


def assessed_pieces(solved: Solved) -> Iterator[AssessedRows]:
    """All observations of an adjustment in their order, so many at a time."""
    for number, group in enumerate(solved.adjustment.problem.groups):
        for start in range(0, group.count, PIECE):
            yield assessed_rows(solved, number, slice(start, start + PIECE))


def assessed_rows(solved: Solved, number: int, rows: IntArray | slice) -> AssessedRows:
    """Some rows of a group."""
    quality, groups = solved.quality, solved.adjustment.problem.groups
    group = some_rows(groups[number], rows)
    is_check = number >= len(groups) - len(solved.network.checks)
    if quality is None:
        nothing = np.full(group.observed.shape, np.nan)
        none = np.zeros(nothing.shape, dtype=bool)
        no_joint = np.full(group.count, np.nan), np.zeros(group.count, dtype=np.int8)
        one = ObservationQuality(
            -misclosures(group, solved.adjustment.values), nothing, nothing, *no_joint, nothing, none
        )
        return AssessedRows(group, is_check, None, one, Reliability(one, np.nan), nothing, nothing)
    one, tests = quality.groups[number].at(rows), quality.reliability[number].at(rows)
    return AssessedRows(group, is_check, quality, one, tests, tests.test, normalised_residuals(one))


# ---- Columns of the residual table that say how an observation was tested, and how reliable it is.

SCHEMA = data_types("Residual")
"""Columns of the table of residuals."""
FLAGS = ("", "uncontrolled", "gross", "excluded", "check")


def tested_names() -> list[str]:
    """Names of the numbers that tests and reliability give."""
    names = list(SCHEMA)
    return names[names.index("r") : names.index("flag")]


def tested_columns(rows: AssessedRows) -> dict[str, Callable[[], FloatArray]]:
    """Return functions that compute each column but the flag, (k, m) each, in the user's units and axes.

    NaN without a test.
    """
    group, one, tests, quality = rows.group, rows.one, rows.tests, rows.whole
    if quality is None:
        return {name: lambda: np.full(group.observed.shape, np.nan) for name in tested_names()}
    out = group.left_out
    freedom = quality.redundancy
    sigma0 = quality.sigma0 if quality.sigma0 > 0.0 else np.nan

    @cache
    def w() -> FloatArray:
        return np.where(out, rows.test, rows.w)

    @cache
    def square() -> FloatArray:
        return np.where(out, np.nan, student_square(rows.test, quality.omega, freedom))

    @cache
    def freedom_of_several() -> FloatArray:
        return np.where(one.freedom > 1.0, one.freedom, np.nan)

    @cache
    def joint() -> FloatArray:
        return np.where(np.isfinite(freedom_of_several()), one.joint, np.nan)

    def p_joint() -> FloatArray:
        known = np.isfinite(joint()).any()
        return np.exp(log_p_chi2(joint(), freedom_of_several())) if known else joint()

    variance = group.given_sigma**2
    return {
        "r": lambda: said_numbers(group, np.where(out, variance / (variance + one.q_adjusted), one.r)),
        "w": lambda: said_signs(group, rows.test),
        "normalised": lambda: said_signs(group, w()),
        "tau": lambda: said_signs(group, np.where(out, np.nan, w()) / sigma0),
        "p": lambda: said_numbers(group, np.exp(log_p_normal(rows.test))),
        "t2": lambda: said_numbers(group, square()),
        "p_t": lambda: said_numbers(group, np.exp(log_p_student(square(), freedom - 1))),
        "error": lambda: said_differences(group, tests.error),
        "nabla": lambda: said_sizes(group, tests.smallest),
        "external": lambda: said_numbers(group, tests.external),
        "influence": lambda: said_signs(group, tests.influence),
        "joint": lambda: said_numbers(group, joint()),
        "joint_freedom": lambda: said_numbers(group, freedom_of_several()),
        "p_joint": lambda: said_numbers(group, p_joint()),
    }


def flags(rows: AssessedRows) -> IntArray:
    """Return the flags of observations (k, m), as numbers into :data:`FLAGS`, in the user's axes."""
    group = rows.group
    number = np.where(rows.uncontrolled, FLAGS.index("uncontrolled"), 0)
    number[rows.flagged] = FLAGS.index("gross")
    number[group.left_out] = FLAGS.index("check" if rows.is_check else "excluded")
    return np.asarray(number[:, ends_of_group(group).source])


# ---- The residual table in long form: one row for every observation, units and all.

SHOWN = (
    *("type", "group", "at", "from", "to", "component", "unit", "observed", "adjusted", "v", "sigma"),
    *("r", "w", "error", "nabla", "external", "influence", "flag"),
)
"""Columns that pages and pictures are drawn from."""


def observation_table(solved: Solved, columns: Sequence[str] = tuple(SCHEMA)) -> pl.DataFrame:
    """All observations. ``v`` = adjusted − observed; ``r`` and ``w`` are empty if there was no solution."""
    parts = [table_of(rows, columns) for rows in assessed_pieces(solved)]
    return pl.concat(parts) if parts else pl.DataFrame(schema={name: SCHEMA[name] for name in columns})


def table_of(rows: AssessedRows, wanted: Sequence[str] = tuple(SCHEMA)) -> pl.DataFrame:
    """Rows of the table for some rows of a group, one for each component that was observed; of it some columns."""
    group = rows.group
    out = ends_of_group(group)
    mask = group.mask[:, out.source]
    row, component = np.nonzero(mask)
    whole = bool(mask.all())
    number_of = {key: make() for key, make in _numbers(rows).items() if key in wanted}
    texts = {key: names.column().expression(row) for key, names in named_places(group).items() if key in wanted}
    texts["component"] = _among([of.name for of in group.type.components]).expression(component)
    texts["unit"] = _among(out.external.units).expression(component)
    texts["flag"] = Coded(pl.Series(FLAGS), flags(rows)[mask]).expression(np.arange(len(row)))
    said_of_all = {"type": group.type.name, "group": group.name, "at": ""}
    texts = {**{key: pl.lit(text) for key, text in said_of_all.items()}, **texts}
    numbers = {key: values.ravel() if whole else values[mask] for key, values in number_of.items()}
    columns = [text.alias(key) for key, text in texts.items()]
    return pl.DataFrame(numbers, nan_to_null=True).with_columns(columns).select(wanted)


def _among(names: Sequence[str]) -> Coded:
    return Coded(pl.Series(names, dtype=pl.String), np.arange(len(names)))


def _numbers(rows: AssessedRows) -> dict[str, Callable[[], FloatArray]]:
    """Functions that compute each numeric column, (k, m), in the units and axes of the project."""
    group, one = rows.group, rows.one
    observed = said_values(group, group.observed)
    factor = rows.whole.sigma_factor if rows.whole is not None else np.nan
    return {
        "observed": lambda: observed,
        "adjusted": lambda: observed + said_differences(group, one.v),
        "v": lambda: said_differences(group, one.v),
        "sigma": lambda: said_sizes(group, group.given_sigma),
        "sigma_adjusted": lambda: said_sizes(group, factor * np.sqrt(np.maximum(one.q_adjusted, 0.0))),
        **tested_columns(rows),
    }


def named_places(group: ObservationGroup) -> dict[str, Names]:
    """Identifiers of a group's rows as at, from, to; nothing for at where the type has none."""
    if len(group.references) == 3:
        return dict(zip(("at", "from", "to"), group.references, strict=True))
    return dict(zip(("from", "to"), (*group.references, one_name("", group.count)), strict=False))


# ---- The worst observations, found in arrays: only their rows become rows of a table.


def worst_residuals(solved: Solved, count: int) -> pl.DataFrame:
    """The rows of the table of residuals with the largest |w|, the worst first, equal ones in their order."""
    parts, groups = [], solved.adjustment.problem.groups
    found = [_largest(solved, number, count) for number in range(len(groups))]
    largest = np.sort(np.concatenate([np.zeros(0), *(sizes for _, sizes in found)]))[-count:]
    limit = max(least_alike(float(largest[0])), 0.0) if len(largest) else 0.0
    for number, (places, sizes) in enumerate(found):
        rows = np.unique(places[sizes >= limit] // groups[number].observed.shape[1])
        if len(rows):
            parts.append(table_of(assessed_rows(solved, number, rows)))
    if not parts:
        return pl.DataFrame(schema=SCHEMA)
    table = pl.concat(parts).filter(pl.col("w").is_not_null())
    return table[np.argsort(-comparable(np.abs(table["w"].to_numpy())), kind="stable")[:count]]


def _largest(solved: Solved, number: int, count: int) -> tuple[IntArray, FloatArray]:
    """Places of the largest |w| of a group in its flat array, and those; −1 where there is none."""
    if solved.quality is None:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    tests = solved.quality.reliability[number]
    shape = solved.adjustment.problem.groups[number].observed.shape
    return largest_entries(shape, lambda rows: np.nan_to_num(np.abs(tests.at(rows).test), nan=-1.0), count)


def uncontrolled_residuals(solved: Solved, count: int) -> tuple[pl.DataFrame, int]:
    """The first rows of observations that hardly anything controls, and how many there are of them.

    Those that are flagged all the same are not among them.
    """
    if solved.quality is None:
        return pl.DataFrame(schema=SCHEMA), 0
    parts, number = [], 0
    for k, flagged in enumerate(solved.quality.flagged):
        loose = uncontrolled(solved.quality, k) & ~flagged
        rows = np.flatnonzero(loose.any(axis=1))[:count]
        number += int(np.count_nonzero(loose))
        if len(rows):
            parts.append(table_of(assessed_rows(solved, k, rows)).filter(pl.col("flag") == "uncontrolled"))
    return (pl.concat(parts).head(count) if parts else pl.DataFrame(schema=SCHEMA)), number


# ---- Mean redundancy number and largest |w| by point and by image.


def control_of_points(solved: Solved, numbers: IntArray) -> dict[str, FloatArray]:
    """Columns ``mean_r`` and ``largest_w`` of point blocks (n,), over all observations that name them as a target."""
    return {name: values[numbers] for name, values in _control(solved)["point"].items()}


def control_of_images(solved: Solved) -> dict[str, FloatArray]:
    """Return mean redundancy number and largest |w| of all images, over their rays."""
    return _control(solved)["image"]


def owners_of_rows(solved: Solved, group: ObservationGroup) -> Iterator[tuple[str, AnyIntArray]]:
    """Points, or images, that the rows of a group count for: which of the two, and their numbers (n,)."""
    for slot, blocks in group.blocks_by_slot:
        if slot.kind == "point" and slot.of != "image":
            yield "point", blocks
    if is_image_point(group.type):
        yield "image", places_of(group.references[0], solved.network.things["image"].ids)


@once
def _control(solved: Solved) -> dict[str, dict[str, FloatArray]]:
    """Both columns of all point blocks and of all images."""
    counts = {"point": len(solved.network.blocks["point"].ids), "image": len(solved.network.things["image"].ids)}
    quality = solved.quality
    if quality is None:
        nothing = {key: np.full(count, np.nan) for key, count in counts.items()}
        return {key: {"mean_r": array, "largest_w": array} for key, array in nothing.items()}
    totals = {key: np.zeros((2, count)) for key, count in counts.items()}
    largest = {key: np.zeros(count) for key, count in counts.items()}
    for group, one, tests in zip(quality.adjustment.problem.groups, quality.groups, quality.reliability, strict=True):
        owners = list(owners_of_rows(solved, group))
        for first in range(0, group.count if owners else 0, ROWS_AT_A_TIME):
            rows = slice(first, first + ROWS_AT_A_TIME)
            active = group.used_among(rows)
            r = np.where(active, np.nan_to_num(one.at(rows).r), 0.0).sum(axis=1)
            size = np.where(active, np.nan_to_num(np.abs(tests.at(rows).test)), 0.0).max(axis=1, initial=0.0)
            for key, blocks in owners:
                np.add.at(totals[key][0], blocks[rows], r)
                np.add.at(totals[key][1], blocks[rows], active.sum(axis=1))
                np.maximum.at(largest[key], blocks[rows], size)
    return {key: _columns(totals[key], largest[key]) for key in counts}


def _columns(totals: FloatArray, largest: FloatArray) -> dict[str, FloatArray]:
    total, number = totals
    seen = number > 0
    return {
        "mean_r": np.where(seen, total / np.maximum(number, 1), np.nan),
        "largest_w": np.where(seen, largest, np.nan),
    }


# ---- Checks as plain data, in project axes and units.


def check_rows(solved: Solved) -> list[dict[str, Any]]:
    """One entry for each component of each group of checks."""
    quality = solved.quality
    if quality is None or not solved.network.checks:
        return []
    rows = []
    groups = solved.adjustment.problem.groups
    for number in range(len(groups) - len(solved.network.checks), len(groups)):
        group, outcome = groups[number], check_outcome(quality, number)
        said = {"mean": said_differences, "rms": said_sizes, "largest": said_differences}
        values = {key: way(group, getattr(outcome, key)[None])[0] for key, way in said.items()}
        count, exceeding = (said_numbers(group, array[None])[0] for array in (outcome.count, outcome.exceeding))
        for k, component in enumerate(group.type.components):
            if count[k] > 0:
                rows.append(
                    {
                        "group": group.name,
                        "type": group.type.name,
                        "component": component.name,
                        "unit": ends_of_group(group).external.units[k],
                        "count": int(count[k]),
                        **{key: float(array[k]) for key, array in values.items()},
                        "exceeding": int(exceeding[k]),
                    }
                )
    return rows


def largest_length_error(rows: list[dict[str, Any]]) -> float | None:
    """Largest length measurement error of all check distances among the checks, project unit (VDI/VDE 2634)."""
    errors = [abs(row["largest"]) for row in rows if "distance" in row["type"]]
    return float(np.max(errors)) if errors else None


# ---- Gross errors as plain data: suspicious observations and what they do, what was excluded, robust comparison.


@once
def gross_errors(solved: Solved) -> dict[str, Any]:
    """Levels, suspicious observations with their effect, steps of data snooping, robust solution."""
    quality, treatment = solved.quality, solved.treatment
    if quality is None or treatment is None:
        return {}
    limit = chi2_level(quality.redundancy, quality.noncentrality, quality.levels.power) if quality.redundancy else None
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
        {
            "id": ids[test.point],
            "movement": (test.movement @ M).tolist(),
            "freedom": test.freedom,
            "test": test.statistic,
            "p": float(np.exp(test.log_p)),
            "test_estimated": test.ratio if np.isfinite(test.ratio) else None,
            "p_estimated": float(np.exp(test.log_p_estimated)) if np.isfinite(test.log_p_estimated) else None,
        }
        for test in fixed_point_tests(solved.quality)
        if test.freedom
    ]


def suspicious(solved: Solved, effect: PointEffect) -> dict[str, Any]:
    """One suspicious observation in project axes and units."""
    group = solved.adjustment.problem.groups[effect.entry.group]
    component = effect.entry.component
    movement = solved.network.edge.matrix.T @ effect.movement
    return {
        **place(group, effect.entry.row, component),
        "w": said_one(said_signs, group, component, effect.test),
        "r": effect.r,
        "error": said_one(said_differences, group, component, effect.error),
        "nabla": said_one(said_sizes, group, component, effect.smallest),
        "point": solved.network.blocks["point"].ids[effect.point] if effect.point >= 0 else None,
        "movement": [float(x) for x in movement] if effect.point >= 0 and effect.tells else None,
        "flagged": abs(effect.test) > (solved.quality.critical if solved.quality else np.inf),
    }


def place(group: ObservationGroup, row: int, component: int) -> dict[str, Any]:
    """Return the names of an observation as in a row of residuals, by the references of its type."""
    outside = reported_component(group, component)
    names = group.names_of(row)
    ends = {key: column[row] for key, column in named_places(group).items()}
    return {
        "type": group.type.name,
        "group": group.name,
        "at": "",
        **ends,
        "names": names,
        "component": group.type.components[outside].name,
        "unit": ends_of_group(group).external.units[outside],
    }


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
    of, name = (space, own) if space in ("image", "station", "system") and own else (one.kind, name)
    return {"of": of, "id": name, "excluded": one.excluded, "observations": one.observations}


def _step(solved: Solved, step: Snooped) -> dict[str, Any]:
    group = solved.adjustment.problem.groups[step.group]
    sign = float(ends_of_group(group).sign[reported_component(group, step.component)])
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
    return np.asarray((there - here)[solved.network.things["point"].parts["position"]] @ solved.network.edge.matrix)


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


# ---- Observations left out because all together have no solution, as plain data.


def suspects(solved: Solved) -> dict[str, Any] | None:
    """Return the outcome of the adjustment of all observations, and the suspects, worst first."""
    found, quality = solved.suspects, solved.quality
    if found is None or quality is None:
        return None
    plain, groups = found.plain, solved.adjustment.problem.groups
    entries = [
        (float(found.sizes[number][row, component]), number, int(row), int(component))
        for number, (group, mask) in enumerate(zip(groups, found.masks, strict=True))
        for row, component in np.argwhere(mask & group.left_out)
    ]
    entries.sort(key=lambda entry: (-entry[0], *entry[1:]))
    last = plain.iterations[-1].sigma0 if plain.iterations else None
    # Suspects that results.json lists; the table of residuals has all.
    return {
        "outcome": plain.outcome.value,
        "iterations": len(plain.iterations),
        "sigma0_ratio": last,
        "count": len(entries),
        "observations": [
            {**place(groups[number], row, component), "misfit": size}
            for size, number, row, component in entries[:10_000]
        ],
    }


# ---- Possible causes of a rejection, and hypotheses that were tried, as plain data.


def possible_causes(solved: Solved) -> list[dict[str, Any]]:
    """Possible causes by score tests, the best first."""
    return [
        {
            "cause": one.cause,
            "things": list(one.things),
            "line": one.line,
            "amount": _amount(solved.network, one.amount),
            "vtpv_decrease": one.gain,
            "parameters": one.parameters,
            "log10_p": one.log10_p,
            "verified": False,
        }
        for one in solved.possible_causes
    ]


def diagnosis(network: Network, found: Diagnosis, document: Document, folder: Path) -> dict[str, Any]:
    """A search for mistakes: vᵀPv before, what is offered, and what was tried.

    ``document`` is the project file and ``folder`` that of its tables: hypotheses come with the diff of their edits.
    """
    before = found.before
    return {
        "vtpv_before": before.told if isfinite(before.told) else None,
        "freedom_before": before.freedom,
        "offered": [
            {
                "cause": one.hypothesis.cause,
                "things": list(one.hypothesis.things),
                "line": one.hypothesis.line,
                "diff": as_diff(document, folder, one.hypothesis.edits, one.amount),
                "candidates": one.hypothesis.candidates,
                "amount": _amount(network, one.amount),
                "vtpv_after": one.after,
                "freedom_after": one.freedom_after,
                "gain": one.gain,
                "like_the_first": one.like_the_first,
            }
            for one in found.offered
        ],
        "tried": [
            {
                "cause": one.hypothesis.cause,
                "things": list(one.hypothesis.things),
                "vtpv_after": one.fit.omega if one.fit is not None else None,
                "freedom_after": one.fit.freedom if one.fit is not None else None,
                "gain": one.gain if one.fit is not None and isfinite(one.gain) else None,
            }
            for one in found.trials
        ],
        "untried": found.untried,
    }


def _amount(network: Network, amount: AddedParameter | None) -> dict[str, Any] | None:
    if amount is None:
        return None
    units = {"offset": network.project.units.length, "scale": "", "sigma factor": ""}
    units["height"] = units["offset"]
    unit = units.get(amount.name, next((scale.unit for scale in network.scales.values()), ""))
    return {"name": amount.name, "value": amount.value, "unit": unit}
