"""Small networks of batches and simulations, and what a project may do to the process it is in."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

NET = """mor: 1
title: {title}
settings: {{dimensions: xy}}
points:
- columns: [id, x, y]
  rows: [[A, 0, 0], [B, 100, 0], [C, 100, 80], [D, 0, 90]]
observations:
- type: horizontal_distance
  columns: [from, to, distance]
  values: {{sigma: 2 mm}}
  rows: [[A, B, {ab}], [B, C, 80.001], [C, D, 100.499], [D, A, 89.999], [A, C, 128.062], [B, D, 134.537]]
datum: free
"""


def write_project(folder: Path, name: str, ab: str = "", text: str = NET) -> None:
    """Write a project into a folder of its name; ``ab`` is a distance in it."""
    path = folder / name / "project.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(text.format(title=name, ab=ab))


def act(deed: str) -> int:
    """What a project may do to the process it is in."""
    if deed == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if deed == "hang":
        time.sleep(600.0)
    if deed == "raise":
        raise RuntimeError("broken")
    if deed == "leave":
        os._exit(7)
    print("done", flush=True)
    return 0


def linger(folder: str) -> int:
    """Tell who one is, and stay."""
    Path(folder, "pid").write_text(str(os.getpid()))
    time.sleep(600.0)
    return 0


PLAN = """mor: 1
title: four points
settings: {dimensions: xy}
points:
- columns: [id, x, y]
  rows: [[A, 0, 0], [B, 100, 0], [C, 100, 80], [D, 0, 90], [E, 50, 40]]
observations:
- type: horizontal_distance
  columns: [from, to]
  values: {sigma: 2 mm}
  rows: [[A, B], [B, C], [C, D], [D, A], [A, C], [B, D], [A, E], [B, E], [C, E], [D, E]]
datum: free
"""
