"""Ceres Solver and pycolmap on the same data. Ceres' program is compiled here from ``ceres/adjust.cpp``.

Nothing heavy is imported on top: what runs other programs has to stay small, see ``measure.run``.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

from measure import Run, run

if TYPE_CHECKING:
    from scenes import Scene

_HERE = Path(__file__).parent
_EIGEN = ("/usr/include/eigen3", "/usr/local/include/eigen3", "/opt/homebrew/include/eigen3")
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class NotAvailableError(Exception):
    """A peer that is not installed, or does not run; the text says why."""


def compile_ceres(folder: Path, source: str = "adjust.cpp") -> Path:
    """A program of Ceres. Raises :class:`NotAvailableError` where it cannot be built."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        raise NotAvailableError("no C++ compiler")
    program = folder / "adjust_by_ceres"
    includes = [f"-I{path}" for path in _EIGEN if Path(path).is_dir()]
    file = str(_HERE / "ceres" / source)
    command = [compiler, "-O3", "-march=native", "-std=c++17", *includes, file, "-o", str(program)]
    done = subprocess.run([*command, "-lceres", "-lglog"], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NotAvailableError("its program does not compile: " + done.stderr.strip().split("\n")[0])
    return program


def write_block(scene: Scene, path: Path) -> None:
    """An image block as ``adjust.cpp`` reads it, image points in the order of their points, which suits Ceres."""
    import numpy as np
    from scenes import SIGMA_CENTRE, SIGMA_IMAGE, Block

    if not isinstance(scene, Block):
        raise ValueError("only image blocks are adjusted by Ceres")
    order = np.argsort(scene.of_point, kind="stable")
    with path.open("wb") as file:
        np.array([len(scene.centre), len(scene.point), len(order)], dtype=np.int64).tofile(file)
        np.array([SIGMA_IMAGE, SIGMA_CENTRE]).tofile(file)
        np.hstack([scene.start_centre, scene.start_angles]).tofile(file)
        for array in (scene.start_interior, scene.start_point, scene.observed_centre, scene.xy[order]):
            np.ascontiguousarray(array, dtype=np.float64).tofile(file)
        scene.image[order].tofile(file)
        scene.of_point[order].tofile(file)


def adjust_by_ceres(program: Path, block: Path, dense: bool, covariance: bool, blas: str) -> dict[str, Any]:
    """Ceres' fastest solver of this block by CPU time, and what it needs with all cores; seconds, bytes.

    ``blas`` is a folder with the libblas and liblapack it shall use, or empty for those of the system.
    """
    solvers = ("sparse", "dense", "dense-lapack") if dense else ("sparse",)
    analytic = {solver: _run(program, block, blas, solver) for solver in solvers}
    best = min(analytic, key=lambda solver: float(analytic[solver]["iteration_cpu"]))
    result = {**analytic[best], "solver": best, "blas": _blas_of(program, blas)}
    result["iteration_cpu_of_solvers"] = {name: one["iteration_cpu"] for name, one in analytic.items()}
    automatic = _run(program, block, blas, best, derivatives="automatic")
    result["iteration_cpu_automatic"] = automatic["iteration_cpu"]
    careful = _run(program, block, blas, best, more="default-radius")
    for name in ("iterations", "solve_cpu", "solve_wall"):
        result[f"{name}_default_radius"] = careful[name]
    quickest = [one["solve_wall"] for one in analytic.values()]
    cores = os.cpu_count() or 1
    if cores > 1:
        together = [_run(program, block, blas, solver, threads=cores) for solver in solvers]
        result["iteration_wall_all_cores"] = min(one["iteration_wall"] for one in together)
        quickest += [one["solve_wall"] for one in together]
    result["fastest_solve_wall"] = min(quickest)
    if covariance:
        result |= {k: v for k, v in _run(program, block, blas, best, more="covariance").items() if k not in result}
    return result


def _run(
    program: Path,
    block: Path,
    blas: str,
    solver: str,
    derivatives: str = "analytic",
    threads: int = 1,
    more: str = "",
) -> dict[str, Any]:
    limit = ONE_THREAD if threads == 1 else {name: str(threads) for name in ONE_THREAD}
    paths = {"LD_LIBRARY_PATH": f"{blas}:{os.environ.get('LD_LIBRARY_PATH', '')}"} if blas else {}
    command = [program, block, derivatives, solver, str(threads), *([more] if more else [])]
    done = run(command, block.parent, {**limit, **paths})
    return {**_answer(done), "peak_bytes": done.peak}


def _blas_of(program: Path, blas: str) -> str:
    """The file of the linear algebra Ceres is run with, as far as the system tells."""
    paths = {"LD_LIBRARY_PATH": blas} if blas else {}
    ldd = shutil.which("ldd")
    if ldd is None:
        return "unknown"
    told = subprocess.run([ldd, str(program)], capture_output=True, text=True, check=False, env={**os.environ, **paths})
    lines = [line.split("=>")[1].split()[0] for line in told.stdout.split("\n") if "libblas" in line and "=>" in line]
    return os.path.basename(os.path.dirname(os.path.realpath(lines[0]))) if lines else "unknown"


def covariance_by_pycolmap(python: str, block: Path) -> dict[str, Any]:
    """pycolmap's covariance of a block of the same size, by a Python that has pycolmap."""
    done = run([python, _HERE / "colmap.py", block], block.parent, ONE_THREAD)
    return {**_answer(done), "peak_bytes": done.peak}


def _answer(done: Run) -> dict[str, Any]:
    if done.code:
        words = done.errors.strip().split("\n")[-1]
        raise NotAvailableError(f"ended with code {done.code}: {words}")
    found: dict[str, Any] = json.loads(done.output)
    return found
