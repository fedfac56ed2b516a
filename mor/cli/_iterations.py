"""Iterations on the terminal: a live table, or one plain line for each where nobody looks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mor.report.words.language import ENGLISH, Words

if TYPE_CHECKING:
    from rich.table import Table

    from mor.adjustment.state import Iteration

MOST = 8
"""Iterations a table shows unless all are asked for: the result has to stay on one screen with them."""


def iteration_line(step: Iteration, words: Words = ENGLISH) -> str:
    """One iteration as plain text."""
    sigma0 = (
        words("sigma0 / a priori {value}", value=f"{step.sigma0:.6g}")
        if step.sigma0 is not None
        else f"vTPv {words.number(f'{step.objective:.6g}')}"
    )
    return words(
        "iteration {number}: {sigma0}, largest change {change} sigma, {step}",
        number=step.number,
        sigma0=sigma0,
        change=f"{step.largest_change:.3g}",
        step=_step(step, words),
    )


def iteration_table(
    steps: Sequence[Iteration], title: str, most: int | None = MOST, words: Words = ENGLISH
) -> Table:
    """Number, σ0, largest change in units of σ and length of step: of many iterations the first and the last ones."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    headers = ["iteration", "σ0 / a priori", "largest change [σ]", "step"]
    for name in headers:
        table.add_column(words.header(name), justify="right")
    left_out = range(1, len(steps) - most + 2) if most is not None and len(steps) > most else range(0)
    for number, step in enumerate(steps):
        if number in left_out:
            if number == 1:
                table.add_row(*"…" * 4)
            continue
        sigma0 = "–" if step.sigma0 is None else words.number(f"{step.sigma0:.6g}")
        change = words.number(f"{step.largest_change:.3g}")
        table.add_row(str(step.number), sigma0, change, _step(step, words))
    return table


def _step(step: Iteration, words: Words) -> str:
    return words("damping {value}", value=f"{step.damping:.0e}") if step.damping else words("full step")
