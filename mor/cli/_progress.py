"""Progress on standard error: a live line on a terminal, plain lines in pipes and in CI when asked for."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

if TYPE_CHECKING:
    from rich.status import Status

    from mor.adjustment.solve import Iteration
    from mor.errors import Problem
    from mor.project.nodes import Document


@dataclass
class Progress:
    """Says what is going on."""

    quiet: bool
    verbose: bool
    status: Status | None = None
    name: str = ""
    """The phase that runs."""
    events: TextIO | None = None
    """Where events go as JSON Lines, for programs that watch."""

    def event(self, kind: str, /, **data: object) -> None:
        """Tell a watching program what happened: one line, at once."""
        if self.events is not None:
            line = json.dumps({"event": kind, **data}, ensure_ascii=False, allow_nan=False)
            self.events.write(line + "\n")
            self.events.flush()

    def phase(self, name: str) -> None:
        """A new phase begins."""
        self.name = name
        self.event("phase", name=name)
        if self.status is not None:
            self.status.update(f"{name} …")
        elif self.verbose and not self.quiet:
            click.echo(f"{name} …", err=True)

    def counter(self, total: int) -> Callable[[int], None]:
        """Counts what is done of a phase, and shows how much is left of it and for how long."""
        done, begun = 0, time.monotonic()
        name = self.name

        def more(count: int) -> None:
            nonlocal done
            done += count
            if self.status is not None and 0 < done <= total:
                left = (time.monotonic() - begun) * (total - done) / done
                self.status.update(f"{name}: {100 * done // total} %, {left:.0f} s left")

        return more

    def table_counter(self, document: Document, folder: Path) -> Callable[[str | None], None]:
        """Counts the tables of a project that are read, by the sizes of their files."""
        sizes = {
            name: path.stat().st_size for name in document.table_files() if (path := folder / name).is_file()
        }
        more = self.counter(sum(sizes.values()))
        return lambda name: more(sizes.get(name or "", 0))

    def notes(self, notes: Iterable[Problem]) -> None:
        """What a reader left out or decided on its own."""
        for note in notes:
            self.event("note", message=note.message, file=note.file, line=note.line)
            if not self.quiet:
                click.echo(f"note: {note}", err=True)

    def note(self, words: str) -> None:
        """Something the user should know."""
        self.event("note", message=words, file="", line=0)
        if not self.quiet:
            click.echo(f"note: {words}", err=True)

    def iteration(self, step: Iteration) -> None:
        """One iteration is done."""
        self.event(
            "iteration",
            number=step.number,
            objective=step.objective,
            largest_change=step.largest_change,
            damping=step.damping,
        )
        words = (
            f"iteration {step.number}: vTPv {step.objective:.6g}, largest change {step.largest_change:.3g} sigma"
            + (f", damping {step.damping:.0e}" if step.damping else "")
        )
        if self.verbose and not self.quiet:
            (self.status.console.print if self.status else _to_stderr)(words)
        elif self.status is not None:
            self.status.update(words)


def _to_stderr(words: str) -> None:
    click.echo(words, err=True)


@contextmanager
def progress(quiet: bool, verbose: bool, events: TextIO | None = None) -> Iterator[Progress]:
    """Progress of one command; a live line only on a terminal."""
    if quiet or not sys.stderr.isatty():
        yield Progress(quiet, verbose, events=events)
        return
    from rich.console import Console

    with Console(stderr=True).status("starting …") as status:
        yield Progress(quiet, verbose, status, events=events)
