"""Columns of the residual table that say how an observation was tested, and how reliable it is."""

from __future__ import annotations

import numpy as np
import polars as pl

from mor.arrays import FloatArray, IntArray
from mor.observations import ObservationGroup
from mor.quality.assess import Quality
from mor.quality.reliability.detectable_errors import student_square
from mor.quality.tests.p_values import log_p_chi2, log_p_normal, log_p_student
from mor.report.edge import said, said_differences, said_numbers, said_signs, said_sizes
from mor.report.tables.assessed_observations import AssessedRows

TESTED = {
    "r": pl.Float64,
    "w": pl.Float64,
    "normalised": pl.Float64,
    "tau": pl.Float64,
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


FLAGS = ("", "uncontrolled", "gross", "excluded", "check")


def tested_columns(rows: AssessedRows) -> dict[str, FloatArray]:
    """The columns but for the flag, (k, m) each, in the units, axes and senses of the project; NaN without a test."""
    group, one, tests, quality = rows.group, rows.one, rows.tests, rows.whole
    if quality is None:
        return {name: np.full(group.observed.shape, np.nan) for name in TESTED if name != "flag"}
    out = group.left_out
    r = np.where(out, _as_if_inside(group, one.q_adjusted), one.r)
    w = np.where(out, rows.test, rows.w)
    square = np.where(out, np.nan, student_square(rows.test, quality.omega, quality.redundancy))
    several = np.nan_to_num(one.freedom) > 1.0
    joint, freedom = (np.where(several, array, np.nan) for array in (one.joint, one.freedom))
    p_joint = np.exp(log_p_chi2(joint, freedom)) if several.any() else joint
    sigma0 = quality.sigma0 if quality.sigma0 > 0.0 else np.nan
    return {
        "r": said_numbers(group, r),
        "w": said_signs(group, rows.test),
        "normalised": said_signs(group, w),
        "tau": said_signs(group, np.where(out, np.nan, w) / sigma0),
        "p": said_numbers(group, np.exp(log_p_normal(rows.test))),
        "t2": said_numbers(group, square),
        "p_t": said_numbers(group, np.exp(log_p_student(square, quality.redundancy - 1))),
        "error": said_differences(group, tests.error),
        "nabla": said_sizes(group, tests.smallest),
        "external": said_numbers(group, tests.external),
        "influence": said_signs(group, tests.influence),
        "joint": said_numbers(group, joint),
        "joint_freedom": said_numbers(group, freedom),
        "p_joint": said_numbers(group, p_joint),
    }


def _as_if_inside(group: ObservationGroup, q: FloatArray) -> FloatArray:
    """Redundancy number an excluded observation would have had."""
    variance = group.given_sigma**2
    return np.asarray(variance / (variance + q))


def flags(rows: AssessedRows) -> IntArray:
    """What is to be said of observations (k, m), as numbers into :data:`FLAGS`. In the user's axes."""
    group = rows.group
    number = np.where(rows.uncontrolled, FLAGS.index("uncontrolled"), 0)
    number[rows.flagged] = FLAGS.index("gross")
    number[group.left_out] = FLAGS.index("check" if rows.is_check else "excluded")
    said_there: IntArray = number[:, said(group).source]
    return said_there


def excluded_count(quality: Quality) -> int:
    """Number of entries kept out, checks included."""
    return int(sum(np.count_nonzero(group.left_out) for group in quality.adjustment.problem.groups))
