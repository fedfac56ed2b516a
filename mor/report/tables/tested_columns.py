"""Columns of the residual table that say how an observation was tested, and how reliable it is."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

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


def tested_columns(rows: AssessedRows) -> dict[str, Callable[[], FloatArray]]:
    """Return functions that compute each column but the flag, (k, m) each, in the user's units and axes.

    NaN without a test.
    """
    group, one, tests, quality = rows.group, rows.one, rows.tests, rows.whole
    if quality is None:
        return {name: lambda: np.full(group.observed.shape, np.nan) for name in TESTED if name != "flag"}
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

    return {
        "r": lambda: said_numbers(group, np.where(out, _as_if_inside(group, one.q_adjusted), one.r)),
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
        "p_joint": lambda: said_numbers(group, _p_joint(joint(), freedom_of_several())),
    }


def _p_joint(joint: FloatArray, freedom: FloatArray) -> FloatArray:
    return np.exp(log_p_chi2(joint, freedom)) if np.isfinite(joint).any() else joint


def _as_if_inside(group: ObservationGroup, q: FloatArray) -> FloatArray:
    """Redundancy number an excluded observation would have had."""
    variance = group.given_sigma**2
    return np.asarray(variance / (variance + q))


def flags(rows: AssessedRows) -> IntArray:
    """Return the flags of observations (k, m), as numbers into :data:`FLAGS`, in the user's axes."""
    group = rows.group
    number = np.where(rows.uncontrolled, FLAGS.index("uncontrolled"), 0)
    number[rows.flagged] = FLAGS.index("gross")
    number[group.left_out] = FLAGS.index("check" if rows.is_check else "excluded")
    said_there: IntArray = number[:, said(group).source]
    return said_there


def excluded_count(quality: Quality) -> int:
    """Number of entries kept out, checks included."""
    return int(sum(np.count_nonzero(group.left_out) for group in quality.adjustment.problem.groups))
