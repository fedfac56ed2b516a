"""Movements between epochs as a table, in project axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl

from mor.arrays import FloatArray
from mor.quality.deformation.congruence import MovementTest
from mor.quality.deformation.epochs import Epochs


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


def verdict(epochs: Epochs, level: float, known: bool) -> list[str]:
    """The congruence test in words."""
    result = epochs.result
    test = result.global_test
    if test is None or test.freedom == 0:
        return ["No movement can be tested: no coordinate has a variance."]
    value = test.statistic if known else test.ratio
    which = "sigma0 known" if known else f"pooled sigma0 {np.sqrt(result.variance):.4f}"
    lines = [
        f"Global congruence test: {value:.4f} against {result.critical:.4f} "
        f"({test.freedom} degrees of freedom, level {level:g}, {which}): "
        + ("congruent, nothing has moved." if value <= result.critical else "NOT congruent.")
    ]
    moved = [name for name, stable in zip(epochs.names, result.stable, strict=True) if not stable]
    if moved:
        lines.append(f"Taken out of the datum as moved: {', '.join(moved)}.")
    return lines
