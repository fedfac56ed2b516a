"""Spatial angles: closed forms, and the network that horizontal and vertical directions of the same sights give."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from mor.model.observation_types import ALL_TYPES
from tests.scenarios.small_projects import mor, write

GON = np.pi / 200.0


def angle(at, first, second, heights=(0.0, 0.0, 0.0)) -> float:
    blocks = [
        np.array([row], dtype=float)
        for xyz, height in zip((at, first, second), heights, strict=True)
        for row in (xyz, (height,))
    ]
    return float(ALL_TYPES["spatial_angle"].equation(blocks, np.zeros((1, 0))).values[0, 0])


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ((0, 3, 0), (2, 0, 0), math.pi / 2),
        ((1, 0, 0), (1, 0, 1), math.pi / 4),
        ((1, 1, 1), (-1, -1, 1), math.acos(-1.0 / 3.0)),
        ((1, 1, 1), (2, 2, 2), 0.0),
        ((1, 0, 0), (-7, 0, 0), math.pi),
        ((1, 0, 0), (1, 1e-9, 0), 1e-9),
    ],
)
def test_closed_forms(first, second, expected):
    assert angle((0, 0, 0), first, second) == pytest.approx(expected, rel=1e-12, abs=1e-16)
    assert angle((0, 0, 0), second, first) == pytest.approx(expected, rel=1e-12, abs=1e-16)


def test_heights_of_instrument_and_targets_count():
    assert angle((0, 0, 0), (1, 0, 0), (0, 1, 0), (0.0, 1.0, 1.0)) == pytest.approx(math.pi / 3, rel=1e-12)
    assert angle((0, 0, 1), (1, 0, 0), (0, 1, 0), (1.0, 2.0, 2.0)) == pytest.approx(math.pi / 2, rel=1e-12)


def test_it_is_the_spherical_side_between_directions_and_zenith_angles():
    """cos γ = cos z1 cos z2 + sin z1 sin z2 cos β, whatever the tilt of the instrument."""
    random = np.random.default_rng(5)
    for _ in range(20):
        at, first, second = random.uniform(-5, 5, (3, 3))
        u, v = first - at, second - at
        z1, z2 = (math.acos(w[2] / np.linalg.norm(w)) for w in (u, v))
        beta = math.atan2(v[0], v[1]) - math.atan2(u[0], u[1])
        cosine = math.cos(z1) * math.cos(z2) + math.sin(z1) * math.sin(z2) * math.cos(beta)
        assert math.cos(angle(at, first, second)) == pytest.approx(cosine, abs=1e-12)


TARGETS = {"A": (0, 0, 2), "B": (40, 5, 12), "C": (35, 50, 1), "D": (-8, 45, 20), "E": (10, 20, 35)}
TRUTH = np.array([14.0, 17.0, 3.0])
PROJECT = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: %s, fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[S, 13, 18, 2.5]]}
observations:
  - type: spatial_angle
    columns: [at, from, to, angle, at_height]
    rows: %s
    values: {sigma: 1 mgon}
"""


def test_a_resection_by_spatial_angles_finds_the_truth(tmp_path: Path) -> None:
    """No level, no orientation: the angles of a sextant, or of a tilted instrument, fix the place all the same."""
    rows, names = [], list(TARGETS)
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            u, v = (np.array(TARGETS[name]) - TRUTH - [0, 0, 1.5] for name in (first, second))
            gamma = math.acos(u @ v / np.linalg.norm(u) / np.linalg.norm(v))
            rows.append(["S", first, second, gamma / GON, 1.5])
    points = json.dumps([[name, *xyz] for name, xyz in TARGETS.items()])
    run = mor("adjust", write(tmp_path, PROJECT % (points, json.dumps(rows))), "--json", "--quiet")
    assert run.code == 0, run.err
    data = json.loads(run.out)
    found = next(point for point in data["points"] if point["id"] == "S")
    np.testing.assert_allclose([found[key] for key in "xyz"], TRUTH, atol=1e-7)
    assert data["redundancy"] == len(rows) - 3
    assert data["redundancy_sum"] == pytest.approx(data["redundancy"], abs=1e-9)
