"""With long arrays in files, every project has the numbers that it has in memory; files and folders go."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mor
from mor import long_arrays, machine
from mor.errors import InputError
from mor.linalg import compilation
from mor.solve import rays as plan
from sample_projects.simulate import SCENES
from tests.reference_data import NETWORKS, network_name
from tests.scenarios.image_blocks import Kind, command, write_block
from tests.selection import slow_after, slow_but

SAMPLES = Path(__file__).resolve().parents[2] / "sample_projects"
FEW_SAMPLES = ("facade", "machine_part")
FEW_NETWORKS = NETWORKS[:: len(NETWORKS) // 3]


@pytest.fixture
def small_shards(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Every array of a hundred numbers goes into a file, its pages are given back all the time, shards are short."""
    sizes: list[int] = []
    allocate = long_arrays._allocate

    def counted(descriptor: int, size: int) -> None:
        sizes.append(size)
        allocate(descriptor, size)

    monkeypatch.setattr(long_arrays, "_allocate", counted)
    for name, value in (("LONG", 800), ("_SHARE", 0.0), ("_WORTH", -1e12), ("_PAUSE", 0.001)):
        monkeypatch.setattr(long_arrays, name, value)
    return sizes


def shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "POINTS_AT_A_TIME", 8)
    monkeypatch.setattr(plan, "RAYS_AT_A_TIME", 64)


def assert_same(path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, snoop: bool = False) -> Any:
    """Adjust as ever, then with short shards and arrays in files: the same to 1e-9 σ."""
    one = mor.adjust(path, snoop).solved
    shortened(monkeypatch)
    with long_arrays.limited_memory(8e9, folder):
        other = mor.adjust(path, snoop).solved
    assert other.adjustment.outcome is one.adjustment.outcome
    assert (one.quality is None) == (other.quality is None)
    if one.quality is None or other.quality is None:
        return other
    for kind, values in one.adjustment.values.items():
        q = one.quality.cofactors.get(kind)
        if q is None or values.ndim != 2:
            continue
        variance = np.diagonal(q, axis1=1, axis2=2)
        sigma = np.sqrt(np.maximum(variance, 0.0))
        apart = np.abs(values - other.adjustment.values[kind])
        known = np.isfinite(sigma) & np.isfinite(values)
        assert (apart[known] <= 1e-9 * sigma[known] + 1e-14 * np.abs(values[known])).all(), kind
        there = np.sqrt(np.maximum(np.diagonal(other.quality.cofactors[kind], axis1=1, axis2=2), 0.0))
        np.testing.assert_allclose(there[known], sigma[known], rtol=1e-7, atol=1e-12)
    for group, here, there in zip(one.adjustment.problem.groups, one.quality.groups, other.quality.groups, strict=True):
        scale = np.where(np.isfinite(group.sigma), group.sigma, 1.0)
        np.testing.assert_allclose(there.v / scale, here.v / scale, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(there.r, here.r, rtol=0.0, atol=1e-7)
    assert other.quality.sigma0 == pytest.approx(one.quality.sigma0, rel=1e-10)
    return other


@pytest.mark.parametrize("name", slow_but(FEW_SAMPLES, SCENES))
def test_samples(name: str, small_shards: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_same(SAMPLES / name / "project.yaml", tmp_path, monkeypatch)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("path", slow_but(FEW_NETWORKS, NETWORKS), ids=network_name)
def test_reference_networks(
    path: Path, small_shards: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert_same(path, tmp_path, monkeypatch)


@pytest.mark.parametrize(
    ("kind", "settings", "snoop"),
    slow_after(
        2,
        [
            (Kind(points=150, sights=20, control=6), "", False),
            (Kind(points=150, convergent=True, datum="free"), "", False),
            (Kind(gnss=False, control=8), "robust: danish", False),
            (Kind(eccentric=True), "variance_components: iterate", False),
            (Kind(table="csv"), "", True),
        ],
    ),
)
def test_blocks_with_every_option(
    kind: Kind,
    settings: str,
    snoop: bool,
    small_shards: list[int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    project = write_block(tmp_path / "block", kind)
    if settings:
        project.write_text(project.read_text() + f"settings: {{{settings}}}\n")
    solved = assert_same(project, tmp_path, monkeypatch, snoop)
    assert len(solved.adjustment.plan.rays.chunks) >= 4
    assert len(small_shards) > 10


@pytest.mark.slow
def test_kernels(small_shards: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(compilation.ASKED, "numba")
    monkeypatch.setattr(compilation, "WORTH_COMPILING", 0)
    solved = assert_same(write_block(tmp_path / "block", Kind(sights=20)), tmp_path, monkeypatch)
    assert solved.adjustment.kernels


def test_results_are_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = write_block(tmp_path / "block", Kind(points=150))
    assert command("adjust", project, "-o", tmp_path / "one", "--no-html", "-q").exit_code == 0
    monkeypatch.setattr(long_arrays, "LONG", 800)
    assert command("adjust", project, "-o", tmp_path / "other", "--no-html", "-q", "--memory", "8GB").exit_code == 0
    names = {path.name for path in (tmp_path / "one").iterdir()}
    assert names == {path.name for path in (tmp_path / "other").iterdir()}
    for name in names - {"results.json"}:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes(), name
    assert sorted(path.name for path in tmp_path.iterdir()) == ["block", "one", "other"]


def test_a_limit_that_cannot_be_kept_is_refused(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind(table="csv"))
    done = command("adjust", project, "-o", tmp_path / "out", "--memory", "20 MB")
    assert done.exit_code == 5
    assert "of 20 MB are left (--memory)" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("size", ["0GB", "many", "-1GB", "1e9XB"])
def test_amounts(size: str, tmp_path: Path) -> None:
    done = command("adjust", tmp_path, "--memory", size)
    assert done.exit_code == 2
    assert "expected an amount of memory such as 4GB" in done.stderr


def test_a_full_disk_is_told_with_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int, size: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    project = write_block(tmp_path / "block", Kind())
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr(long_arrays, "_allocate", full)
    monkeypatch.setattr(long_arrays, "LONG", 800)
    done = command("adjust", project, "-o", tmp_path / "out", "--memory", "8GB", "--scratch", tmp_path / "scratch")
    assert done.exit_code == 2
    assert f"{tmp_path / 'scratch'}: long arrays cannot be kept in this folder: No space left" in done.stderr
    assert not (tmp_path / "out").exists()
    assert not list((tmp_path / "scratch").iterdir())


def test_the_scratch_folder_must_exist(tmp_path: Path) -> None:
    project = write_block(tmp_path / "block", Kind())
    done = command("adjust", project, "--memory", "8GB", "--scratch", tmp_path / "nowhere")
    assert done.exit_code == 2
    assert "this is not a folder" in done.stderr


_HELD = """
import sys, time
from pathlib import Path
from mor import long_arrays
with long_arrays.limited_memory(8e9, Path(sys.argv[1])):
    array = long_arrays.full(1_000_000, 1.0)
    print(len(list(Path(sys.argv[1]).iterdir())), flush=True)
    time.sleep(60)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems name their temporary files")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_of_a_process_that_is_ended(number: int, tmp_path: Path) -> None:
    free = os.statvfs(tmp_path).f_bavail
    with subprocess.Popen([sys.executable, "-c", _HELD, tmp_path], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"0\n"
        process.send_signal(number)
        process.wait(10)
    assert not list(tmp_path.iterdir())
    assert free > 0


def test_pages_are_given_back_and_read_again(tmp_path: Path) -> None:
    size = 64_000_000
    with long_arrays.limited_memory(machine.resident() + size / 8, tmp_path):
        array = long_arrays.empty(size // 8)
        array[:] = np.arange(len(array))
        time.sleep(0.2)
        assert machine.pages_of_files() == 0.0 or machine.pages_of_files() < machine.resident()
        assert array[12_345] == 12_345.0
        assert float(array.sum()) == len(array) * (len(array) - 1) / 2
    with pytest.raises(InputError, match="not a folder"), long_arrays.limited_memory(1e9, tmp_path / "no"):
        pass
