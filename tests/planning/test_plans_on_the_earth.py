"""Plans of networks on the earth: without any measured value they are worth what their simulated measurements are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.api.plan import at_its_place, read_plan, solve_plan
from mor.api.simulation import simulated
from mor.plan.simulation import Wishes
from mor.quality.solution import Solved
from mor.report.output_folder import reserve
from sample_projects.expected import ROOT
from tests.scenarios.small_projects import mor

MEASURED = {
    "gnss_vector": ("dx", "dy", "dz"),
    "zenith_directions": ("horizontal", "zenith"),
    "distance": ("distance",),
    "height_difference": ("dz",),
    "image": ("x", "y"),
    "projected_position": ("east", "north", "height"),
}


@pytest.fixture(scope="module")
def without_errors(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample of a dam with measurements that are free of errors, at the place that it has been adjusted to."""
    folder = tmp_path_factory.mktemp("dam")
    simulation = simulated(ROOT / "dam" / "project.yaml", "", seed=1, wishes=Wishes(), noise=False)
    with reserve(folder / "there", False) as place:
        simulation.write(place)
    return folder / "there"


def _adjusted(folder: Path) -> Solved:
    return solve_network(read_network(read_document(folder / "project.yaml"), folder))


def _same_quality(one: Solved, other: Solved) -> None:
    assert one.quality is not None
    assert other.quality is not None
    for ours, theirs in zip(one.quality.groups, other.quality.groups, strict=True):
        np.testing.assert_allclose(ours.r, theirs.r, rtol=0.0, atol=1e-9)
    for kind in one.quality.cofactors:
        sigma = [
            np.sqrt(np.maximum(np.diagonal(solved.quality.cofactors[kind], axis1=1, axis2=2), 0.0))
            for solved in (one, other)
            if solved.quality is not None
        ]
        np.testing.assert_allclose(sigma[0], sigma[1], rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_sigma_and_r_of_a_plan_without_values(without_errors: Path, tmp_path: Path) -> None:
    solved = _adjusted(without_errors)
    assert solved.quality is not None
    assert solved.quality.omega < 1e-9
    for file in without_errors.iterdir():
        kind = file.stem.split("_", 2)[-1]
        if file.name.startswith("observations_"):
            pl.read_csv(file, infer_schema=False).drop(MEASURED[kind]).write_csv(tmp_path / file.name)
        else:
            (tmp_path / file.name).write_bytes(file.read_bytes())
    text = (tmp_path / "project.yaml").read_text()
    geoid = str(ROOT / "dam" / "geoid.gtx")
    lines = [f"  geoid: {geoid}" if line.startswith("  geoid:") else line for line in text.splitlines()]
    (tmp_path / "project.yaml").write_text("\n".join(lines))
    network = read_plan(read_document(tmp_path / "project.yaml"), tmp_path).network
    assert len(network.unmeasured) == len(MEASURED)
    _same_quality(solve_plan(at_its_place(network)), solved)
    assert mor("design", tmp_path / "project.yaml", "-o", tmp_path / "plan").code == 0


@pytest.mark.slow
def test_simulated_control_has_its_errors_in_its_coordinates(tmp_path: Path) -> None:
    """The benchmark is given elsewhere than where it is, by errors like its σ; reference stations are held."""
    for seed in (1, 2):
        simulation = simulated(ROOT / "dam" / "project.yaml", "", seed=seed, wishes=Wishes())
        with reserve(tmp_path / str(seed), False) as place:
            simulation.write(place)
    given = [pl.read_csv(tmp_path / str(seed) / "start_points_3.csv") for seed in (1, 2)]
    shift = [g["height"][0] - g["start_height"][0] for g in given]
    assert given[0]["start_height"][0] == pytest.approx(given[1]["start_height"][0], abs=1e-9)
    assert 1e-5 < abs(shift[0] - shift[1]) < 3e-3
    held = [pl.read_csv(tmp_path / str(seed) / "start_points_1.csv") for seed in (1, 2)]
    assert held[0].equals(held[1])
    solved = _adjusted(tmp_path / "1")
    assert solved.quality is not None
    assert 0.93 < solved.quality.sigma0 < 1.07


def test_a_position_above_the_geoid_needs_to_know_where_that_is(tmp_path: Path) -> None:
    text = """\
mor: 1
world: {crs: "EPSG:25832", heights: orthometric}
cameras: {K: {interior: {c: 100}}}
images:
  - columns: [id, camera, east, north, elevation, geoid, omega, phi, kappa]
    rows: [[B, K, 600100, 5500100, 900, 47, 0, 0, 0]]
points:
  - {columns: [id, east, north, height, geoid], rows: [[A, 600000, 5500000, 100, 47]], fixed: [x, y, z]}
observations:
  - {type: projected_position, columns: [point], rows: [[B]], values: {sigma: 0.03}}
"""
    (tmp_path / "project.yaml").write_text(text)
    found = mor("design", tmp_path / "project.yaml", "-o", tmp_path / "out")
    assert found.code == 2
    assert "'B': its height is above the geoid, but the geoid is unknown" in found.err
    (tmp_path / "project.yaml").write_text(text.replace("sigma: 0.03", "sigma: 0.03, geoid: 47"))
    assert "above the geoid" not in mor("design", tmp_path / "project.yaml", "-o", tmp_path / "out").err
