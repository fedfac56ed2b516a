"""A cluster: what keeps its workers from the work is said before, a lost one of whatever kind in words."""

from __future__ import annotations

import contextlib
import socket
import time
from concurrent.futures import CancelledError
from pathlib import Path
from threading import Thread

import pytest

from mor.errors import InputError
from mor.solve import cluster
from mor.solve.cluster import ComputeCluster

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")


def test_other_versions_and_no_common_files_are_told_at_once(tmp_path: Path) -> None:
    class Two:
        """Two workers that cannot do it."""

        def wait_for_workers(self, count: int, timeout: float) -> None:
            pass

        def run(self, function: object, token: str) -> dict[str, object]:
            word = Path(token).read_text(encoding="ascii")
            old = {**cluster.versions(), "mor": "0.0.1"}
            return {
                "tcp://a:1": {"versions": old, "word": word},
                "tcp://b:1": {"versions": cluster.versions(), "word": ""},
            }

    with pytest.raises(InputError) as raised:
        cluster._check(Two(), tmp_path / "state")
    told = [(problem.file, problem.message) for problem in raised.value.problems]
    assert [file for file, _ in told] == ["tcp://a:1", "tcp://b:1"]
    assert "mor 0.0.1 there" in told[0][1]
    assert "does not see" in told[1][1]
    assert list((tmp_path / "state").iterdir()) == []


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({}, "all workers are lost"),
        ({"tcp://a:1": ()}, "gives them nothing to do"),
        (TimeoutError(), "has stopped answering"),
        (OSError(), "has stopped answering"),
    ],
)
def test_where_nobody_is_at_work_it_is_said(monkeypatch: pytest.MonkeyPatch, told: object, words: str) -> None:
    engine = waiting(told)
    monkeypatch.setattr(cluster, "_PATIENCE", -1.0)
    with pytest.raises(InputError, match=words):
        engine.result(Waiting(TimeoutError()))


def test_a_long_task_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = waiting({"tcp://a:1": ("task",)})
    monkeypatch.setattr(cluster, "_PATIENCE", -1.0)
    assert engine.result(Waiting(*[TimeoutError()] * 50)) == "done"


def test_a_lost_scheduler_is_said() -> None:
    engine = waiting({})
    with pytest.raises(InputError, match="the scheduler is lost"):
        engine.result(Waiting(CancelledError()))


def test_what_a_task_raises_itself_is_not_taken_for_a_lost_scheduler() -> None:
    engine = waiting({})
    with pytest.raises(OSError, match="No space left"):
        engine.result(Waiting(OSError(28, "No space left on device"), status="error"))


class Waiting:
    """A task that ends after some raised errors."""

    def __init__(self, *errors: Exception, status: str = "pending") -> None:
        self.errors, self.status = list(errors), status

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


def waiting(told: object) -> ComputeCluster:
    """A cluster with such a scheduler."""
    return ComputeCluster(Client(told))


def test_a_worker_lost_while_it_is_asked_is_asked_again() -> None:
    class Losing:
        """A client that loses a worker the first time."""

        times = 0

        def run(self, function: object, token: str) -> dict[str, dict[str, object]]:
            self.times += 1
            if self.times == 1:
                raise OSError("lost")
            return {"tcp://a:1": {}}

    assert cluster._asked(Losing(), "token") == {"tcp://a:1": {}}


@pytest.mark.parametrize(("state", "told"), [("running", "is it installed there"), ("closed", "the scheduler is lost")])
def test_workers_without_the_program_and_a_lost_scheduler_are_told(state: str, told: str) -> None:
    class Other:
        """A client whose workers do not know the program, or whose scheduler is lost."""

        status = state

        def run(self, function: object, token: str) -> dict[str, dict[str, object]]:
            raise Exception("ModuleNotFoundError(\"No module named 'mor'\")")

    with pytest.raises(InputError, match=told):
        cluster._asked(Other(), "token")


@pytest.mark.parametrize("answer", [None, b"", b"SSH-2.0-OpenSSH_9.6 and so on\r\n", b"HTTP/1.1 400 Bad\r\n\r\n" * 9])
def test_a_port_that_is_no_scheduler_is_told_in_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: bytes | None
) -> None:
    """Silent, closed at once, or with bytes that were taken for the length of a message: 3.01 EiB."""
    monkeypatch.setattr(cluster, "_ANSWER", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        kept = []

        def serve() -> None:
            with contextlib.suppress(OSError):
                while True:
                    kept.append(server.accept()[0])
                    if answer is not None:
                        kept[-1].sendall(answer)
                    if answer == b"":
                        kept[-1].close()

        Thread(target=serve, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        begun = time.monotonic()
        with pytest.raises(InputError, match="no Dask scheduler answers") as raised:
            cluster._check_scheduler(address)
        assert time.monotonic() - begun < 20.0
        assert raised.value.problems[0].file == address
