"""``python -m tests.scenarios.mixtures --count 1000 --seed 1``: how many mixtures start from nothing, by ingredient.

The criterion: with nothing given the adjustment reaches the solution that starting at the truth reaches; where plain
least squares do not, what ``mor adjust`` ends at counts, which may leave out what it suspects ("by mor adjust only").
Only worlds whose adjustment from the truth converges are counted. With ``--as-adjusted`` both are what ``mor adjust``
ends at, and worlds count for which that is a solution from the truth: what a user sees where identities are wrong.
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.scenarios.mixtures.ingredients import mixture, wrong_identities
from tests.scenarios.mixtures.project_file import write_project
from tests.scenarios.mixtures.situations import SITUATIONS, situation
from tests.scenarios.mixtures.surveys.composed import composed
from tests.scenarios.mixtures.surveys.newer import NEWER
from tests.scenarios.mixtures.surveys.tied import tied
from tests.scenarios.mixtures.trial import Trial, compared, compared_as_adjusted

OTHERS = {**NEWER, "tied": tied}
"""Surveys of one kind."""


def main() -> None:
    """Run the trials, print each that failed and the rates."""
    parser = argparse.ArgumentParser(prog="python -m tests.scenarios.mixtures", description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--wrong", type=float, default=0.0, help="share of wrong identities")
    parser.add_argument("--situations", action="store_true", help="each of the single situations, instead of mixtures")
    parser.add_argument(
        "--surveys",
        choices=["composed", *OTHERS],
        help="surveys of the second generator, instead of mixtures",
    )
    parser.add_argument("--as-adjusted", action="store_true", help="compare what mor adjust ends at")
    parser.add_argument("--keep", type=Path, help="folder in which the projects stay")
    options = parser.parse_args()
    trials: list[Trial] = []
    with tempfile.TemporaryDirectory() as scratch, contextlib.suppress(KeyboardInterrupt):
        folder = options.keep or Path(scratch)
        for seed in range(options.seed, options.seed + options.count):
            for trial in _trials(seed, options, folder / str(seed)):
                trials.append(trial)
                if trial.counts and not trial.reached:
                    print(f"{seed}: {trial.words} [{', '.join(sorted(trial.tags))}]", flush=True)
    _print_rates(trials)


def _trials(seed: int, options: argparse.Namespace, folder: Path) -> Iterator[Trial]:
    compare = compared_as_adjusted if options.as_adjusted else compared
    if options.surveys:
        composes = options.surveys == "composed"
        survey = composed(seed, options.wrong) if composes else OTHERS[options.surveys](seed)
        yield compare(*survey.write(folder), frozenset(survey.tags))
        return
    worlds = [situation(name, seed) for name in SITUATIONS] if options.situations else [mixture(seed)]
    for number, world in enumerate(worlds):
        wrong_identities(world, options.wrong)
        yield compare(*write_project(world, folder / str(number)), frozenset(world.tags))


def _print_rates(trials: list[Trial]) -> None:
    counted = [trial for trial in trials if trial.counts]
    of, reached = Counter(), Counter()
    for trial in counted:
        of.update(["all", *trial.tags])
        reached.update(["all", *trial.tags] if trial.reached else [])
    for tag in sorted(of, key=lambda tag: (tag != "all", tag)):
        print(f"{tag:34} {reached[tag]:5} of {of[tag]:5}  {100.0 * reached[tag] / of[tag]:6.2f} %")
    print(f"{len(trials)} worlds; {len(trials) - len(counted)} not counted: not determined from the truth")


if __name__ == "__main__":
    main()
