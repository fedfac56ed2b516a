"""Batches and simulations by the workers of a cluster: each project, or each chunk of runs, is a task.

What is done twice, because a worker was lost, leaves the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from mor.arrays import FloatArray
from mor.cluster import Cluster
from mor.errors import InputError
from mor.errors import Problem as Mistake
from mor.input_files import ReadFile, files_read
from mor.planning.monte_carlo import Chunk, Prepared, Trial, Worked, chunk_of, digest_of, prepared
from mor.planning.workers import Done, Function, Task, done_alone


def tasks_on_cluster(
    cluster: Cluster, function: Function, tasks: Sequence[Task], most_seconds: float | None = None
) -> Iterator[Done]:
    """Do all tasks, each in a process of its own where a worker is; what is done comes in the order of the tasks.

    Raises :class:`InputError` if the working folder is not there, or nobody does them any more.
    """
    here = Path.cwd()
    submitted = [
        cluster.submit(_alone, function, number, task, here, most_seconds)
        for number, task in enumerate(tasks)
    ]
    yield from map(cluster.result, submitted)


def _alone(function: Function, number: int, task: Task, folder: Path, most_seconds: float | None) -> Done:
    if not folder.is_dir():
        words = (
            "workers do not see this folder: it has to be on a file system that all machines have in common"
        )
        raise InputError([Mistake(words, str(folder))])
    return done_alone(function, number, task, folder, most_seconds)


def chunks_on_cluster(
    ready: Prepared, chunks: list[Chunk], cluster: Cluster, files: Mapping[Any, ReadFile]
) -> Worked:
    """Do chunks of a trial, whose inputs are the ``files`` that were read for it.

    Raises :class:`InputError` if they are others for a worker, or nobody does the chunks any more.
    """
    trial = ready.trial._replace(path=ready.trial.path.resolve())
    submitted = [cluster.submit(_chunk, trial, digest_of(files), chunk) for chunk in chunks]
    yield from zip(chunks, map(cluster.result, submitted), strict=True)


def _chunk(trial: Trial, digest: str, chunk: Chunk) -> dict[str, FloatArray]:
    return chunk_of(_prepared(trial, digest), *chunk).arrays()


@lru_cache(maxsize=1)
def _prepared(trial: Trial, digest: str) -> Prepared:
    """The trial, read once by a process for each state of its inputs."""
    with files_read() as files:
        ready = prepared(trial)
    if digest_of(files) != digest:
        raise InputError([Mistake("a worker reads other input than was read here", str(trial.path))])
    return ready
