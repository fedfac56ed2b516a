"""Ceres Solver on the same data: compiled here from ``ceres/adjust.cpp`` where a compiler and the library are found."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scenes import SIGMA_CENTRE, SIGMA_IMAGE, Block

_SOURCE = Path(__file__).parent / "ceres" / "adjust.cpp"
_EIGEN = ("/usr/include/eigen3", "/usr/local/include/eigen3", "/opt/homebrew/include/eigen3")


def compile_ceres(folder: Path) -> Path | None:
    """The program, or ``None`` where it cannot be built; says why."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        print("no C++ compiler: Ceres is left out")
        return None
    program = folder / "adjust_by_ceres"
    includes = [f"-I{path}" for path in _EIGEN if Path(path).is_dir()]
    command = [compiler, "-O3", "-march=native", "-std=c++17", *includes, str(_SOURCE), "-o", str(program)]
    done = subprocess.run([*command, "-lceres", "-lglog"], capture_output=True, text=True, check=False)
    if done.returncode:
        print("Ceres is left out; its program does not compile:", done.stderr.strip().split("\n")[0])
        return None
    return program


def write_block(block: Block, path: Path) -> None:
    """A block as ``adjust.cpp`` reads it."""
    with path.open("wb") as file:
        np.array([len(block.centre), len(block.point), len(block.image)], dtype=np.int64).tofile(file)
        np.array([SIGMA_IMAGE, SIGMA_CENTRE]).tofile(file)
        np.hstack([block.start_centre, block.start_angles]).tofile(file)
        for array in (block.start_interior, block.start_point, block.observed_centre, block.xy):
            np.ascontiguousarray(array, dtype=np.float64).tofile(file)
        block.image.tofile(file)
        block.of_point.tofile(file)


def run_ceres(
    program: Path,
    block: Block,
    derivatives: str = "analytic",
    solver: str = "sparse",
    covariance: bool = False,
) -> dict[str, Any]:
    """CPU seconds of an iteration, of the whole solution and of the covariances; objective at the end."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "block.bin"
        write_block(block, path)
        command = [str(program), str(path), derivatives, solver, *(["covariance"] if covariance else [])]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found
