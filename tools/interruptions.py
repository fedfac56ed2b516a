"""Runs of the program that something happens to at random moments, and what they leave on disk.

    python -m tools.interruptions --count 200 --fault SIGKILL
    python -m tools.interruptions --count 50 --fault disk --engine memory

Each trial replaces the results of an earlier project by those of a changed one and is hit at a seeded moment, up to a
little after the usual end. Then the folder holds the old or the new result, complete; an orderly end leaves nothing
else; no process stays; and the next run ends well and leaves nothing but its result. Messages are never a traceback.

SIGKILL, SIGINT, SIGTERM   the process gets this signal
worker                     one worker is killed, or both, or each that starts from then on
scheduler                  the scheduler of a cluster is killed, and its workers with it
disk                       the disk has a random amount of space left (a small one is mounted, which root may do)
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, NamedTuple

import psutil

from tests.scenarios.image_blocks import Kind, write_block
from tools.snapshot import ENGINES

ROOT = Path(__file__).parents[1]
PROJECT = """\
mor: 1
title: {title}
points:
  - {{columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]}}
  - {{columns: [id, x, y, z], rows: [[B, 0, 0, 11], [C, 0, 0, 12]], fixed: [x, y]}}
observations:
  - type: height_difference
    columns: [from, to, dz, sigma]
    rows: [[A, B, 1.001, 0.001], [B, C, 1.002, 0.001], [C, A, {dz}, 0.001]]
"""
STATES = tuple(PROJECT.format(title=title, dz=dz) for title, dz in (("one", -2.001), ("other", -2.0015)))
SIGNALS = ("SIGKILL", "SIGINT", "SIGTERM")
FAULTS = {**dict.fromkeys(SIGNALS, "threads"), "worker": "workers", "scheduler": "cluster", "disk": "threads"}
"""The engine that each fault is tried with unless another one is asked for."""
OPTIONS = {"threads": [], "memory": ["--memory", "8GB"], "workers": ["--workers", "2"], "cluster": ["--cluster"]}
START = """\
import importlib, runpy
for name, values in {changed!r}.items():
    vars(importlib.import_module(name)).update(values)
runpy.run_module("mor", run_name="__main__", alter_sys=True)
"""
DISK = 1 << 24
"""Bytes of the disk that is filled."""
PATIENCE = 120.0
"""Seconds after which a run, or a process that it has begun, should have ended."""
Content = Mapping[str, bytes]


class Trial(NamedTuple):
    """How a run ended that was hit: its code, what was in the folder, and what was wrong."""

    moment: float
    """Seconds, or bytes that the disk had left."""
    code: int
    found: str
    faults: tuple[str, ...]
    said: str


class Scene(NamedTuple):
    """A project, and its results in both of its states, with a file of the user among them."""

    folder: Path
    engine: str = "threads"
    states: tuple[str, ...] = STATES
    inputs: frozenset[str] = frozenset()
    results: tuple[Content, ...] = ()
    seconds: float = 0.0
    """How long an undisturbed run takes."""

    @property
    def project(self) -> Path:
        """The project file."""
        return self.folder / "project.yaml"

    @property
    def out(self) -> Path:
        """The folder of the results."""
        return self.folder / "project.results"


@contextmanager
def prepared(fault: str = "SIGKILL", engine: str = "threads") -> Iterator[Scene]:
    """Yield a project in a folder of its own, adjusted in both states; image points unless threads adjust it."""
    with ExitStack() as held:
        place = Path(held.enter_context(tempfile.TemporaryDirectory()))
        if fault == "disk":
            subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK}", "tmpfs", place], check=True)
            held.callback(subprocess.run, ["umount", place], check=True)
        (place / "tmp").mkdir()
        scene, results = Scene(place, engine), []
        if engine != "threads":
            text = write_block(place, Kind(strips=2, points=100, table="csv")).read_text()
            scene = scene._replace(states=(text, text.replace("title: Block", "title: Other")))
        scene = scene._replace(inputs=frozenset({*_names(place), scene.project.name, scene.out.name}))
        for state in scene.states:
            scene.project.write_text(state, encoding="utf-8")
            _finish(scene)
            (scene.out / "mine.txt").write_text("mine")
            results.append(content(scene.out))
        begun = time.monotonic()
        with _options(engine) as options:
            _finish(scene, options)
        yield scene._replace(results=tuple(results), seconds=time.monotonic() - begun)


def trial(scene: Scene, fault: str, draw: random.Random) -> Trial:
    """One run, hit by a fault at a random moment, and the next run after it."""
    old = draw.randrange(2)
    _put(scene.out, scene.results[old])
    scene.project.write_text(scene.states[1 - old], encoding="utf-8")
    moment, faults = draw.uniform(0.0, 1.15 * scene.seconds), []
    if fault == "disk":
        moment = 4096.0 * 2.0 ** draw.uniform(0.0, 11.0)
        _fill(scene.folder / "ballast", int(moment))
    with _options(scene.engine) as options, tempfile.TemporaryFile("w+") as words:
        process = _started(scene, options, words)
        if fault != "disk":
            time.sleep(moment)
            _hit(process, fault, options, draw)
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            faults.append("it did not end")
            process.kill()
            process.wait()
        words.seek(0)
        said = words.read()
    (scene.folder / "ballast").unlink(missing_ok=True)
    # Hit before or after all of the program, which has no say then.
    outside = process.returncode < 0 or ("Traceback" in said and "__main__.py" not in said)
    found = content(scene.out)
    which = next((word for word, k in (("old", old), ("new", 1 - old)) if found == scene.results[k]), "neither")
    if which == "neither":
        faults.append("the results are neither the old nor the new ones")
    if not outside and ("Traceback" in said or "Exception ignored" in said):
        faults.append(f"it said: {said.strip().splitlines()[-1]}")
    faults += [f"still there: {name}" for name in _processes(scene)]
    if fault != "SIGKILL" and not outside:
        faults += [f"left behind: {path}" for path in _strangers(scene)]
        expected = (0, 128 + getattr(signal, fault) if fault in SIGNALS else 2)
        late = fault in SIGNALS and which == "new"  # the signal came when the results were in place
        if process.returncode not in expected or ((process.returncode == 0) != (which == "new") and not late):
            faults.append(f"exit code {process.returncode} with the {which} results: {said[-300:].strip()}")
    _finish(scene)
    if content(scene.out) != scene.results[1 - old]:
        faults.append("the next run has another result")
    faults += [f"left behind by the next run: {path}" for path in _strangers(scene)]
    return Trial(moment, process.returncode, which, tuple(faults), (said.strip().splitlines() or [""])[-1])


def _hit(process: subprocess.Popen[str], fault: str, options: Sequence[str], draw: random.Random) -> None:
    if fault in SIGNALS:
        process.send_signal(getattr(signal, fault))
    elif fault == "scheduler":
        os.kill(int(options[-1]), signal.SIGKILL)
    else:
        killed, most = 0, draw.choice((1, 2, 99))
        while process.poll() is None and killed < most:
            for worker in _workers(process.pid)[: most - killed]:
                with suppress(psutil.Error):
                    worker.kill()
                    killed += 1
            time.sleep(0.1)


def _workers(process: int) -> list[psutil.Process]:
    found = []
    with suppress(psutil.Error):
        for child in psutil.Process(process).children():
            with suppress(psutil.Error):
                found += [child] if "spawn_main" in " ".join(child.cmdline()) else []
    return found


def content(folder: Path) -> Content:
    """Every file of a folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir()} if folder.is_dir() else {}


def _put(folder: Path, files: Content) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_bytes(text)


def _names(folder: Path) -> Iterator[str]:
    return (path.name for path in folder.iterdir())


def _strangers(scene: Scene) -> list[str]:
    """Names of files that are neither of the project nor of the results, and of temporary files."""
    temporary = {*_names(scene.folder / "tmp")} - {"dask-scratch-space"}  # two locks; Dask removes the rest itself
    return sorted({*_names(scene.folder)} - scene.inputs) + sorted(temporary)


def _processes(scene: Scene) -> list[str]:
    """Processes of a run that stay when it has ended."""
    until = time.monotonic() + PATIENCE
    while True:
        found = []
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                if process.environ().get("TMPDIR") == str(scene.folder / "tmp"):
                    found.append(f"{process.pid} {' '.join(process.cmdline())[:60]}")
        if not found or time.monotonic() > until:
            return found
        time.sleep(0.05)


def _fill(ballast: Path, left: int) -> None:
    """Leave so many bytes of the disk."""
    disk = os.statvfs(ballast.parent)
    with ballast.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, max(disk.f_bavail * disk.f_bsize - left, 1))


@contextmanager
def _options(engine: str) -> Iterator[list[str]]:
    """Yield the options of an engine; those of a cluster end with its address and the number of its process."""
    if engine != "cluster":
        yield OPTIONS[engine]
        return
    command = [sys.executable, "-m", "tools.snapshot", "cluster"]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as cluster:
        assert cluster.stdout is not None
        yield [*OPTIONS[engine], cluster.stdout.readline().strip(), str(cluster.pid)]
        with suppress(BrokenPipeError):
            cluster.communicate()


def _started(scene: Scene, options: Sequence[str], words: IO[str]) -> subprocess.Popen[str]:
    start = ["-m", "mor"]
    if scene.engine != "threads":
        start = ["-c", START.format(changed=ENGINES["workers" if scene.engine == "cluster" else scene.engine])]
    command = [sys.executable, *start, "adjust", str(scene.project), "--no-html", "--force", *options[:2]]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(scene.folder / "tmp")}
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=words, text=True)


def _finish(scene: Scene, options: Sequence[str] = ()) -> None:
    """Adjust without a fault, by threads unless options say otherwise: every engine gives the same bytes."""
    with tempfile.TemporaryFile("w+") as words:
        code = _started(scene, options, words).wait()
        if code:
            words.seek(0)
            raise RuntimeError(f"exit code {code}: {words.read()}")


def main() -> None:
    """Do as many trials as asked for and say what came of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--fault", choices=FAULTS, default="SIGKILL")
    parser.add_argument("--engine", choices=OPTIONS, help="what adjusts (default: threads, or what the fault needs)")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    found: Counter[str] = Counter()
    said: Counter[str] = Counter()
    faulty = 0
    with prepared(given.fault, given.engine or FAULTS[given.fault]) as scene:
        for number in range(given.count):
            try:
                done = trial(scene, given.fault, random.Random(f"{given.seed} {given.fault} {number}"))
            except KeyboardInterrupt:  # what is done is counted
                break
            found[done.found] += 1
            said[done.said.replace(str(scene.folder), "")] += 1
            faulty += bool(done.faults)
            for fault in done.faults:
                print(f"trial {number}, {done.moment:.3f}, exit code {done.code}: {fault}", flush=True)
    counts = ", ".join(f"{found[which]} {which}" for which in ("old", "new", "neither"))
    print(f"{sum(found.values())} × {given.fault}: {counts}, {faulty} with faults")
    for words, count in said.most_common():
        print(f"{count:4} × {words}")
    sys.exit(1 if faulty else 0)


if __name__ == "__main__":
    main()
