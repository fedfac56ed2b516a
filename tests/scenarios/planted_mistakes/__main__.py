"""``python -m tests.scenarios.planted_mistakes --count 10``: how often the right cause is offered, by kind."""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Callable
from functools import partial

from tests.scenarios.planted_mistakes.error_free import rates
from tests.scenarios.planted_mistakes.trial import KINDS, Trial, mixture_trial, trial
from tests.scenarios.planted_mistakes.truth import NotHereError


def row(name: str, found: list[Trial]) -> str:
    """A row of the table in Markdown."""
    first = sum(one.place == 0 for one in found)
    among = sum(one.place is not None and one.place < 3 for one in found)
    blamed = sum(bool(one.offered) and one.place != 0 and one.outcome != "input" for one in found)
    codes = Counter(one.code for one in found)
    said = ", ".join(f"{code}: {count}" for code, count in sorted(codes.items()))
    visible = sum(one.visible for one in found)
    listed = sum(one.scored is not None for one in found)
    listed_first = sum(one.scored == 0 for one in found)
    listed_wrong = sum(bool(one.listed) and one.scored != 0 for one in found)
    counts = (len(found), visible, first, among, blamed, listed_first, listed, listed_wrong)
    return f"| {name} | {' | '.join(map(str, counts))} | {said} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=4, help="projects for each kind of mistake")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--kind", choices=sorted(KINDS), action="append", help="only this kind")
    parser.add_argument("--show", action="store_true", help="tell what is named where the right cause is not first")
    parser.add_argument(
        "--error-free", type=int, default=0, help="in place of that, so many projects without a mistake"
    )
    parser.add_argument("--mixtures", type=int, default=0, help="in place of that, so many mixtures")
    parser.add_argument("--sample", default="bridge", help="sample project without a mistake")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    if chosen.error_free:
        count, rejected, offered = rates(chosen.sample, chosen.error_free)
        print(f"{chosen.sample}: {count} without a mistake, {rejected} looked into, {offered} with a hypothesis")
        return
    print("| mistake | cases | visible | diagnose: first | among three | another first ", end="")
    print("| score tests: first | among three | another first | exit codes |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    everything: list[Trial] = []
    trials: dict[str, list[Callable[[], Trial]]] = {
        kind: [partial(trial, kind, seed) for seed in range(chosen.first, chosen.first + chosen.count)]
        for kind in chosen.kind or KINDS
    }
    if chosen.mixtures:
        seeds = range(chosen.first, chosen.first + chosen.mixtures)
        trials = {f"mixture {seed}": [partial(mixture_trial, seed)] for seed in seeds}
    for kind, some in trials.items():
        found = []
        for one in some:
            try:
                found.append(one())
            except NotHereError:
                print(f"{kind}: no project for it")
        everything += found
        print(row(kind.replace("_", " "), found), flush=True)
        if chosen.show:
            for seed, one in enumerate(found, chosen.first):
                if one.place != 0 or one.scored != 0:
                    print("   ", seed, *one[:7], "diagnose", one.place, *one.offered[:4], sep="; ")
                    print("        score tests", one.scored, *one.listed, sep="; ", flush=True)
    print(row("all", everything))
    print(row("of these: visible", [one for one in everything if one.visible]))
    solved = [one for one in everything if one.outcome == "converged"]
    print(row("of these: the plain adjustment converges", solved))
    print(row("of these: it does not, or cannot begin", [o for o in everything if o.outcome != "converged"]))


if __name__ == "__main__":
    main()
