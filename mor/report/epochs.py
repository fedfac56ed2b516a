"""Reports of epochs and movements."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from markupsafe import Markup

from mor.input_files import note_input
from mor.quality.deformation import EpochComparison, MovementTest, blocks_of
from mor.quality.solution import Solved
from mor.report.estimates import movement_rows, point_table
from mor.report.identity import RunIdentity, identity_of
from mor.report.language import ENGLISH, Words
from mor.report.layout import DIGITS, fixed, small_unit
from mor.report.movements import PointMovements, moved_points, movement_drawing, series_drawing
from mor.report.page import rendered
from mor.report.page_data import plan_axes
from mor.report.summary import summary
from mor.report.text_tables import listed_movements, listed_parameters, statements
from mor.types import FloatArray

# ---- Movements between epochs as a table, in project axes.


def movement_table(
    names: Sequence[str], tests: Sequence[MovementTest], M: FloatArray, level: float, known: bool
) -> pl.DataFrame:
    """One row for each point or pair: movement, σ, test values (mean squares), p-values, verdict."""
    turned = np.array([test.movement @ M for test in tests]).reshape(-1, 3)
    sigma = np.array([test.sigma @ np.abs(M) for test in tests]).reshape(-1, 3)
    p, p_estimated = (np.exp([getattr(test, name) for test in tests]) for name in ("log_p", "log_p_estimated"))
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


def verdict(epochs: EpochComparison, level: float, known: bool, words: Words = ENGLISH) -> list[str]:
    """The congruence test in words."""
    result = epochs.result
    test = result.global_test
    if test is None or test.freedom == 0:
        return [words("No movement can be tested: no coordinate has a variance.")]
    value = test.statistic if known else test.ratio
    which = (
        words("sigma0 known") if known else words("pooled sigma0 {sigma0}", sigma0=f"{np.sqrt(result.variance):.4f}")
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


# ---- The comparison of two epochs as a page that needs nothing else.


class EpochResults(NamedTuple):
    """Summary and identity of an epoch as in ``results.json``, and its source."""

    place: str
    summary: dict[str, Any]
    identity: dict[str, Any]


def comparison_page(
    epochs: tuple[EpochResults, EpochResults],
    found: PointMovements,
    table: pl.DataFrame,
    verdict: list[str],
    known: bool,
    words: Words,
) -> str:
    """Verdict, both epochs side by side, the drawing of movements, and the table, what has moved first.

    ``known``: tests are those with σ0 known.
    """
    rows = sorted(table.to_dicts(), key=lambda row: not row["moved"])
    title = epochs[1].summary["title"] or words("Two epochs")
    moved = int(table["moved"].sum())
    return rendered(
        "epochs.html.j2",
        title,
        epochs[1].identity,
        words,
        _STYLES,
        **_headline(moved, table.height, words),
        verdict=verdict,
        facts=_facts(epochs, words),
        rows=[_cells(row, DIGITS[found.unit], known, words) for row in rows],
        unit=found.unit,
        drawing=movement_drawing(found, words),
    )


_STYLES = ("page.css", "certificate.css", "epochs.css")


def _headline(moved: int, count: int, words: Words) -> dict[str, str]:
    said = words("{count:point has|points have} moved, of {all}", count=moved, all=count)
    return {"headline": said if moved else words("Nothing has moved"), "state": "bad" if moved else "good"}


def _facts(epochs: tuple[EpochResults, EpochResults], words: Words) -> list[tuple[str, str, str]]:
    def said(of: EpochResults) -> dict[str, str]:
        data, sigma0 = of.summary, of.summary["sigma0"]
        return {
            "results": of.place,
            "title": data["title"] or "–",
            "operator": of.identity.get("operator") or "–",
            "measured": of.identity.get("measured") or "–",
            "input as of": of.identity.get("date") or "–",
            "program": of.identity.get("program", "–"),
            "observations n": str(data["observations"]),
            "unknowns u": str(data["unknowns"]),
            "redundancy n − u + d": str(data["redundancy"]),
            "σ0 a posteriori / a priori": fixed(sigma0["ratio_of_sigmas"], 3),
            "global test": words("accepted") if data["global_test"]["accepted"] else words("rejected"),
        }

    first, second = map(said, epochs)
    return [(words(name), first[name], second[name]) for name in first]


def _cells(row: dict[str, Any], places: int, known: bool, words: Words) -> dict[str, Any]:
    p, test = (row["p"], row["test"]) if known else (row["p_estimated"], row["test_estimated"])
    return {
        "point": row["point"],
        "movement": [fixed(row[f"d{axis}"], places) for axis in "xyz"],
        "sigma": [fixed(row[f"sd{axis}"], places) for axis in "xyz"],
        "length": fixed(sum(row[f"d{axis}"] ** 2 for axis in "xyz") ** 0.5, places),
        "test": fixed(test, 2),
        "p": "< 0.0001" if p is not None and p < 1e-4 else fixed(p, 4),
        "moved": row["moved"],
        "said": words("moved") if row["moved"] else "",
    }


# ---- Content of the page of two epochs, from their adjustments.


def epoch(place: Path, solved: Solved) -> EpochResults:
    """An epoch, with the identity its results had; of a project, which has none yet, that of its file."""
    file = place / "results.json" if place.is_dir() else place
    identity = identity_of(solved.network.project, RunIdentity())
    if file.name == "results.json" and file.is_file():
        note_input(file)
        identity |= json.loads(file.read_text(encoding="utf-8")).get("identity", {})
    return EpochResults(str(place), summary(solved), identity)


def moved(first: Solved, found: EpochComparison, table: pl.DataFrame) -> PointMovements:
    """Places of the first epoch, movements and covariances, in project axes."""
    M = first.network.edge.matrix
    tests = found.result.points
    places = first.adjustment.values["point"][blocks_of(first.network, found.names)]
    right, _, backwards = plan_axes(first.network.project.axes.xy)
    cofactors = np.array([test.cofactors for test in tests]).reshape(-1, 3, 3)
    return PointMovements(
        names=found.names,
        places=places @ M,
        movements=np.array([test.movement @ M for test in tests]).reshape(-1, 3),
        covariances=found.result.variance * (M.T @ cofactors @ M),
        moved=table["moved"].to_numpy(),
        unit=first.network.project.units.length,
        reversed=backwards,
        right=right,
    )


# ---- Movements of points in one adjustment of several epochs, as a page that needs nothing else.

MOST_SERIES = 60
"""Points whose movements are drawn against time, the most significant ones."""
MOST_ROWS = 300


def movements_page(solved: Solved, of: RunIdentity, words: Words) -> str:
    """Verdict, drawing of the movements from the first to the last epoch, curves against time, tables."""
    identity = identity_of(solved.network.project, of)
    title = solved.network.project.title or words("Movements of points")
    frame, project = movement_rows(solved), solved.network.project
    last = frame.group_by("point", maintain_order=True).last()
    moved = int(last["moved"].sum()) if last.height else 0
    length, drawing = project.units.length, Markup("")
    if last.height:
        drawing = movement_drawing(moved_points(point_table(solved), last, project.axes.xy, length), words)
    return rendered(
        "movements.html.j2",
        title,
        identity,
        words,
        _STYLES,
        **_headline(moved, last.height, words),
        statements=statements(solved, words),
        drawing=drawing,
        series=_series(solved, last),
        shown=MOST_SERIES,
        parameters=listed_parameters(solved, words, MOST_ROWS),
        movements=listed_movements(frame, length, words, MOST_ROWS),
    )


def _series(solved: Solved, last: pl.DataFrame) -> list[Any]:
    frame = movement_rows(solved)
    year = dict(zip(solved.network.motion.labels, solved.network.motion.times, strict=True))
    sizes = [float(frame[name].abs().max() or 0.0) for name in "xyz"] if frame.height else [0.0]  # type: ignore[arg-type]
    unit, factor = small_unit(solved.network.project.units.length, max(sizes) or 1.0)
    drawings = []
    for name in last.sort("p", nulls_last=True)["point"].head(MOST_SERIES):
        own = frame.filter(pl.col("point") == name)
        years = np.array([year[own["from"][0]], *(year[label] for label in own["to"])])
        values, sigma = (
            np.vstack([np.zeros(3), own.select(*(f"{s}{axis}" for axis in "xyz")).to_numpy()]) * factor
            for s in ("", "s")
        )
        drawings.append(series_drawing(f"{name} [{unit}]", years, values, sigma, unit, ("X", "Y", "Z")))
    return drawings
