"""``python -m tests.scenarios.undeterminable --count 200``: the rate of mixtures with all named and the rest right.

With ``--far`` it is that of blocks of 49 images without calibration and with far points, with and without start values.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from itertools import product
from pathlib import Path

from tests.scenarios.undeterminable.far_points import far_trial
from tests.scenarios.undeterminable.trial import Trial, trial

SIDE = 7
"""Images in each direction of the blocks with far points."""


def main() -> None:
    """Run the trials and print the rates."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--count", type=int, default=50)
    arguments.add_argument("--first", type=int, default=0)
    arguments.add_argument("--far", action="store_true", help="blocks with far points, instead of mixtures")
    given = arguments.parse_args()
    good, tried = Counter(), Counter()
    for seed in range(given.first, given.first + given.count):
        with tempfile.TemporaryDirectory() as folder:
            results = _far(seed, Path(folder)) if given.far else [trial(seed, Path(folder))]
        for result in results:
            for key in ("all", *result.kinds):
                tried[key] += 1
                good[key] += not result.mistakes
            if result.mistakes:
                print(seed, " ".join(result.kinds), *result.mistakes, sep="\n   ", flush=True)
    for key in tried:
        print(f"{key:34s} {good[key]:4d} of {tried[key]:4d}")


def _far(seed: int, folder: Path) -> list[Trial]:
    """A camera for each image or one for all, with start values or without."""
    results = []
    for own, given in product((True, False), repeat=2):
        kind = f"{'own cameras' if own else 'one camera'}, {'given' if given else 'nothing given'}"
        words = far_trial(seed, SIDE, own, given, folder)
        results.append(Trial(seed, (kind,), (words,) if words else ()))
    return results


if __name__ == "__main__":
    main()
