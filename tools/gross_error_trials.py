"""``python -m tools.gross_error_trials --count 40``: rates of random scenes with gross errors.

A row is *named* where data snooping that begins with the suspects takes it out or flags it. It *can be* named where its
error is so large that the test of it, at the level 0.001, finds it with a probability of 0.999 in the adjustment of all
that is right.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.model.contract import ObservationGroup, wrap
from mor.model.parameters import index_unknowns
from mor.quality.assessment import Levels, Quality, assess
from mor.quality.outliers import (
    SuspectedOutliers,
    held,
    lost_blocks,
    may_be_absurd,
    with_suspects,
    without_suspects,
)
from mor.quality.robust_estimation import exclude
from mor.quality.snooping import snoop
from mor.solve.iterate import Adjustment, Outcome, adjust
from mor.types import BoolArray, FloatArray
from tests.scenarios.gross_error_scenes import KINDS, Spoiled, disturbed, spoiled

GON = np.pi / 200.0
PARTS = (0.0, 0.01, 0.03, 0.1)
CERTAIN = 3.29 + 3.09
"""Non-centrality, as a root, of an error that the test finds with a probability of 0.999."""


class Found(NamedTuple):
    """What became of a scene; numbers of rows."""

    converged: bool
    plainly: bool
    """True where the plain adjustment converged to a place that is not absurd."""
    sigma0: float
    planted: int
    can_be_named: int
    missed: int
    """Of those that can be named."""
    false: int
    rows: int
    effort: float
    """CPU time over that of the plain adjustment."""


def adjusted(
    scene: Spoiled, part: float, angle: float, seed: int
) -> tuple[Adjustment, SuspectedOutliers | None, float]:
    """The adjustment of a scene from disturbed start values, its suspects, and its effort."""
    start = disturbed(scene, np.random.default_rng(seed), part, angle)
    begin = time.process_time()
    plain = adjust(scene.problem, start)
    middle = time.process_time()
    if plain.outcome is Outcome.CONVERGED and not may_be_absurd(plain):
        return plain, None, 1.0
    found = without_suspects(plain)
    return found.adjustment, found.suspects, (time.process_time() - begin) / max(middle - begin, 1e-9)


def trial(kind: str, errors: float, seed: int, part: float = 0.01, angle: float = GON) -> Found:
    """One scene, adjusted, its gross errors compared with those that were named."""
    scene = spoiled(seed, kind, errors)
    found, suspects, effort = adjusted(scene, part, angle, seed)
    rows = sum(group.count for group in scene.problem.groups)
    planted = sum(int(mask.any(axis=1).sum()) for mask in scene.wrong)
    can = _rows(can_be_named(scene))
    count = int(can.sum())
    if found.outcome is not Outcome.CONVERGED:
        return Found(False, False, np.inf, planted, count, count, 0, rows, effort)
    quality = assess(found)
    snooped = snooped_from(quality, suspects)
    wrong = _rows(scene.wrong)
    named = _rows(tuple(group.left_out for group in snooped.adjustment.problem.groups))
    named |= _rows(snooped.flagged)
    return Found(
        True,
        suspects is None,
        snooped.sigma0,
        planted,
        count,
        int((can & ~named).sum()),
        int((named & ~wrong).sum()),
        rows,
        effort,
    )


def snooped_from(quality: Quality, suspects: SuspectedOutliers | None) -> Quality:
    """Quality after data snooping that begins with the suspects taken out."""
    problem, out = quality.adjustment.problem, None
    if suspects is not None:
        problem, out = with_suspects(problem, suspects)
    return snoop(problem, quality, Levels(), aposteriori=True, excluded=out).quality


def _rows(masks: tuple[BoolArray, ...]) -> BoolArray:
    return np.concatenate([mask.any(axis=1) for mask in masks])


def can_be_named(scene: Spoiled) -> tuple[BoolArray, ...]:
    """(n, m) of each group: wrong observations that the rest, without any wrong one, finds almost certainly.

    Points and images that nothing good determines are held; what tells of them cannot be named.
    """
    problem, truth = scene.problem, scene.truth
    adjustment = adjust(exclude(problem, scene.wrong), truth)
    lost: tuple[tuple[str, str], ...] = ()
    while adjustment.outcome is Outcome.SINGULAR:
        lost += tuple(one.unknowns[0][:2] for one in adjustment.defect.undetermined)
        without = replace(problem, index=index_unknowns(held(problem.index.blocks, lost)))
        adjustment = adjust(exclude(without, scene.wrong), truth)
    quality = assess(adjustment)
    result = []
    for group, wrong, reliability in zip(problem.groups, scene.wrong, quality.reliability, strict=True):
        error = np.abs(_errors(group, truth))
        with np.errstate(invalid="ignore"):
            found = np.asarray(error / reliability.smallest * np.sqrt(reliability.ncp) > CERTAIN)
        for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind in problem.index.blocks:
                found &= ~lost_blocks(problem.index.blocks[slot.kind], slot.kind, lost)[numbers][:, None]
        result.append(found & wrong)
    return tuple(result)


def _errors(group: ObservationGroup, truth: dict[str, FloatArray]) -> FloatArray:
    """(n, m) observed − true; NaN where not observed."""
    blocks = [truth[slot.kind][numbers] for slot, numbers in zip(group.type.slots, group.blocks, strict=True)]
    error: FloatArray = group.observed - group.type.equation(blocks, group.constants).values
    error[:, group.type.wraps] = wrap(error[:, group.type.wraps])
    return error


def table(count: int, part: float, angle: float, first: int = 0) -> str:
    """Rates of all kinds of scenes as a table in Markdown."""
    lines = [
        "| scene | wrong rows | converged | plainly | σ0, median | named of those that can be | false names "
        "per row | effort |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for kind in KINDS:
        for errors in PARTS:
            found = [trial(kind, errors, seed, part, angle) for seed in range(first, first + count)]
            can, missed, false, rows = (
                sum(getattr(one, name) for one in found) for name in ("can_be_named", "missed", "false", "rows")
            )
            lines.append(
                f"| {kind} | {errors:.0%} | {sum(one.converged for one in found)}/{count} "
                f"| {sum(one.plainly for one in found)} | {np.median([one.sigma0 for one in found]):.2f} "
                f"| {can - missed}/{can} | {false / rows:.4f} | {np.mean([one.effort for one in found]):.1f} |"
            )
            print(lines[-1], flush=True)
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20, help="scenes of each kind and part of errors")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--start", type=float, default=0.01, help="start values off by this part of the extent")
    parser.add_argument("--turn", type=float, default=1.0, help="attitudes off by so many gon")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    table(chosen.count, chosen.start, chosen.turn * GON, chosen.first)


if __name__ == "__main__":
    main()
