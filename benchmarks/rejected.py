"""Whole command for rejected networks, as ratios to the accepted ones that they were made from.

    python benchmarks/rejected.py --seeds 2
    python benchmarks/rejected.py --seeds 0 --pair accepted/project.yaml rejected/project.yaml

Every kind of planted mistake of the tests goes into every sample project that has room for it. The two commands run in
turn, and the smallest of their times counts. Nothing else should run. A network whose observations, all of them, do not
converge from the start values may take longer.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]
from measure import run  # noqa: E402

from tests.scenarios.planted_mistakes.survey import NAMES, survey  # noqa: E402
from tests.scenarios.planted_mistakes.trial import KINDS  # noqa: E402
from tests.scenarios.planted_mistakes.truth import NotHereError  # noqa: E402

LIMITS = {True: 2.0, False: 5.0}
"""Largest ratio of a network that converges from its start values, and of another."""


class Run(NamedTuple):
    """CPU seconds of the command, its exit code, and whether all observations converge from the start values."""

    seconds: float
    code: int
    at_once: bool


def adjusted(project: Path) -> Run:
    """Run the command."""
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder) / "results"
        done = run([sys.executable, "-m", "mor", "adjust", project, "-o", results, "-q"], Path(folder))
        path = results / "results.json"
        told = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    suspects = told.get("suspects") or {"outcome": "converged"}
    repaired = any("start values lead" in str(note) for note in told.get("notes", ()))
    at_once = bool(told.get("solution")) and suspects["outcome"] == "converged" and not repaired
    return Run(done.seconds.cpu, done.code, at_once)


def compared(accepted: Path, rejected: Path, times: int) -> tuple[float, Run]:
    """CPU seconds of the accepted one, and the run of the rejected one."""
    found = [(adjusted(accepted), adjusted(rejected)) for _ in range(times)]
    return min(one.seconds for one, _ in found), min(other for _, other in found)


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
    print("| network | mistake | seed | accepted (CPU-s) | rejected (CPU-s) | ratio | exit code | from the start |")
    print("|---|---|---|---|---|---|---|---|")

    def row(words: str, accepted: Path, rejected: Path) -> None:
        before, after = compared(accepted, rejected, chosen.times)
        ratio = after.seconds / before
        ratios[after.at_once].append(ratio)
        start = "converges" if after.at_once else "does not"
        print(f"| {words} | {before:.2f} | {after.seconds:.2f} | {ratio:.2f} | {after.code} | {start} |", flush=True)

    for pair in chosen.pair:
        accepted, rejected = (path.resolve() for path in pair)
        row(f"{accepted.parent.name} | {rejected.parent.name} | ", accepted, rejected)
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        for kind in chosen.kind or KINDS:
            for name in chosen.sample or NAMES:
                with tempfile.TemporaryDirectory() as folder:
                    found = planted(kind, name, seed, Path(folder))
                    if found:
                        row(f"{name} | {kind} | {seed}", *found)
    for at_once, words in ((True, "converge from their start values"), (False, "do not")):
        some = ratios[at_once]
        if some:
            above = sum(ratio > LIMITS[at_once] for ratio in some)
            print(
                f"{words}: {len(some)}, median {median(some):.2f}, largest {max(some):.2f}, "
                f"{above} above {LIMITS[at_once]:g}"
            )


if __name__ == "__main__":
    main()
