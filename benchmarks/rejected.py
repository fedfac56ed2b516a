"""Whole command for rejected networks, as ratios to the accepted ones that they were made from.

    python benchmarks/rejected.py --seeds 2
    python benchmarks/rejected.py --seeds 0 --pair accepted/project.yaml rejected/project.yaml

Every kind of planted mistake of the tests goes into every sample project that has room for it. The two commands run in
turn, and the smallest of their times counts. Nothing else should run.
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

LIMITS = {True: 2.0, False: 5.0}
"""Largest ratio of a network with a solution, and of one without it."""


def seconds(project: Path, folder: Path) -> tuple[float, int]:
    """CPU seconds of the command, and its exit code."""
    command = [sys.executable, "-m", "mor", "adjust", project, "-o", folder / "results", "--force", "-q"]
    done = run(command, folder)
    return done.seconds.cpu, done.code


def compared(accepted: Path, rejected: Path, folder: Path, times: int) -> tuple[float, float, int]:
    """CPU seconds of both, and the exit code of the rejected one."""
    found = [(seconds(accepted, folder), seconds(rejected, folder)) for _ in range(times)]
    return min(one[0] for one, _ in found), min(other[0] for _, other in found), found[0][1][1]


def planted(kind: str, name: str, seed: int, folder: Path) -> tuple[Path, Path] | None:
    """A sample without a mistake and with it; nothing if the sample has no room for the mistake."""
    random = np.random.default_rng([seed, list(KINDS).index(kind), NAMES.index(name)])
    wrong = survey(name)
    try:
        KINDS[kind](wrong, random)
    except NotHereError:
        return None
    return survey(name).write(folder / "accepted"), wrong.write(folder / "rejected")


def main() -> None:
    """Print a row for each pair, and the largest ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1, help="networks for each kind of mistake and sample")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--times", type=int, default=2, help="runs of each command")
    parser.add_argument("--kind", choices=sorted(KINDS), action="append", help="only this kind")
    parser.add_argument("--sample", choices=NAMES, action="append", help="only this sample")
    parser.add_argument("--pair", nargs=2, type=Path, action="append", default=[], metavar="PROJECT")
    chosen = parser.parse_args()
    ratios: dict[bool, list[float]] = {True: [], False: []}
    print("| network | mistake | seed | accepted (CPU-s) | rejected (CPU-s) | ratio | exit code |")
    print("|---|---|---|---|---|---|---|")

    def row(words: str, accepted: Path, rejected: Path, folder: Path) -> None:
        before, after, code = compared(accepted, rejected, folder, chosen.times)
        ratios[code in (0, 1)].append(after / before)
        print(f"| {words} | {before:.2f} | {after:.2f} | {after / before:.2f} | {code} |", flush=True)

    for pair in chosen.pair:
        with tempfile.TemporaryDirectory() as folder:
            accepted, rejected = (path.resolve() for path in pair)
            row(f"{accepted.parent.name} | {rejected.parent.name} | ", accepted, rejected, Path(folder))
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        for kind in chosen.kind or KINDS:
            for name in chosen.sample or NAMES:
                with tempfile.TemporaryDirectory() as folder:
                    found = planted(kind, name, seed, Path(folder))
                    if found:
                        row(f"{name} | {kind} | {seed}", *found, Path(folder))
    for solved, words in ((True, "solved"), (False, "without a solution, or not begun")):
        some = ratios[solved]
        if some:
            above = sum(ratio > LIMITS[solved] for ratio in some)
            print(
                f"{words}: {len(some)}, median {median(some):.2f}, largest {max(some):.2f}, "
                f"{above} above {LIMITS[solved]:g}"
            )


if __name__ == "__main__":
    main()
