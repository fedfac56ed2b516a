"""The ranking of a plan as a table, and its first lines in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from mor.project.network.build import Network
from mor.quality.design.ranking import Ranked, Step
from mor.quality.design.shortfall import Outcome
from mor.report.layout import heading, short, table
from mor.report.tables.observations import named_places
from mor.report.words.language import Words

SHOWN = 10
"""Observations of each kind that the text names."""
_SCHEMA = {
    **dict.fromkeys(("kind", "type", "group", "at", "from", "to"), pl.String),
    "rank": pl.Int64,
    "measurements": pl.Int64,
    "shortfall": pl.Float64,
    "rms_sigma": pl.Float64,
    "largest_sigma_ratio": pl.Float64,
    "smallest_r": pl.Float64,
    "possible": pl.Boolean,
}


def now_row(now: Outcome, network: Network) -> dict[str, Any]:
    """Return the row of the unchanged plan; ``rms_sigma`` is in parts of the limits, or in the length unit."""
    return {
        "shortfall": float(now.shortfall[0]),
        "rms_sigma": float(np.sqrt(now.precision[0])),
        "rms_sigma_unit": _unit(now, network) or "limit",
        "largest_sigma_ratio": _number(float(now.largest_ratio[0])),
        "smallest_r": _number(float(now.smallest_r[0])),
    }


def ranking_table(
    network: Network, planned: Sequence[Ranked], candidates: Sequence[Ranked], steps: Sequence[Step]
) -> pl.DataFrame:
    """All of them: ``spare`` for planned observations, ``add`` for candidates, ``greedy`` for the choices in turn."""
    texts: dict[tuple[bool, int], dict[str, pl.Series]] = {}
    rows = [
        *(_row(network, "spare", k, one, one.unit.cost, texts) for k, one in enumerate(planned, start=1)),
        *(_row(network, "add", k, one, one.unit.cost, texts) for k, one in enumerate(candidates, start=1)),
        *(_row(network, "greedy", k, one.ranked, one.measurements, texts) for k, one in enumerate(steps, 1)),
    ]
    return pl.DataFrame(rows, schema=_SCHEMA, orient="row")


def _row(
    network: Network,
    kind: str,
    rank: int,
    one: Ranked,
    measurements: int,
    texts: dict[tuple[bool, int], dict[str, pl.Series]],
) -> tuple[Any, ...]:
    """A row of the table; ``texts`` keeps the names of each group."""
    unit = one.unit
    group = (network.candidates if unit.is_candidate else network.groups)[unit.group]
    key = (unit.is_candidate, unit.group)
    if key not in texts:
        texts[key] = {name: column.texts() for name, column in named_places(group).items()}
    places = [texts[key][name][unit.row] if name in texts[key] else "" for name in ("at", "from", "to")]
    numbers = (
        one.shortfall,
        float(np.sqrt(max(one.precision, 0.0))),
        _number(one.largest_ratio),
        _number(one.smallest_r),
    )
    said = numbers if one.possible else (None,) * len(numbers)
    return (kind, group.type.name, group.name, *places, rank, measurements, *said, one.possible)


def _unit(now: Outcome, network: Network) -> str:
    """Length unit of the mean σ; empty if σ are required, for then it is in parts of their limits."""
    return "" if np.isfinite(now.largest_ratio[0]) else network.project.units.length


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None


def ranking_text(frame: pl.DataFrame, now: Outcome, network: Network, unestimable: int, words: Words) -> str:
    """Return the changes that lose least, those that gain most, and the greedy plan as text."""
    lines = [
        heading(words("What observations are worth")),
        words(
            "As it is: shortfall {shortfall}, {name} {sigma}, worst / limit {ratio}, smallest r {r}.",
            shortfall=short(float(now.shortfall[0]), 4),
            name=words.header(_rms(now, network)),
            sigma=short(float(np.sqrt(now.precision[0])), 5),
            ratio=short(float(now.largest_ratio[0]), 4),
            r=short(float(now.smallest_r[0]), 4),
        ),
        words(
            "The shortfall is 0 where all that is required is reached. Each line tells what the plan is with this "
            "one change; ranking.csv has all of them."
        ),
    ]
    for kind, title in (
        ("spare", "Without it (the most easily spared first)"),
        ("add", "With it besides (the most useful first)"),
        ("greedy", "Chosen one after the other, with all before it"),
    ):
        some = frame.filter(pl.col("kind") == kind)
        shown = some if kind == "greedy" else some.head(SHOWN)
        if some.height:
            lines += ["", f"{words(title)}:", _lines(shown, _rms(now, network), words)]
    lost = frame.filter(~pl.col("possible") & (pl.col("kind") == "spare")).height
    if lost:
        said = "{count:observation|observations} cannot be spared: something would be undetermined."
        lines += ["", words(said, count=lost)]
    beyond = frame.filter(~pl.col("possible") & (pl.col("kind") == "add")).height
    if beyond:
        said = "Of {count:candidate|candidates} nothing can be said: such a sight is far outside of any measurement."
        lines += ["", words(said, count=beyond)]
    if not frame.filter(pl.col("kind") == "spare").height:
        lines += ["", words("In so large a block candidates alone are ranked.")]
    if unestimable:
        said = (
            "{count:candidate is|candidates are} not ranked: it would settle a free movement of the network, "
            "so that the datum would be another one."
        )
        lines += ["", words(said, count=unestimable)]
    return "\n".join(lines)


def _rms(now: Outcome, network: Network) -> str:
    unit = _unit(now, network)
    return f"rms sigma [{unit}]" if unit else "rms / limit"


def _lines(frame: pl.DataFrame, rms: str, words: Words) -> str:
    rows = [
        [
            row["type"],
            " ".join(row[key] for key in ("at", "from", "to") if row[key]),
            str(row["measurements"]),
            short(row["shortfall"], 4),
            short(row["rms_sigma"], 5),
            short(row["largest_sigma_ratio"], 4),
            short(row["smallest_r"], 4),
        ]
        for row in frame.to_dicts()
    ]
    headers = ["type", "between", "n", "shortfall", "worst / limit", "smallest r"]
    return table([*headers[:4], rms, *headers[4:]], rows, 2, words, margin=2)
