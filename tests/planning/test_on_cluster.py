"""Batches and simulations by a cluster: the same as here, whoever dies; a process of a lost worker goes with it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest

from mor.api.workers import Task, done_alone
from mor.cli import run
from tests.scenarios.batch_scenes import PLAN, act, write_project

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")


TIMED = ("junit.xml", "batch.txt", "batch.html")


@pytest.fixture(autouse=True)
def scenes_are_found(monkeypatch):
    """In processes that are begun here, too."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))


@pytest.fixture(scope="module")
def cluster():
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as begun:
        yield begun


@pytest.fixture
def blocks(tmp_path):
    write_project(tmp_path / "blocks", "good", "100.003")
    write_project(tmp_path / "blocks", "deep/better", "100.004")
    write_project(tmp_path / "blocks", "wrong", text="mor: 1\npoints: nothing\n")
    write_project(tmp_path / "blocks", "bad", "100.200")
    return str(tmp_path / "blocks/**/project.yaml")


def _results(folder):
    """All files below a folder but those that tell times; the folder itself is in logs."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name not in TIMED]
    name, neutral = str(folder).encode(), b"FOLDER"
    return {str(path.relative_to(folder)): path.read_bytes().replace(name, neutral) for path in files}


@pytest.mark.slow
def test_a_batch_is_the_same_as_here_though_a_worker_is_killed(cluster, blocks, tmp_path):
    from distributed import Client

    assert run(["batch", blocks, "-o", str(tmp_path / "here"), "--strict", "-q"]) == 1
    with Client(cluster, set_as_default=False) as client:

        def kill_one():
            time.sleep(1.0)
            os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)

        killer = threading.Thread(target=kill_one)
        killer.start()
        options = ["-o", str(tmp_path / "there"), "--strict", "-q", "--cluster", cluster.scheduler_address]
        assert run(["batch", blocks, *options]) == 1
        killer.join()
    here, there = (_results(tmp_path / name) for name in ("here", "there"))
    assert {"batch.json", "good/results.json", "wrong/log.txt"} <= here.keys()
    assert there == here
    data = json.loads(there["batch.json"])
    assert {row["name"]: row["code"] for row in data["projects"]} == {
        "bad": 1,
        "deep/better": 0,
        "good": 0,
        "wrong": 2,
    }


@pytest.mark.slow
def test_a_simulation_is_the_same_as_here(cluster, tmp_path):
    path = tmp_path / "plan" / "project.yaml"
    path.parent.mkdir()
    path.write_text(PLAN)
    options = ["simulate", str(path), "--runs", "60", "-q", "-o"]
    codes = [
        run([*options, str(tmp_path / "here")]),
        run([*options, str(tmp_path / "there"), "--cluster", cluster.scheduler_address]),
    ]
    assert codes[0] == codes[1]
    here, there = (_results(tmp_path / name) for name in ("here", "there"))
    assert "montecarlo.json" in here
    assert here == there


def test_places_are_told_from_where_the_command_was_given(tmp_path):
    (tmp_path / "place").mkdir()
    done = done_alone(act, 0, Task(("ok",), Path("log.txt")), tmp_path / "place")
    assert done.code == 0
    assert (tmp_path / "place" / "log.txt").read_text() == "done\n"


@pytest.mark.slow
def test_what_dies_hangs_or_raises_by_itself(tmp_path):
    deeds = ("ok", "die", "hang", "raise", "leave")
    done = [done_alone(act, k, Task((deed,), tmp_path / f"{k}.txt"), tmp_path, 8.0) for k, deed in enumerate(deeds)]
    assert [one.code for one in done] == [0, None, None, 1, 7]
    assert done[1].death == "killed by SIGKILL"
    assert done[2].death == "ended after 8 s"
    assert "RuntimeError: broken" in (tmp_path / "3.txt").read_text()
    assert (tmp_path / "0.txt").read_text() == "done\n"


@pytest.mark.slow
def test_the_process_of_a_lost_worker_goes_with_it(tmp_path):
    code = "import sys; from pathlib import Path; from tests.scenarios.batch_scenes import linger\n"
    code += "from mor.api.workers import Task, done_alone\n"
    code += "place = Path(sys.argv[1]); done_alone(linger, 0, Task((str(place),), place / 'log'), place)"
    told = tmp_path / "pid"
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)]) as worker:
        _until(lambda: told.exists() and bool(told.read_text()))
        worker.kill()
    _until(lambda: not psutil.pid_exists(int(told.read_text())))


def _until(happened):
    end = time.monotonic() + 60.0
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_processes_here_and_a_cluster_are_not_asked_for_together(blocks, tmp_path, capfd):
    output = tmp_path / "results"
    assert run(["batch", blocks, "-o", str(output), "--jobs", "2", "--cluster", "tcp://127.0.0.1:9"]) == 2
    assert "--jobs and --cluster together" in capfd.readouterr().err
    assert not output.exists()


def test_one_simulated_project_needs_no_cluster(tmp_path, capfd):
    path = tmp_path / "project.yaml"
    path.write_text(PLAN)
    assert run(["simulate", str(path), "--cluster", "tcp://127.0.0.1:9"]) == 2
    assert "this goes with --runs" in capfd.readouterr().err
    assert [one.name for one in tmp_path.iterdir()] == ["project.yaml"]
