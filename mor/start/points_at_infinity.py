"""Points whose rays are parallel to their precision: they have a direction, and no distance.

A ray from C to a point in direction u at the inverse distance ρ from C̄ is parallel to u + ρ (C̄ − C). In the plane
across u this is linear in the direction and in ρ, so ρ and its σ follow from the rays in closed form, whatever the
distance (J. M. M. Montiel, J. Civera, A. J. Davison: Unified inverse depth parametrization, 2006). A point is at
infinity where ρ is not significantly positive: rays that meet far behind all measurements, in parallel, or nowhere.
Rays that part by more than the angle at which nobody asks contradict each other: one of them is to another point.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.model import rotations
from mor.model.contract import some_rows
from mor.model.coordinates import can_be_at_infinity, target_slot
from mor.model.parameters import Values
from mor.project.network import Network
from mor.types import BoolArray, FloatArray, IntArray

NARROW = 0.05
"""Angle (rad) between rays beyond which nobody asks whether they are parallel."""


class RayPoints(NamedTuple):
    """Points that nothing but nearly parallel rays determine."""

    points: IntArray
    """(k,) point blocks."""
    directions: FloatArray
    """(k, 3) unit vectors."""
    inverse: FloatArray
    """(k,) inverse distances ρ from ``centres``."""
    sigma: FloatArray
    """(k,) their standard deviations; infinite where all rays come from one place."""
    centres: FloatArray
    """(k, 3)."""
    apart: FloatArray
    """(k,) largest difference of a ray, of length one, from the direction."""

    def take(self, chosen: BoolArray) -> RayPoints:
        """Some of them."""
        return RayPoints._make(array[chosen] for array in self)

    def parallel(self, critical: float) -> BoolArray:
        """(k,) true where the rays do not meet significantly; ``critical`` is the quantile of the test."""
        return ~self.from_one_place() & (self.inverse <= critical * self.sigma)

    def contradicting(self) -> BoolArray:
        """(k,) true where the rays part by more than :data:`NARROW`: they go to no one point, however far away."""
        return ~self.from_one_place() & (self.inverse <= 0.0) & (2.0 * self.apart > NARROW)

    def from_one_place(self) -> BoolArray:
        """(k,) true where all rays come from one place: the point is anywhere along them."""
        return np.isinf(self.sigma)

    def coordinates(self) -> FloatArray:
        """(k, 3) where the rays meet."""
        return self.centres + self.directions / self.inverse[:, None]


def nearly_parallel(network: Network, values: Values, contradicting: bool = False) -> RayPoints:
    """Points with two rays or more, nothing else, at less than :data:`NARROW` to each other, or without coordinates.

    Where their rays contradict each other only those without coordinates are among them, unless ``contradicting``.
    """
    suspects = _suspects(network, values)
    none = np.zeros(0)
    if not suspects.any():
        return RayPoints(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), none, none, np.zeros((0, 3)), none)
    groups = tuple(
        some_rows(group, np.flatnonzero(suspects[group.blocks[target_slot(group.type)]]))
        for group in network.groups
        if can_be_at_infinity(group.type)
    )
    only = replace(network, groups=tuple(group for group in groups if group.count), start=values)
    found = _met(only, values["point"])
    placed = np.isfinite(values["point"][found.points]).all(axis=1)
    return found if contradicting else found.take(~(placed & found.contradicting()))


def _suspects(network: Network, values: Values) -> BoolArray:
    """(points,) candidates seen under a narrow angle, or not known where."""
    blocks = network.blocks["point"]
    count = len(blocks.ids)
    foreign = blocks.owner != np.arange(count)[:, None]
    only: BoolArray = blocks.free.all(axis=1) & ~foreign.any(axis=1)
    only[blocks.owner[foreign]] = False
    seen = np.zeros(count, dtype=bool)
    targets = [target_slot(group.type) if can_be_at_infinity(group.type) else -1 for group in network.groups]
    for group, target in zip(network.groups, targets, strict=True):
        for k, (slot, numbers) in enumerate(zip(group.type.slots, group.blocks, strict=True)):
            if slot.kind == "point" and k != target:
                only[numbers] = False
        if target >= 0:
            seen[group.blocks[target]] = True
            only[group.blocks[target][~group.mask.all(axis=1)]] = False
    for cluster in network.correlations:
        for g, row in zip(cluster.groups, cluster.rows, strict=True):
            if targets[g] >= 0:
                only[network.groups[g].blocks[targets[g]][row]] = False
    candidates = only & seen
    if not candidates.any():
        return candidates
    points = values["point"]
    first, rays = np.zeros(len(points), dtype=np.int64), np.zeros(len(points), dtype=np.int64)
    for place, point in _rays_to(network, candidates):
        first[point] = place
        rays += np.bincount(point, minlength=len(points))
    met = np.zeros(len(points), dtype=bool)
    for place, point in _rays_to(network, candidates):
        here = np.take(points, point, axis=0)  # in a quarter of the time of an index
        away = here - np.take(points, place, axis=0)
        other = here - np.take(points, np.take(first, point), axis=0)
        along = np.einsum("ni,ni->n", away, other)
        size = np.einsum("ni,ni->n", away, away) * np.einsum("ni,ni->n", other, other)
        met[point[(along < 0.0) | (along * along < np.cos(NARROW) ** 2 * size)]] = True
    return candidates & (rays > 1) & ~met


def _rays_to(network: Network, candidates: BoolArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Blocks (k,) that the rays to candidates come from and go to, so many at a time."""
    for group in network.groups:
        if can_be_at_infinity(group.type):
            for start in range(0, group.count, 250_000):
                some = slice(start, start + 250_000)
                point = group.blocks[target_slot(group.type)][some]
                rows = candidates[point]
                yield group.blocks[0][some][rows].astype(np.int64), point[rows].astype(np.int64)


def _met(network: Network, given: FloatArray) -> RayPoints:
    """Direction and inverse distance of each point that two posed frames or more see."""
    # Imported here: nearly all networks do without, and it takes as long to load as a small project to adjust.
    from mor.start.intersection import posed_frames
    from mor.start.join import starting_part
    from mor.start.part import image_frames, sightings, theodolite_frames

    frames = (*image_frames(network), *theodolite_frames(network))
    seen = sightings(frames, len(given))
    centres, turns = posed_frames(starting_part(network, frames).poses, len(frames))
    known = np.isfinite(centres[seen.frame, 0])
    frame = seen.frame[known]
    points, point = np.unique(seen.point[known], return_inverse=True)
    rays = np.einsum("ni,nij->nj", seen.rays[known], turns[frame])
    # What the frames of the start values multiply the σ of rays with.
    weight = (3.0 / seen.sigma[known]) ** 2
    found = _inverse_distances(point, centres[frame], rays, weight, len(points))
    enough = np.bincount(point, minlength=len(points)) > 1
    return _as_given(found._replace(points=points.astype(np.int64)), given).take(enough)


def _inverse_distances(
    point: IntArray, centre: FloatArray, ray: FloatArray, weight: FloatArray, count: int
) -> RayPoints:
    """Weighted least squares of rays (n, 3), ``point`` (n,) numbers the point of each."""

    def mean(values: FloatArray) -> FloatArray:
        sums = [np.bincount(point, weights=weight * column, minlength=count) for column in values.T]
        return np.stack(sums, axis=1) / total[:, None]

    total = np.bincount(point, weights=weight, minlength=count)
    middle = mean(ray)
    middle /= np.linalg.norm(middle, axis=1)[:, None]
    basis = rotations.svd(middle[:, None, :])[2][:, 1:, :]
    place = mean(centre)
    toward = np.einsum("ni,ni->n", ray, middle[point])
    seen = np.einsum("nij,nj->ni", basis[point], ray) / toward[:, None]
    lever = np.einsum("nij,nj->ni", basis[point], place[point] - centre)
    seen_mean, lever_mean = mean(seen), mean(lever)
    apart, beside = lever - lever_mean[point], seen - seen_mean[point]
    normal = np.bincount(point, weights=weight * np.sum(apart**2, axis=1), minlength=count)
    # Levers that are round-off of the coordinates are none: all rays come from one place.
    digits = (1e-14 * np.abs(centre).max(initial=0.0)) ** 2 * total
    side = np.bincount(point, weights=weight * np.sum(apart * beside, axis=1), minlength=count)
    some = normal > digits
    inverse = np.where(some, side / np.where(some, normal, 1.0), 0.0)
    sigma = np.where(some, 1.0 / np.sqrt(np.where(some, normal, 1.0)), np.inf)
    across = seen_mean - inverse[:, None] * lever_mean
    direction = middle + np.einsum("nij,ni->nj", basis, across)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    apart = np.zeros(count)
    np.maximum.at(apart, point, np.linalg.norm(ray - direction[point], axis=1))
    return RayPoints(np.zeros(count, dtype=np.int64), direction, inverse, sigma, place, apart)


def _as_given(found: RayPoints, given: FloatArray) -> RayPoints:
    """Directions as the start values tell them, where these agree with the rays."""
    away = given[found.points] - found.centres
    size = np.linalg.norm(away, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = away / size[:, None]
        # Angle (rad) to its rays up to which the start values of a far point tell its direction.
        alike = np.linalg.norm(unit - found.directions, axis=1) < 1e-2
    return found._replace(directions=np.where(alike[:, None], unit, found.directions))
