"""Bundles of rays: directions, reprojection, similarity transformations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from itertools import combinations
from math import comb
from typing import NamedTuple, TypeVar

import numpy as np

from mor.model import rotations
from mor.model.cameras import CameraModel
from mor.types import BoolArray, FloatArray, IntArray

Rows = TypeVar("Rows", FloatArray, IntArray)

# ---- How well alternatives fit.

AS_GOOD = 25.0
"""Σ (v/σ)² by which another solution may be worse and still count as fitting equally well (5 σ)."""
BY_ITSELF = 2.9e-7
"""Probability that errors alone lead beyond 5 σ, on one side."""


def evenly(rows: Rows, most: int) -> Rows:
    """Return the rows, ``most`` of them evenly spread if they are more."""
    return rows if len(rows) <= most else rows[np.linspace(0, len(rows) - 1, most).astype(int)]


def samples(count: int, size: int, most: int, batch: int, random: np.random.Generator) -> Iterator[IntArray]:
    """Batches (k, size) of samples of ``count`` rows, ``most`` in all: every sample, where these are not more."""
    if comb(count, size) > most:
        for _ in range(0, most, batch):
            yield np.stack([random.permutation(count)[:size] for _ in range(batch)]).astype(np.int64)
        return
    every = random.permutation(np.array(list(combinations(range(count), size)), dtype=np.int64))
    for first in range(0, len(every), batch):
        yield every[first : first + batch]


# ---- Vectors of three components, many at a time.


def sphere(count: int) -> FloatArray:
    """Unit vectors (count, 3) spread evenly, from +Z to −Z: equal steps in height, the golden angle in between."""
    k = np.arange(count) + 0.5
    z, around = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    flat = np.sqrt(1.0 - z**2)
    return np.stack([flat * np.cos(around), flat * np.sin(around), z], axis=1)


def cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Vector products (…, 3) over the last axis; for short arrays several times as fast as ``numpy.cross``."""
    shape = np.broadcast_shapes(first.shape, second.shape)
    product = np.empty(shape)
    x, y, z = first[..., 0], first[..., 1], first[..., 2]
    u, v, w = second[..., 0], second[..., 1], second[..., 2]
    product[..., 0] = y * w - z * v
    product[..., 1] = z * u - x * w
    product[..., 2] = x * v - y * u
    return product


def unit(vectors: FloatArray) -> FloatArray:
    """Vectors (…, 3) at length one; a zero vector stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length == 0.0, 1.0, length))


def principal_rows(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """All k singular values of a matrix (n, k), descending, and its right singular vectors (k, k) as rows.

    By the triangle of QR: the left vectors of ten thousand rows, which nobody asks for, would fill the memory.
    """
    triangle = np.asarray(np.linalg.qr(matrix, mode="r")) if len(matrix) > matrix.shape[1] else matrix
    _, found, right = rotations.svd(triangle, full_matrices=True)
    values = np.zeros(matrix.shape[1])
    values[: len(found)] = found
    return values, right


def tangent_axes(normals: FloatArray) -> FloatArray:
    """Two orthonormal vectors (…, 3, 2) across each of the vectors (…, 3)."""
    direction = unit(np.asarray(normals, dtype=float))
    helper = np.zeros_like(direction)
    smallest = np.argmin(np.abs(direction), axis=-1)
    np.put_along_axis(helper, smallest[..., None], 1.0, axis=-1)
    first = unit(cross(direction, helper))
    return np.stack([first, cross(direction, first)], axis=-1)


# ---- A bundle of rays in one frame, and how precisely each was measured.
#
# Images and theodolites give the same thing: directions in a frame. They differ in where the measuring error
# lies, in the image plane or across the ray. Both are a *measuring plane*: h·q = h·p for the ray p, with two
# axes in it. For an image the plane is z = −c and the axes are x and y; for a theodolite it touches the unit
# sphere at p.


@dataclass(frozen=True)
class Bundle:
    """Rays of one frame, towards the object: a point in front lies at a positive multiple of its ray."""

    rays: FloatArray
    """(n, 3) the rays p in the axes of the frame; of an image (x, y, −c)."""
    normals: FloatArray
    """(n, 3) h, normal to the measuring plane of each ray."""
    axes: FloatArray
    """(n, 3, 2) the two measured coordinates in the measuring plane, orthonormal."""
    sigma: FloatArray
    """(n,) standard deviation of a coordinate in the measuring plane, in the unit of the rays."""

    def __len__(self) -> int:
        return len(self.rays)

    def take(self, chosen: IntArray | BoolArray) -> Bundle:
        """Return the bundle of the chosen rays (indices or a mask)."""
        return Bundle(self.rays[chosen], self.normals[chosen], self.axes[chosen], self.sigma[chosen])

    @cached_property
    def whitened_axes(self) -> FloatArray:
        """(n, 3, 2) axes times σ: displacements of the rays per unit-variance measuring error."""
        return self.axes * self.sigma[:, None, None]

    @cached_property
    def lengths(self) -> FloatArray:
        """(n,) of the rays."""
        return np.asarray(np.linalg.norm(self.rays, axis=1))

    @cached_property
    def directions(self) -> FloatArray:
        """(n, 3) unit vectors."""
        return unit(self.rays)

    @property
    def noise(self) -> float:
        """Mean angular standard deviation of a ray in radians."""
        return float(np.mean(self.sigma / self.lengths))


def image_bundle(rays: FloatArray, sigma: float | FloatArray) -> Bundle:
    """Bundle of an image: rays (n, 3) as (x, y, −c), ``sigma`` of x and y in the image unit (scalar or (n,)).

    Each ray may carry a c of its own. Raises ``ValueError`` for shapes or σ ≤ 0 that make no bundle.
    """
    rays, spread = _checked(rays, sigma)
    normals = np.zeros_like(rays)
    normals[:, 2] = 1.0
    axes = np.zeros((len(rays), 3, 2))
    axes[:, 0, 0] = axes[:, 1, 1] = 1.0
    return Bundle(rays, normals, axes, spread)


def direction_bundle(rays: FloatArray, sigma: float | FloatArray) -> Bundle:
    """Bundle of directions of a theodolite: rays (n, 3) of any length, ``sigma`` across the ray in radians.

    Raises ``ValueError`` for shapes or σ ≤ 0 that make no bundle.
    """
    rays, spread = _checked(rays, sigma)
    directions = unit(rays)
    return Bundle(directions, directions, tangent_axes(directions), spread)


def _checked(rays: FloatArray, sigma: float | FloatArray) -> tuple[FloatArray, FloatArray]:
    rays = np.array(rays, dtype=float)
    if rays.ndim != 2 or rays.shape[1] != 3:
        raise ValueError(f"rays must have the shape (n, 3), not {rays.shape}")
    spread = np.array(np.broadcast_to(np.asarray(sigma, dtype=float), (len(rays),)))
    if not np.all(spread > 0.0):
        raise ValueError("the standard deviation of a ray must be positive")
    return rays, spread


# ---- Rays computed from coordinates in the frame, compared with measured ones in the measuring plane.


class Reprojection(NamedTuple):
    """Computed minus measured, in units of σ."""

    residuals: FloatArray
    """(n, 2) in the two axes of the measuring plane."""
    by_star: FloatArray
    """(n, 2, 3) derivatives by the point in the frame."""


def reproject(bundle: Bundle, star: FloatArray) -> Reprojection:
    """Residuals of the points ``star`` (n, 3), in the axes of the frame, against the rays of ``bundle``.

    The point q is carried to the measuring plane, q (h·p)/(h·q); for an image these are the collinearity
    equations x = −c X*/Z*. A point behind is carried there too: depths are a matter of their own.
    """
    depth = np.einsum("ni,ni->n", bundle.normals, star)
    depth = np.where(np.abs(depth) < 1e-12, 1e-12, depth)
    factor = np.einsum("ni,ni->n", bundle.normals, bundle.rays) / depth
    axes = bundle.axes / bundle.sigma[:, None, None]
    offset = star * factor[:, None] - bundle.rays
    by_star = np.swapaxes(axes, 1, 2) * factor[:, None, None]
    along = np.einsum("nij,ni->nj", axes, star) * (factor / depth)[:, None]
    by_star = by_star - along[:, :, None] * bundle.normals[:, None, :]
    return Reprojection(np.einsum("nij,ni->nj", axes, offset), by_star)


def misfits(bundle: Bundle, star: FloatArray) -> FloatArray:
    """Lengths (m, n) of the residuals, in units of σ, of m sets of points ``star`` (m, n, 3); infinite behind."""
    depth = np.einsum("ni,mni->mn", bundle.normals, star)
    factor = np.einsum("ni,ni->n", bundle.normals, bundle.rays) / np.where(depth == 0.0, 1e-300, depth)
    offset = star * factor[:, :, None] - bundle.rays
    across = np.einsum("nij,mni->mnj", bundle.axes / bundle.sigma[:, None, None], offset)
    return np.asarray(np.where(factor > 0.0, np.sqrt(np.sum(across**2, axis=2)), np.inf))


def ahead(bundle: Bundle, star: FloatArray) -> BoolArray:
    """(n,) True where a point lies at a positive multiple of its ray."""
    return np.asarray(np.einsum("ni,ni->n", bundle.rays, star) > 0.0)


# ---- From measured image coordinates back to rays, through any camera model.


def ideal_rays(
    model: CameraModel, interior: FloatArray, of: IntArray, constants: FloatArray, measured: FloatArray
) -> FloatArray:
    """Unit rays (n, 3), scene at Z* < 0, whose projections are the ``measured`` coordinates (n, 2).

    ``interior`` (m, k) are the interior orientations, and ``of`` (n,) tells which of them each ray has; ``constants``
    (n, j) are those of the model.

    Behind a port the rays are those in the water, to points so far away that they begin at the projection centre.

    Newton's method in the tangent plane of the ray, so that fisheye rays beyond 90° are reached too. Where it does not
    converge (a polynomial beyond its range), the ray of the central projection along the axis of the camera is kept.
    """
    rays = np.empty((len(measured), 3))
    # Some thousand rays at a time stay in the cache, and ten million do not fill the memory with derivatives.
    for first in range(0, len(measured), 5000):
        chosen = slice(first, first + 5000)
        rays[chosen] = _chunk_of_rays(model, interior[of[chosen]], constants[chosen], measured[chosen])
    return rays


def _chunk_of_rays(model: CameraModel, interior: FloatArray, constants: FloatArray, measured: FloatArray) -> FloatArray:
    axis = np.tile([0.0, 0.0, -1.0], (len(measured), 1))
    with np.errstate(all="ignore"):
        far = 2.0**20  # a power of 2 changes no digit of a central projection
        middle, across = model.project(far * axis, interior, constants, measured), tangent_axes(axis)
        beside = _solved(far * middle.by_star @ across, measured - middle.xy, 1e-12 * interior[:, 0] ** 2)
        ray = start = unit(axis + np.einsum("nij,nj->ni", across, beside))
        for left in range(12, -1, -1):
            projection = model.project(far * ray, interior, constants, measured)
            wrong = measured - projection.xy
            away = np.abs(wrong).max(axis=1) / interior[:, 0]
            # Parts of the camera constant: no further step is made, and the ray is not reached.
            if not left or np.nanmax(away, initial=0.0) < 1e-12:
                break
            across = tangent_axes(ray)
            step = _solved(far * projection.by_star @ across, wrong, 1e-12 * interior[:, 0] ** 2)
            step *= np.minimum(1.0, 0.3 / np.maximum(np.linalg.norm(step, axis=1), 1e-300))[:, None]
            ray = unit(ray + np.einsum("nij,nj->ni", across, step))
            # Radians of a step after which no other one is needed, or none leads farther.
            if np.nanmax(np.abs(step), initial=0.0) < 1e-9:
                break
    missed: BoolArray = np.asarray(~(away < 1e-6))
    return np.where(missed[:, None], start, ray)


def _solved(jacobian: FloatArray, wrong: FloatArray, least: FloatArray) -> FloatArray:
    """Solutions (n, 2) of n pairs of equations, 0 where their determinant is at most ``least``."""
    (a, b), (c, d) = np.moveaxis(jacobian, 0, 2)
    determinant = a * d - b * c
    good = np.isfinite(determinant) & (np.abs(determinant) > least)
    divisor = np.where(good, determinant, 1.0)
    x, y = wrong.T
    solution = np.stack([d * x - b * y, a * y - c * x], axis=1) / divisor[:, None]
    return np.where(good[:, None], solution, 0.0)


# ---- Closed-form similarity between two sets of points, in space and in the plane, with or without scale.
#
# target = λ R source + t. The rotation is the orthogonal factor of the cross-covariance (P. H.
# Schönemann 1966; B. K. P. Horn 1987; S. Umeyama 1991 for the sign of the determinant), the scale follows
# from the spreads. A local system X̄ = λ D (X − X0) is the same with D = R, X0 = ``origin``.


class SimilarityOutcome(Enum):
    """Outcome of a similarity transformation."""

    DETERMINED = "determined"
    TOO_FEW = "fewer common points than the transformation needs"
    INVALID = "a coordinate is not a number, or the sets differ in size"
    COINCIDENT = "all points of one set coincide"
    COLLINEAR = "the points are collinear: the rotation about their line is undetermined"
    MIRRORED = "one set is the mirror image of the other: a left-handed system, or exchanged axes"

    @property
    def usable(self) -> bool:
        """True if the transformation can serve as a start value."""
        return self is SimilarityOutcome.DETERMINED


class Similarity(NamedTuple):
    """target = scale · rotation · source + translation, in d = 2 or 3 dimensions."""

    outcome: SimilarityOutcome
    scale: float
    rotation: FloatArray
    """(d, d)"""
    translation: FloatArray
    """(d,)"""
    residuals: FloatArray
    """(n, d) transformed minus target, in the unit of the target."""
    sigma0: float
    """Standard deviation of a coordinate; not a number without redundancy."""

    def transform(self, points: FloatArray) -> FloatArray:
        """Carry points (n, d) over."""
        return np.asarray(self.scale * points @ self.rotation.T + self.translation)

    def times(self, factor: float) -> Similarity:
        """Return the similarity to a target that is so many times larger."""
        return self._replace(scale=self.scale * factor, translation=self.translation * factor)

    @property
    def origin(self) -> FloatArray:
        """(d,) the source point that becomes the zero of the target: X0 of a local system."""
        return np.asarray(-self.rotation.T @ self.translation / self.scale)

    def inverse(self, points: FloatArray) -> FloatArray:
        """Carry points (n, d) of the target back."""
        return np.asarray((points - self.translation) @ self.rotation / self.scale)


def movement_by(scale: float = 1.0, rotation: FloatArray | None = None, shift: FloatArray | None = None) -> Similarity:
    """Return a similarity in space of a given scale, rotation (3, 3) and shift (3,)."""
    R, t = np.eye(3) if rotation is None else rotation, np.zeros(3) if shift is None else shift
    return Similarity(SimilarityOutcome.DETERMINED, scale, R, t, np.zeros((0, 3)), 0.0)


def similarity(source: FloatArray, target: FloatArray) -> Similarity:
    """Similarity with scale of n points (n, d), d = 2 (n ≥ 2) or 3 (n ≥ 3, not collinear)."""
    return _similarity_solved(source, target, scaled=True)


def congruence(source: FloatArray, target: FloatArray) -> Similarity:
    """Return the same with scale 1."""
    return _similarity_solved(source, target, scaled=False)


def _similarity_solved(source: FloatArray, target: FloatArray, *, scaled: bool) -> Similarity:
    source, target = np.asarray(source, dtype=float), np.asarray(target, dtype=float)
    refusal = _refusal(source, target)
    if refusal is not None:
        return _failed(refusal, source)
    dimension = source.shape[1]
    centre_source, centre_target = source.mean(axis=0), target.mean(axis=0)
    a, b = source - centre_source, target - centre_target
    left, values, right = rotations.svd(b.T @ a)
    proper = np.ones(dimension)
    proper[-1] = np.sign(np.linalg.det(left @ right))
    rotation = (left * proper) @ right
    spread_source, spread_target = float(np.sum(a**2)), float(np.sum(b**2))
    scale = float(values @ proper) / spread_source if scaled else 1.0
    if not scale > 0.0:
        return _failed(SimilarityOutcome.MIRRORED, source)
    translation = centre_target - scale * rotation @ centre_source
    residuals = scale * source @ rotation.T + translation - target
    objective = float(np.sum(residuals**2))
    reflected = float(np.sum(values))
    mirrored_scale = reflected / spread_source if scaled else 1.0
    mirrored = spread_target + mirrored_scale**2 * spread_source - 2.0 * mirrored_scale * reflected
    # So many times smaller must the residuals of the reflection be for the sets to count as mirrored.
    is_mirrored = proper[-1] < 0.0 and objective > 10.0**2 * max(mirrored, 1e-20 * spread_target)
    redundancy = source.size - dimension - dimension * (dimension - 1) // 2 - int(scaled)
    return Similarity(
        SimilarityOutcome.MIRRORED if is_mirrored else SimilarityOutcome.DETERMINED,
        scale,
        rotation,
        translation,
        residuals,
        float(np.sqrt(objective / redundancy)) if redundancy > 0 else float("nan"),
    )


def _refusal(source: FloatArray, target: FloatArray) -> SimilarityOutcome | None:
    if source.shape != target.shape or source.shape[1] not in (2, 3):
        return SimilarityOutcome.INVALID
    if not np.all(np.isfinite(source)) or not np.all(np.isfinite(target)):
        return SimilarityOutcome.INVALID
    if len(source) < source.shape[1]:
        return SimilarityOutcome.TOO_FEW
    for points in (source, target):
        values = rotations.singular_values(points - points.mean(axis=0))
        if values[0] <= 1e-14 * float(np.max(np.abs(points))):
            return SimilarityOutcome.COINCIDENT
        # Extension across, relative to that along, below which points lie in a line.
        if points.shape[1] == 3 and values[1] <= 1e-9 * values[0]:
            return SimilarityOutcome.COLLINEAR
    return None


def _failed(outcome: SimilarityOutcome, source: FloatArray) -> Similarity:
    dimension = source.shape[1] if source.ndim == 2 else 3
    nothing = float("nan")
    return Similarity(
        outcome,
        nothing,
        np.full((dimension, dimension), nothing),
        np.full(dimension, nothing),
        np.full(source.shape, nothing),
        nothing,
    )
