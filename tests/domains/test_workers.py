"""Workers: the same bytes as one process, also where they are killed; what keeps them from it is said before."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

import polars as pl
import pytest

from mor import cluster
from mor.domains import reweighting, robust, room
from tests.scenarios.domains_blocks import Kind, command, write_block

pytest.importorskip("distributed")
pytestmark = [pytest.mark.filterwarnings("default"), pytest.mark.slow]


@pytest.fixture
def small_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "rays_of_domain", lambda rays, memory, workers=1: 500)
    monkeypatch.setattr(room, "PROGRAM", 0.0)
    monkeypatch.setattr(room, "OF_OUTER", 0)


def adjust(project: Path, folder: Path, *options: str) -> dict[str, bytes]:
    """Files of the results of ``mor adjust`` with these options."""
    done = command("adjust", project, "-o", folder, "--no-html", *options)
    assert done.exit_code == 0, done.stderr
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.usefixtures("small_domains")
@pytest.mark.parametrize(
    ("kind", "options"),
    [
        (Kind(control=6, sights=20), ("--snoop",)),
        (Kind(strips=4, images=8, points=900), ()),  # state goes as domains are assessed
    ],
)
def test_same_bytes_though_workers_are_killed(kind: Kind, options: tuple[str, ...], tmp_path: Path) -> None:
    from distributed import Client, LocalCluster

    project = write_block(tmp_path / "project", kind)
    alone = adjust(project, tmp_path / "alone", "--memory", "1MB", *options)
    assert {"points.csv", "images.csv", "residuals.csv", "domains.json", "report.txt"} <= alone.keys()
    over = threading.Event()
    killed = []
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        client.run_on_scheduler(_forgive)

        def kill_now_and_then() -> None:
            while not over.wait(2.0) and len(killed) < 4:
                process = next(iter(client.run(os.getpid).values()), None)
                if process is not None:
                    os.kill(process, signal.SIGKILL)  # a worker of the cluster that was begun here
                    killed.append(process)

        killer = threading.Thread(target=kill_now_and_then)
        killer.start()
        try:
            shared = adjust(project, tmp_path / "shared", "--cluster", cluster.scheduler_address, *options)
        finally:
            over.set()
            killer.join()
    assert killed
    assert shared == alone


def _forgive(dask_scheduler: object = None) -> None:
    dask_scheduler.allowed_failures = 100  # type: ignore[union-attr]


@pytest.mark.usefixtures("small_domains")
def test_weights_and_start_values_by_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (reweighting, robust):
        monkeypatch.setattr(module, "ROUNDS", 2)  # rounds are counted here, not where workers are
    project = write_block(tmp_path / "project", Kind(strips=2, points=300, sights=10))
    pl.read_parquet(project.parent / "points.parquet").select("id")[:20].write_parquet(
        project.parent / "points.parquet"
    )
    asked = "settings: {robust: danish, variance_components: iterate, undeclared_points: free}\ndatum:"
    text = project.read_text(encoding="utf-8")
    project.write_text(text.replace("datum:", asked), encoding="utf-8")
    alone = adjust(project, tmp_path / "alone", "--memory", "1MB")
    assert adjust(project, tmp_path / "shared", "--workers", "2") == alone


@pytest.mark.usefixtures("small_domains")
def test_two_workers_of_this_machine(tmp_path: Path) -> None:
    project = write_block(tmp_path / "project", Kind())
    rays = pl.read_parquet(project.parent / "rays.parquet")
    wrong = pl.int_range(pl.len()) % 97 == 5
    rays.with_columns(x=pl.col("x") + 0.1 * wrong).write_parquet(project.parent / "rays.parquet")
    alone = adjust(
        project, tmp_path / "alone", "--memory", "1MB", "--table-format", "csv", "--snoop", "--full"
    )
    shared = adjust(project, tmp_path / "shared", "--workers", "2", "--snoop", "--full")
    assert shared == alone
    assert b"Data snooping" in alone["report.txt"]


def test_nobody_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "_ANSWER", 0.5)
    project = write_block(tmp_path / "project", Kind())
    done = command("adjust", project, "--cluster", "tcp://127.0.0.1:9")
    assert done.exit_code == 2
    assert "no Dask scheduler answers" in done.stderr
    assert not (tmp_path / "project.results").exists()


@pytest.mark.usefixtures("small_domains")
def test_mistakes_found_by_workers_are_told_as_ever(tmp_path: Path) -> None:
    project = write_block(tmp_path / "project", Kind(table="csv"))
    rays = project.parent / "rays.csv"
    rays.write_text(rays.read_text(encoding="utf-8") + "I0,nowhere,1.0,2.0\n", encoding="utf-8")
    done = command("adjust", project, "--workers", "1")
    assert done.exit_code == 2
    assert "point 'nowhere' does not exist" in done.stderr
