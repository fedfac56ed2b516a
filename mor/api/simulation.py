"""Simulate projects, and run Monte Carlo, here or on a cluster."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor import __version__
from mor.api.pipeline import determinable_start, make_problem, read_document
from mor.api.plan import at_its_place, read_plan, solve_plan
from mor.api.workers import Done, Function, Task, done_alone
from mor.errors import InputError, Message, NoStartValuesError
from mor.input_files import ReadFile, files_read
from mor.linalg.cholesky import one_thread
from mor.linalg.compilation import chosen_by_size
from mor.model.contract import ObservationGroup
from mor.model.coordinates import OBSERVED_PARAMETERS
from mor.model.parameters import Values
from mor.output_files import Content, write_file
from mor.plan.simulation import (
    Planted,
    Tally,
    Truth,
    Wishes,
    added,
    empty_tally,
    errors,
    is_implied,
    measured_at,
    one_run,
    place_with_errors,
    planted,
    tally_of,
    unwritten,
    with_planted,
)
from mor.project.document import Document
from mor.project.network import Network
from mor.report.output_folder import Reservation, write_folder
from mor.report.results import PROJECT, table_writer
from mor.report.simulation import planted_table, simulated_project, truth_table
from mor.solve.cluster import ComputeCluster
from mor.solve.iterate import Adjustment, SolverSettings, adjust
from mor.solve.problem import Problem
from mor.types import FloatArray

# ---- Simulated measurements of a project: the project again, with values that its instruments might have shown.

LEFT_OUT = "a part of the network has no coordinates; a simulation needs coordinates of all points, images and stations"
USUAL_FILES = (PROJECT, "truth.csv", "planted.csv")
"""Files that every simulated project has."""


class Simulation(NamedTuple):
    """A network with simulated observations, the place they were measured at, and the errors planted in them."""

    network: Network
    place: Values
    planted: tuple[Planted, ...]
    document: Document
    folder: Path

    def write(self, place: Reservation) -> None:
        """Write the simulated project, its truth and what was planted into a folder."""
        text, tables = simulated_project(self.network, self.place, self.document, self.folder, place.folder)
        writers: dict[str, Content] = {name: table_writer(frame) for name, frame in tables.items()}
        truth: pl.DataFrame = truth_table(self.network, self.place)
        writers["truth.csv"] = table_writer(truth)
        writers["planted.csv"] = table_writer(planted_table(self.network, self.planted))
        head = "# Simulated observations: nothing of this was measured. truth.csv has the true values.\n"
        writers[PROJECT] = head + text
        write_folder(place, writers)


def placed_network(path: Path, form: str) -> tuple[Network, Document]:
    """The network of a project at its place, with everything in it. Raises :class:`InputError`."""
    plan = read_plan(read_document(path, form), path.parent)
    network = at_its_place(plan.network)
    if network.original is not None:
        raise InputError([Message(LEFT_OUT, network.file)])
    return network, plan.document


def simulated(path: Path, form: str, seed: int, wishes: Wishes, noise: bool = True) -> Simulation:
    """A project with simulated observations; the same for the same seed. Raises :class:`InputError`.

    Without ``noise`` there are no random errors, only what is planted.
    """
    network, document = placed_network(path, form)
    generator = np.random.default_rng(seed)
    problem = make_problem(network, network.start, network.start)
    drawn = errors(problem, generator) if noise else tuple(np.zeros(g.observed.shape) for g in problem.groups)
    place = place_with_errors(problem, network.start, drawn, unwritten(problem))
    there = measured_at(network, place)
    place = there.start
    problem = make_problem(there, place, place)
    found = planted(problem, wishes, generator)
    kept = len(there.groups)
    observed = [
        group.observed if is_implied(group) else group.observed + error
        for group, error in zip(problem.groups[:kept], drawn, strict=False)
    ]
    of_checks = [group.observed + error for group, error in zip(there.checks, drawn[kept:], strict=True)]
    observed = list(with_planted(problem, [*observed, *of_checks], found, wishes))
    groups = tuple(replace(group, observed=values) for group, values in zip(there.groups, observed, strict=False))
    checks = tuple(replace(group, observed=values) for group, values in zip(there.checks, observed[kept:], strict=True))
    there = replace(there, groups=groups, checks=checks, observed=_prior(there, groups))
    if there.world is not None:
        from mor.project.planned_network import with_control_moved  # most projects need nothing of it

        there = with_control_moved(there)
    return Simulation(there, place, tuple(found), document, path.parent)


def _prior(network: Network, groups: tuple[ObservationGroup, ...]) -> Mapping[str, FloatArray]:
    """Observed values of the things themselves, by kind, as the groups of observed parameters have them now."""
    observed = {kind: values.copy() for kind, values in network.observed.items()}
    kinds = {type_.key: kind for kind, type_ in OBSERVED_PARAMETERS.items()}
    for group in groups:
        if group.type.key in kinds and not len(group.lines):
            known = np.isfinite(group.observed)
            block = observed[kinds[group.type.key]]
            rows = group.blocks[0]
            block[rows] = np.where(known, group.observed, block[rows])
    return observed


# ---- Monte Carlo of a project: many simulated measurements, shared among processes, kept on disk in chunks.
#
# Each chunk is a file of its own, written in one step. A simulation that was interrupted, or is to have more
# runs, takes the chunks that are there. The chunks do not depend on who works them out, and are added in
# their order.

CHUNK = 20
"""Runs of one chunk."""


class SimulationTask(NamedTuple):
    """A project to simulate, a seed, and whether every run computes start values."""

    path: Path
    form: str
    seed: int
    starts: bool = False


class Prepared(NamedTuple):
    """A trial that is ready to be run."""

    trial: SimulationTask
    network: Network
    truth: Truth | None
    """Nothing where the plan has no solution."""


def prepared(trial: SimulationTask) -> Prepared:
    """The truth of a trial. Raises :class:`InputError`."""
    network, _ = placed_network(trial.path, trial.form)
    with one_thread():
        solved = solve_plan(network)
    if solved.quality is None or solved.network.original is not None:
        return Prepared(trial, network, None)
    problem = make_problem(network, network.start, network.start)
    return Prepared(trial, network, Truth(problem, network.start, solved.quality))


def chunk_of(ready: Prepared, first: int, count: int) -> Tally:
    """The tally of some runs, one after the other, the same wherever they are done.

    Kernels are compiled where the runs of a chunk have together what a project is worth compiling from.
    """
    truth = ready.truth
    assert truth is not None
    solve = _solver(ready)
    tallies = [empty_tally(truth)]
    compiled = chosen_by_size(ready.network.observations, CHUNK)
    with compiled, one_thread(), np.errstate(all="ignore"):
        for number in range(first, first + count):
            tallies.append(one_run(truth, ready.trial.seed, number, solve))
    return added(tallies)


def _solver(ready: Prepared) -> Callable[[Problem], Adjustment | None]:
    """Return a function that adjusts from the true values, or from start values computed for each run."""
    settings = SolverSettings(ready.network.project.settings.max_iterations)
    if not ready.trial.starts:
        return lambda problem: adjust(problem, ready.network.start, settings)
    groups = len(ready.network.groups)

    def from_found_values(problem: Problem) -> Adjustment | None:
        observed = [group.observed for group in problem.groups[:groups]]
        pairs = zip(ready.network.groups, observed, strict=True)
        network = replace(
            ready.network,
            groups=tuple(replace(group, observed=values) for group, values in pairs),
            start=_without_free(ready.network),
        )
        try:
            found, start = determinable_start(network)
        except (InputError, NoStartValuesError):
            return None
        if found.original is not None:
            return None
        return adjust(problem, start, settings)

    return from_found_values


def _without_free(network: Network) -> Mapping[str, FloatArray]:
    start = {kind: values.copy() for kind, values in network.start.items()}
    for kind in ("point", "rotation"):
        if kind not in start:
            continue
        start[kind][(network.blocks[kind].free & ~np.isfinite(network.sigma[kind])).all(axis=1)] = np.nan
    return start


Chunk = tuple[int, int]
"""First run, and how many."""
Worked = Iterator[tuple[Chunk, dict[str, FloatArray]]]
"""Chunks that are done, each with the arrays of its tally."""


def run_trial(
    ready: Prepared,
    runs: int,
    work: Callable[[Prepared, list[Chunk]], Worked],
    folder: Path,
    files: Mapping[Any, ReadFile],
    told: Callable[[int], None],
) -> Tally:
    """All runs of a trial, with what the folder has of them already; ``told`` hears how many more are done.

    ``work`` does the chunks that are missing. Raises :class:`InputError` if the folder has runs of something else.
    """
    assert ready.truth is not None
    folder.mkdir(parents=True, exist_ok=True)
    # Write down what the runs are of; runs of something else are never mixed with them.
    key = {
        "program": __version__,
        "seed": ready.trial.seed,
        "starts": ready.trial.starts,
        "inputs": digest_of(files),
        "chunk": CHUNK,
        "keeps": [one.name for one in fields(Tally)],
    }
    path = folder / "key.json"
    if path.is_file() and json.loads(path.read_text(encoding="utf-8")) != key:
        words = "this folder contains runs of other input or of another seed; choose another folder, or remove them"
        raise InputError([Message(words, str(folder))])
    write_file(path, json.dumps(key) + "\n", True)
    chunks = [(first, min(CHUNK, runs - first)) for first in range(0, runs, CHUNK)]
    missing = [chunk for chunk in chunks if not _file(folder, *chunk).is_file()]
    told(runs - sum(count for _, count in missing))
    for chunk, arrays in work(ready, missing):
        _keep(_file(folder, *chunk), arrays)
        told(chunk[1])
    tallies = [empty_tally(ready.truth)]
    for chunk in chunks:
        with np.load(_file(folder, *chunk)) as kept:
            tallies.append(tally_of(kept))
    return added(tallies)


def by_processes(ready: Prepared, chunks: list[Chunk], jobs: int) -> Worked:
    """Do chunks by so many processes of this machine, as many as there are chunks at most."""
    if jobs == 1 or len(chunks) < 2:
        for chunk in chunks:
            yield chunk, chunk_of(ready, *chunk).arrays()
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(chunks)), context, _begin, (ready.trial,)) as pool:
        yield from zip(chunks, pool.map(_in_worker, chunks), strict=True)


_READY: list[Prepared] = []
"""The trial of this process, read once."""


def _begin(trial: SimulationTask) -> None:
    _READY.append(prepared(trial))


def _in_worker(chunk: Chunk) -> dict[str, FloatArray]:
    return chunk_of(_READY[0], *chunk).arrays()


def _file(folder: Path, first: int, count: int) -> Path:
    return folder / f"{first:08d}-{first + count - 1:08d}.npz"


def _keep(path: Path, arrays: dict[str, FloatArray]) -> None:
    write_file(path, lambda place: np.savez(place, **arrays), True)  # type: ignore[arg-type]


def digest_of(files: Mapping[Any, ReadFile]) -> str:
    """Return a digest of the names and contents of all files that were read."""
    content = sorted((file.path.name, file.sha256) for file in files.values())
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


# ---- Batches and simulations by the workers of a cluster: each project, or each chunk of runs, is a task.
#
# What is done twice, because a worker was lost, leaves the same.


def tasks_on_cluster(
    cluster: ComputeCluster, function: Function, tasks: Sequence[Task], most_seconds: float | None
) -> Iterator[Done]:
    """Do all tasks, each in a process of its own where a worker is; what is done comes in the order of the tasks.

    Raises :class:`InputError` if the working folder is not there, or nobody does them any more.
    """
    here = Path.cwd()
    submitted = [
        cluster.submit(_alone, function, number, task, here, most_seconds) for number, task in enumerate(tasks)
    ]
    yield from map(cluster.result, submitted)


def _alone(function: Function, number: int, task: Task, folder: Path, most_seconds: float | None) -> Done:
    if not folder.is_dir():
        words = "workers do not see this folder: it has to be on a file system that all machines share"
        raise InputError([Message(words, str(folder))])
    return done_alone(function, number, task, folder, most_seconds)


def chunks_on_cluster(
    ready: Prepared, chunks: list[Chunk], cluster: ComputeCluster, files: Mapping[Any, ReadFile]
) -> Worked:
    """Do chunks of a trial, whose inputs are the ``files`` that were read for it.

    Raises :class:`InputError` if they are others for a worker, or nobody does the chunks any more.
    """
    trial = ready.trial._replace(path=ready.trial.path.resolve())
    submitted = [cluster.submit(_chunk, trial, digest_of(files), chunk) for chunk in chunks]
    yield from zip(chunks, map(cluster.result, submitted), strict=True)


def _chunk(trial: SimulationTask, digest: str, chunk: Chunk) -> dict[str, FloatArray]:
    return chunk_of(_prepared(trial, digest), *chunk).arrays()


@lru_cache(maxsize=1)
def _prepared(trial: SimulationTask, digest: str) -> Prepared:
    """The trial, read once by a process for each state of its inputs."""
    with files_read() as files:
        ready = prepared(trial)
    if digest_of(files) != digest:
        raise InputError([Message("a worker reads other input than was read here", str(trial.path))])
    return ready
