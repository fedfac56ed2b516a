"""Passes over image points by the processes of a cluster: the numbers of threads, whatever is lost on the way."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import mor
from mor.cli import run
from mor.errors import InputError
from mor.quality.solution import Solved
from mor.solve import engine
from mor.solve.cluster import ComputeCluster, local

pytest.importorskip("distributed")
pytest.importorskip("cryptography")
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]
SAMPLES = Path(__file__).parents[2] / "sample_projects"


@pytest.fixture(scope="module")
def workers() -> Iterator[ComputeCluster]:
    """Two processes."""
    with local(2) as cluster:
        yield cluster


@pytest.fixture(autouse=True)
def _all_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "WORTH_SENDING", 0)


def assert_same(one: Solved, other: Solved) -> None:
    """Values, residuals and redundancy numbers are the same to 1e-9 σ."""
    assert one.adjustment.outcome is other.adjustment.outcome
    for kind, values in one.adjustment.values.items():
        np.testing.assert_allclose(other.adjustment.values[kind], values, rtol=1e-12, atol=1e-12)
    if one.quality is None or other.quality is None:
        assert one.quality is other.quality
        return
    for group, same in zip(one.quality.groups, other.quality.groups, strict=True):
        np.testing.assert_allclose(same.v, group.v, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(same.r, group.r, atol=1e-9)


@pytest.mark.parametrize("name", ["aerial_strip", "stereo_rig", "test_field", "three_line_strip"])
def test_numbers_of_threads(workers: ComputeCluster, name: str) -> None:
    project = str(SAMPLES / name / "project.yaml")
    here = mor.adjust(project).solved
    with engine.shared_among(lambda: workers):
        there = mor.adjust(project).solved
    assert_same(here, there)


@pytest.mark.parametrize("lost", [1, 2])
def test_lost_workers_change_nothing(lost: int) -> None:
    project = str(SAMPLES / "test_field" / "project.yaml")
    here = mor.adjust(project).solved
    with local(2) as workers:

        def kill(iteration: object) -> None:
            if getattr(iteration, "number", 0) == 2:
                for process in list(workers.client.run(os.getpid).values())[:lost]:
                    os.kill(process, signal.SIGKILL)

        with engine.shared_among(lambda: workers):
            there = mor.adjust(project, watch=kill).solved
    assert_same(here, there)


def test_an_error_of_a_task_is_raised_here(workers: ComputeCluster) -> None:
    with pytest.raises(ZeroDivisionError):
        list(workers.results(0, _divided, [0, 1], 1))


def _divided(shared: int, one: int, common: int) -> float:
    return common / one


def test_a_lost_scheduler_is_told() -> None:
    with local(1) as cluster:
        cluster.client.cluster.close()
        with pytest.raises(InputError, match=r"the scheduler is lost|all workers are lost"):
            list(cluster.results(0, _divided, [1], 1))


def test_either_workers_or_a_cluster(tmp_path: Path) -> None:
    project = str(SAMPLES / "bridge" / "project.yaml")
    options = ["--workers", "1", "--cluster", "tcp://host:8786", "-o", str(tmp_path / "results")]
    assert run(["adjust", project, *options]) == 2
    assert not (tmp_path / "results").exists()
