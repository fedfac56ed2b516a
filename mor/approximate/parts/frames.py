"""What the strategy works with: frames with their rays, horizontal sets, distances and height differences.

Images and full theodolite bundles are the same thing here: a frame with unit rays towards points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mor.approximate.terrestrial.direction_sets import direction_sets, frame_verticals
from mor.approximate.terrestrial.polar import polar_rays
from mor.approximate.undistort import ideal_rays
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.cameras import CAMERA_MODELS, CameraModel
from mor.observations import ObservationGroup, is_image_point
from mor.project.network.build import Network

SLACKS = (0.0, 5e-4, 2e-3, 8e-3)
"""Radians by which rays may be off beside their own σ, tried in this order: distortion not yet known, a rough c."""


class Frame(NamedTuple):
    """A frame whose pose is wanted: blocks that hold it, and its rays."""

    name: str
    position: int
    rotation: int
    height: int
    eccentricity: int
    relative: tuple[int, int] | None
    """Blocks (rotation, base) of the relative orientation of a stereo follower."""
    points: IntArray
    """(n,) point blocks its rays go to."""
    heights: FloatArray
    """(n,) heights of the targets above their points."""
    rays: FloatArray
    """(n, 3) unit vectors in the axes of the frame."""
    sigma: FloatArray
    """(n,) radians."""
    offset: FloatArray
    """(4,) height of the rotation centre and eccentricity r0*, 0 where not known."""
    up: FloatArray
    """(3,) the vertical in the axes of the frame, NaN where it is not known."""

    @property
    def stands(self) -> bool:
        """True where ``position`` is its own; that of a stereo follower is the position of its leader."""
        return self.relative is None


def given_pose(network: Network, frame: Frame) -> tuple[FloatArray, FloatArray] | None:
    """Projection centre O = X0 + h e_Z − Dᵀ r0* and D that the project gives; of a follower those of its leader."""
    start = network.start
    D, position = start["rotation"][frame.rotation], start["point"][frame.position]
    if not (np.isfinite(D).all() and np.isfinite(position).all()):
        return None
    lift = np.array([0.0, 0.0, float(start["height"][frame.height, 0])])
    return position + lift - D.T @ start["eccentricity"][frame.eccentricity], D


def loosened(sigma: FloatArray, slack: float) -> FloatArray:
    """σ of rays that may be off by a slack besides."""
    return np.hypot(sigma, slack)


class _Rays(NamedTuple):
    """Rays of images, image after image."""

    image: IntArray
    point: IntArray
    rays: FloatArray
    sigma: FloatArray

    def take(self, chosen: IntArray | BoolArray | slice) -> _Rays:
        return _Rays(self.image[chosen], self.point[chosen], self.rays[chosen], self.sigma[chosen])


def image_frames(network: Network) -> list[Frame]:
    """Frames of all images that have measured points; their arrays are parts of common ones."""
    groups = [group for group in network.groups if is_image_point(group.type)]
    if not groups:
        return []
    keys, owners = np.unique(_pose_key(network, network.things["image"].parts), return_index=True)
    found = [_measured_rays(network, group, owners, keys) for group in groups]
    together = found[0] if len(found) == 1 else _joined(found)
    if (np.diff(together.image) < 0).any():
        together = together.take(np.argsort(together.image, kind="stable"))
    cuts = np.flatnonzero(np.diff(together.image)) + 1
    edges = np.concatenate([[0], cuts, [len(together.image)]])
    up = frame_verticals(network)
    return [
        _image_frame(network, together.take(slice(start, end)), up)
        for start, end in pairwise(edges.tolist())
        if end > start
    ]


def _joined(found: Sequence[_Rays]) -> _Rays:
    return _Rays(
        np.concatenate([one.image for one in found]),
        np.concatenate([one.point for one in found]),
        np.concatenate([one.rays for one in found]),
        np.concatenate([one.sigma for one in found]),
    )


def _pose_key(network: Network, blocks: Mapping[str, IntArray]) -> IntArray:
    """One number (n,) for the blocks that hold a pose: images of one pose are one frame."""
    rotations = len(network.blocks["rotation"].ids) + 1
    relative = blocks.get("relative rotation", np.full(len(blocks["rotation"]), -1))
    key: IntArray = (blocks["position"] * rotations + blocks["rotation"]) * rotations + relative + 1
    return key


def _measured_rays(network: Network, group: ObservationGroup, owners: IntArray, keys: IntArray) -> _Rays:
    """Rays of the completely measured rows of a group, and the images they belong to."""
    slots = zip(group.type.slots, group.blocks, strict=True)
    blocks = {slot.part: numbers.astype(np.int64) for slot, numbers in slots if slot.of == "image"}
    rays, sigma = _image_rays(network, group, CAMERA_MODELS[group.type.key.partition("/")[2]])
    image = owners[np.searchsorted(keys, _pose_key(network, blocks))]
    point = group.blocks[-1].astype(np.int64)
    found, whole = _Rays(image, point, rays, sigma), np.asarray(group.mask.all(axis=1))
    return found if whole.all() else found.take(whole)


def _image_frame(network: Network, rays: _Rays, up: FloatArray) -> Frame:
    images = network.things["image"]
    number = int(rays.image[0])
    blocks = {part: int(numbers[number]) for part, numbers in images.parts.items()}
    return Frame(
        name=f"image {images.ids[number]}",
        position=blocks["position"],
        rotation=blocks["rotation"],
        height=blocks["height"],
        eccentricity=blocks["eccentricity"],
        relative=None if blocks["base"] < 0 else (blocks["relative rotation"], blocks["base"]),
        points=rays.point,
        heights=np.zeros(len(rays.point)),
        rays=rays.rays,
        sigma=rays.sigma,
        offset=_offset(network, blocks["height"], blocks["eccentricity"]),
        up=up[blocks["rotation"]] if blocks["base"] < 0 else np.full(3, np.nan),
    )


def _offset(network: Network, height: int, eccentricity: int) -> FloatArray:
    start = network.start
    offset: FloatArray = np.nan_to_num(
        np.concatenate([start["height"][height], start["eccentricity"][eccentricity]])
    )
    return offset


def _image_rays(
    network: Network, group: ObservationGroup, model: CameraModel
) -> tuple[FloatArray, FloatArray]:
    """Unit rays (n, 3) of measured image coordinates, distortion taken off as far as it is known, and σ in radians."""
    slot = next(k for k, slot in enumerate(group.type.slots) if slot.part == "interior")
    interior, of = network.start[group.type.slots[slot].kind], group.blocks[slot]
    rays = ideal_rays(model, interior, of, group.constants[:, 2:], group.observed)
    sigma = np.fmax(*group.sigma.T) / np.maximum(np.abs(interior[of, 0]), 1e-300)
    return rays, 3.0 * sigma


def theodolite_frames(network: Network) -> list[Frame]:
    """Frames of theodolite sets, of the targets with both directions."""
    frames = []
    up = frame_verticals(network)
    for one in direction_sets(network):
        both = np.isfinite(one.horizontal) & np.isfinite(one.vertical)
        if both.any():
            frames.append(
                Frame(
                    name=one.name,
                    position=one.position,
                    rotation=one.rotation,
                    height=one.height,
                    eccentricity=0,
                    relative=None,
                    points=one.points[both],
                    heights=one.heights[both],
                    rays=polar_rays(one.horizontal[both], one.vertical[both]),
                    sigma=np.hypot(3.0 * one.sigma[both], 1e-5),
                    offset=_offset(network, one.height, 0),
                    up=up[one.rotation],
                )
            )
    return frames
