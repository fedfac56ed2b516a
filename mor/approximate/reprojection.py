"""Rays computed from coordinates in the frame, compared with measured ones in the measuring plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.arrays import BoolArray, FloatArray


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
