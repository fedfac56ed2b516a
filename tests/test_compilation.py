"""Kernels come from a sealed cache or not at all: whatever fails, NumPy does the work and a note says why."""

from __future__ import annotations

import importlib
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mor.linalg import compilation
from mor.linalg.compilation import WORTH_COMPILING, chosen_by_size, notes_told_by, wanted

numba = pytest.importorskip("numba")
pytestmark = pytest.mark.skipif(not compilation.available, reason="nothing is compiled")

INNER = """
from mor.linalg.compilation import compile_kernel

@compile_kernel
def add(numbers, offset):
    total = {start}
    for number in numbers:
        total += number - offset
    return total
"""
OUTER = """
from mor.linalg.compilation import compile_kernel
from inner_kernels import add

@compile_kernel
def twice(numbers, offset):
    return 2.0 * add(numbers, offset)
"""
NUMBERS = np.array([1.0, 2.0])


class Process:
    """This process as one that has just begun, with two kernels of its own and a cache that is empty."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self._patch = folder / "cache" / "mor", monkeypatch
        self.compiled = 0
        self.notes: list[str] = []
        self.asked = "numba"
        for name, text in (("inner_kernels", INNER.format(start=0.0)), ("outer_kernels", OUTER)):
            (folder / f"{name}.py").write_text(text)
        monkeypatch.syspath_prepend(folder)
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder / "cache"))
        monkeypatch.setattr(compilation, "_compile_apart", self._compile)

    def _begin(self) -> None:
        for name in ("_state", "_kernels"):
            self._patch.setattr(compilation, name, [])
        for name in ("inner_kernels", "outer_kernels"):
            self._patch.delitem(sys.modules, name, raising=False)
        self.kernels = importlib.import_module("outer_kernels")

    def _compile(self) -> None:
        self.compiled += 1
        self._begin()
        compilation.compile_all([lambda: self.kernels.twice(NUMBERS, 0.25)], lambda: None)
        self._begin()

    def run(self, observations: int = WORTH_COMPILING) -> bool:
        """Return whether kernels are used for so many observations, after a check that they give what Python gives."""
        self._patch.setenv("MOR_KERNELS", self.asked)
        self.notes = []
        self._begin()
        with notes_told_by(lambda words, **values: self.notes.append(words.format(**values))):
            for _ in range(2):
                with chosen_by_size(observations):
                    assert self.kernels.twice(NUMBERS, 0.25) == 5.0
                    used = wanted()
        return used

    def files(self) -> set[str]:
        return {path.name.partition(".")[0] for path in self.folder.rglob("*.nbc")}


@pytest.fixture
def process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Process:
    return Process(tmp_path, monkeypatch)


def test_what_is_asked_for_is_compiled_once(process: Process) -> None:
    assert process.run()
    assert process.notes == [compilation.COMPILING]
    assert process.run()
    assert (process.notes, process.compiled) == ([], 1)
    assert process.files() == {"inner_kernels", "outer_kernels"}


def test_what_is_too_small_or_asked_of_numpy_uses_none(process: Process) -> None:
    assert not process.run(WORTH_COMPILING - 1)
    process.asked = "numpy"
    assert not process.run(10**9)
    assert (process.notes, process.compiled) == ([], 0)


def test_auto_compiles_where_numpy_takes_longer_and_takes_what_is_there(process: Process) -> None:
    process.asked = "auto"
    assert not process.run()
    assert process.compiled == 0
    speed = json.loads((process.folder / "speed.json").read_text())
    assert all(rounds > 0.0 for rounds in speed.values())
    (process.folder / "speed.json").write_text(json.dumps({"numpy": 1e-6, "python": 1.0}))
    assert process.run()
    assert process.compiled == 1
    (process.folder / "speed.json").write_text(json.dumps({"numpy": 1e9, "python": 1.0}))
    assert process.run()
    assert process.compiled == 1


def test_a_division_by_zero_is_infinite_as_in_numpy() -> None:
    """A point at the depth 0 must not end the program."""

    def ratio(a: float, b: float) -> float:
        return a / b

    assert compilation.Kernel(ratio, cache=False).in_numba(1.0, 0.0) == np.inf


def test_another_state_of_the_sources_or_of_numba_has_a_cache_of_its_own(
    process: Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = compilation._folder()
    monkeypatch.setattr(compilation._numba(), "__version__", "another")
    compilation._state_of_code.cache_clear()
    try:
        assert compilation._folder() != folder
    finally:
        compilation._state_of_code.cache_clear()


def test_another_installation_of_the_same_code_has_a_cache_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numba would compile all of it again in each of them, and say nothing."""

    def state_of(package: Path) -> str:
        monkeypatch.setattr(compilation, "__file__", str(package / "linalg" / "compilation.py"))
        return compilation._state_of_code.__wrapped__()

    one, other = tmp_path / "one", tmp_path / "other"
    for package in (one, other):
        shutil.copytree(Path(compilation.__file__).parent, package / "linalg")
    states = [state_of(one), state_of(one), state_of(other)]
    os.utime(one / "linalg" / "numba_registers.py", (1e9, 1e9))
    states.append(state_of(one))
    assert states[0] == states[1]
    assert len(set(states)) == 3


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda code: b"",
    "cut short": lambda code: code[: len(code) // 2],
    "one byte changed": lambda code: code[:-1] + bytes([code[-1] ^ 1]),
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("pattern", ["*.nbc", "signatures", "seal.json"])
def test_a_damaged_cache_is_not_used(process: Process, pattern: str, damage: str) -> None:
    assert process.run()
    for path in process.folder.rglob(pattern):
        path.write_bytes(DAMAGES[damage](path.read_bytes()))
    _is_refused(process, "")
    process._compile()
    assert process.run(), "not renewed"


@pytest.mark.parametrize("damage", ["empty", "cut short"])
def test_a_damaged_index_is_not_used(process: Process, damage: str) -> None:
    assert process.run()
    for path in process.folder.rglob("*.nbi"):
        path.write_bytes(DAMAGES[damage](path.read_bytes()))
    _is_refused(process, "")


def test_a_file_of_the_cache_that_is_gone_is_missed(process: Process) -> None:
    assert process.run()
    next(process.folder.rglob("outer*.nbc")).unlink()
    _is_refused(process, "No such file")


def test_a_full_disk_leaves_nothing(process: Process) -> None:
    """A limit for the sizes of files fails as a full disk does: while a file is written."""
    with _files_of_at_most(1_000):
        _is_refused(process, "File too large")
    assert not list(process.folder.glob("kernels-*"))


def test_a_cache_that_cannot_be_made_is_done_without(process: Process) -> None:
    process.folder.parent.write_text("a file in the way")
    _is_refused(process, str(process.folder.parent))


def test_a_cache_that_is_read_only_is_done_without(process: Process, monkeypatch: pytest.MonkeyPatch) -> None:
    assert process.run()

    def refuse(*args: object, **options: object) -> None:
        raise OSError(30, "Read-only file system", str(process.folder))

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    _is_refused(process, f"{process.folder}: Read-only file system")
    monkeypatch.setattr(tempfile, "mkdtemp", refuse)
    for path in process.folder.rglob("seal.json"):
        path.unlink()
    _is_refused(process, f"{process.folder}: Read-only file system")


class _Broken:
    signatures = ()

    def __call__(self, *args: object) -> None:
        raise RuntimeError("it does not compile\nfor reasons")

    def compile(self, signature: object) -> None:
        raise RuntimeError("it does not load")


def test_a_numba_that_does_not_compile_is_done_without(process: Process, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba, "njit", lambda **options: lambda function: _Broken())
    _is_refused(process, "RuntimeError: it does not compile")


def test_a_numba_that_does_not_load_is_done_without(process: Process, monkeypatch: pytest.MonkeyPatch) -> None:
    assert process.run()
    monkeypatch.setattr(numba, "njit", lambda **options: lambda function: _Broken())
    _is_refused(process, "RuntimeError: it does not load")


def test_a_numba_that_is_not_imported_is_done_without(process: Process, monkeypatch: pytest.MonkeyPatch) -> None:
    class Finder:
        @staticmethod
        def find_spec(name: str, *rest: object) -> None:
            if name == "numba":
                raise RuntimeError("it needs another NumPy")

    monkeypatch.delitem(sys.modules, "numba")
    monkeypatch.setattr(sys, "meta_path", [Finder, *sys.meta_path])
    compilation._imported.cache_clear()
    _is_refused(process, "RuntimeError: it needs another NumPy")


def test_where_numba_is_missing_a_large_network_is_told(process: Process, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("available", "_installed"):
        monkeypatch.setattr(compilation, name, False)
    assert not process.run()
    assert process.notes == [compilation.MISSING]
    assert not process.run(WORTH_COMPILING - 1)
    assert process.notes == []


LARGE = """
import mor.linalg.compilation
mor.linalg.compilation.WORTH_COMPILING = 3
from mor.__main__ import main
main()
"""
SAMPLES = Path(__file__).parents[1] / "sample_projects"


@pytest.mark.slow
def test_compiled_ahead_kernels_are_complete_and_give_the_numbers_of_numpy(tmp_path: Path) -> None:
    """Sample projects taken for large ones: nothing is left to compile, and all agrees to 1e-9 σ."""

    def run(*arguments: str, kernels: str = "numba") -> str:
        done = subprocess.run(
            [sys.executable, "-c", LARGE, *arguments],
            env={
                **os.environ,
                "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
                "MOR_KERNELS": kernels,
                "PYTHONPATH": os.pathsep.join(sys.path),
            },
            capture_output=True,
            text=True,
        )
        assert done.returncode in (0, 1), done.stderr
        return done.stderr

    run("compile")
    kept = sorted((tmp_path / "cache").rglob("*.nbc"))
    assert kept
    for sample in ("aerial_strip", "building", "facade", "panorama", "three_line_strip"):
        found: list[Any] = []
        for kernels in ("numpy", "numba"):
            out = tmp_path / sample / kernels
            out.parent.mkdir(exist_ok=True)
            told = run("adjust", str(SAMPLES / sample / "project.yaml"), "-o", str(out), "--no-html", kernels=kernels)
            assert "the kernels" not in told
            found.append(json.loads((out / "results.json").read_text()))
            assert found[-1]["kernels"] == kernels
        numpy, numba = found
        assert numba["sigma0"]["aposteriori"] == pytest.approx(numpy["sigma0"]["aposteriori"], rel=1e-9)
        assert len(numpy["points"]) == len(numba["points"]) > 0
        for one, other in zip(numpy["points"], numba["points"], strict=True):
            for axis in "xyz":
                sigma = one[f"s{axis}"]
                if sigma:
                    assert abs(one[axis] - other[axis]) <= 1e-9 * sigma + 4e-16 * abs(one[axis])
                    assert other[f"s{axis}"] == pytest.approx(sigma, rel=1e-9)
    assert sorted((tmp_path / "cache").rglob("*.nbc")) == kept


def _is_refused(process: Process, reason: str) -> None:
    """NumPy does the work, and one note says why."""
    assert not process.run()
    (note,) = (note for note in process.notes if note != compilation.COMPILING)
    assert note.startswith(compilation.FAILED.format(reason=""))
    assert reason in note
    assert "\n" not in note


@contextmanager
def _files_of_at_most(size: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
