"""``python -m tests.undeterminable --count 200``: the rate of mixtures in which all is named and the rest is right."""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

from tests.undeterminable.trial import trial


def main() -> None:
    """Run the trials and print the rates."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--count", type=int, default=50)
    arguments.add_argument("--first", type=int, default=0)
    given = arguments.parse_args()
    good, tried = Counter(), Counter()
    for seed in range(given.first, given.first + given.count):
        with tempfile.TemporaryDirectory() as folder:
            result = trial(seed, Path(folder))
        for key in ("all", *result.kinds):
            tried[key] += 1
            good[key] += not result.mistakes
        if result.mistakes:
            print(seed, " ".join(result.kinds), *result.mistakes, sep="\n   ", flush=True)
    for key in tried:
        print(f"{key:14s} {good[key]:4d} of {tried[key]:4d}")


if __name__ == "__main__":
    main()
