"""``mor adjust``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from pathlib import Path
from tempfile import gettempdir
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import click

from mor.cli.console import language_option, tell
from mor.cli.options import (
    InputPath,
    MemorySize,
    OutputPath,
    cluster_option,
    format_option,
    kernels_option,
    only_project,
    output_option,
    quiet_option,
)
from mor.errors import MOST_TOLD, ExitCode, InputError, Message, NoStartValuesError

if TYPE_CHECKING:
    from mor.cli.progress import Progress
    from mor.project.document import Document
    from mor.quality.solution import Solved
    from mor.report.identity import RunIdentity
    from mor.report.language import Words
    from mor.report.output_folder import Reservation
    from mor.report.results import Choice
    from mor.solve.cluster import ComputeCluster


class Asked(NamedTuple):
    """Options of the command line."""

    project: Path
    output: Path | None
    force: bool
    source_format: str | None
    as_json: bool
    strict: bool
    snoop: bool
    lang: str
    full: bool
    html: bool | None
    tables: Literal["none", "worst", "all"] | None
    table_format: Literal["csv", "parquet"] | None
    memory: float | None
    scratch: Path | None
    workers: int | None
    cluster: str | None
    events: Path | None
    quiet: bool
    verbose: bool

    @property
    def writes(self) -> bool:
        """False if results are only printed."""
        return self.output is not None or not self.as_json

    @property
    def folder(self) -> Path:
        """The folder of the results."""
        from mor.report.output_folder import folder_beside

        return self.output or folder_beside(self.project, ".results")

    @property
    def told(self) -> tuple[str, ...]:
        """The options on which the numbers depend, as the report repeats them."""
        of_format = ("--from", self.source_format) if self.source_format else ()
        return (*(("--snoop",) if self.snoop else ()), *of_format)


@contextmanager
def workers_of(asked: Asked, scratch: Path) -> Iterator[Callable[[], ComputeCluster | None]]:
    """Yield a function that returns the workers that were asked for; those of this machine start when it is called.

    Raises :class:`InputError` if they cannot do the work, and so does the function.
    """
    if asked.workers is None and asked.cluster is None:
        yield lambda: None
        return
    if asked.workers is not None and asked.cluster is not None:
        raise InputError([Message("--workers and --cluster together; give either of them")])
    from mor.solve.cluster import connected, local

    with ExitStack() as held:
        if asked.workers is not None:
            yield cache(partial(held.enter_context, local(asked.workers, scratch)))
        else:
            there = held.enter_context(connected(None, asked.cluster or ""))
            yield lambda: there


@click.command(name="adjust")
@click.argument("project", type=InputPath(), default=".")
@output_option("Folder for the results.", "PROJECT.results")
@click.option("-f", "--force", is_flag=True, help="Replace existing results of other input or options.")
@format_option
@click.option(
    "--json", "as_json", is_flag=True, help="Print results.json on standard output; write files only with -o."
)
@click.option("--strict", is_flag=True, help="Exit with 1 if the global test rejects or an observation is flagged.")
@click.option(
    "--snoop", is_flag=True, help="Data snooping: exclude flagged observations one by one until none is flagged."
)
@language_option("report.txt, report.html and the terminal")
@click.option("--full", is_flag=True, help="List all points and all observations in report.txt.")
@click.option(
    "--html/--no-html",
    default=None,
    show_default="html up to 200 000 observations",
    help="Write report.html, the report for the browser.",
)
@click.option(
    "--tables",
    type=click.Choice(["none", "worst", "all"]),
    show_default="all; worst above 2 million observations",
    help="Tables of results: none; points, images and the largest residuals (worst); or all.",
)
@click.option(
    "--table-format",
    type=click.Choice(["csv", "parquet"]),
    show_default="csv; parquet for tables of more than 200 000 rows",
    help="Format of the tables.",
)
@click.option(
    "--memory",
    metavar="SIZE",
    type=MemorySize(),
    show_default="the available memory",
    help="Memory that mor may use, e.g. 4GB; if it is not enough, long arrays are kept in files.",
)
@click.option(
    "--scratch",
    metavar="FOLDER",
    type=InputPath(),
    show_default="beside the results",
    help="Folder for the files of long arrays.",
)
@click.option(
    "--workers",
    metavar="N",
    type=click.IntRange(min=1),
    help="Processes that do the passes over a million image points or more (needs mor-adjustment[dask]).",
)
@cluster_option
@click.option(
    "--events",
    metavar="FILE",
    type=OutputPath(),
    help="Write phases and iterations as JSON Lines while mor works; - is standard output.",
)
@kernels_option
@quiet_option
@click.option(
    "-v", "--verbose", is_flag=True, help="Print the phases and their times, all notes, the groups and every iteration."
)
def command(**given: Any) -> int:
    """Adjust PROJECT and write reports, results and tables.

    \b
    Examples:
      mor adjust project.yaml
      mor adjust project.yaml -o results --force --snoop
      mor adjust project.yaml --lang de --tables all --table-format parquet
      mor adjust project.yaml --strict --quiet || echo "look at the report"
      mor adjust project.yaml --json --quiet | jq .sigma0.aposteriori
      mor adjust network.dat --from starnet --memory 4GB
      mor adjust - < project.yaml

    PROJECT is a project file (.yaml), a file of another program that mor convert can read, or a folder with one
    project file; the default is the current folder. - is standard input: paths of tables are relative to the current
    folder, and results go to stdin.results. Missing start values are computed.

    \b
    Exit codes: 0 done; 1 rejected (--strict), or suspects excluded; 2 input; 3 not converged;
    4 singular; 5 memory.
    """
    return run(Asked(**given))


def run(asked: Asked) -> int:
    """Adjust a project and write what was asked for; the exit code."""
    asked = asked._replace(project=only_project(asked.project, asked.source_format))
    from mor.api.pipeline import read_document
    from mor.cli.progress import progress
    from mor.input_files import files_read
    from mor.linalg.compilation import notes_told_by
    from mor.long_arrays import limited_memory
    from mor.output_files import lines_into
    from mor.report.identity import RunIdentity
    from mor.report.language import words_of
    from mor.report.output_folder import is_repeated, reserve
    from mor.report.results import usual_files, write_results
    from mor.solve.engine import shared_among

    project, folder, words = asked.project, asked.folder, words_of(asked.lang)
    # Notes that are shown unless all are asked for.
    most_notes = 3
    with ExitStack() as held:
        files = held.enter_context(files_read())
        events = held.enter_context(lines_into(asked.events, asked.force))
        most = None if asked.verbose else most_notes
        say = held.enter_context(progress(asked.quiet, asked.verbose, events, words, most))
        held.enter_context(notes_told_by(say.note))
        say.phase("reading")
        document = read_document(project, asked.source_format or "")
        replaces = asked.force or is_repeated(folder, project, asked.told)
        names = usual_files(asked.tables, asked.table_format)
        place = held.enter_context(reserve(folder, replaces, names)) if asked.writes else None
        scratch = asked.scratch or (place.work if place is not None else Path(gettempdir()))
        held.enter_context(limited_memory(asked.memory, scratch))
        with named_in_full(place), workers_of(asked, scratch) as workers, shared_among(workers):
            solved = adjusted(document, project.parent, asked.snoop, say)
        of = RunIdentity(tuple(files.values()), project.parent, asked.told)
        say.phase("writing")
        if place is not None:
            write_results(solved, document, of, place, chosen(asked, solved, say))
        said = on_screen(asked, solved, words)  # of what the reports have found already, beside the tables
        if say.told > most_notes and said and not asked.verbose:
            more = say.told - most_notes
            said += "\n" + words("and {count:more note|more notes}; --verbose shows all", count=more)
        if said and asked.verbose:
            said += "\n" + say.durations()
        code = exit_code(solved, asked.strict)
        written = str(folder) if asked.writes else None
        say.event("done", outcome=solved.adjustment.outcome.value, exit_code=int(code), folder=written)
    show(asked, solved, of, said)
    return code


def on_screen(asked: Asked, solved: Solved, words: Words) -> str:
    """The result on one screen; nothing of a solution where quiet was asked for."""
    from mor.report.text import screen

    if asked.quiet and solved.quality is not None:
        return ""
    told = [
        screen(solved, words, asked.verbose),
        *([words("results in {place}", place=asked.folder)] if asked.writes else []),
    ]
    return "\n".join(told)


def show(asked: Asked, solved: Solved, of: RunIdentity, said: str) -> None:
    """Print the results to standard output and the summary to the terminal, with the outcome in colour there."""
    from mor.report.output_folder import to_json
    from mor.report.results import results

    if asked.as_json:
        click.echo(to_json(results(solved, {}, of)), nl=False)
    if said:
        first, *rest = said.split("\n")
        good = exit_code(solved, strict=False) is ExitCode.DONE and solved.accepted
        click.echo("\n".join([click.style(first, bold=True, fg="green" if good else "red"), *rest]), err=True)


@contextmanager
def named_in_full(place: Reservation | None) -> Iterator[None]:
    """Things without start values that do not fit on a screen are named in a table in the folder of the results."""

    try:
        yield
    except NoStartValuesError as error:
        if place is not None and len(error.things) >= MOST_TOLD:
            from mor.report.results import write_undeterminable

            write_undeterminable(error.things, place)
            tell(f"all of them are listed in {place.folder / 'undetermined.csv'}:")
        raise


def adjusted(document: Document, folder: Path, snoop: bool, say: Progress) -> Solved:
    """Solve a project whose tables are in the folder."""
    from mor.api.pipeline import read_network
    from mor.api.project import Project
    from mor.api.result import adjust

    look_ahead(document, folder)
    network = read_network(document, folder, say.table_counter(document, folder))
    say.notes(network.notes)
    say.inputs_are_known()
    say.phase("adjusting")
    project = Project(document, network, folder)
    solved = adjust(project, snoop, say.iteration, lambda effort: say.phase("precision and reliability", effort)).solved
    say.notes(solved.network.notes[len(network.notes) :])
    return solved


def rows_of_parquet(path: Path) -> int:
    """Number of rows of a Parquet file; 0 of any other one, or if it cannot be read, which is told when it is read."""
    import polars as pl

    if path.suffix.lower() != ".parquet":
        return 0
    try:
        return int(pl.scan_parquet(path).select(pl.len()).collect().item())
    except (pl.exceptions.PolarsError, OSError):
        return 0


def look_ahead(document: Document, folder: Path) -> None:
    """By the sizes of the tables: refuse what memory cannot hold, begin to load what many observations will need."""
    from mor.linalg.compilation import WORTH_COMPILING, load_ahead
    from mor.long_arrays import is_limited
    from mor.machine import check_room

    files = [path for name in document.table_files() if (path := folder / name).is_file()]
    size = sum(path.stat().st_size for path in files if path.suffix.lower() == ".csv")
    rows = sum(map(rows_of_parquet, files))
    # Bytes of memory, measured: a byte of a CSV table takes 5 (its rows as arrays and its texts), a row of Parquet 150,
    # or 100 where long arrays are in files.
    room = 5 * size + (100 if is_limited() else 150) * rows
    check_room(float(room), "reading the tables", "fewer observations at a time")
    # An observation takes at most 60 bytes of the CSV tables, or two rows of Parquet, its points among them.
    if size + 30 * rows >= 60 * WORTH_COMPILING:
        load_ahead()


def chosen(asked: Asked, solved: Solved, say: Progress) -> Choice:
    """Choose the files to write, by the options or the size of the result, and add notes about omitted ones."""
    from mor.machine import check_room
    from mor.report.results import FEWER, MOST_OF_PAGE, Choice, entries, memory_of_reports, tables_by_size

    say.notes(left_out(solved, asked.tables, asked.html))
    page = asked.html if asked.html is not None else entries(solved) <= MOST_OF_PAGE
    tables = asked.tables or tables_by_size(solved)
    check_room(memory_of_reports(solved.network, page, tables), "writing the reports", FEWER)
    return Choice(
        tables=tables,
        kind=asked.table_format,
        html=page and has_library(say),
        language=asked.lang,
        full=asked.full,
        done=say.counter(entries(solved)),
    )


def has_library(say: Progress) -> bool:
    """Return whether the chart library of the page is installed, and note if it is not."""
    from mor.report.page_data import library_path

    if library_path() is None:
        say.notes([Message("no report.html: the Python package plotly is missing (pip install plotly)")])
        return False
    return True


def left_out(solved: Solved, tables: str | None, html: bool | None) -> list[Message]:
    """Notes about files that are omitted because the project is large."""
    from mor.report.results import MOST_OF_PAGE, WORST, entries, is_large

    if solved.quality is None:
        return []
    notes = []
    if tables is None and is_large(solved):
        notes.append(
            Message(f"only the {WORST} worst residuals are written because of their number; --tables all writes all")
        )
    if html is None and entries(solved) > MOST_OF_PAGE:
        notes.append(Message("no report.html because of the number of observations; mor report writes it"))
    return notes


def exit_code(solved: Solved, strict: bool) -> ExitCode:
    """The documented exit code of an outcome."""
    from mor.solve.iterate import Outcome

    quality = solved.quality
    if solved.adjustment.outcome is Outcome.SINGULAR:
        return ExitCode.SINGULAR
    if quality is None:
        return ExitCode.NOT_CONVERGED
    if solved.suspects is not None:
        return ExitCode.REJECTED
    rejected = not solved.accepted or any(flags.any() for flags in quality.flagged)
    return ExitCode.REJECTED if strict and rejected else ExitCode.DONE
