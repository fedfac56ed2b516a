"""Traverses of which a third of the directions is wrong: what a station's set hangs on alone cannot be taken out."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.scenarios.small_projects import mor, write

PLACES = {"A": (0, 0), "C": (-120, 60), "B": (520, 40), "D": (130, 35), "E": (260, -20), "F": (390, 30)}
SIGHTS = ("AC", "AD", "DA", "DE", "ED", "EF", "FE", "FB")


def _traverse(seed: int) -> str:
    random = np.random.default_rng(seed)
    directions, distances = [], []
    for at, to in SIGHTS:
        x, y = np.subtract(PLACES[to], PLACES[at])
        wrong = random.normal() * 0.003
        wrong += random.uniform(-150, 150) if random.random() < 0.35 else 0.0
        directions.append(f"[{at}, {to}, {(np.degrees(np.arctan2(x, y)) / 0.9 + wrong) % 400:.4f}]")
    for at, to in SIGHTS[1:]:
        length = np.hypot(*np.subtract(PLACES[to], PLACES[at])) + random.normal() * 0.005
        distances.append(f"[{at}, {to}, {length:.3f}]")
    points = [f"[{name}, {x}, {y}]" for name, (x, y) in PLACES.items()]
    return f"""\
mor: 1
units: {{length: m, angle: gon}}
settings: {{dimensions: xy}}
points:
  - {{columns: [id, x, y], rows: [{", ".join(points[:3])}], fixed: [x, y]}}
  - {{columns: [id, x, y], rows: [{", ".join(points[3:])}]}}
observations:
  - {{type: directions, columns: [station, to, horizontal], rows: [{", ".join(directions)}],
     values: {{sigma_horizontal: 0.003}}}}
  - {{type: horizontal_distance, columns: [from, to, distance], rows: [{", ".join(distances)}],
     values: {{sigma: 0.005}}}}
"""


@pytest.mark.parametrize("seed", [14, 24])
def test_redundancy_numbers_add_up_whatever_is_taken_out(tmp_path, seed):
    """Of seed 14 both directions of a station went out, whose orientation they still gave, with vanishing weight."""
    project = write(tmp_path, _traverse(seed))
    run = mor("adjust", project, "--snoop", "--no-html", "--tables", "none")
    assert run.code in (0, 1), run.err
    results = json.loads((tmp_path / "project.results" / "results.json").read_text())
    assert results["redundancy_sum"] == pytest.approx(results["redundancy"], abs=1e-6)
