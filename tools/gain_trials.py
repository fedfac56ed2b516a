"""How far ranked gains are from those of the network adjusted anew: ``python -m tools.gain_trials --count 200``.

Of every sample project rows are drawn that it measures, of all kinds; they become candidates to the rest. Each is then
ranked, and the rest adjusted with it: the variances of five points, and of networks that are not large all redundancy
numbers, against each other.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
from mor.api.design import Ranking, ranking  # noqa: E402
from mor.api.plan import solve_plan  # noqa: E402
from mor.model.contract import ObservationGroup  # noqa: E402
from mor.plan.requirements import (  # noqa: E402
    MOST_ROWS,
    REACHED,
    RequiredControl,
    RequiredPrecision,
    Requirement,
    requirements,
)
from mor.project.network import Network  # noqa: E402
from mor.quality.assessment import Quality  # noqa: E402
from sample_projects.simulate import SCENES  # noqa: E402
from tests.scenarios.planned_networks import sample  # noqa: E402

AT_A_TIME, CONTROLLED = 25, 0.2


def planned_with_candidates(network: Network, quality: Quality, seed: int) -> Network:
    """The network of which some rows that others control are but candidates."""
    rng = np.random.default_rng(seed)
    tied = {int(k) for one in network.correlations for k in one.groups}
    where = [
        (k, row)
        for k, group in enumerate(network.groups)
        if k not in tied
        for row in np.flatnonzero(
            (np.nan_to_num(quality.groups[k].r) > CONTROLLED).sum(axis=1) == np.maximum(group.mask.sum(axis=1), 1)
        ).tolist()
    ]
    drawn = [where[i] for i in rng.permutation(len(where))[: min(AT_A_TIME, len(where) // 10)].tolist()]
    groups, candidates = list(network.groups), []
    for k in sorted({k for k, _ in drawn}):
        rows = np.array(sorted(row for one, row in drawn if one == k))
        its = np.isin(np.arange(groups[k].count), rows)
        candidates.append(_measured(groups[k], its))
        groups[k] = _measured(groups[k], ~its)
    return replace(network, groups=tuple(groups), candidates=tuple(candidates))


def _measured(group: ObservationGroup, rows: np.ndarray) -> ObservationGroup:
    return replace(group, observed=np.where(rows[:, None], group.observed, np.nan))


def differences(network: Network, required: tuple[Requirement, ...], found: Ranking) -> list[tuple[str, float]]:
    """Kind of each candidate that can be ranked, and how far its outcome is from that of the adjusted network."""
    far = []
    for one in found.candidates:
        group = network.candidates[one.unit.group]
        row = np.arange(group.count) == one.unit.row
        quality = solve_plan(replace(network, groups=(*network.groups, _measured(group, row)), candidates=())).quality
        assert quality is not None, group.type.name
        of_sigma = abs(one.precision / _precision(quality, required) - 1.0)
        of_r = abs(one.shortfall - _shortfall(quality, required))
        far.append((group.type.name, max(of_sigma, of_r)))
    return far


def _precision(quality: Quality, required: tuple[Requirement, ...]) -> float:
    """Mean of variance by limit of the points with a required σ."""
    (one,) = (each for each in required if isinstance(each, RequiredPrecision))
    variance = np.diagonal(quality.cofactors["point"][one.blocks], axis1=1, axis2=2) / one.limit**2
    return float(variance[quality.adjustment.problem.index.columns["point"][one.blocks] >= 0].mean())


def _shortfall(quality: Quality, required: tuple[Requirement, ...]) -> float:
    """By how much all redundancy numbers are below the required one, in parts of that."""
    least = [each.limit for each in required if isinstance(each, RequiredControl)]
    below = [np.maximum(1.0 - group.r / r, 0.0) for group in quality.groups for r in least]
    return float(sum(np.nansum(np.where(b < REACHED, 0.0, b)) for b in below))


def main() -> None:
    """Count, sample by sample."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("samples", nargs="*", default=sorted(SCENES))
    given = parser.parse_args()
    for name in given.samples:
        whole = sample(name)
        quality = solve_plan(whole).quality
        assert quality is not None
        ids, small = whole.things["point"].ids, whole.observations < MOST_ROWS - 30
        far: list[tuple[str, float]] = []
        seed = 0
        while len(far) < given.count and seed < given.count:
            rng = np.random.default_rng(seed)
            points = sorted(str(ids[i]) for i in rng.permutation(len(ids))[:5].tolist())
            require: dict[str, object] = {"sigma": {"points": points, "xyz": "1 km"}}
            if small:
                require["reliability"] = {"r": "0.999"}
            network = sample(name, require=require)
            some = planned_with_candidates(network, quality, seed)
            seed += 1
            solved, required = solve_plan(some), requirements(some)
            if solved.quality is not None:
                far += differences(some, required, ranking(solved, required, 0))
        kinds = {kind: max(f for k, f in far if k == kind) for kind in sorted({k for k, _ in far})}
        worst = ", ".join(f"{kind} {f:.1e}" for kind, f in kinds.items())
        missed = sum(f > 1e-9 for _, f in far)
        print(f"{name}: {len(far)} candidates, {missed} over 1e-9; largest: {worst}", flush=True)


if __name__ == "__main__":
    main()
