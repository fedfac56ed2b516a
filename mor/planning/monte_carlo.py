"""Monte Carlo of a project: many simulated measurements, shared among processes, kept on disk in chunks.

Each chunk is a file of its own, written in one step. A simulation that was interrupted, or is to have more runs, takes
the chunks that are there. The chunks do not depend on who works them out, and are added in their order.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mor import __version__
from mor.adjustment.problem import Problem
from mor.adjustment.solve import Settings, adjust
from mor.adjustment.state import Adjustment
from mor.arrays import FloatArray
from mor.compilation import chosen_by_size
from mor.errors import InputError, MorError, NoStartValuesError
from mor.errors import Problem as Mistake
from mor.input_files import ReadFile
from mor.output_files import write_file
from mor.planning.plan import solve_plan
from mor.planning.simulation import placed_network
from mor.preparation import determinable_start, make_problem
from mor.project.network.build import Network
from mor.quality.simulation.monte_carlo import Tally, Truth, empty_tally, one_run, tally_of
from mor.quality.solved import Solved
from mor.sparse.blas_threads import one_thread

CHUNK = 20
"""Runs of one chunk."""
_KEY = "key.json"


class SingularPlanError(MorError):
    """The network that is to be simulated cannot be adjusted."""


class Trial(NamedTuple):
    """A project to simulate, a seed, and whether every run computes start values."""

    path: Path
    form: str
    seed: int
    starts: bool = False


class Prepared(NamedTuple):
    """A trial that is ready to be run."""

    trial: Trial
    network: Network
    solved: Solved
    truth: Truth | None
    """Nothing where the plan has no solution."""


def prepared(trial: Trial) -> Prepared:
    """The truth of a trial. Raises :class:`InputError`."""
    network, _ = placed_network(trial.path, trial.form)
    with one_thread():
        solved = solve_plan(network)
    if solved.quality is None or solved.network.original is not None:
        return Prepared(trial, network, solved, None)
    problem = make_problem(network, network.start, network.start)
    return Prepared(trial, network, solved, Truth(problem, network.start, solved.quality))


def chunk_of(ready: Prepared, first: int, count: int) -> Tally:
    """The tally of some runs, one after the other, the same wherever they are done.

    Kernels are compiled where the runs of a chunk have together what a project is worth compiling from.
    """
    truth = ready.truth
    assert truth is not None
    solve = _solver(ready)
    total = empty_tally(truth)
    compiled = chosen_by_size(ready.network.observations, CHUNK)
    with compiled, one_thread(), np.errstate(all="ignore"):
        for number in range(first, first + count):
            total = total + one_run(truth, ready.trial.seed, number, solve)
    return total


def _solver(ready: Prepared) -> Callable[[Problem], Adjustment | None]:
    """From the true place, or from start values that are worked out anew."""
    settings = Settings(ready.network.project.settings.max_iterations)
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
    """Start values without those of free points and attitudes that nobody observed."""
    start = {kind: values.copy() for kind, values in network.start.items()}
    for kind in ("point", "rotation"):
        if kind not in start:
            continue
        known = np.isfinite(network.sigma[kind])
        loose = (network.blocks[kind].free & ~known).all(axis=1)
        start[kind][loose] = np.nan
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
    _check_key(folder, ready.trial, files)
    chunks = [(first, min(CHUNK, runs - first)) for first in range(0, runs, CHUNK)]
    missing = [chunk for chunk in chunks if not _file(folder, *chunk).is_file()]
    told(runs - sum(count for _, count in missing))
    for chunk, arrays in work(ready, missing):
        _keep(_file(folder, *chunk), arrays)
        told(chunk[1])
    total = empty_tally(ready.truth)
    for chunk in chunks:
        with np.load(_file(folder, *chunk)) as kept:
            total = total + tally_of(kept)
    return total


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


def _begin(trial: Trial) -> None:
    _READY.append(prepared(trial))


def _in_worker(chunk: Chunk) -> dict[str, FloatArray]:
    return chunk_of(_READY[0], *chunk).arrays()


def _file(folder: Path, first: int, count: int) -> Path:
    return folder / f"{first:08d}-{first + count - 1:08d}.npz"


def _keep(path: Path, arrays: dict[str, FloatArray]) -> None:
    write_file(path, lambda place: np.savez(place, **arrays), True)  # type: ignore[arg-type]


def _check_key(folder: Path, trial: Trial, files: Mapping[Any, ReadFile]) -> None:
    """Write down what the runs are of; runs of something else are never mixed with them."""
    key = {
        "program": __version__,
        "seed": trial.seed,
        "starts": trial.starts,
        "inputs": digest_of(files),
        "chunk": CHUNK,
    }
    path = folder / _KEY
    if path.is_file() and json.loads(path.read_text(encoding="utf-8")) != key:
        words = (
            "the runs that are here are of other input or another seed; choose another folder, or remove them"
        )
        raise InputError([Mistake(words, str(folder))])
    write_file(path, json.dumps(key) + "\n", True)


def digest_of(files: Mapping[Any, ReadFile]) -> str:
    """Return a digest of the names and contents of all files that were read."""
    content = sorted((file.path.name, file.sha256) for file in files.values())
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()
