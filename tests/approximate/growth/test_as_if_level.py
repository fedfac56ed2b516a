"""Two stations of which one measures no vertical angles and the other no distances: nothing given, known truth."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import yaml

from tests.scenarios.small_projects import mor
from tests.selection import slow_after

SIGMA_ANGLE, SIGMA_DISTANCE = 3e-5, 3e-4


def surveyed(seed):
    """Project and true distances between the first point and the others."""
    random = np.random.default_rng(seed)
    P = random.uniform(-30.0, 30.0, (9, 3)) * (1.0, 1.0, 0.3)
    S = random.uniform(-18.0, 18.0, (2, 3)) * (1.0, 1.0, 0.2)
    names = [f"P{k}" for k in range(len(P))]
    rows, lengths = [], []
    for station, place, zero in zip(("s0", "s1"), S, random.uniform(0.0, 2.0 * math.pi, 2), strict=True):
        for name, (dx, dy, dz) in zip(names, P - place, strict=True):
            circle = (math.atan2(dx, dy) - zero + SIGMA_ANGLE * random.normal()) % (2.0 * math.pi)
            zenith = math.atan2(math.hypot(dx, dy), dz) + SIGMA_ANGLE * random.normal()
            rows.append([station, name, str(circle), str(zenith) if station == "s0" else ""])
            if station == "s1":
                length = math.hypot(dx, dy, dz) + SIGMA_DISTANCE * random.normal()
                lengths.append([station, name, str(length)])
    project = {
        "mor": 1,
        "units": {"angle": "rad"},
        "points": [{"columns": ["id", "x"], "rows": [[name, ""] for name in ["A", "B", *names]]}],
        "stations": [{"columns": ["id", "point", "height"], "rows": [["s0", "A", "0"], ["s1", "B", "0"]]}],
        "observations": [
            {
                "type": "zenith_directions",
                "columns": ["station", "to", "horizontal", "zenith"],
                "values": {"sigma": SIGMA_ANGLE},
                "rows": rows,
            },
            {
                "type": "distance",
                "columns": ["from", "to", "distance"],
                "values": {"sigma": SIGMA_DISTANCE},
                "rows": lengths,
            },
        ],
        "datum": "free",
    }
    return project, np.linalg.norm(P[1:] - P[0], axis=1)


@pytest.mark.parametrize("seed", slow_after(0, range(3)))
def test_it_comes_to_the_true_network(tmp_path, seed):
    project, expected = surveyed(seed)
    (tmp_path / "project.yaml").write_text(yaml.safe_dump(project), encoding="utf-8")
    run = mor("adjust", tmp_path / "project.yaml", "--no-html", "-o", tmp_path / "results")
    assert run.code == 0, run.err
    results = json.loads((tmp_path / "results" / "results.json").read_text(encoding="utf-8"))
    assert results["sigma0"]["ratio_of_sigmas"] < 2.0
    lines = (tmp_path / "results" / "points.csv").read_text(encoding="utf-8").splitlines()
    place = {}
    for line in lines[1:]:
        row = dict(zip(lines[0].split(","), line.split(","), strict=True))
        place[row["id"]] = np.array([float(row[axis]) for axis in "xyz"])
    found = [np.linalg.norm(place[f"P{k}"] - place["P0"]) for k in range(1, 9)]
    np.testing.assert_allclose(found, expected, atol=0.1)
