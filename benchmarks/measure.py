"""Seconds and memory of what runs here, and of other programs."""

from __future__ import annotations

import os
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple


class Seconds(NamedTuple):
    """CPU seconds (user and system, all threads) and wall seconds."""

    cpu: float
    wall: float


def now() -> Seconds:
    """The clocks of this process."""
    return Seconds(time.process_time(), time.perf_counter())


def since(start: Seconds) -> Seconds:
    """Return the elapsed time."""
    end = now()
    return Seconds(end.cpu - start.cpu, end.wall - start.wall)


class Run(NamedTuple):
    """Another program that has ended."""

    seconds: Seconds
    peak: int
    """Largest resident memory in bytes."""
    output: str
    errors: str
    code: int
    stopped: bool = False
    """True where it was stopped at the limit of time."""


def run(
    command: Sequence[str | Path],
    folder: Path,
    environment: Mapping[str, str] | None = None,
    limit: float | None = None,
) -> Run:
    """Run a program to its end, or for so many wall seconds; its output goes through files in a folder.

    Its peak can not come out smaller than this process itself is, which therefore has to be small.
    """
    texts = folder / "output.txt", folder / "errors.txt"
    start = time.perf_counter()
    with texts[0].open("w") as output, texts[1].open("w") as errors:
        child = subprocess.Popen(
            [str(part) for part in command],
            stdout=output,
            stderr=errors,
            # Compiled modules are kept, as where mor is installed.
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "", **(environment or {})},
        )
        watch = threading.Timer(limit or 0.0, child.kill)
        if limit is not None:
            watch.start()
        _, status, used = os.wait4(child.pid, 0)
        watch.cancel()
    wall = time.perf_counter() - start
    child.returncode = os.waitstatus_to_exitcode(status)
    seconds = Seconds(used.ru_utime + used.ru_stime, wall)
    output_text, error_text = (path.read_text(errors="replace") for path in texts)
    stopped = limit is not None and wall >= limit and child.returncode < 0
    return Run(seconds, used.ru_maxrss * 1024, output_text, error_text, child.returncode, stopped)


def resident() -> int:
    """Resident memory of this process now, in bytes; 0 where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")
