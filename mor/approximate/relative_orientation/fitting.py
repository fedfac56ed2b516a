"""All orientations that two bundles leave open: of five to seven homologous points, of a plane, of weak pairs.

What decides between them is a third bundle, or control. With five points there are up to ten exact orientations, with
six or seven as many as fit within their errors; from eight on those that ``relative_orientation`` cannot tell apart.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.special import chdtri

from mor.approximate.bundle import Bundle
from mor.approximate.relative_orientation.coplanarity import in_front
from mor.approximate.relative_orientation.five_points import five_point_unknowns
from mor.approximate.relative_orientation.robust import robust_relative_orientation
from mor.approximate.relative_orientation.two_bundles import MINIMUM, Seed, adjust_seeds, apart, best_of_four

FEWEST = 5
SAMPLES = 21
"""Samples of five: all of seven points."""
MOST = 12
"""Solutions of samples that are adjusted, the best that differ."""
BY_ITSELF = 1e-4
"""Probability that a right orientation fits worse."""


def fitting_orientations(a: Bundle, b: Bundle) -> list[Seed]:
    """Orientations (b, D*) of bundle ``b`` in ``a`` that fit n ≥ 5 homologous rays, the best first.

    Distinct ones, with all points in front of both bundles (from eight points on: but for a few).
    """
    if len(a) < FEWEST:
        return []
    if len(a) >= MINIMUM:
        found = robust_relative_orientation(a, b).orientation
        if not found.outcome.usable:
            return []
        candidates = [Seed(found.base, found.rotation)]
        return candidates + [Seed(one.base, one.rotation) for one in found.alternatives]
    chosen = np.array(list(combinations(range(len(a)), FEWEST))[:SAMPLES])
    unknowns = five_point_unknowns(a.directions[chosen], b.directions[chosen])
    adjusted = adjust_seeds(a, b, [best_of_four(a, b, ik) for ik in apart(a, b, unknowns, MOST)])
    limit = float(chdtri(max(len(a) - FEWEST, 0.1), BY_ITSELF))
    fitting = [Seed(one.base, one.rotation) for one in adjusted if one.objective <= limit]
    return [seed for seed in fitting if bool(np.all(in_front(a, b, *seed)))]
