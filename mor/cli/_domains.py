"""``mor adjust`` in domains: larger than memory, or by several workers."""

from __future__ import annotations

import gc
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import click

from mor.errors import InputError
from mor.errors import Problem as Mistake
from mor.input_files import is_folder

if TYPE_CHECKING:
    from mor.adjustment.domains.tree import Engine
    from mor.cli._progress import Progress
    from mor.domains.story import Outcomes
    from mor.input_files import ReadFile
    from mor.project.file.model import Project
    from mor.project.file.nodes import Document
    from mor.report.domains.summary import Summary
    from mor.report.identity import Identity
    from mor.report.results.reservation import Reservation
    from mor.report.words.language import Words


class Amount(click.ParamType):  # type: ignore[type-arg]
    """An amount of memory: 4GB, 800MB."""

    name = "size"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Bytes."""
        from mor.domains.room import size_of

        if isinstance(value, float):
            return value
        try:
            return size_of(str(value))
        except ValueError as error:
            self.fail(str(error), param, ctx)


class Wanted(NamedTuple):
    """What was asked for."""

    memory: float | None
    workers: int | None
    cluster: str | None
    scratch: Path | None
    snoop: bool = False
    html: bool | None = None

    @property
    def shared_out(self) -> bool:
        """True if workers are to do it."""
        return self.workers is not None or self.cluster is not None


class Results(NamedTuple):
    """How results are written, and told."""

    kind: Literal["csv", "parquet"]
    residuals: bool
    strict: bool
    quiet: bool
    words: Words
    options: tuple[str, ...]
    as_json: bool
    full: bool

    @property
    def listed(self) -> bool:
        """True if all residuals are written anywhere: into their table, or into the report."""
        return self.residuals or self.full


_SMALL = 100e6
"""Bytes of tables that fit into any memory: nobody looks any closer."""


def needs_domains(document: Document, folder: Path, wanted: Wanted) -> bool:
    """Return True if workers are asked for, or a project does not fit in the memory it may take.

    What nobody asked for is not done where something else was that domains do not do. Raises :class:`InputError`.
    """
    if wanted.workers is not None and wanted.cluster is not None:
        raise InputError([Mistake("--workers and --cluster together; give either of them")])
    if wanted.shared_out:
        return True
    if wanted.memory is None and _bytes_of_tables(document, folder) < _SMALL:
        return False
    from mor.domains.room import need_of_all, rays_of
    from mor.machine import available
    from mor.project.domains.refusals import refuse_unsupported, with_snooping
    from mor.project.file.validation import validate

    memory = wanted.memory if wanted.memory is not None else available()
    project = with_snooping(validate(document), wanted.snoop)
    snooping = project.settings.snooping
    if memory is None or need_of_all(rays_of(project, document, folder), wanted.html, snooping) <= memory:
        return False
    try:
        refuse_unsupported(project, document)
    except InputError:
        if wanted.memory is not None:
            raise
        return False
    return True


def _bytes_of_tables(document: Document, folder: Path) -> int:
    paths = [folder / name for name in document.table_files()]
    return sum(path.stat().st_size for path in paths if path.is_file())


def adjust_in_domains(
    document: Document,
    folder: Path,
    wanted: Wanted,
    place: Reservation | None,
    how: Results,
    say: Progress,
    files: Mapping[Path, ReadFile],
) -> int:
    """Adjust a project in domains, write and tell its results. Returns the exit code."""
    from mor.domains.results import exit_code
    from mor.domains.room import (
        check_scratch,
        has_page,
        need_of_scratch,
        rays_of,
        rays_of_domain,
        results_of_ray,
    )
    from mor.machine import available
    from mor.project.domains.parts import has_ground
    from mor.project.file.validation import validate
    from mor.report.domains.summary import verdict
    from mor.report.identity import Identity

    project = validate(document)
    rays = rays_of(project, document, folder)
    memory = wanted.memory or available() or 4e9
    size = rays_of_domain(rays, memory, wanted.workers or 1)
    html = False
    if place is not None:
        html = has_page(rays, memory, wanted.html) and how.residuals and has_library(say)
        say.notes(_without_page(rays, memory, wanted.html, html))
    with _scratch(wanted, place) as scratch:
        results = results_of_ray(how.kind, how.listed)
        check_scratch(need_of_scratch(rays, results, has_ground(project), _again(project, wanted)), scratch)
        with _engine(wanted, scratch, 2 * rays) as engine:
            found = _adjusted(engine, document, folder, scratch, size, memory, wanted.snoop, how, say)
        say.phase("writing")
        of = Identity(tuple(files.values()), folder, how.options)
        short = _written(found, of, scratch, place, how, html)
        code = exit_code(short, how.strict)
        written = str(place.folder) if place is not None else None
        say.event("done", outcome=short.outcome, exit_code=int(code), folder=written)
        if how.as_json:
            _print(scratch / "results.json")
    if not how.quiet or short.solution is None:
        click.echo(verdict(short, how.words), err=True)
        if place is not None:
            click.echo(how.words("results in {place}", place=place.folder), err=True)
    return code


def _again(project: Project, wanted: Wanted) -> bool:
    """Return True if adjustments follow the first one, whose state stays until they are solutions."""
    settings = project.settings
    weights = settings.robust is not None or settings.variance_components == "iterate"
    return wanted.snoop or settings.snooping or weights


def _written(
    found: Outcomes, of: Identity, scratch: Path, place: Reservation | None, how: Results, html: bool
) -> Summary:
    """Write the folder of results; what is printed of them is kept in the scratch folder, for it is read before."""
    from mor.domains.results import Told, content, printed, summary, write

    parts = scratch / "parts"
    together = content(found, parts, of)
    if how.as_json:
        with (scratch / "results.json").open("w", encoding="utf-8") as file:
            file.writelines(printed(found, parts, together))
    if place is not None:
        write(found, together, parts, place, Told(how.kind, how.residuals, how.words, html, of, how.full))
    return summary(found, together.results)


def _print(file: Path) -> None:
    """A text on standard output, once all else is done: whoever reads it has the whole of it, or nothing."""
    with file.open(encoding="utf-8") as text:
        while some := text.read(1 << 20):
            click.echo(some, nl=False)


def has_library(say: Progress) -> bool:
    """Return True if the chart library of the page is installed; says so where it is not."""
    from mor.report.html.library import library_path

    if library_path() is None:
        say.notes([Mistake("no report.html: the Python package plotly is missing (pip install plotly)")])
        return False
    return True


def _without_page(rays: int, memory: float, wanted: bool | None, html: bool) -> list[Mistake]:
    """The word that there is no page. Raises :class:`OutOfMemoryError` if it was asked for and has no room."""
    from mor.domains.room import MOST_ON_PAGE, need_of_page
    from mor.errors import OutOfMemoryError

    if html or wanted is False or (wanted is None and 2 * rays > MOST_ON_PAGE):
        return []
    need = need_of_page(rays)
    if need <= memory:
        return [Mistake("domains: a page (report.html) needs the table of all residuals: --tables all")]
    words = f"the page (report.html) takes about {need / 1e9:.2f} GB in one process"
    words = f"{words}, and {memory / 1e9:.2f} GB are allowed (--memory)"
    if wanted:
        raise OutOfMemoryError(words)
    return [Mistake(f"domains: no page: {words}")]


def _adjusted(
    engine: Engine,
    document: Document,
    folder: Path,
    scratch: Path,
    size: int,
    memory: float,
    snoop: bool,
    how: Results,
    say: Progress,
) -> Outcomes:
    """Divide, prepare, adjust and assess."""
    import numpy as np

    from mor.compilation import chosen_by_size
    from mor.domains.prepared import prepared
    from mor.domains.room import check_boundaries, need_of_domains, wide_borders
    from mor.domains.story import divided, solved
    from mor.machine import keep_freed_memory
    from mor.sparse.blas_threads import one_thread

    keep_freed_memory()
    say.phase("dividing")
    found = divided(document, folder, scratch, size, snoop)
    with chosen_by_size(2 * found.observations), one_thread(), np.errstate(all="ignore"):
        ready = prepared(engine, found, say.phase("reading", found.parts.count))
        say.notes(ready.notes)
        most = max(found.parts.rays)
        widest = ready.boundaries.widest
        check_boundaries([len(numbers) for numbers in ready.boundaries.numbers], widest, memory)
        need = need_of_domains(found.observations, most, widest)
        borders = f"the widest border has {widest} unknowns; about {need / 1e9:.2f} GB in one process"
        say.notes([Mistake(f"domains: {found.parts.count}, the largest with {most} image points; {borders}")])
        if wide_borders(widest, most):
            words = "its dense matrices take more time and room than the image points of a domain"
            say.notes(
                [Mistake(f"domains: borders are wide: {words}; long ties across the network make them so")]
            )
        say.inputs_are_known()
        say.phase("adjusting")
        parts = scratch / "parts"
        assessing = partial(say.phase, "precision and reliability")
        return solved(engine, ready, parts, how.kind, how.listed, say.iteration, assessing)


def check_scratch_folder(folder: Path | None) -> None:
    """Raise :class:`InputError` if the folder for the state of the domains is none."""
    if folder is not None and not is_folder(folder):
        words = "this is no folder, expected one for the state of the domains"
        raise InputError([Mistake(words, str(folder))])


@contextmanager
def _scratch(wanted: Wanted, place: Reservation | None) -> Iterator[Path]:
    """A folder for the state of the domains: where it is wanted, or beside the results; it goes at the end.

    Without results in a folder it is among the temporary files of the system.
    """
    above = wanted.scratch or (place.work if place is not None else Path(tempfile.gettempdir()))
    check_scratch_folder(above)
    folder = Path(tempfile.mkdtemp(prefix="mor-domains-", dir=above.resolve()))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _engine(wanted: Wanted, scratch: Path, observations: int) -> Iterator[Engine]:
    """Who does the tasks."""
    from mor.adjustment.domains.store import FileStore
    from mor.adjustment.domains.tree import Here

    store = FileStore(scratch / "state")
    if wanted.workers is None and wanted.cluster is None:
        with _kept_apart():
            yield Here(store)
        return
    from mor.cluster import connected
    from mor.domains.workers import Workers

    with connected(store.folder, wanted.cluster, wanted.workers, wanted.memory) as cluster:
        yield Workers(store, cluster, observations)


@contextmanager
def _kept_apart() -> Iterator[None]:
    """What is there stays: only what domains leave behind is looked through for garbage between them."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
