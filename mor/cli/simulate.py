"""``mor simulate``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import language_option, tell, tell_note
from mor.cli.options import (
    InputPath,
    cluster_option,
    force_option,
    format_option,
    jobs_here,
    jobs_option,
    kernels_option,
    only_project,
    output_option,
    quiet_option,
)
from mor.errors import ExitCode, InputError, Message, screenful

if TYPE_CHECKING:
    from mor.api.simulation import Chunk, Prepared, SimulationTask, Worked
    from mor.input_files import ReadFile
    from mor.plan.simulation import Systematic, Wishes


@click.command(name="simulate")
@click.argument("project", type=InputPath())
@output_option(
    "Folder for the simulated project, or for the report of many runs.",
    "PROJECT.simulated; PROJECT.montecarlo with --runs",
)
@force_option
@format_option
@click.option(
    "--seed", metavar="N", default=1, show_default=True, type=click.IntRange(min=0), help="Seed of the random numbers."
)
@click.option("--noise-free", is_flag=True, help="Draw no random errors; only planted ones remain.")
@click.option(
    "--gross", default=0, show_default=True, metavar="N", type=click.IntRange(min=0), help="Plant N gross errors."
)
@click.option(
    "--size",
    metavar="K",
    default=20.0,
    show_default=True,
    type=click.FloatRange(min=0.0, min_open=True),
    help="Size of a gross error, in units of the sigma of its observation.",
)
@click.option(
    "--drop",
    default=0.0,
    show_default=True,
    metavar="SHARE",
    type=click.FloatRange(min=0.0, max=1.0, max_open=True),
    help="Drop this share of the rows of tables, e.g. 0.1.",
)
@click.option(
    "--offset",
    "offsets",
    multiple=True,
    metavar="GROUP[:COMPONENT]=AMOUNT",
    help="Add an amount to all observations of a group, in its unit.",
)
@click.option(
    "--ppm",
    "scales",
    multiple=True,
    metavar="GROUP[:COMPONENT]=PPM",
    help="Add parts per million to the values of a group.",
)
@click.option(
    "--runs",
    metavar="N",
    type=click.IntRange(min=2),
    help="Monte Carlo: adjust N simulated sets of observations and compare the results with theory.",
)
@jobs_option("Number of processes that share the runs.")
@cluster_option
@click.option("--starts", is_flag=True, help="Compute start values again in every run of --runs.")
@click.option("--json", "as_json", is_flag=True, help="Also print montecarlo.json on standard output.")
@language_option("the report of many runs")
@kernels_option
@quiet_option
def command(
    project: Path,
    output: Path | None,
    force: bool,
    source_format: str | None,
    seed: int,
    noise_free: bool,
    gross: int,
    size: float,
    drop: float,
    offsets: tuple[str, ...],
    scales: tuple[str, ...],
    runs: int | None,
    jobs: int | None,
    cluster: str | None,
    starts: bool,
    as_json: bool,
    lang: str,
    quiet: bool,
) -> int:
    """Simulate the observations of PROJECT and write a project with them, ready to be adjusted.

    \b
    Examples:
      mor simulate project.yaml && mor adjust project.simulated/project.yaml
      mor simulate project.yaml -o trial --seed 7 --gross 3 --drop 0.1
      mor simulate project.yaml -o trial --offset distances.csv=0.003 --force
      mor simulate project.yaml --runs 2000 --jobs 4
      mor simulate project.yaml --runs 20000 --cluster tcp://host:8786

    The start values are the true values; measured values are ignored. Errors are drawn from the sigmas and
    covariances of the project; observed parameters, such as control points with a sigma, get errors too. truth.csv
    contains the true values, and planted.csv the errors planted on purpose. --runs writes only a report: bias,
    coverage of confidence regions, levels and power of the tests, compared with theory. A seed gives the same bytes
    for any number of jobs, and an interrupted run continues when it is started again.

    \b
    Exit codes: 0 done; 1 simulation and theory disagree (--runs); 2 input; 4 singular (--runs).
    """
    from mor.api.simulation import SimulationTask
    from mor.plan.simulation import Wishes

    project = only_project(project, source_format)
    systematic = (*_systematic(offsets, False), *_systematic(scales, True))
    wishes = Wishes(gross, size, drop, systematic)
    if runs is not None:
        given = {"--gross": gross, "--drop": drop, "--offset or --ppm": systematic, "--noise-free": noise_free}
        problems = [
            Message("this goes with one simulated project, not with --runs", key) for key, v in given.items() if v
        ]
        if problems:
            raise InputError(problems)
        trial = SimulationTask(project, source_format or "", seed, starts)
        return _many(trial, output, force, runs, jobs_here(jobs, cluster), cluster, as_json, lang, quiet)

    if cluster is not None:
        raise InputError([Message("this goes with --runs, not with one simulated project", "--cluster")])
    return _one(project, output, force, source_format or "", seed, noise_free, wishes, quiet)


def _one(
    project: Path, output: Path | None, force: bool, form: str, seed: int, noise_free: bool, wishes: Wishes, quiet: bool
) -> int:
    from mor.api.simulation import USUAL_FILES, simulated
    from mor.output_files import check_folder
    from mor.report.output_folder import folder_beside, reserve

    folder = output or folder_beside(project, ".simulated")
    check_folder(folder, force, USUAL_FILES)
    simulation = simulated(project, form, seed, wishes, not noise_free)
    with reserve(folder, force, USUAL_FILES) as place:
        simulation.write(place)
    if not quiet:
        for note in screenful(simulation.network.notes, "mor check --all"):
            tell_note(note)
        tell(f"simulated project in {folder}")
    return ExitCode.DONE


def _many(
    trial: SimulationTask,
    output: Path | None,
    force: bool,
    runs: int,
    jobs: int,
    cluster: str | None,
    as_json: bool,
    lang: str,
    quiet: bool,
) -> int:
    from mor.api.simulation import prepared, run_trial
    from mor.cli.progress import progress
    from mor.input_files import files_read
    from mor.linalg.compilation import notes_told_by
    from mor.output_files import write_among
    from mor.plan.simulation import findings
    from mor.report.identity import RunIdentity
    from mor.report.language import words_of
    from mor.report.output_folder import folder_beside, to_json
    from mor.report.simulation import finding_table, monte_carlo_data, monte_carlo_text, verdict

    folder, words = output or folder_beside(trial.path, ".montecarlo"), words_of(lang, "planning")
    _check_folder(folder, force)
    with files_read() as files:
        ready = prepared(trial)
    if ready.truth is None:
        click.echo(words("the plan has no solution; mor design says why"), err=True)
        return ExitCode.SINGULAR
    with (
        progress(quiet, False, words=words) as say,
        notes_told_by(say.note),
        _workers(folder / "runs", jobs, cluster, files) as work,
    ):
        tally = run_trial(ready, runs, work, folder / "runs", files, say.phase("simulating", runs))
    of = RunIdentity(tuple(files.values()), trial.path.parent, (f"--runs {runs}", f"--seed {trial.seed}"))
    about = ready.network, ready.truth, tally, trial.seed, trial.starts
    data = to_json(monte_carlo_data(*about, of))
    write_among(folder, dict(zip(_REPORTS, (monte_carlo_text(*about, words, of), data), strict=True)))
    if as_json:
        click.echo(data, nl=False)
    found = findings(ready.truth, tally)
    if not quiet:
        tell(f"{verdict(found, words)}\n{finding_table(found, words)}")
        click.echo(words("report in {place}", place=folder), err=True)
    return ExitCode.DONE if all(one.agrees for one in found) else ExitCode.REJECTED


@contextmanager
def _workers(
    folder: Path, jobs: int, cluster: str | None, files: Mapping[Path, ReadFile]
) -> Iterator[Callable[[Prepared, list[Chunk]], Worked]]:
    """Who works out the runs: processes of this machine, or the workers of a cluster, who see the folder of runs."""
    from mor.api.simulation import by_processes

    if cluster is None:
        yield partial(by_processes, jobs=jobs)
        return
    from mor.api.simulation import chunks_on_cluster
    from mor.solve.cluster import connected

    with connected(folder.resolve(), cluster) as workers:
        yield partial(chunks_on_cluster, cluster=workers, files=files)


_REPORTS = ("montecarlo.txt", "montecarlo.json")


def _check_folder(folder: Path, force: bool) -> None:
    """A folder of earlier runs goes on; any other one that is not empty needs ``--force``."""
    from mor.output_files import check_folder, check_names

    runs = folder / "runs"
    if (runs / "key.json").is_file():
        check_names(folder, _REPORTS)
        return
    check_folder(folder, force, _REPORTS)
    if runs.is_dir() and any(runs.iterdir()):
        words = "this folder is not empty and contains no runs of mor; choose another folder with -o"
        raise InputError([Message(words, str(runs))])


def _systematic(given: tuple[str, ...], is_ppm: bool) -> list[Systematic]:
    from mor.plan.simulation import Systematic

    found, problems = [], []
    for text in given:
        pattern, sign, amount = text.rpartition("=")
        try:
            found.append(Systematic(pattern, float(amount), is_ppm))
            if not sign:
                raise ValueError
        except ValueError:
            words = f"found {text!r}, expected GROUP=AMOUNT, e.g. distances.csv=0.003"
            problems.append(Message(words, "--ppm" if is_ppm else "--offset"))
    if problems:
        raise InputError(problems)
    return found
