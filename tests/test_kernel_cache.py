"""Machine code on disk: read by later runs, and never in the way where the disk fails."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytest.importorskip("numba")
from mor import kernel_cache
from mor.compilation import available, compilation_announced

pytestmark = pytest.mark.skipif(not available, reason="nothing is compiled")

INNER = """
from mor.compilation import compile_kernel

@compile_kernel
def add(numbers, offset):
    total = {start}
    for number in numbers:
        total += number - offset
    return total
"""
OUTER = """
from mor.compilation import compile_kernel
from inner_kernels import add

@compile_kernel
def twice(numbers, offset):
    return 2.0 * add(numbers, offset)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the machine code, which is not there yet."""
    monkeypatch.setattr(kernel_cache, "_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr(kernel_cache, "not_kept", [])
    return tmp_path / "cache"


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[float, int]]:
    """Calls the kernel as a new process would: what it returns, and how often something was compiled."""

    def again(start: str = "0.0", numbers: Any = (1.0, 2.0)) -> tuple[float, int]:
        kernel_cache._digest.cache_clear()
        for name, text in (("inner_kernels", INNER.format(start=start)), ("outer_kernels", OUTER)):
            path = tmp_path / f"{name}.py"
            path.write_text(text)
            monkeypatch.setitem(sys.modules, name, _module(name, path))
        compiled: list[None] = []
        with compilation_announced(lambda: compiled.append(None), lambda: None):
            return sys.modules["outer_kernels"].twice(numbers, 0.25), len(compiled)

    return again


def _module(name: str, path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    exec(compile(path.read_text(), str(path), "exec"), module.__dict__)
    return module


def test_a_later_run_compiles_nothing(folder: Path, run: Callable[..., tuple[float, int]]) -> None:
    assert run() == (5.0, 1)
    assert run() == (5.0, 0)
    assert run(numbers=(1.0, 2.0, 3.0)) == (10.5, 1), "arguments of another type"
    assert {path.name.split("-")[0] for path in folder.iterdir()} == {
        "inner_kernels.add",
        "outer_kernels.twice",
    }
    assert not kernel_cache.not_kept


def test_what_a_kernel_calls_is_part_of_it(folder: Path, run: Callable[..., tuple[float, int]]) -> None:
    assert run()[0] == 5.0
    assert run(start="10.0") == (25.0, 1)
    assert run() == (5.0, 0)


def test_so_is_what_is_made_of_registers(
    folder: Path, run: Callable[..., tuple[float, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    run()
    known, kept = kernel_cache._digest, len(list(folder.iterdir()))
    changed = str(Path(kernel_cache.__file__).with_name("registers_in_numba.py"))
    other = cache(lambda file: b"" if file == changed else known(file))
    monkeypatch.setattr(kernel_cache, "_digest", other)
    kernel_cache._versions.cache_clear()
    try:
        _, compiled = run()
    finally:
        kernel_cache._versions.cache_clear()
    assert compiled
    assert len(list(folder.iterdir())) == 2 * kept


def test_a_kernel_is_compiled_with_one_that_was_kept(
    folder: Path, run: Callable[..., tuple[float, int]]
) -> None:
    run()
    (outer,) = folder.glob("outer*")
    outer.unlink()
    assert run() == (5.0, 1)


@pytest.mark.parametrize("damage", [lambda code: b"", lambda code: code[:100], lambda code: code[:-1] + b"?"])
def test_a_damaged_file_is_no_file(
    folder: Path, run: Callable[..., tuple[float, int]], damage: Callable[[bytes], bytes]
) -> None:
    run()
    for path in folder.iterdir():
        path.write_bytes(damage(path.read_bytes()))
    assert run() == (5.0, 1)
    assert run() == (5.0, 0), "not mended"


def test_another_processor_has_machine_code_of_its_own(
    folder: Path, run: Callable[..., tuple[float, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    from numba.core.codegen import CPUCodegen

    run()
    monkeypatch.setattr(CPUCodegen, "magic_tuple", lambda self: ("another",))
    assert run() == (5.0, 1)


@pytest.mark.parametrize("what", ["a file in the way", "no space left"])
def test_where_nothing_can_be_kept_the_run_goes_on(
    folder: Path, run: Callable[..., tuple[float, int]], monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    if what == "no space left":

        def full(path: Path, content: bytes) -> int:
            path.touch()
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(Path, "write_bytes", full)
    else:
        folder.write_text("not a folder")
    assert run() == (5.0, 1)
    assert kernel_cache.not_kept[0].startswith(f"{folder}: ")
    assert not folder.is_dir() or not list(folder.iterdir())


FIRST_AND_LATER = """
import atexit
import sys

import mor.compilation
atexit.register(lambda: print("numba.np.arrayobj" in sys.modules))
mor.compilation.WORTH_COMPILING = 0.0
from mor.__main__ import main
main()
"""


@pytest.mark.slow
def test_the_compiling_run_gives_the_bytes_of_later_ones(tmp_path: Path) -> None:
    """And says once that it compiles, the later ones nothing: they load nothing of what it compiles with."""
    project = Path(__file__).parents[1] / "sample_projects" / "facade" / "project.yaml"
    said, loaded, written = [], [], []
    for number in range(2):
        out = tmp_path / str(number)
        done = subprocess.run(
            [sys.executable, "-c", FIRST_AND_LATER, "adjust", str(project), "-o", str(out)],
            env={
                **os.environ,
                "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
                "PYTHONPATH": os.pathsep.join(sys.path),
            },
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        said.append(done.stderr)
        loaded.append(done.stdout.strip())
        written.append(
            {path.name: path.read_bytes() for path in out.iterdir() if path.name != "adjusted.yaml"}
        )
    assert [words.count("first run on this machine") for words in said] == [1, 0]
    assert loaded == ["True", "False"]
    assert written[0] == written[1]
