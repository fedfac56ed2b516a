"""The runner of the benchmarks on its smallest case: same solution everywhere, Σ r = n − u + d. Nothing is timed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

RUNNER = Path(__file__).parents[2] / "benchmarks" / "run.py"


def runner(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, RUNNER, *arguments], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def smallest(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("benchmark")
    done = runner("aerial-6", "--json", str(folder / "out.json"), "--folder", str(folder))
    assert done.returncode == 0, done.stdout + done.stderr
    results: dict[str, Any] = json.loads((folder / "out.json").read_text(encoding="utf-8"))
    return results


def test_kernel_fits_the_simulated_noise_and_its_redundancy_numbers_add_up(smallest: dict[str, Any]) -> None:
    kernel = smallest["cases"]["aerial-6"]["kernel"]
    assert kernel["outcome"] == "converged"
    assert abs(kernel["redundancy_check"]) < 1e-6
    assert kernel["redundancy"] == kernel["observations"] - kernel["unknowns"]
    # vᵀPv is χ² distributed with variance 2 r
    assert abs(kernel["objective"] - kernel["redundancy"]) < 4 * (2 * kernel["redundancy"]) ** 0.5


def test_whole_command_reaches_the_same_solution(smallest: dict[str, Any]) -> None:
    one = smallest["cases"]["aerial-6"]
    assert set(one["commands"]) == {"csv", "parquet", "csv, html"}
    for done in one["commands"].values():
        assert done["sigma0"] == pytest.approx(one["kernel"]["sigma0"], rel=1e-9)
        assert abs(done["redundancy_check"]) < 1e-6


def test_ceres_solves_the_same_problem(smallest: dict[str, Any]) -> None:
    one = smallest["cases"]["aerial-6"]
    if "ceres" not in one:
        pytest.skip("; ".join(smallest["left_out"]))
    assert one["ceres"]["objective"] == pytest.approx(one["kernel"]["objective"], rel=1e-10)


def test_unknown_cases_are_named() -> None:
    done = runner("aerial-7")
    assert done.returncode == 2
    assert "aerial-7" in done.stderr


def test_images_and_sights_in_one_project_reach_the_solution_of_the_kernel(tmp_path: Path) -> None:
    done = runner("mixed-6", "--no-peers", "--json", str(tmp_path / "out.json"), "--folder", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    one = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["cases"]["mixed-6"]
    assert set(one["commands"]) == {"csv", "csv, html"}
    for command in one["commands"].values():
        assert command["sigma0"] == pytest.approx(one["kernel"]["sigma0"], rel=1e-9)
        assert abs(command["redundancy_check"]) < 1e-6
