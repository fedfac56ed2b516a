"""Mistakes in epochs and motions: one clear message each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.motion_scenes import project, scene
from tests.scenarios.small_projects import mor, write

V = "  - {model: velocity, points: [D1]}\n"


@pytest.mark.parametrize(
    ("motions", "words"),
    [
        ("  - {model: velocity, points: [D9]}", "point 'D9' does not exist"),
        ("  - {model: velocity, points: ['X*']}", "point 'X*' does not exist"),
        (V + V, "point 'D1' has a velocity already"),
        (V + "  - {model: epochs, points: [D1]}", "point 'D1' has coordinates of its own in every epoch"),
        ("  - {model: epochs, points: [D1]}\n" + V, "point 'D1' has coordinates of its own in every epoch"),
        ("  - {model: velocity, points: [D1], fixed: [sin_x]}", "model velocity has no component 'sin_x'"),
        (
            "  - {model: steps, points: [D1], values: {time: soon}}",
            "time: found 'soon', expected a date such as",
        ),
        ("  - {model: steps, points: [D1]}", "column 'time' is missing"),
        (
            "  - {model: linear, points: [D1]}",
            "found 'linear', expected 'velocity', 'seasonal', 'steps' or 'epochs'",
        ),
        ("  - {model: velocity}", "give either a file, rows or points"),
    ],
)
def test_mistakes_in_motions(tmp_path: Path, motions: str, words: str) -> None:
    text = project(scene(count=2, epochs=2), motions, np.random.default_rng(1))
    run = mor("check", write(tmp_path, text))
    assert run.code == 2
    assert words in run.err + run.out


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("epoch: 2015.0", "epoch: 12.5.2015", "epoch: found '12.5.2015', expected a date such as 2015-05-12"),
        (", epoch: 2015.0", "", "point 'D1' moves, and this row has no epoch"),
        ("motions:", "epochs: {reference: once}\nmotions:", "reference: found 'once', expected a date"),
        (
            "motions:",
            "stations: [{columns: [id, point, epoch], rows: [[S, A, 2001]]}]\nmotions:",
            "S is of epoch 2001",
        ),
    ],
)
def test_mistakes_in_epochs(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = project(scene(count=2, epochs=2), V, np.random.default_rng(1)).replace(old, new)
    if "S is" in words:
        text = text.replace("[A, e0, D1,", "[S, '', D1,")
    run = mor("check", write(tmp_path, text))
    assert run.code == 2
    assert words in run.err + run.out
