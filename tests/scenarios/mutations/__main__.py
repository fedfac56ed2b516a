"""``python -m tests.scenarios.mutations --count 50000 --seed 1``: run mutants, print faults and figures."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections import Counter
from pathlib import Path


def main() -> int:
    """Run the mutants that are asked for; 1 where one of them has a fault."""
    if sys.argv[1:2] == ["--work"]:
        from .worker import main as work

        del sys.argv[1]
        work()
        return 0
    parser = argparse.ArgumentParser(prog="python -m tests.scenarios.mutations", description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="how many mutants")
    parser.add_argument("--seed", type=int, default=1, help="another seed, other mutants")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--only", type=int, nargs="+", help="numbers of single mutants, to look at them again")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--keep", type=Path, help="folder into which projects with faults are put")
    wanted = parser.parse_args()
    from .material import all_material
    from .pool import run_pool

    numbers = wanted.only or list(range(wanted.first, wanted.first + wanted.count))
    if not wanted.only:
        originals = range(-len(all_material()), 0)
        for result in run_pool(wanted.seed, list(originals), 1, None):
            told = [fault for fault in result.faults if not fault.startswith("slow")]
            print("".join(f"{result.material}, not mutated: {fault}\n" for fault in told), end="", flush=True)
    keep = wanted.keep.resolve() if wanted.keep else None
    began, codes, kinds, seconds, peak = time.monotonic(), Counter[int](), Counter[str](), [], 0.0
    with contextlib.suppress(KeyboardInterrupt):  # what has been run so far is told all the same
        for result in run_pool(wanted.seed, numbers, wanted.jobs, keep):
            codes[result.code] += 1
            seconds.append(result.seconds)
            peak = max(peak, result.peak)
            for fault in result.faults:
                kinds[fault.split(":")[0]] += 1
                print(f"{result.number} ({result.material}, {' '.join(result.command)}): {fault}", flush=True)
    print(f"{len(seconds)} mutants of seed {wanted.seed} in {time.monotonic() - began:.0f} s")
    print("exit codes: " + ", ".join(f"{code}: {count}" for code, count in sorted(codes.items())))
    print(
        f"computing time: {sum(seconds) / max(len(seconds), 1):.3f} s in the mean, "
        f"{max(seconds, default=0.0):.1f} s at most; {peak:.2f} GB at most"
    )
    print("faults: " + (", ".join(f"{kind}: {count}" for kind, count in sorted(kinds.items())) or "none"))
    return int(bool(kinds))


sys.exit(main())
