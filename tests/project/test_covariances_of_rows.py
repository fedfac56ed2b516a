"""Covariances in columns: a variance is its own column, or the square of the σ."""

from __future__ import annotations

import json

import pytest

from tests.scenarios.small_projects import mor

ROWS = [["A", "B", 10.0, 0.0, 1.0], ["A", "B", 10.004, 0.003, 1.002], ["B", "C", 0.0, 20.0, -2.0]]
ROWS += [["A", "C", 10.003, 20.001, -0.998]]
COVARIANCE = {"dx_dy": 2e-6, "dx_dz": -1e-6, "dy_dz": 5e-7}


def solved(folder, columns, values, constant=""):
    folder.mkdir()
    rows = [[*row, *values] for row in ROWS]
    (folder / "project.yaml").write_text(f"""\
mor: 1
units: {{length: m}}
points:
  - {{columns: [id, x, y, z], rows: [[A, 0, 0, 0]], fixed: [x, y, z]}}
  - {{columns: [id], rows: [[B], [C]]}}
observations:
  - type: vector
    columns: {json.dumps(["from", "to", "dx", "dy", "dz", *columns])}
    rows: {json.dumps(rows)}
{constant}
""")
    run = mor("adjust", folder / "project.yaml", "--json", "--quiet")
    assert run.code in (0, 1), run.err
    found = json.loads(run.out)
    return [[row["v"], row["r"], row["w"]] for row in found["residuals"]], found["sigma0"]["aposteriori"]


def test_a_variance_without_a_column_is_the_square_of_the_sigma(tmp_path):
    names, values = [f"cov_{name}" for name in COVARIANCE], list(COVARIANCE.values())
    variances = {"cov_dx_dx": 9e-6, "cov_dy_dy": 4e-6, "cov_dz_dz": 1.6e-5}
    whole = solved(tmp_path / "whole", [*variances, *names], [*variances.values(), *values])
    sigma = solved(tmp_path / "sigma", ["sigma_dx", "sigma_dy", "sigma_dz", *names], [0.003, 0.002, 0.004, *values])
    mixed = solved(
        tmp_path / "mixed",
        ["cov_dx_dx", "sigma_dy", *names],
        [9e-6, "2 mm", *values],
        "    values: {sigma_dz: 4 mm}",
    )
    for other in (sigma, mixed):
        assert other[1] == pytest.approx(whole[1], rel=1e-12)
        for row, expected in zip(other[0], whole[0], strict=True):
            assert row == pytest.approx(expected, abs=1e-9)
