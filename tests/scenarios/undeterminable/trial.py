"""One trial: is what was planted named, and is the rest what it is without it?"""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.scenarios.small_projects import mor
from tests.scenarios.undeterminable.plantings import KINDS, planted, sound, write

CLOSE = 1e-4
"""Difference of coordinates in units of their σ up to which two adjustments are the same."""


class Trial(NamedTuple):
    """How it went: the mistakes found, none where all is well."""

    seed: int
    kinds: tuple[str, ...]
    mistakes: tuple[str, ...]


def trial(seed: int, folder: Path) -> Trial:
    """Run a seed: the sound project, and with what was planted, left out."""
    random = np.random.default_rng(1000 + seed)
    kinds = tuple(random.choice(KINDS, int(random.integers(1, 4)), replace=False).tolist())
    world = sound(seed)
    clean = copy.deepcopy(world)
    expected = planted(world, kinds)
    mistakes = [
        *_left_out(clean, world, expected, folder),
        *_refused(world, expected, folder),
    ]
    return Trial(
        seed,
        (*kinds, "free" if world.free else "control", "given" if world.given else "none"),
        tuple(mistakes),
    )


def _left_out(clean, world, expected, folder):
    truth = mor("adjust", write(folder / "clean", clean, "refuse"), "--no-html", "--force")
    if truth.code:
        return []  # not a matter of this test
    run = mor("adjust", write(folder / "planted", world, "leave_out"), "--no-html", "--force")
    if run.code:
        return [f"leave_out: exit {run.code}: {run.err[-300:]}"]
    one, other = (_results(folder / name) for name in ("clean", "planted"))
    named = {(row["kind"], row["id"]) for row in other["undeterminable"]}
    mistakes = [f"not named: {thing} ({expected[thing]})" for thing in set(expected) - named]
    mistakes += [f"wrongly left out: {thing}" for thing in named - set(expected)]
    return [*mistakes, *_different(one, other, world.free and not world.given)]


def _different(one, other, anywhere):
    """How far points are from those of the sound project; ``anywhere``: but for a movement, where nothing is given."""
    rows = {row["id"]: row for row in other["points"]}
    there = [[rows[row["id"]][axis] for axis in "xyz"] for row in one["points"]]
    lost = [row["id"] for row, place in zip(one["points"], there, strict=True) if None in place]
    if lost:
        return [f"point {lost[0]} has no coordinates"]
    X, Y = np.array([[row[axis] for axis in "xyz"] for row in one["points"]]), np.array(there)
    if anywhere:
        Y = _moved(Y, X)
    sigma = np.array([[row[f"s{axis}"] or np.inf for axis in "xyz"] for row in one["points"]])
    worst = float(np.max(np.abs(Y - X) / sigma))
    return [f"the rest differs by {worst:.2g} sigma"] if worst > CLOSE else []


def _moved(these, onto):
    """Points (n, 3) turned and shifted onto others."""
    left, _, right = np.linalg.svd((these - these.mean(axis=0)).T @ (onto - onto.mean(axis=0)))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return (these - these.mean(axis=0)) @ turn + onto.mean(axis=0)


def _refused(world, expected, folder):
    """Without leave_out: far points are held, anything else stops the adjustment and is named."""
    run = mor("adjust", write(folder / "refused", world, "refuse"), "--no-html", "--force")
    others = {thing for thing, kind in expected.items() if kind != "far"}
    if not others:
        if run.code:
            return [f"far: exit {run.code}: {run.err[-300:]}"]
        held = {(row["kind"], row["id"]) for row in _results(folder / "refused")["undeterminable"]}
        return [] if held == set(expected) else [f"far: held {held}"]
    if run.code not in (2, 4):
        return [f"refuse: exit {run.code}"]
    missing = [name for _, name in others if name not in _said(folder / "refused", run)]
    return [f"refuse: not named {missing}"] if missing else []


def _said(folder, run):
    tables = folder / "project.results"
    texts = [path.read_text() for path in sorted(tables.glob("*")) if path.name in ("report.txt", "undetermined.csv")]
    return "\n".join([run.err, *texts])


def _results(folder):
    return json.loads((folder / "project.results" / "results.json").read_text())
