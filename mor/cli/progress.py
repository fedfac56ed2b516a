"""Progress on the console."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.errors import Message, screenful
from mor.report.language import ENGLISH, Words

if TYPE_CHECKING:
    from rich.status import Status
    from rich.table import Table

    from mor.output_files import EventFile
    from mor.project.document import Document
    from mor.solve.iterate import Iteration


# ---- Iterations on the terminal: a live table, or one plain line for each where nobody looks.

MOST = 8
"""Iterations a table shows unless all are asked for: the result has to stay on one screen with them."""


def iteration_line(step: Iteration, words: Words = ENGLISH) -> str:
    """One iteration as plain text."""
    sigma0 = (
        words("sigma0 / a priori {value}", value=f"{step.sigma0:.6g}")
        if step.sigma0 is not None
        else f"vTPv {words.number(f'{step.objective:.6g}')}"
    )
    said = "iteration {number}: {sigma0}, largest change {change} sigma, {step}"
    return words(said, number=step.number, sigma0=sigma0, change=f"{step.largest_change:.3g}", step=_step(step, words))


def iteration_table(steps: Sequence[Iteration], title: str, most: int | None = MOST, words: Words = ENGLISH) -> Table:
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
        table.add_row(str(step.number), sigma0, words.number(f"{step.largest_change:.3g}"), _step(step, words))
    return table


def _step(step: Iteration, words: Words) -> str:
    return words("damping {value}", value=f"{step.damping:.0e}") if step.damping else words("full step")


# ---- Progress on standard error: a live line on a terminal, plain lines in pipes and in CI when asked for.


@dataclass
class Progress:
    """Says what is going on."""

    quiet: bool
    verbose: bool
    status: Status | None = None
    name: str = ""
    """The phase that runs."""
    events: EventFile | None = None
    """Where events go as JSON Lines, for programs that watch."""
    steps: list[Iteration] = field(default_factory=list)
    """Iterations of this phase."""
    words: Words = ENGLISH
    """Language of the messages; events are the same in every language."""
    most_notes: int | None = None
    """Notes that are shown."""
    told: int = 0
    """Notes there were."""
    begun: list[tuple[str, float]] = field(default_factory=list)
    """Phases, each with the time at which it began."""

    def event(self, kind: str, /, **data: object) -> None:
        """Tell a watching program what happened: one line, at once."""
        if self.events is not None:
            self.events.write(json.dumps({"event": kind, **data}, ensure_ascii=False, allow_nan=False) + "\n")

    def inputs_are_known(self) -> None:
        """All inputs have been read: from here on events may replace an existing file."""
        if self.events is not None:
            self.events.inputs_are_known()

    def phase(self, name: str, total: int = 0) -> Callable[[int], None]:
        """A new phase begins; what is returned counts what is done of a ``total``."""
        self.name = self.words.listed(name)
        self.begun.append((self.name, time.monotonic()))
        self.event("phase", name=name)
        if self.status is not None and self.steps and self.verbose:
            self.status.console.print(iteration_table(self.steps, self.words("adjusted"), most=None, words=self.words))
        self.steps.clear()
        if self.status is not None:
            self.status.update(f"{self.name} …")
        elif self.verbose and not self.quiet:
            click.echo(f"{self.name} …", err=True)
        return self.counter(total)

    def durations(self) -> str:
        """The phases so far with their durations, in a line."""
        ends = [at for _, at in self.begun[1:]] + [time.monotonic()]
        parts = [f"{name} {end - at:.1f} s" for (name, at), end in zip(self.begun, ends, strict=True)]
        return self.words("duration of the phases: {phases}", phases=", ".join(parts))

    def counter(self, total: int) -> Callable[[int], None]:
        """Counts what is done of a phase, and shows how much is left of it and for how long."""
        done, shown, begun = 0, 0, time.monotonic()
        name, lock = self.name, threading.Lock()

        def more(count: int) -> None:
            nonlocal done, shown
            with lock:  # the passes over the rays count from several threads
                done += count
                share = 100 * done // max(total, 1)
                if self.status is not None and shown < share <= 100:
                    shown = share
                    left = f"{(time.monotonic() - begun) * (total - done) / done:.0f}"
                    told = self.words("{name}: {share} %, {left} s left", name=name, share=share, left=left)
                    self.status.update(f"{told}  {'━' * (share // 5)}{'╌' * (20 - share // 5)}")

        return more

    def table_counter(self, document: Document, folder: Path) -> Callable[[str | None], None]:
        """Counts the tables of a project that are read, by the sizes of their files."""
        sizes = {name: path.stat().st_size for name in document.table_files() if (path := folder / name).is_file()}
        more = self.counter(sum(sizes.values()))
        return lambda name: more(sizes.get(name or "", 0))

    def notes(self, notes: Iterable[Message]) -> None:
        """Print notes of a reader, at most one screen of them."""

        told = list(notes)
        for note in told:
            self.event("note", message=note.message, file=note.file, line=note.line)
        shown = told if self.most_notes is None else told[: max(0, self.most_notes - self.told)]
        self.told += len(told)
        for note in () if self.quiet else screenful(shown, "--events FILE"):
            click.echo(self.words("note: {text}", text=note._replace(message=self.words.told(note.message))), err=True)

    def note(self, words: str, /, **values: object) -> None:
        """Something the user should know, with values for the places in braces."""
        self.event("note", message=words.format(**values), file="", line=0)
        self.told += 1
        if not self.quiet and (self.most_notes is None or self.told <= self.most_notes):
            click.echo(self.words("note: {text}", text=self.words(words, **values)), err=True)

    def iteration(self, step: Iteration) -> None:
        """One iteration is done."""
        self.event(
            "iteration",
            number=step.number,
            objective=step.objective,
            largest_change=step.largest_change,
            damping=step.damping,
        )
        self.steps.append(step)
        if self.status is not None:
            self.status.update(iteration_table(self.steps, f"{self.words('adjusting')} …", words=self.words))
        elif self.verbose and not self.quiet:
            click.echo(iteration_line(step, self.words), err=True)


@contextmanager
def progress(
    quiet: bool, verbose: bool, events: EventFile | None = None, words: Words = ENGLISH, most_notes: int | None = None
) -> Iterator[Progress]:
    """Progress of one command; a live line only on a terminal."""
    said = Progress(quiet, verbose, events=events, words=words, most_notes=most_notes)
    if quiet or not sys.stderr.isatty():
        yield said
        return
    from rich.console import Console

    with Console(stderr=True).status(f"{words('starting')} …") as said.status:
        yield said
