"""mor and Ceres Solver on random problems like those of BAL: costs at the end, and iterations.

``python benchmarks/bal.py --seeds 200 --first 1000`` prints a line for each problem at which mor ends higher than Ceres
or takes more than 1.5 times its iterations, and the rates. ``--file`` takes a BAL file instead. A cost is half the sum
of squares in px². mor is the whole command; iterations of every adjustment that it makes count. Ceres has its own
options, its tolerance of the cost being 1e-6 (*default*) and 1e-12 (*tight*: its minimum).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from peers import compile_ceres

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.scenarios.bal_problems import SAME, Minimum, bal_problem, minimum_of_mor


class Trial(NamedTuple):
    """Minima of mor and of Ceres with both tolerances."""

    mor: Minimum
    tight: Minimum
    default: Minimum
    redundancy: int

    @property
    def is_well(self) -> bool:
        """True if mor ends as low, but for what the test for points at infinity calls chance."""
        return self.mor.is_as_low_as(self.tight, self.redundancy)

    @property
    def excess(self) -> float:
        """Relative difference of the costs; infinite without a solution of all observations."""
        return self.mor.cost / self.tight.cost - 1.0 if self.mor.converged else np.inf

    def ratio(self, other: Minimum) -> float:
        """Iterations beside those of Ceres."""
        return self.mor.iterations / max(other.iterations, 1)


def by_ceres(program: Path, path: Path, tolerance: float) -> Minimum:
    """Return the minimum that Ceres reaches; rejected steps are iterations too."""
    done = subprocess.run([program, path, str(tolerance)], capture_output=True, text=True, check=True, timeout=3600)
    found = json.loads(done.stdout)
    words = f"{found['behind']} image points behind their camera"
    return Minimum(found["cost"], found["iterations"], found["converged"], words)


def trial(program: Path, path: Path) -> Trial:
    """Adjust a file by both."""
    with path.open() as file:
        cameras, points, rays = map(int, file.readline().split())
    redundancy = 2 * rays - 9 * cameras - 3 * points + 7
    own = minimum_of_mor(path)
    return Trial(own, by_ceres(program, path, 1e-12), by_ceres(program, path, 1e-6), redundancy)


def main() -> None:
    """Print what differs, and the rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--file", type=Path)
    chosen = parser.parse_args()
    trials = []
    with tempfile.TemporaryDirectory() as folder:
        program = compile_ceres(Path(folder), "bal.cpp")
        path = Path(folder) / "problem.txt"
        for seed in [chosen.first] if chosen.file else range(chosen.first, chosen.first + chosen.seeds):
            if chosen.file is None:
                path.write_text(bal_problem(seed).text)
            one = trial(program, chosen.file or path)
            trials.append(one)
            if chosen.file or one.excess > SAME or one.ratio(one.default) > 1.5:
                words = f"as low: {one.is_well}, excess {one.excess:.2e}, redundancy {one.redundancy}"
                print(chosen.file or seed, words, *one[:3], sep="\n  ", flush=True)
    print(f"{sum(one.excess <= SAME for one in trials)} of {len(trials)} at the minimum of Ceres or lower")
    print(f"{sum(one.is_well for one in trials)} with points at infinity that the test does not tell from finite ones")
    for name in ("default", "tight"):
        ratios = np.array([one.ratio(getattr(one, name)) for one in trials])
        print(
            f"iterations beside those of Ceres ({name}): median {np.median(ratios):.2f}, most {ratios.max():.2f}, "
            f"at most 1.5 in {np.mean(ratios <= 1.5):.0%}"
        )


if __name__ == "__main__":
    main()
