"""Relative orientation against a few per cent of wrong pairs: sampling, then adjustment of what agrees.

Samples of five pairs give compatible unknowns (also for plane scenes); each is judged by the truncated sum of
squared residuals of all pairs (M. A. Fischler, R. C. Bolles 1981; truncation after P. Torr, A. Zisserman
2000). The best set of agreeing pairs is adjusted and drawn anew until it stands. The seed is fixed: same
input, same result.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.planar.homography import fit_homography
from mor.approximate.relative_orientation.assessment import BEHIND, candidate, failed
from mor.approximate.relative_orientation.coplanarity import (
    adjust_coplanarity,
    first_order_residuals,
    in_front,
)
from mor.approximate.relative_orientation.five_points import five_point_unknowns
from mor.approximate.relative_orientation.outcome import RelativeOrientation, RelativeOutcome, SceneGeometry
from mor.approximate.relative_orientation.rinner import auxiliary_unknowns
from mor.approximate.relative_orientation.two_bundles import (
    MINIMUM,
    best_of_four,
    facing,
    relative_orientation,
)
from mor.arrays import BoolArray, FloatArray, IntArray

BATCH = 25
LOOKED_AT = 12
"""Best unknowns of a batch whose depths are looked at."""
MOST_BATCHES = 40
CERTAINTY = 1e-4
"""Probability left that no sample was free of wrong pairs."""
TRUNCATION = 5.0
"""Residual v/σ at which a pair stops counting while samples are compared."""
AGREES = 4.0
"""Residual v/σ up to which a pair agrees with an adjusted orientation."""
FEW, FEW_PART = 2, 0.05
"""So many pairs, or such a part of them, off a plane do not decide between its orientations."""
DIFFERENT = 0.01
"""Distance of two rotations beyond which they are different ones."""
ROUNDS = 10
HALF = 0.5
"""Part of the pairs that must agree for an orientation to be believed."""


class RobustOrientation(NamedTuple):
    """A relative orientation and the pairs it rests on."""

    orientation: RelativeOrientation
    """Of the agreeing pairs; its residuals and front flags belong to these, in their order."""
    agreeing: BoolArray
    """(n,) the pairs that were used."""
    residuals: FloatArray
    """(n,) v/σ of all pairs; not a number where nothing was found."""
    samples: int
    """Number of samples drawn; 0 if all pairs agreed at once."""


def robust_relative_orientation(a: Bundle, b: Bundle, seed: int = 1956) -> RobustOrientation:
    """Orientation of ``b`` in ``a`` from n ≥ 8 homologous rays, some of which may be wrong pairs.

    If all agree this is ``two_bundles.relative_orientation`` itself. Wrong pairs that lie on
    the right plane through the base cannot be seen, except by their depth. Outcomes are data, as there.
    """
    everything = relative_orientation(a, b)
    believable = everything.outcome not in (
        RelativeOutcome.DOES_NOT_FIT,
        RelativeOutcome.BEHIND,
        RelativeOutcome.MIRRORED,
    )
    small = bool(np.all(np.abs(np.nan_to_num(everything.residuals)) < AGREES))
    agree = small and bool(np.all(everything.front))
    if believable and (agree or not everything.outcome.usable):
        return RobustOrientation(everything, np.ones(len(a), dtype=bool), everything.residuals, 0)
    ik, samples = _sampled(a, b, np.random.default_rng(seed))
    if ik is None:
        return _nothing(everything, len(a), samples)
    found = _settled(a, b, ik)
    if found is None or np.sum(found) < max(MINIMUM, HALF * len(a)):
        return _nothing(everything, len(a), samples)
    orientation = relative_orientation(a.take(found), b.take(found))
    for _ in range(ROUNDS):
        if not orientation.outcome.usable:
            return RobustOrientation(orientation, found, np.full(len(a), np.nan), samples)
        now = _agreeing(a, b, orientation.base, orientation.rotation)
        if np.array_equal(now, found) or np.sum(now) < MINIMUM:
            break
        found, orientation = now, relative_orientation(a.take(now), b.take(now))
    unknowns = auxiliary_unknowns(orientation.base, orientation.rotation)
    residuals = first_order_residuals(a, b, unknowns[None])[0]
    meeting = residuals < AGREES
    if np.sum(found) < BEHIND * np.sum(meeting):
        # Many rays meet, but behind a frame: no wrong pairs, but a mirrored or reversed bundle.
        whole = relative_orientation(a.take(meeting), b.take(meeting))
        if not whole.outcome.usable:
            return RobustOrientation(whole, np.zeros(len(a), dtype=bool), residuals, samples)
    return RobustOrientation(_doubted(a.take(found), b.take(found), orientation), found, residuals, samples)


def _doubted(a: Bundle, b: Bundle, orientation: RelativeOrientation) -> RelativeOrientation:
    """Ambiguous, if all but a few pairs lie in a plane that leaves several orientations.

    A wrong pair that happens to fit one of them would decide between them otherwise.
    """
    plane = _plane_part(a, b)
    few = max(FEW, FEW_PART * len(a))
    if orientation.outcome is not RelativeOutcome.DETERMINED or not 0 < np.sum(~plane) <= few:
        return orientation
    of_plane = relative_orientation(a.take(plane), b.take(plane))
    if of_plane.outcome is not RelativeOutcome.AMBIGUOUS:
        return orientation
    every = [candidate(a, b, of_plane.base, of_plane.rotation), *of_plane.alternatives]
    others = tuple(
        one for one in every if float(np.linalg.norm(one.rotation - orientation.rotation)) > DIFFERENT
    )
    return orientation._replace(
        outcome=RelativeOutcome.AMBIGUOUS, geometry=SceneGeometry.PLANE, alternatives=others
    )


def _plane_part(a: Bundle, b: Bundle) -> BoolArray:
    """Pairs that one collineation carries over, the worst left out one after the other."""
    kept = np.ones(len(a), dtype=bool)
    for _ in range(int(max(FEW, FEW_PART * len(a))) + 1):
        homography = fit_homography(a.take(kept), b.take(kept))
        if np.all(homography.residuals < AGREES):
            return kept
        kept[np.flatnonzero(kept)[int(np.argmax(homography.residuals))]] = False
    return np.zeros(len(a), dtype=bool)


def _agreeing(a: Bundle, b: Bundle, base: FloatArray, rotation: FloatArray) -> BoolArray:
    unknowns = auxiliary_unknowns(base, rotation)
    front = np.all(in_front(a, b, base, rotation), axis=1)
    return np.asarray((first_order_residuals(a, b, unknowns[None])[0] < AGREES) & front)


def _nothing(everything: RelativeOrientation, points: int, samples: int) -> RobustOrientation:
    kept = everything if not everything.outcome.usable else failed(RelativeOutcome.DOES_NOT_FIT, points)
    return RobustOrientation(kept, np.zeros(points, dtype=bool), np.full(points, np.nan), samples)


def _sampled(a: Bundle, b: Bundle, generator: np.random.Generator) -> tuple[FloatArray | None, int]:
    """Best unknowns over samples, drawn until one free of wrong pairs is all but certain."""
    best, best_cost = None, np.inf
    drawn = 0
    for chosen in _samples(len(a), generator):
        drawn += len(chosen)
        unknowns = five_point_unknowns(a.directions[chosen], b.directions[chosen])
        if len(unknowns):
            residuals = first_order_residuals(a, b, unknowns)
            costs = np.sum(np.minimum(residuals, TRUNCATION) ** 2, axis=1)
            for index in np.argsort(costs)[:LOOKED_AT]:
                if costs[index] >= best_cost:
                    break
                counted = _counted(a, b, unknowns[index], residuals[index])
                cost = float(np.sum(counted**2))
                if cost < best_cost:
                    best, best_cost = unknowns[index], cost
                    agreeing = float(np.mean(counted < TRUNCATION))
        # A sample free of wrong pairs may still be too noisy to tell: three of them are asked for.
        if best is not None and drawn / 3.0 >= _samples_needed(agreeing):
            break
    return best, drawn


def _samples(rays: int, generator: np.random.Generator) -> Iterator[IntArray]:
    """Batches (k, 5) of five different rays each; where there are few such fives, each of them once."""
    most = MOST_BATCHES * BATCH
    if comb(rays, 5) > most:
        for _ in range(MOST_BATCHES):
            yield np.stack([generator.permutation(rays)[:5] for _ in range(BATCH)])
        return
    every = generator.permutation(np.array(list(combinations(range(rays), 5)), dtype=np.int64))
    for first in range(0, len(every), BATCH):
        yield every[first : first + BATCH]


def _counted(a: Bundle, b: Bundle, ik: FloatArray, residuals: FloatArray) -> FloatArray:
    """Residuals truncated, those of points behind too: a plane bears unknowns that fit with half of it behind."""
    _, front = facing(a, b, ik)
    return np.asarray(np.where(front, np.minimum(residuals, TRUNCATION), TRUNCATION))


def _samples_needed(agreeing: float) -> float:
    clean = min(max(agreeing, 1e-3), 1.0 - 1e-6) ** 5
    return float(np.log(CERTAINTY) / np.log(1.0 - clean))


def _settled(a: Bundle, b: Bundle, ik: FloatArray) -> BoolArray | None:
    """Pairs that agree with the orientation adjusted to themselves, starting from the unknowns of a sample."""
    agreeing: BoolArray = first_order_residuals(a, b, ik[None])[0] < 2.0 * TRUNCATION
    base, rotation = best_of_four(a.take(agreeing), b.take(agreeing), ik)
    for _ in range(ROUNDS):
        if np.sum(agreeing) < MINIMUM:
            return None
        chosen_a, chosen_b = a.take(agreeing), b.take(agreeing)
        adjusted = adjust_coplanarity(chosen_a, chosen_b, base, rotation)
        unknowns = auxiliary_unknowns(adjusted.base, adjusted.rotation)
        base, rotation = best_of_four(chosen_a, chosen_b, unknowns)
        now = _agreeing(a, b, base, rotation)
        if np.array_equal(now, agreeing) or np.sum(now) < MINIMUM:
            break
        agreeing = now
    return agreeing
