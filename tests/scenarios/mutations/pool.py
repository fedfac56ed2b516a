"""Processes that run mutants, watched from outside: one that hangs or dies is told and replaced."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from .worker import Judged

_HANGS, _WAITS = 60.0, 1200.0
"""Seconds of computing, and on the clock, after which a mutant is taken for one that never ends."""
_COMPILING = 600.0
"""Seconds of computing of the projects themselves, which are run first: kernels are compiled then."""
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "POLARS_MAX_THREADS", "OMP_NUM_THREADS"), "1")


class Worker:
    """A process with a mutant under way, or none."""

    def __init__(self, seed: int, keep: Path | None) -> None:
        command = [
            sys.executable,
            "-m",
            "tests.scenarios.mutations",
            "--work",
            str(seed),
            *([str(keep)] if keep else []),
        ]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, **_ONE_THREAD},
        )  # fmt: skip
        self.answers: queue.Queue[str] = queue.Queue()
        self.said: list[str] = []
        for stream, take in (
            (self.process.stdout, self.answers.put),
            (self.process.stderr, self.said.append),
        ):
            threading.Thread(target=lambda s=stream, t=take: [t(line) for line in s] and t(""), daemon=True).start()

    def judged(self, number: int) -> Judged:
        """Run one mutant; a process that does not answer is ended, and that is the fault."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(f"{number}\n")
            self.process.stdin.flush()
            answer = self._answer(_HANGS if number >= 0 else _COMPILING)
        except BrokenPipeError:
            answer = ""
        if answer:
            return Judged(**json.loads(answer))
        hangs = not self._ended()
        self.close()
        words = "hang" if hangs else f"died with {self.process.returncode}: {''.join(self.said[-3:]).strip()}"
        return Judged(number, "", (), -1, 0.0, 0.0, [words])

    def _answer(self, most: float) -> str:
        """The next answer; an empty one where the process ends, or computes longer than ``most`` seconds."""
        begun, clock = self._computed(), time.monotonic()
        while self._computed() - begun < most and time.monotonic() - clock < _WAITS:
            try:
                return self.answers.get(timeout=2.0)
            except queue.Empty:
                continue
        return ""

    def _computed(self) -> float:
        """Seconds of computing of the process so far, where the system tells."""
        try:
            words = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(words[11]) + int(words[12])) / float(os.sysconf("SC_CLK_TCK"))

    @property
    def over(self) -> bool:
        """True where the process has ended."""
        return self.process.poll() is not None

    def _ended(self) -> bool:
        try:
            self.process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            return False
        return True

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()


def run_pool(seed: int, numbers: list[int], jobs: int, keep: Path | None) -> Iterator[Judged]:
    """Run mutants in ``jobs`` processes, in the order in which they end."""
    todo: queue.Queue[int] = queue.Queue()
    done: queue.Queue[Judged | None] = queue.Queue()
    for number in numbers:
        todo.put(number)
    for _ in range(jobs):
        threading.Thread(target=_work, args=(seed, todo, done, keep), daemon=True).start()
    working = jobs
    while working:
        result = done.get()
        if result is None:
            working -= 1
        else:
            yield result


def _work(seed: int, todo: queue.Queue[int], done: queue.Queue[Judged | None], keep: Path | None) -> None:
    worker = Worker(seed, keep)
    while True:
        try:
            number = todo.get_nowait()
        except queue.Empty:
            break
        if worker.over:
            worker = Worker(seed, keep)
        done.put(worker.judged(number))
    worker.close()
    done.put(None)
