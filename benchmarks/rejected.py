"""Whole command for rejected networks, as ratios to the accepted ones that they were made from.

    python benchmarks/rejected.py --seeds 2
    python benchmarks/rejected.py --seeds 0 --pair accepted/project.yaml rejected/project.yaml

Every kind of planted mistake of the tests goes into sample projects. The two commands run in turn, and the smaller of
two times counts. Nothing else should run.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from statistics import median

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]
from measure import run  # noqa: E402

from tests.scenarios.planted_mistakes.survey import NAMES, survey  # noqa: E402
from tests.scenarios.planted_mistakes.trial import KINDS  # noqa: E402
from tests.scenarios.planted_mistakes.truth import NotHereError  # noqa: E402

TIMES = 2


def seconds(project: Path, folder: Path) -> tuple[float, int]:
    """CPU seconds of the command, and its exit code."""
    command = [sys.executable, "-m", "mor", "adjust", project, "-o", folder / "results", "--force", "-q"]
    done = run(command, folder)
    return done.seconds.cpu, done.code


def compared(accepted: Path, rejected: Path, folder: Path) -> tuple[float, float, int]:
    """CPU seconds of both, and the exit code of the rejected one."""
    times = [(seconds(accepted, folder), seconds(rejected, folder)) for _ in range(TIMES)]
    return min(one[0] for one, _ in times), min(other[0] for _, other in times), times[0][1][1]


def planted(kind: str, seed: int, folder: Path) -> tuple[str, Path, Path] | None:
    """A sample with a mistake and without it; nothing where no sample has room for the mistake."""
    random = np.random.default_rng([seed, list(KINDS).index(kind)])
    for name in random.permutation(NAMES):
        chosen = survey(str(name))
        try:
            KINDS[kind](chosen, random)
        except NotHereError:
            continue
        clean = survey(str(name)).write(folder / "accepted")
        return str(name), clean, chosen.write(folder / "rejected")
    return None


def main() -> None:
    """Print a row for each pair, and the largest ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1, help="networks for each kind of mistake")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--pair", nargs=2, type=Path, action="append", default=[], metavar="PROJECT")
    chosen = parser.parse_args()
    ratios: dict[bool, list[float]] = {True: [], False: []}
    print(
        "| network | mistake | accepted (CPU-s) | rejected (CPU-s) | ratio | exit code |\n|---|---|---|---|---|---|"
    )

    def row(name: str, mistake: str, accepted: Path, rejected: Path, folder: Path) -> None:
        before, after, code = compared(accepted, rejected, folder)
        ratios[code in (0, 1)].append(after / before)
        print(
            f"| {name} | {mistake} | {before:.2f} | {after:.2f} | {after / before:.2f} | {code} |", flush=True
        )

    for pair in chosen.pair:
        with tempfile.TemporaryDirectory() as folder:
            row(pair[0].parent.name, pair[1].stem, *(path.resolve() for path in pair), Path(folder))
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        for kind in KINDS:
            with tempfile.TemporaryDirectory() as folder:
                found = planted(kind, seed, Path(folder))
                if found:
                    row(found[0], kind.replace("_", " "), *found[1:], Path(folder))
    for solved, words in ((True, "rejected"), (False, "without a solution, or not begun")):
        if ratios[solved]:
            print(
                f"{words}: {len(ratios[solved])}, median {median(ratios[solved]):.2f}, "
                f"largest {max(ratios[solved]):.2f}"
            )


if __name__ == "__main__":
    main()
