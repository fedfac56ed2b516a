"""The process around the command line: signals and warnings. More trials: ``python -m tools.interruptions``."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import types
import warnings
from collections.abc import Iterator
from importlib._bootstrap import _get_module_lock  # type: ignore[import-not-found]
from typing import cast

import numpy as np
import pytest

from mor import __main__ as process
from mor.cli import run
from tests.scenarios.small_projects import LEVELLING, mor, write
from tools.interruptions import SIGNALS, Scene, prepared, trial


@pytest.fixture(scope="module")
def scene() -> Iterator[Scene]:
    with prepared() as ready:
        yield ready


@pytest.mark.slow
@pytest.mark.parametrize("name", SIGNALS)
def test_hit_at_random_moments_the_old_or_the_new_result_is_there(scene: Scene, name: str) -> None:
    draw = random.Random(f"suite {name}")
    for _ in range(2):
        done = trial(scene, name, draw)
        assert not done.faults, done


def _can_mount() -> bool:
    if sys.platform != "linux" or os.geteuid() != 0:
        return False
    with tempfile.TemporaryDirectory() as place:
        if subprocess.run(["mount", "-t", "tmpfs", "tmpfs", place], check=False, capture_output=True).returncode:
            return False
        subprocess.run(["umount", place], check=True)
    return True


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "engine"),
    [("worker", "workers"), ("SIGKILL", "workers"), ("scheduler", "cluster"), ("disk", "threads"), ("disk", "memory")],
)
def test_lost_workers_and_a_full_disk_leave_the_old_or_the_new_result(fault: str, engine: str) -> None:
    if fault == "disk" and not _can_mount():
        pytest.skip("a small disk cannot be mounted")
    if engine in ("workers", "cluster"):
        pytest.importorskip("distributed")
        pytest.importorskip("cryptography")
    draw = random.Random(f"suite {fault} {engine}")
    with prepared(fault, engine) as scene:
        for _ in range(2):
            done = trial(scene, fault, draw)
            assert not done.faults, done


def test_a_run_that_is_asked_to_end_tidies_up(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr("mor.report.results.text_report", lambda *_: process._interrupt(15, None))
    project = write(tmp_path, LEVELLING)
    run = mor("adjust", project)
    assert run.code == 143
    assert run.err.splitlines()[-1] == "interrupted; no file was left incomplete"
    assert list(tmp_path.iterdir()) == [project]


def test_an_error_that_a_library_makes_of_an_interruption_is_one(
    tmp_path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Compiled libraries put an error of their own around it, as pydantic does while it builds a validator."""

    def wrapped(*_: object) -> str:
        came.append(signal.SIGINT)
        raise ValueError("KeyboardInterrupt: 2")

    came: list[int] = []
    monkeypatch.setattr("mor.report.results.text_report", wrapped)
    assert run(["adjust", str(write(tmp_path, LEVELLING))], signals=came) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "interrupted; no file was left incomplete"


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs a timer of the system")
def test_while_modules_are_loaded_an_interruption_waits() -> None:
    before = signal.getsignal(signal.SIGALRM)
    loading = types.SimpleNamespace(f_code=types.SimpleNamespace(co_filename=_get_module_lock.__code__.co_filename))
    try:
        process._interrupt(signal.SIGUSR1, cast(types.FrameType, loading))
        with pytest.raises(KeyboardInterrupt) as raised:
            time.sleep(10.0)
        assert raised.value.args == (signal.SIGUSR1,)
    finally:
        signal.signal(signal.SIGALRM, before)
        signal.signal(signal.SIGUSR1, signal.SIG_DFL)


def test_arithmetic_that_goes_wrong_is_an_error_and_nothing_else_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "warnoptions", [])
    with warnings.catch_warnings():
        process._heed_warnings()
        with pytest.raises(RuntimeWarning):
            np.sqrt(np.array([-1.0]))
        warnings.warn("no longer in the next version", DeprecationWarning, stacklevel=1)
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs a timer of the system")
def test_an_interruption_that_c_code_drops_comes_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """LLVM calls such functions while a kernel is compiled."""
    import ctypes

    before = signal.getsignal(signal.SIGALRM)
    monkeypatch.setattr(sys, "unraisablehook", process._unraisable)
    monkeypatch.setattr(process, "_CAME", [])
    called = ctypes.CFUNCTYPE(None)(lambda: process._interrupt(signal.SIGUSR1, None))

    def call_and_go_on() -> None:
        called()
        time.sleep(10.0)

    try:
        with pytest.raises(KeyboardInterrupt) as raised:
            call_and_go_on()
        assert raised.value.args == (signal.SIGUSR1,)
    finally:
        signal.signal(signal.SIGALRM, before)
        signal.signal(signal.SIGUSR1, signal.SIG_DFL)
