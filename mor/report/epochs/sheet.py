"""The comparison of two epochs as a page that needs nothing else."""

from __future__ import annotations

from typing import Any, NamedTuple

import polars as pl
from markupsafe import Markup

from mor.report.epochs.drawing import Moved, movement_drawing
from mor.report.html.page import asset, environment
from mor.report.html.paper import running_heads
from mor.report.layout import DIGITS, fixed
from mor.report.words.language import ENGLISH, Words


class Epoch(NamedTuple):
    """Summary and identity of an epoch as in ``results.json``, and its source."""

    place: str
    summary: dict[str, Any]
    identity: dict[str, Any]


def comparison_page(
    epochs: tuple[Epoch, Epoch],
    found: Moved,
    table: pl.DataFrame,
    verdict: list[str],
    known: bool,
    words: Words = ENGLISH,
) -> str:
    """Verdict, both epochs side by side, the drawing of movements, and the table, what has moved first.

    ``known``: tests are those with σ0 known.
    """
    rows = sorted(table.to_dicts(), key=lambda row: not row["moved"])
    title = epochs[1].summary["title"] or words("Two epochs")
    moved = int(table["moved"].sum())
    return (
        environment()
        .get_template("epochs.html.j2")
        .render(
            title=title,
            headline=words("{count:point has|points have} moved, of {all}", count=moved, all=table.height)
            if moved
            else words("Nothing has moved"),
            state="bad" if moved else "good",
            verdict=verdict,
            facts=_facts(epochs, words),
            rows=[_cells(row, DIGITS[found.unit], known, words) for row in rows],
            unit=found.unit,
            drawing=movement_drawing(found, words),
            identity=epochs[1].identity,
            say=words,
            style=Markup(asset("page.css") + asset("certificate.css") + asset("epochs.css")),
            running=running_heads(title, epochs[1].identity, words),
        )
    )


def _facts(epochs: tuple[Epoch, Epoch], words: Words) -> list[tuple[str, str, str]]:
    """Rows of what was compared: name, first epoch, second epoch."""

    def said(of: Epoch) -> dict[str, str]:
        data, sigma0 = of.summary, of.summary["sigma0"]
        test = data["global_test"]
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
            "global test": words("accepted") if test["accepted"] else words("rejected"),
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
