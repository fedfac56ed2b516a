"""Columns of the residual table that say how an observation was tested, and how reliable it is."""

from __future__ import annotations

import numpy as np
import polars as pl

from mor.geometry.arrays import FloatArray
from mor.observations import ObservationGroup
from mor.quality.assess import Quality
from mor.quality.probabilities import log_p_chi2, log_p_normal, log_p_student
from mor.quality.reliability import student_square
from mor.quality.solved import Solved
from mor.report.outward import said, said_differences, said_numbers, said_signs, said_sizes

TESTED = {
    "r": pl.Float64,
    "w": pl.Float64,
    "tau": pl.Float64,
    "test": pl.Float64,
    "p": pl.Float64,
    "t2": pl.Float64,
    "p_t": pl.Float64,
    "error": pl.Float64,
    "nabla": pl.Float64,
    "external": pl.Float64,
    "influence": pl.Float64,
    "joint": pl.Float64,
    "joint_freedom": pl.Float64,
    "p_joint": pl.Float64,
    "flag": pl.String,
}


def tested_columns(
    solved: Solved, number: int, group: ObservationGroup, influence: FloatArray
) -> dict[str, FloatArray]:
    """The columns but for the flag, (n, m) each, in the units, axes and senses of the project; NaN without a test."""
    quality = solved.quality
    if quality is None:
        return {name: np.full(group.observed.shape, np.nan) for name in TESTED if name != "flag"}
    one, tests = quality.groups[number], quality.reliability[number]
    out = group.left_out
    r, w = np.where(out, _as_if_inside(group, one.q_adjusted), one.r), quality.w[number]
    w = np.where(out, tests.test, w)
    square = np.where(out, np.nan, student_square(tests.test, quality.omega, quality.redundancy))
    several = np.nan_to_num(one.freedom) > 1.0
    joint, freedom = (np.where(several, array, np.nan) for array in (one.joint, one.freedom))
    sigma0 = quality.sigma0 if quality.sigma0 > 0.0 else np.nan
    return {
        "r": said_numbers(group, r),
        "w": said_signs(group, w),
        "tau": said_signs(group, np.where(out, np.nan, w) / sigma0),
        "test": said_signs(group, tests.test),
        "p": said_numbers(group, np.exp(log_p_normal(tests.test))),
        "t2": said_numbers(group, square),
        "p_t": said_numbers(group, np.exp(log_p_student(square, quality.redundancy - 1))),
        "error": said_differences(group, tests.error),
        "nabla": said_sizes(group, tests.smallest),
        "external": said_numbers(group, tests.external),
        "influence": said_signs(group, influence),
        "joint": said_numbers(group, joint),
        "joint_freedom": said_numbers(group, freedom),
        "p_joint": said_numbers(group, np.exp(log_p_chi2(joint, freedom))),
    }


def _as_if_inside(group: ObservationGroup, q: FloatArray) -> FloatArray:
    """Redundancy number an excluded observation would have had."""
    variance = group.given_sigma**2
    return np.asarray(variance / (variance + q))


def flags(solved: Solved, number: int, group: ObservationGroup) -> np.ndarray:
    """What is to be said of an observation: check, excluded, gross, uncontrolled, or nothing. In the user's axes."""
    words = np.full(group.observed.shape, "", dtype=object)
    quality = solved.quality
    if quality is not None:
        words[np.isfinite(quality.groups[number].r) & ~np.isfinite(quality.reliability[number].test)] = (
            "uncontrolled"
        )
        words[quality.flagged[number]] = "gross"
    words[group.left_out] = "check" if is_check(solved, number) else "excluded"
    return np.asarray(words[:, said(group).source])


def is_check(solved: Solved, number: int) -> bool:
    """True for a group that was kept out to check the adjustment by."""
    return number >= len(solved.adjustment.problem.groups) - len(solved.network.checks)


def excluded_count(quality: Quality) -> int:
    """Number of entries kept out, checks included."""
    return int(sum(np.count_nonzero(group.left_out) for group in quality.adjustment.problem.groups))
