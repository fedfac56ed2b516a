"""Rotations, frames and lines of sight of the simulated scenes: plain numpy, nothing of the adjustment program."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GON = np.pi / 200.0
DEGREE = np.pi / 180.0


class Frame(NamedTuple):
    """An image, a theodolite: where it stands, and the rotation from object axes to its own."""

    position: Array
    """(3,)."""
    D: Array
    """(3, 3)."""


def rotation(omega: float, phi: float, kappa: float) -> Array:
    """(Rx(ω) Ry(φ) Rz(κ))ᵀ, from object axes to the axes of a frame."""
    so, co, sp, cp, sk, ck = (f(a) for a in (omega, phi, kappa) for f in (np.sin, np.cos))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, co, -so], [0.0, so, co]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[ck, -sk, 0.0], [sk, ck, 0.0], [0.0, 0.0, 1.0]])
    product: Array = about_x @ about_y @ about_z
    return product.T


def angles(D: Array) -> Array:
    """ω, φ, κ of a rotation from object axes to the axes of a frame."""
    R = D.T
    return np.array(
        [np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(np.clip(R[0, 2], -1.0, 1.0)), np.arctan2(-R[0, 1], R[0, 0])]
    )


def look_at(
    position: Sequence[float],
    target: Sequence[float],
    roll: float = 0.0,
    up: Sequence[float] = (0.0, 0.0, 1.0),
) -> Frame:
    """A camera at a position whose axis points at a target; ``up`` is upwards in the image, turned by ``roll``."""
    z = np.asarray(position, dtype=float) - np.asarray(target, dtype=float)
    z /= np.linalg.norm(z)
    x = np.cross(np.asarray(up, dtype=float), z)
    x /= np.linalg.norm(x)
    upright = np.stack([x, np.cross(z, x), z])
    return Frame(np.asarray(position, dtype=float), rotation(0.0, 0.0, roll) @ upright)


def disturbed(frame: Frame, random: np.random.RandomState, length: float, angle: float) -> Frame:
    """A frame as somebody would estimate it: off by these standard deviations in every direction."""
    shift, turn = length * random.standard_normal(3), angle * random.standard_normal(3)
    return Frame(frame.position + shift, rotation(*turn) @ frame.D)


def incidence(points: Array, normals: Array, position: Array) -> Array:
    """(n,) angles between the normals of targets and the rays to a position."""
    rays = position - points
    cosine = np.einsum("ni,ni->n", rays, normals) / np.linalg.norm(rays, axis=1)
    angle: Array = np.arccos(np.clip(cosine / np.linalg.norm(normals, axis=1), -1.0, 1.0))
    return angle


class Post(NamedTuple):
    """An upright round obstacle: a tree, a lamp post, a column."""

    x: float
    y: float
    radius: float
    bottom: float
    top: float


def hidden_by_post(points: Array, position: Array, post: Post) -> Mask:
    """(n,) true where the ray from a position to a point passes through the post."""
    start = position[:2] - np.array([post.x, post.y])
    along = points[:, :2] - position[:2]
    share = np.clip(-(along @ start) / np.einsum("ni,ni->n", along, along), 0.0, 1.0)
    nearest = start + share[:, None] * along
    height = position[2] + share * (points[:, 2] - position[2])
    close = np.linalg.norm(nearest, axis=1) < post.radius
    blocked: Mask = close & (share < 0.999) & (height > post.bottom) & (height < post.top)
    return blocked
