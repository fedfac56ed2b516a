"""Runs of the program that are killed, interrupted or ended at random moments, and what they leave on disk.

    python -m tools.interruptions --count 200 --signal SIGKILL

Each trial replaces the results of an earlier project by those of a changed one and is hit at a seeded moment, up to a
little after the usual end. Then the folder holds the old or the new result, complete; an orderly end leaves nothing
else; and the next run ends well and leaves nothing but its result. Words are never a traceback.
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
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

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
Content = Mapping[str, bytes]


class Trial(NamedTuple):
    """How a run ended that was hit: its code, what was in the folder, and what was wrong."""

    moment: float
    code: int
    found: str
    faults: tuple[str, ...]


class Scene(NamedTuple):
    """A project, and its results in both of its states, with a file of the user among them."""

    folder: Path
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
def prepared() -> Iterator[Scene]:
    """A project in a folder of its own, adjusted in both states."""
    with tempfile.TemporaryDirectory() as place:
        scene, results = Scene(Path(place)), []
        for state in STATES:
            scene.project.write_text(state, encoding="utf-8")
            begun = time.monotonic()
            _finish(scene)
            seconds = time.monotonic() - begun
            (scene.out / "mine.txt").write_text("mine")
            results.append(content(scene.out))
        yield scene._replace(results=tuple(results), seconds=seconds)


def trial(scene: Scene, name: str, draw: random.Random) -> Trial:
    """One run, hit by a signal at a random moment, and the next run after it."""
    old = draw.randrange(2)
    _put(scene.out, scene.results[old])
    scene.project.write_text(STATES[1 - old], encoding="utf-8")
    moment = draw.uniform(0.0, 1.15 * scene.seconds)
    process = _started(scene)
    time.sleep(moment)
    process.send_signal(getattr(signal, name))
    said = process.communicate()[1]
    # Hit before or after all of the program, which has no say then.
    outside = process.returncode < 0 or ("Traceback" in said and "__main__.py" not in said)
    found, faults = content(scene.out), []
    which = next((word for word, k in (("old", old), ("new", 1 - old)) if found == scene.results[k]), "neither")
    if which == "neither":
        faults.append("the results are neither the old nor the new ones")
    if not outside and ("Traceback" in said or "Exception ignored" in said):
        faults.append(f"it said: {said.strip().splitlines()[-1]}")
    if name != "SIGKILL" and not outside:
        faults += [f"left behind: {path}" for path in _strangers(scene)]
        if process.returncode not in (0, 128 + getattr(signal, name)):
            faults.append(f"exit code {process.returncode}")
    _finish(scene)
    if content(scene.out) != scene.results[1 - old]:
        faults.append("the next run has another result")
    faults += [f"left behind by the next run: {path}" for path in _strangers(scene)]
    return Trial(moment, process.returncode, which, tuple(faults))


def content(folder: Path) -> Content:
    """Every file of a folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir()} if folder.is_dir() else {}


def _put(folder: Path, files: Content) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_bytes(text)


def _strangers(scene: Scene) -> list[str]:
    """What stands beside project and results."""
    return sorted(path.name for path in scene.folder.iterdir() if path not in (scene.project, scene.out))


def _started(scene: Scene) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "mor", "adjust", str(scene.project), "--force"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def _finish(scene: Scene) -> None:
    process = _started(scene)
    said = process.communicate()[1]
    if process.returncode:
        raise RuntimeError(f"exit code {process.returncode}: {said}")


def main() -> None:
    """Do as many trials as asked for and say what came of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--signal", choices=SIGNALS, default="SIGKILL")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    found: Counter[str] = Counter()
    faulty = 0
    with prepared() as scene:
        for number in range(given.count):
            done = trial(scene, given.signal, random.Random(f"{given.seed} {given.signal} {number}"))
            found[done.found] += 1
            faulty += bool(done.faults)
            for fault in done.faults:
                print(f"trial {number}, after {done.moment:.3f} s, exit code {done.code}: {fault}", flush=True)
    print(f"{given.count} × {given.signal}: {found['old']} old, {found['new']} new, {faulty} with faults")
    sys.exit(1 if faulty else 0)


if __name__ == "__main__":
    main()
