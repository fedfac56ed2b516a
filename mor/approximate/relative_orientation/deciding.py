"""Which of several orientations of a pair a chain of images has: that with which all of them fit together.

Two images of a plane, or of a few points, can leave several orientations. With a further image each of them makes
another model, and the least-squares fit of the models decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice, product
from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.relative_orientation.assessment import AS_GOOD, Judged, candidate, result
from mor.approximate.relative_orientation.coplanarity import adjust_coplanarity
from mor.approximate.relative_orientation.model import Chain, Model, adjust_model, chain
from mor.approximate.relative_orientation.outcome import RelativeOutcome
from mor.approximate.relative_orientation.robust import RobustOrientation
from mor.arrays import BoolArray

SAME = 1e-5
"""Difference of positions and attitudes up to which two models are one; the first base has length one."""
MOST = 32
"""Combinations of the orientations of all pairs that are tried."""


class Joined(NamedTuple):
    """Pairs with the orientations that the model has."""

    pairs: list[RobustOrientation]
    chain: Chain | None
    model: Model | None
    """Nothing where no scale passes from one pair to the next."""
    rivals: int
    """Other combinations of orientations that fit as well."""


def joined(pairs: Sequence[RobustOrientation], images: Sequence[Bundle], used: BoolArray) -> Joined:
    """Chain of m images in the combination of orientations of its pairs that fits best; ``used`` (m, n) the rays."""
    options = [[pair] for pair in pairs]
    if len(pairs) > 1:
        options = [_orientations(pair, *_rays(k, pair, images)) for k, pair in enumerate(pairs)]
    tried = [_tried(list(chosen), images, used) for chosen in islice(product(*options), MOST)]
    order = sorted(tried, key=_misfit)
    model = order[0].model
    if model is None:
        return order[0]
    lost, least = _misfit(order[0])
    limit = least + AS_GOOD * max(1.0, float(np.nan_to_num(model.sigma0)) ** 2)
    same = [one for one in order if _away(one.model, model) < SAME]
    rivals = [one for one in order if _away(one.model, model) >= SAME and _misfit(one) <= (lost, limit)]
    # From another combination the adjustment can come to the same model: the pairs are those that began nearest to it.
    return min(same, key=lambda one: _away(one.chain, model))._replace(rivals=len(rivals))


def _away(one: Chain | Model | None, model: Model) -> float:
    """Largest difference of a position or an attitude."""
    if one is None:
        return np.inf
    of_positions = np.max(np.abs(one.positions - model.positions))
    return float(max(of_positions, np.max(np.abs(one.rotations - model.rotations))))


def _rays(k: int, pair: RobustOrientation, images: Sequence[Bundle]) -> tuple[Bundle, Bundle]:
    """The rays that the orientation of images k and k + 1 rests on."""
    both = np.all(np.isfinite(images[k].rays) & np.isfinite(images[k + 1].rays), axis=1)
    index = np.flatnonzero(both)[pair.agreeing]
    return images[k].take(index), images[k + 1].take(index)


def _orientations(pair: RobustOrientation, a: Bundle, b: Bundle) -> list[RobustOrientation]:
    """The pair as it was judged, and with each of its alternatives in the first place."""
    found = pair.orientation
    options = [pair]
    if found.outcome is not RelativeOutcome.AMBIGUOUS:
        return options
    of_plane = [(one.base, one.rotation) for one in found.plane_orientations]
    for k, one in enumerate(found.alternatives):
        adjusted = adjust_coplanarity(a, b, one.base, one.rotation, iterations=1)
        other = result(a, b, Judged(found.geometry, found.singular_values, [adjusted], of_plane))
        rest = found.alternatives[:k] + found.alternatives[k + 1 :]
        others = (candidate(a, b, found.base, found.rotation), *rest)
        residuals = pair.residuals.copy()
        residuals[pair.agreeing] = other.residuals
        turned = other._replace(outcome=found.outcome, alternatives=others)
        options.append(pair._replace(orientation=turned, residuals=residuals))
    return options


def _tried(pairs: list[RobustOrientation], images: Sequence[Bundle], used: BoolArray) -> Joined:
    linked = chain([pair.orientation for pair in pairs], images, used)
    model = adjust_model(images, used, linked) if np.all(linked.common != 0) else None
    if model is not None and not np.isfinite(model.frame_covariance).all():
        model = None  # no point lies in front of its images, or too few do
    return Joined(pairs, linked, model, 0)


def _misfit(one: Joined) -> tuple[int, float]:
    """Points without a place, and Σ (v/σ)² of the others."""
    if one.model is None:
        return 10**9, np.inf
    lost = int(np.sum(np.isnan(one.model.points[:, 0])))
    return lost, float(np.nan_to_num(one.model.sigma0) ** 2 * one.model.redundancy)
