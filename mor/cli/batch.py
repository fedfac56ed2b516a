"""``mor batch``."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import language_option, tell
from mor.cli.options import (
    InputPath,
    cluster_option,
    jobs_here,
    jobs_option,
    kernels_option,
    output_option,
    quiet_option,
)
from mor.errors import ExitCode, InputError, Message

if TYPE_CHECKING:
    from mor.api.batch import Case
    from mor.api.workers import Done, Task
    from mor.report.batch import BatchRow


@click.command(name="batch")
@click.argument("projects", nargs=-1, required=True)
@output_option(
    "Folder for the tables, with a subfolder of results for each project.", show_default=True, default="batch.results"
)
@jobs_option("Number of processes that share the projects.")
@cluster_option
@click.option("--strict", is_flag=True, help="Let projects fail that are rejected or have flagged observations.")
@click.option("--snoop", is_flag=True, help="Data snooping in every project.")
@click.option("--html", is_flag=True, help="Also write report.html of each project.")
@click.option(
    "--against",
    metavar="FOLDER",
    type=InputPath(),
    help="Folder of an earlier batch: projects whose numbers differ from it fail.",
)
@click.option(
    "--tol",
    metavar="NUMBER",
    default=1e-6,
    show_default=True,
    type=click.FloatRange(min=0.0),
    help="Tolerance: numbers are equal within this times max(1, |number|).",
)
@click.option(
    "--timeout",
    metavar="SECONDS",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Terminate projects that take longer.",
)
@click.option("--json", "as_json", is_flag=True, help="Print batch.json on standard output.")
@language_option("the tables and reports")
@kernels_option
@quiet_option
def command(
    projects: tuple[str, ...],
    output: Path,
    jobs: int | None,
    cluster: str | None,
    strict: bool,
    snoop: bool,
    html: bool,
    against: Path | None,
    tol: float,
    timeout: float | None,
    as_json: bool,
    lang: str,
    quiet: bool,
) -> int:
    """Adjust many PROJECTS and write the outcome of all of them in one table.

    \b
    Examples:
      mor batch 'blocks/**/project.yaml'
      mor batch 'blocks/**/project.yaml' --jobs 4 --strict -o nightly
      mor batch 'blocks/**/project.yaml' --against kept.results -o now
      mor batch *.dat --json --quiet | jq .failed
      mor batch 'blocks/**/project.yaml' --cluster tcp://host:8786

    PROJECTS are files, or patterns in quotes, in which ** stands for any number of folders. The folder gets
    batch.txt, batch.json, batch.html, junit.xml, and for each project results.json, report.txt and log.txt. A project
    that crashes or takes too long does not stop the others.

    \b
    Exit codes: 0 none fails; 1 some fail; 2 input, or no project matches.
    A project fails if mor adjust would not exit with 0, or if it differs from
    --against.
    """
    from mor.api.batch import LOG, cases
    from mor.input_files import note_input
    from mor.output_files import write_among
    from mor.report.batch import batch_data, batch_page, batch_text, junit_xml
    from mor.report.language import words_of
    from mor.report.output_folder import to_json

    words = words_of(lang, "planning")
    if against is not None and not against.is_dir():
        raise InputError([Message("there is no such folder of kept results", str(against))])
    options = [
        *(["--strict"] if strict else []),
        *(["--snoop"] if snoop else []),
        *([] if html else ["--no-html"]),
        *("--tables", "none", "--lang", lang, "--force"),
    ]
    found = cases(projects, output)
    for case in found:
        note_input(case.project)
    logs = [f"{case.name}/{LOG}" for case in found]
    tables = ("batch.txt", "batch.json", "batch.html", "junit.xml")
    with _workers(output, len(found), jobs, cluster, timeout) as work:
        write_among(output, {}, (*tables, *logs))
        rows = _rows(found, options, work, against, tol, quiet)
    text, data = batch_text(rows, words), to_json(batch_data(rows))
    contents = (text, data, batch_page(rows, words), junit_xml(rows, words))
    write_among(output, dict(zip(tables, contents, strict=True)))
    if as_json:
        click.echo(data, nl=False)
    if not quiet:
        click.echo(text, err=True, nl=False)
        click.echo(words("tables in {place}", place=output), err=True)
    return ExitCode.REJECTED if any(row.fails for row in rows) else ExitCode.DONE


@contextmanager
def _workers(
    output: Path, count: int, jobs: int | None, cluster: str | None, timeout: float | None
) -> Iterator[Callable[[Sequence[Task]], Iterator[Done]]]:
    """Who does the tasks: processes of this machine, or the workers of a cluster, who see the folder of results."""
    from mor.api.workers import run_tasks

    here = jobs_here(jobs, cluster)
    if cluster is None:
        yield lambda tasks: run_tasks(adjust_one, tasks, min(here, count), timeout)
        return
    from mor.api.simulation import tasks_on_cluster
    from mor.solve.cluster import connected

    with connected(output.resolve(), cluster) as workers:
        yield lambda tasks: tasks_on_cluster(workers, adjust_one, tasks, timeout)


def _rows(
    found: Sequence[Case],
    options: Sequence[str],
    work: Callable[[Sequence[Task]], Iterator[Done]],
    against: Path | None,
    tol: float,
    quiet: bool,
) -> list[BatchRow]:
    """The row of each project in the order of their names; each is told when it is done."""
    from mor.api.batch import LOG, row_of, stamp
    from mor.api.workers import Task
    from mor.output_files import named

    for case in found:
        with named(case.folder):
            case.folder.mkdir(parents=True, exist_ok=True)
    before = [stamp(case) for case in found]
    tasks = [Task((str(case.project), str(case.folder), *options), case.folder / LOG) for case in found]
    rows: dict[int, BatchRow] = {}
    begun = time.monotonic()
    for done in work(tasks):
        is_new = stamp(found[done.number]) != before[done.number]
        rows[done.number] = row = row_of(found[done.number], done, is_new, against, tol)
        if not quiet:
            tell(f"{len(rows)}/{len(tasks)} {row.name}: {row.status}, {done.seconds:.1f} s")
    if not quiet:
        tell(f"{time.monotonic() - begun:.1f} s")
    return [rows[k] for k in sorted(rows)]


def adjust_one(project: str, folder: str, *options: str) -> int:
    """One project, in the process of a batch."""
    from mor.cli import run

    return run(["adjust", project, "-o", folder, *options])
