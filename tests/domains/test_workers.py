"""Workers: the same bytes as one process, also where they are killed; what keeps them from it is said before."""

from __future__ import annotations

import os
import signal
import threading
from concurrent.futures import CancelledError
from pathlib import Path

import polars as pl
import pytest
from domains_blocks import Kind, command, write_block

from mor.adjustment.domains.store import FileStore
from mor.domains import reweighting, robust, room, workers
from mor.errors import InputError

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")


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
@pytest.mark.parametrize("options", [("--full",), ("--snoop",)])
def test_two_workers_of_this_machine(tmp_path: Path, options: tuple[str, ...]) -> None:
    project = write_block(tmp_path / "project", Kind())
    rays = pl.read_parquet(project.parent / "rays.parquet")
    wrong = pl.int_range(pl.len()) % 97 == 5
    rays.with_columns(x=pl.col("x") + 0.1 * wrong).write_parquet(project.parent / "rays.parquet")
    alone = adjust(project, tmp_path / "alone", "--memory", "1MB", "--table-format", "csv", *options)
    shared = adjust(project, tmp_path / "shared", "--workers", "2", *options)
    assert shared == alone
    assert (b"Data snooping" in alone["report.txt"]) == ("--snoop" in options)


def test_nobody_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_PATIENCE", 0.5)
    project = write_block(tmp_path / "project", Kind())
    done = command("adjust", project, "--cluster", "tcp://127.0.0.1:9")
    assert done.exit_code == 2
    assert "no scheduler answers there" in done.stderr
    assert not (tmp_path / "project.results").exists()


def test_other_versions_too_little_memory_and_no_common_files_are_told_at_once(tmp_path: Path) -> None:
    class Cluster:
        """Two workers that cannot do it."""

        def wait_for_workers(self, count: int, timeout: float) -> None:
            pass

        def run(self, function: object, token: str) -> dict[str, object]:
            word = Path(token).read_text(encoding="ascii")
            old = {**workers.versions(), "mor": "0.0.1"}
            return {
                "tcp://a:1": {"versions": old, "word": word, "memory": 1e9},
                "tcp://b:1": {"versions": workers.versions(), "word": "", "memory": 9e9},
            }

    with pytest.raises(InputError) as raised:
        workers._check(Cluster(), tmp_path / "state", 4e9)
    told = [(problem.file, problem.message) for problem in raised.value.problems]
    assert [file for file, _ in told] == ["tcp://a:1", "tcp://a:1", "tcp://b:1"]
    assert "mor 0.0.1 there" in told[0][1]
    assert "1.00 GB of memory" in told[1][1]
    assert "does not see" in told[2][1]
    assert list((tmp_path / "state").iterdir()) == []


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({}, "all workers are lost"),
        ({"tcp://a:1": ()}, "gives them nothing to do"),
        (TimeoutError(), "does not answer any more"),
        (OSError(), "does not answer any more"),
    ],
)
def test_where_nobody_is_at_work_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: object, words: str
) -> None:
    engine, renewed = waiting(tmp_path, told)
    monkeypatch.setattr(workers, "_PATIENCE", -1.0)
    with pytest.raises(InputError, match=words):
        engine.result(Waiting(TimeoutError()))
    assert renewed == []  # it was too late for that


def test_a_long_task_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    engine, _ = waiting(tmp_path, {"tcp://a:1": ("task",)})
    monkeypatch.setattr(workers, "_PATIENCE", -1.0)
    assert engine.result(Waiting(*[TimeoutError()] * 50)) == "done"


def test_workers_are_begun_anew_once_and_given_the_time_they_need(tmp_path: Path) -> None:
    engine, renewed = waiting(tmp_path, {})
    assert engine.result(Waiting(*[TimeoutError()] * 5)) == "done"
    assert renewed == [1]


def test_a_lost_scheduler_is_said(tmp_path: Path) -> None:
    engine, _ = waiting(tmp_path, {})
    with pytest.raises(InputError, match="the scheduler is lost"):
        engine.result(Waiting(CancelledError()))


class Waiting:
    """A task that ends after some raised errors."""

    def __init__(self, *errors: Exception) -> None:
        self.errors = list(errors)

    def result(self, timeout: float) -> str:
        if self.errors:
            raise self.errors.pop()
        return "done"


class Client:
    """A client whose scheduler says this of the tasks of its workers, or raises it."""

    def __init__(self, told: object) -> None:
        self.told = told
        self.scheduler = self

    processing = None

    def sync(self, _: object, workers: None, callback_timeout: float) -> object:
        if isinstance(self.told, Exception):
            raise self.told
        return self.told


def waiting(folder: Path, told: object) -> tuple[workers.Workers, list[int]]:
    """An engine beside such a scheduler, and how often workers were begun anew."""
    renewed: list[int] = []
    return workers.Workers(FileStore(folder), Client(told), 0, lambda: renewed.append(1)), renewed


def test_a_worker_lost_while_it_is_asked_is_asked_again() -> None:
    class Losing:
        """A client that loses a worker the first time."""

        times = 0

        def run(self, function: object, token: str) -> dict[str, dict[str, object]]:
            self.times += 1
            if self.times == 1:
                raise OSError("lost")
            return {"tcp://a:1": {}}

    assert workers._asked(Losing(), "token") == {"tcp://a:1": {}}


def test_workers_without_the_program_are_told() -> None:
    class Other:
        """A client whose workers do not know the program."""

        def run(self, function: object, token: str) -> dict[str, dict[str, object]]:
            raise Exception("ModuleNotFoundError(\"No module named 'mor'\")")

    with pytest.raises(InputError, match="is it installed there"):
        workers._asked(Other(), "token")


def test_workers_that_do_not_begin_are_begun_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[int] = []

    def cluster(n_workers: int, **options: object) -> str:
        tried.append(n_workers)
        if len(tried) < 3:
            raise RuntimeError("Nanny failed to start.")
        return "begun"

    assert workers._begun(cluster, 2, 1_000) == "begun"
    monkeypatch.setattr(workers, "_PATIENCE", -1.0)
    tried.clear()
    with pytest.raises(InputError, match="do not begin"):
        workers._begun(cluster, 2, 1_000)


@pytest.mark.usefixtures("small_domains")
def test_mistakes_found_by_workers_are_told_as_ever(tmp_path: Path) -> None:
    project = write_block(tmp_path / "project", Kind(table="csv"))
    rays = project.parent / "rays.csv"
    rays.write_text(rays.read_text(encoding="utf-8") + "I0,nowhere,1.0,2.0\n", encoding="utf-8")
    done = command("adjust", project, "--workers", "1")
    assert done.exit_code == 2
    assert "point 'nowhere' does not exist" in done.stderr
