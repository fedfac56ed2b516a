"""``python -m sample_projects.trials NAME [COUNT [FIRST]]``: the same measurements with so many other sets of errors.

What theory says of errors over σ and of σ0 is said beside what was found. σ are taken a priori: what they multiply is
known here, and so the ratios are standard normal.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kstest

from mor.api.pipeline import read_document, read_network, solve_network
from sample_projects.expected import parameter_results, point_results, quality_of
from sample_projects.simulate import Files, content

ROOT = Path(__file__).resolve().parent


class Trial(NamedTuple):
    """One set of errors."""

    sigma0: float
    redundancy: int
    ratios: NDArray[np.float64]
    """Errors over σ of all coordinates and of the further parameters."""


def trial(name: str, files: Files) -> Trial:
    """A sample project with these files, adjusted."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for file, found in {
            **files,
            "project.yaml": (ROOT / name / "project.yaml").read_text(encoding="utf-8"),
        }.items():
            (folder / file).parent.mkdir(exist_ok=True)
            (folder / file).write_bytes(content(found))
        solved = solve_network(read_network(read_document(folder / "project.yaml"), folder))
        quality = quality_of(solved)
        found_there, truth = point_results(solved), _truth(folder / "truth" / "points.csv")
        errors = [np.subtract(found_there[point][:3], place) for point, place in truth.items()]
        sigma = [found_there[point][3:] for point in truth]
        for (kind, block, component), value in _parameters(folder / "truth" / "parameters.csv").items():
            estimate, precision = parameter_results(solved)[kind, block, component]
            errors.append(np.array([estimate - value]))
            sigma.append([precision])
    spread = np.concatenate(sigma) / quality.sigma_factor
    known = spread > 0.0
    return Trial(quality.sigma0, quality.redundancy, np.concatenate(errors)[known] / spread[known])


def _truth(path: Path) -> dict[str, list[float]]:
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()[1:]]
    return {name: [float(cell) for cell in cells] for name, *cells in rows}


def _parameters(path: Path) -> dict[tuple[str, str, str], float]:
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()[1:]]
    return {(kind, block, component): float(value) for kind, block, component, value in rows}


def main(arguments: list[str]) -> int:
    """Print what the trials of a sample give; returns the exit code."""
    name, count = arguments[0], int(arguments[1]) if len(arguments) > 1 else 200
    first = int(arguments[2]) if len(arguments) > 2 else 1
    simulate: Callable[[int], Files] = import_module(f"sample_projects.simulate.{name}").simulate
    say([trial(name, simulate(seed)) for seed in range(first, first + count)])
    return 0


def say(trials: Sequence[Trial]) -> None:
    """Print what theory says of sets of errors, and what was found."""
    count = len(trials)
    sigma0 = np.array([t.sigma0 for t in trials])
    ratios = np.stack([t.ratios for t in trials])
    expected = 1.0 / np.sqrt(2.0 * trials[0].redundancy)
    print(f"{count} sets of errors, {ratios.shape[1]} coordinates and parameters, r = {trials[0].redundancy}")
    print(f"sigma0      mean {sigma0.mean():.4f} (1 +- {expected / np.sqrt(count):.4f})")
    print(f"            spread {sigma0.std(ddof=1):.4f} ({expected:.4f} +- {expected / np.sqrt(2 * count):.4f})")
    print(f"error/sigma rms {np.sqrt(np.mean(ratios**2)):.4f}, mean {ratios.mean():+.4f}")
    print(f"            beyond 1.96: {np.mean(np.abs(ratios) > 1.96):.4f} (0.0500)")
    rms = np.sqrt(np.mean(ratios**2, axis=0))
    print(f"            rms of single ones {rms.min():.3f} to {rms.max():.3f} (1 +- {1 / np.sqrt(2 * count):.3f})")
    p = [kstest(column, "norm").pvalue for column in ratios.T]
    print(f"            normal (Kolmogorov-Smirnov, level 0.01): {np.mean(np.array(p) < 0.01):.4f} rejected")


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
