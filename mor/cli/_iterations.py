"""Iterations on the terminal: a live table, or one plain line for each where nobody looks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from mor.adjustment.solve import Iteration

MOST = 8
"""Iterations a table shows unless all are asked for: the result has to stay on one screen with them."""


def iteration_line(step: Iteration) -> str:
    """One iteration as plain text."""
    sigma0 = (
        f"sigma0 / a priori {step.sigma0:.6g}" if step.sigma0 is not None else f"vTPv {step.objective:.6g}"
    )
    return f"iteration {step.number}: {sigma0}, largest change {step.largest_change:.3g} sigma, {_step(step)}"


def iteration_table(steps: Sequence[Iteration], title: str, most: int | None = MOST) -> Table:
    """Number, σ0, largest change in units of σ and length of step: of many iterations the first and the last ones."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("iteration", "σ0 / a priori", "largest change [σ]", "step"):
        table.add_column(name, justify="right")
    left_out = range(1, len(steps) - most + 2) if most is not None and len(steps) > most else range(0)
    for number, step in enumerate(steps):
        if number in left_out:
            if number == 1:
                table.add_row(*"…" * 4)
            continue
        sigma0 = "–" if step.sigma0 is None else f"{step.sigma0:.6g}"
        table.add_row(str(step.number), sigma0, f"{step.largest_change:.3g}", _step(step))
    return table


def _step(step: Iteration) -> str:
    return f"damping {step.damping:.0e}" if step.damping else "full step"
