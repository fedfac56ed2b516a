"""Processes that do tasks one after the other, each with a log of its own; one that dies takes no other along.

The interpreter and its libraries are started once for each process, not for each task. What a task prints, even where
its process is killed, stands in its log.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from subprocess import PIPE, Popen, TimeoutExpired
from threading import Thread
from typing import Any, NamedTuple

Function = Callable[..., int]
"""What is done: an importable function of texts that returns an exit code."""


class Task(NamedTuple):
    """Arguments of the function, and the file that its words go to."""

    arguments: tuple[str, ...]
    log: Path


class Done(NamedTuple):
    """Result of a task."""

    number: int
    code: int | None
    """Exit code; nothing if its process died, or was ended."""
    death: str
    """How it died: ``killed by SIGKILL``, ``ended after 60 s``; empty if it did not."""
    seconds: float


@dataclass
class _Worker:
    process: BaseProcess
    connection: Connection[Any, Any]
    number: int = -1
    begun: float = 0.0


def run_tasks(function: Function, tasks: Sequence[Task], jobs: int, most_seconds: float | None) -> Iterator[Done]:
    """Do all tasks by so many processes; what is done comes in the order in which it ends."""
    context = multiprocessing.get_context("spawn")
    left = list(enumerate(tasks))[::-1]
    workers: list[_Worker] = []
    try:
        while left or any(worker.number >= 0 for worker in workers):
            while left and len(workers) < jobs:
                here, there = context.Pipe()
                process = context.Process(target=_serve, args=(there, function), daemon=True)
                process.start()
                there.close()
                workers.append(_Worker(process, here))
            for worker in workers:
                if worker.number < 0 and left:
                    _give(worker, *left.pop())
            for worker in _heard(workers, most_seconds):
                done = _what_became(worker, most_seconds)
                if done is None:
                    continue
                if done.code is None:
                    workers.remove(worker)
                    _end(worker)
                worker.number = -1
                yield done
    finally:
        for worker in workers:
            _end(worker)


def _give(worker: _Worker, number: int, task: Task) -> None:
    worker.number, worker.begun = number, time.monotonic()
    with suppress(OSError):  # it died meanwhile: what became of it is seen when it is heard
        worker.connection.send((task.arguments, str(task.log)))


def _heard(workers: Sequence[_Worker], most: float | None) -> list[_Worker]:
    busy = [worker for worker in workers if worker.number >= 0]
    left = min((worker.begun + most - time.monotonic() for worker in busy), default=0.0) if most else None
    ready = wait([worker.connection for worker in busy], timeout=None if left is None else max(left, 0.0))
    late = [w for w in busy if most is not None and time.monotonic() - w.begun >= most]
    return [worker for worker in busy if worker.connection in ready or worker in late]


def _what_became(worker: _Worker, most: float | None) -> Done | None:
    seconds = time.monotonic() - worker.begun
    if worker.connection.poll():
        try:
            return Done(worker.number, int(worker.connection.recv()), "", seconds)
        except (EOFError, OSError):
            worker.process.join()
            return Done(worker.number, None, _said_death(worker.process.exitcode or 0), seconds)
    if most is None or seconds < most:
        return None
    return Done(worker.number, None, f"ended after {most:g} s", seconds)


def done_alone(function: Function, number: int, task: Task, folder: Path, most_seconds: float | None = None) -> Done:
    """Do a task in a process of its own, begun in a folder, which ends where this one is lost.

    Unlike those of :func:`run_tasks` it may be begun by the worker of a cluster, which must have no children of
    :mod:`multiprocessing`.
    """
    begun = time.monotonic()
    with (
        (folder / task.log).open("wb") as log,
        Popen([sys.executable, "-P", "-m", __name__], stdin=PIPE, stdout=log, stderr=log, cwd=folder) as process,
    ):
        assert process.stdin is not None
        pickle.dump((function, task.arguments), process.stdin)
        process.stdin.flush()
        try:
            code = process.wait(most_seconds)
        except TimeoutExpired:
            process.kill()
            return Done(number, None, f"ended after {most_seconds:g} s", time.monotonic() - begun)
    seconds = time.monotonic() - begun
    return Done(number, None, _said_death(code), seconds) if code < 0 else Done(number, code, "", seconds)


def _end_with_the_other() -> None:
    os.read(0, 1)
    os._exit(1)


def _said_death(code: int) -> str:
    if code >= 0:
        return f"its process left with {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"


def _end(worker: _Worker) -> None:
    worker.connection.close()
    if worker.process.is_alive():
        worker.process.terminate()
        worker.process.join(2.0)
    if worker.process.is_alive():
        worker.process.kill()
        worker.process.join()


def _serve(connection: Connection[Any, Any], function: Function) -> None:
    import faulthandler

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one that began this process ends it
    while True:
        try:
            arguments, log = connection.recv()
        except (EOFError, OSError):
            return
        file = os.open(log, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o644)
        os.dup2(file, 1)
        os.dup2(file, 2)
        os.close(file)
        faulthandler.enable(2)
        try:
            code = function(*arguments)
        except BaseException as error:  # noqa: BLE001 - whatever it is, it is this task's alone
            os.write(2, f"internal error: {type(error).__name__}: {error}\n".encode())
            code = 70
        connection.send(code)


if __name__ == "__main__":
    function, arguments = pickle.load(sys.stdin.buffer)
    Thread(target=_end_with_the_other, daemon=True).start()
    sys.exit(function(*arguments))
