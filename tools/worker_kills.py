"""Workers of an adjustment in domains, killed at random moments: the same bytes, and never a hang.

    python -m tools.worker_kills --kills 20

A small block is adjusted in one process, then again and again by two workers, of which one is killed after a random
time. What is left must be the same bytes; a run that ends with words instead must say so within the deadline.
With --schedulers so many runs lose their scheduler, at a random moment: they must end with words and exit code 2.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import NamedTuple

import psutil

from mor.domains import room
from mor.errors import ExitCode
from tests.scenarios.domains_blocks import Kind, command, write_block

DEADLINE = 180.0
"""Seconds after which a run counts as hanging."""


class Trial(NamedTuple):
    """One run."""

    kills: int
    exit_code: int | None
    """``None`` where it hung."""
    same: bool
    said: str
    seconds: float


def _files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def workers_of(process: psutil.Process) -> list[psutil.Process]:
    """Worker processes that descend from a process: those their nannies have begun."""
    found = []
    for one in process.children(recursive=True):
        try:
            if "spawn_main" in " ".join(one.cmdline()):
                found.append(one)
        except psutil.Error:
            continue
    return found


def _kill_now_and_then(over: threading.Event, draw: random.Random, killed: list[int], most: int) -> None:
    me = psutil.Process()
    while len(killed) < most and not over.wait(draw.uniform(0.3, 4.0)):
        workers = workers_of(me)
        if workers:
            one = draw.choice(workers)
            try:
                one.send_signal(signal.SIGKILL)
            except psutil.Error:
                continue
            killed.append(one.pid)


def trial(project: Path, folder: Path, alone: dict[str, bytes], draw: random.Random, most: int) -> Trial:
    """One run whose workers are killed, at most so many of them."""
    over, killed, began = threading.Event(), list[int](), time.monotonic()
    ended: list[tuple[int, str]] = []

    def adjust() -> None:
        done = command("adjust", project, "-o", folder, "--workers", "2", "--memory", "400MB", "--no-html")
        ended.append((done.exit_code, done.stderr))

    run = threading.Thread(target=adjust, daemon=True)
    killer = threading.Thread(target=_kill_now_and_then, args=(over, draw, killed, most), daemon=True)
    run.start()
    killer.start()
    run.join(DEADLINE)
    over.set()
    killer.join()
    seconds = time.monotonic() - began
    if not ended:
        return Trial(len(killed), None, False, "", seconds)
    code, said = ended[0]
    return Trial(len(killed), code, code == 0 and _files(folder) == alone, said, seconds)


_SCHEDULER = """
from distributed import LocalCluster
import sys
if __name__ == "__main__":
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


def scheduler_trial(project: Path, folder: Path, alone: dict[str, bytes], draw: random.Random) -> Trial:
    """One run whose scheduler is killed, and its workers with it."""
    script = folder.with_suffix(".py")
    script.write_text(_SCHEDULER, encoding="utf-8")
    told = subprocess.PIPE
    paths = {"PYTHONPATH": str(Path(__file__).parents[1])}
    command_line = [sys.executable, str(script)]
    with subprocess.Popen(
        command_line, stdin=told, stdout=told, text=True, env=os.environ | paths
    ) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        of_it = [*psutil.Process(process.pid).children(recursive=True), psutil.Process(process.pid)]
        ended: list[tuple[int, str]] = []

        def adjust() -> None:
            done = command("adjust", project, "-o", folder, "--cluster", address, "--no-html")
            ended.append((done.exit_code, done.stderr))

        began, run = time.monotonic(), threading.Thread(target=adjust, daemon=True)
        run.start()
        run.join(draw.uniform(0.2, 8.0))
        for one in reversed(of_it):
            one.send_signal(signal.SIGKILL)
        run.join(DEADLINE)
    seconds = time.monotonic() - began
    if not ended:
        return Trial(1, None, False, "", seconds)
    code, said = ended[0]
    return Trial(1, code, code == 0 and _files(folder) == alone, said, seconds)


def _is_wrong(number: int, found: Trial) -> bool:
    """True where bytes differ or no words are said; ends everything where a run hangs."""
    told = "hangs" if found.exit_code is None else f"exit code {found.exit_code}"
    said = (found.said.strip().splitlines() or ["no words"])[-1]
    words = "same bytes" if found.same else said
    print(f"run {number}: {found.kills} killed, {told}, {words}, {found.seconds:.0f} s", flush=True)
    if found.exit_code is None:
        os._exit(1)  # what hangs cannot be ended in an orderly way
    return not (found.same or (found.exit_code == ExitCode.INPUT and bool(found.said)))


def main() -> int:
    """Kill workers; 1 where bytes differ, a run hangs or ends without words."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--schedulers", type=int, default=0)
    chosen = parser.parse_args()
    room.rays_of_domain = lambda rays, memory, workers=1: 500  # type: ignore[assignment]
    room.need_of_all = lambda rays, html=None, snooping=False: 1e18  # type: ignore[assignment]
    room.OF_OUTER = 0
    draw, kills, wrong = random.Random(chosen.seed), 0, 0
    with tempfile.TemporaryDirectory() as held:
        folder = Path(held)
        project = write_block(folder / "project", Kind(control=6, sights=20))
        done = command("adjust", project, "-o", folder / "alone", "--memory", "400MB", "--no-html")
        assert done.exit_code == 0, done.stderr
        alone = _files(folder / "alone")
        number = 0
        while kills < chosen.kills:
            number += 1
            found = trial(project, folder / f"run{number}", alone, draw, min(5, chosen.kills - kills))
            kills += found.kills
            wrong += _is_wrong(number, found)
        for _ in range(chosen.schedulers):
            number += 1
            wrong += _is_wrong(number, scheduler_trial(project, folder / f"run{number}", alone, draw))
    print(f"{kills} workers killed, {number} runs, {wrong} of them wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
