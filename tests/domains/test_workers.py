"""Workers: the same bytes as one process, also where they are killed; what keeps them from it is said before."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

import pytest
from domains_blocks import Kind, command, write_block

from mor.domains import room

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")


@pytest.fixture
def small_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "rays_of_domain", lambda rays, memory, workers=1: 500)
    monkeypatch.setattr(room, "PROGRAM", 0.0)
    monkeypatch.setattr(room, "OF_OUTER", 0)


def adjust(project: Path, folder: Path, *options: str) -> dict[str, bytes]:
    """Files of the results of ``mor adjust`` with these options."""
    done = command("adjust", project, "-o", folder, *options)
    assert done.exit_code == 0, done.stderr
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.usefixtures("small_domains")
def test_same_bytes_though_workers_are_killed(tmp_path: Path) -> None:
    from distributed import Client, LocalCluster

    project = write_block(tmp_path / "project", Kind(control=6, sights=20))
    alone = adjust(project, tmp_path / "alone", "--memory", "1MB")
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
            shared = adjust(project, tmp_path / "shared", "--cluster", cluster.scheduler_address)
        finally:
            over.set()
            killer.join()
    assert killed
    assert shared == alone


def _forgive(dask_scheduler: object = None) -> None:
    dask_scheduler.allowed_failures = 100  # type: ignore[union-attr]


@pytest.mark.usefixtures("small_domains")
def test_two_workers_of_this_machine(tmp_path: Path) -> None:
    project = write_block(tmp_path / "project", Kind())
    alone = adjust(project, tmp_path / "alone", "--memory", "1MB", "--table-format", "csv")
    shared = adjust(project, tmp_path / "shared", "--workers", "2")
    assert shared == alone


def test_nobody_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mor.domains import workers

    monkeypatch.setattr(workers, "_PATIENCE", 0.5)
    project = write_block(tmp_path / "project", Kind())
    done = command("adjust", project, "--cluster", "tcp://127.0.0.1:9")
    assert done.exit_code == 2
    assert "no scheduler answers there" in done.stderr
    assert not (tmp_path / "project.results").exists()


def test_other_versions_too_little_memory_and_no_common_files_are_told_at_once(tmp_path: Path) -> None:
    from mor.domains.workers import _check
    from mor.errors import InputError

    class Cluster:
        """Two workers that cannot do it."""

        def wait_for_workers(self, count: int, timeout: float) -> None:
            pass

        def run(self, function: object, token: str) -> dict[str, object]:
            from mor.domains.workers import versions

            word = Path(token).read_text(encoding="ascii")
            old = {**versions(), "mor": "0.0.1"}
            return {
                "tcp://a:1": {"versions": old, "word": word, "memory": 1e9},
                "tcp://b:1": {"versions": versions(), "word": "", "memory": 9e9},
            }

    with pytest.raises(InputError) as raised:
        _check(Cluster(), tmp_path / "state", 4e9)
    told = [(problem.file, problem.message) for problem in raised.value.problems]
    assert [file for file, _ in told] == ["tcp://a:1", "tcp://a:1", "tcp://b:1"]
    assert "mor 0.0.1 there" in told[0][1]
    assert "1.00 GB of memory" in told[1][1]
    assert "does not see" in told[2][1]
    assert list((tmp_path / "state").iterdir()) == []


def test_without_any_worker_left_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mor.adjustment.domains.store import FileStore
    from mor.domains import workers
    from mor.errors import InputError

    class Waiting:
        def result(self, timeout: float) -> None:
            raise TimeoutError

    class Nobody:
        def nthreads(self) -> dict[str, int]:
            return {}

    monkeypatch.setattr(workers, "_PATIENCE", 0.0)
    renewed: list[int] = []
    engine = workers.Workers(FileStore(tmp_path), Nobody(), 0, lambda: renewed.append(1))
    with pytest.raises(InputError, match="all workers are lost"):
        engine.result(Waiting())
    assert renewed == []  # it was too late for that


@pytest.mark.usefixtures("small_domains")
def test_mistakes_found_by_workers_are_told_as_ever(tmp_path: Path) -> None:
    project = write_block(tmp_path / "project", Kind(table="csv"))
    rays = project.parent / "rays.csv"
    rays.write_text(rays.read_text(encoding="utf-8") + "I0,nowhere,1.0,2.0\n", encoding="utf-8")
    done = command("adjust", project, "--workers", "1")
    assert done.exit_code == 2
    assert "point 'nowhere' does not exist" in done.stderr
