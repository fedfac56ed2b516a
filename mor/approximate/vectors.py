"""Vectors of three components, many at a time."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.geometry import tolerant


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
    _, found, right = tolerant.svd(triangle, full_matrices=True)
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
