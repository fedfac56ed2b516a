"""Measure the benefit of ``mor design --greedy`` in weak random networks.

python benchmarks/advice.py --count 200

Each network has distances in plan, a free datum, and distances that might be measured besides; r ≥ 0.2 is required of
all. The greedy plan stands against the best of 1 000 random orders of the candidates, of which each is followed until
the requirement is reached. All r here are of a dense matrix that shares nothing with the program.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from mor.api.design import ranking
from mor.api.plan import solve_plan
from mor.plan.requirements import requirements
from mor.types import FloatArray
from tests.scenarios.planned_networks import grid

LEAST, ORDERS = 0.2, 1000


def rows_of(network: object, groups: object) -> FloatArray:
    """(n, 2p) derivatives of distances in plan."""
    xy = network.start["point"][:, :2]  # type: ignore[attr-defined]
    found = []
    for group in groups:  # type: ignore[attr-defined]
        slots = [block for slot, block in zip(group.type.slots, group.blocks, strict=True) if slot.part == "position"]
        for a, b in zip(*slots, strict=True):
            row = np.zeros((len(xy), 2))
            row[b] = (xy[b] - xy[a]) / np.linalg.norm(xy[b] - xy[a])
            row[a] = -row[b]
            found.append(row.ravel())
    return np.array(found)


def smallest(A: FloatArray, free: FloatArray) -> float:
    """The least redundancy number of rows A with a free datum."""
    N = A.T @ A + free @ free.T
    if np.linalg.cond(N) > 1e12:
        return -1.0  # something is not determined
    Q = np.linalg.inv(N)
    return float(1.0 - np.einsum("ni,ij,nj->n", A, Q, A).max())


def best_of_orders(A: FloatArray, C: FloatArray, free: FloatArray, draw: np.random.Generator) -> int:
    """The fewest candidates with which any of the random orders reaches the requirement."""
    best = len(C)
    for _ in range(ORDERS):
        order = draw.permutation(len(C))
        for count in range(1, best):
            if smallest(np.concatenate([A, C[order[:count]]]), free) >= LEAST:
                best = count
                break
    return best


def main() -> None:
    """Print what became of every network, and the rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    wanted = parser.parse_args().count
    seed = counted = reached = within = 0
    ratios = []
    while counted < wanted:
        seed += 1
        network = grid(seed)
        A, C = rows_of(network, network.groups), rows_of(network, network.candidates)
        p = A.shape[1] // 2
        xy = network.start["point"][:, :2]
        turn = np.stack([-xy[:, 1], xy[:, 0]], axis=1) / 100.0
        free = np.stack([np.tile([1.0, 0.0], p), np.tile([0.0, 1.0], p), turn.ravel()], axis=1)
        if smallest(A, free) >= LEAST or smallest(np.concatenate([A, C]), free) < LEAST:
            continue  # nothing is wanted of it, or all candidates together do not do
        solved = solve_plan(network)
        if solved.quality is None:
            continue  # of a plan that determines something not at all there is no ranking
        counted += 1
        steps = ranking(solved, requirements(network), len(C)).steps
        rows = [step.ranked.unit.row for step in steps]
        done = smallest(np.concatenate([A, C[rows]]), free) >= LEAST - 1e-9
        best = best_of_orders(A, C, free, np.random.default_rng(seed))
        reached += done
        within += done and len(rows) <= 1.2 * best
        ratios.append(len(rows) / best)
        if counted % 20 == 0:
            print(
                counted,
                "of",
                seed,
                "reached",
                reached,
                "within 1.2",
                within,
                "mean ratio",
                np.mean(ratios),
                flush=True,
            )
    print(f"{counted} networks: requirement reached in {reached}; with up to 1.2 times the best of {ORDERS}: {within}")
    print(f"greedy by best: mean {np.mean(ratios):.3f}, most {max(ratios):.3f}")


if __name__ == "__main__":
    main()
