"""Movements between epochs as a table, in project axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.quality.deformation.congruence import MovementTest
from mor.quality.deformation.epochs import Epochs
from mor.report.words.language import ENGLISH, Words


def movement_table(
    names: Sequence[str], tests: Sequence[MovementTest], M: FloatArray, level: float, known: bool
) -> pl.DataFrame:
    """One row for each point or pair: movement, σ, test values (mean squares), p-values, verdict."""
    turned = np.array([test.movement @ M for test in tests]).reshape(-1, 3)
    sigma = np.array([test.sigma @ np.abs(M) for test in tests]).reshape(-1, 3)
    p, p_estimated = (
        np.exp([getattr(test, name) for test in tests]) for name in ("log_p", "log_p_estimated")
    )
    frame = pl.DataFrame(
        {
            "point": list(names),
            **{f"d{axis}": turned[:, k] for k, axis in enumerate("xyz")},
            **{f"sd{axis}": sigma[:, k] for k, axis in enumerate("xyz")},
            "test": [test.statistic for test in tests],
            "test_estimated": [test.ratio for test in tests],
            "freedom": [test.freedom for test in tests],
            "p": p,
            "p_estimated": p_estimated,
            "moved": (p if known else p_estimated) < level,
        }
    )
    return frame.with_columns(pl.col(pl.Float64).fill_nan(None))


def verdict(epochs: Epochs, level: float, known: bool, words: Words = ENGLISH) -> list[str]:
    """The congruence test in words."""
    result = epochs.result
    test = result.global_test
    if test is None or test.freedom == 0:
        return [words("No movement can be tested: no coordinate has a variance.")]
    value = test.statistic if known else test.ratio
    which = (
        words("sigma0 known")
        if known
        else words("pooled sigma0 {sigma0}", sigma0=f"{np.sqrt(result.variance):.4f}")
    )
    sentence = (
        "Global congruence test: {value} against {limit} ({freedom:degree|degrees} of freedom, level {level}, "
        "{which}): congruent, nothing has moved."
        if value <= result.critical
        else "Global congruence test: {value} against {limit} ({freedom:degree|degrees} of freedom, level {level}, "
        "{which}): NOT congruent."
    )
    lines = [
        words(
            sentence,
            value=f"{value:.4f}",
            limit=f"{result.critical:.4f}",
            freedom=test.freedom,
            level=f"{level:g}",
            which=which,
        )
    ]
    moved = [name for name, stable in zip(epochs.names, result.stable, strict=True) if not stable]
    if moved:
        lines.append(words("Taken out of the datum as moved: {names}.", names=", ".join(moved)))
    return lines
