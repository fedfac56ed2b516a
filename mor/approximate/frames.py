"""What the strategy works with: frames with their rays, horizontal sets, distances and height differences.

Images and full theodolite bundles are the same thing here: a frame with unit rays towards points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mor.approximate.polar import polar_rays
from mor.approximate.undistort import ideal_rays
from mor.geometry.arrays import BoolArray, FloatArray, IntArray
from mor.geometry.cameras import CAMERA_MODELS, CameraModel
from mor.observations import ObservationGroup
from mor.project.network import Network

SLACKS = (0.0, 5e-4, 2e-3, 8e-3)
"""Radians by which rays may be off beside their own σ, tried in this order: distortion not yet known, a rough c."""


@dataclass(frozen=True)
class Frame:
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


def loosened(sigma: FloatArray, slack: float) -> FloatArray:
    """σ of rays that may be off by a slack besides."""
    return np.hypot(sigma, slack)


def image_frames(network: Network) -> list[Frame]:
    """Frames of all images that have measured points."""
    frames: dict[
        tuple[int, int, int], list[tuple[str, FloatArray, FloatArray, IntArray, ObservationGroup, int]]
    ] = {}
    images = network.things["image"]
    for group in network.groups:
        prefix, _, model = group.type.key.partition("/")
        if prefix not in ("image", "follower"):
            continue
        rays, sigma = _image_rays(network, group, CAMERA_MODELS[model])
        names = np.array(group.references[0])
        measured = np.flatnonzero(group.mask.all(axis=1))
        order = measured[np.argsort(names[measured], kind="stable")]
        cuts = np.flatnonzero(names[order][1:] != names[order][:-1]) + 1
        for rows in np.split(order, cuts):
            number = images.numbers[str(names[rows[0]])]
            frames.setdefault((number, 0, 0), []).append(
                (str(names[rows[0]]), rays[rows], sigma[rows], group.blocks[-1][rows], group, number)
            )
    return [_image_frame(network, number, parts) for (number, _, _), parts in sorted(frames.items())]


def _image_frame(network: Network, number: int, parts) -> Frame:  # type: ignore[no-untyped-def]
    blocks = {part: int(numbers[number]) for part, numbers in network.things["image"].parts.items()}
    points = np.concatenate([part[3] for part in parts])
    relative = None if blocks["base"] < 0 else (blocks["relative rotation"], blocks["base"])
    return Frame(
        name=f"image {parts[0][0]}",
        position=blocks["position"],
        rotation=blocks["rotation"],
        height=blocks["height"],
        eccentricity=blocks["eccentricity"],
        relative=relative,
        points=points,
        heights=np.zeros(len(points)),
        rays=np.concatenate([part[1] for part in parts]),
        sigma=np.concatenate([part[2] for part in parts]),
        offset=_offset(network, blocks["height"], blocks["eccentricity"]),
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
    interior = network.start[group.type.slots[slot].kind][group.blocks[slot]]
    rays = ideal_rays(model, interior, group.constants[:, 2:], group.observed)
    sigma = np.nanmax(group.sigma, axis=1) / np.maximum(np.abs(interior[:, 0]), 1e-300)
    return rays, 3.0 * sigma


def theodolite_frames(network: Network) -> list[Frame]:
    """Frames of theodolite sets, of the targets with both directions."""
    frames = []
    for group in network.groups:
        if group.type.key not in ("directions", "zenith_directions"):
            continue
        horizontal, vertical = first_face(group)
        both = np.isfinite(horizontal) & np.isfinite(vertical)
        for rows in rows_by_set(group, both):
            position, rotation, height, point, target, _ = group.blocks
            rays = polar_rays(horizontal[rows], vertical[rows])
            frames.append(
                Frame(
                    name=f"station {group.references[0][rows[0]]}",
                    position=int(position[rows[0]]),
                    rotation=int(rotation[rows[0]]),
                    height=int(height[rows[0]]),
                    eccentricity=0,
                    relative=None,
                    points=point[rows],
                    heights=network.start["height"][target[rows], 0],
                    rays=rays,
                    sigma=np.hypot(3.0 * np.nanmax(group.sigma[rows], axis=1), 1e-5),
                    offset=_offset(network, int(height[rows[0]]), 0),
                )
            )
    return frames


def rows_by_set(group: ObservationGroup, usable: BoolArray) -> list[IntArray]:
    """Rows of a group of directions, set by set (rotation block)."""
    rows = np.flatnonzero(usable)
    order = rows[np.argsort(group.blocks[1][rows], kind="stable")]
    cuts = np.flatnonzero(np.diff(group.blocks[1][order]) != 0) + 1
    return [part for part in np.split(order, cuts) if len(part)]


def first_face(group: ObservationGroup) -> tuple[FloatArray, FloatArray]:
    """Horizontal and vertical directions (n,) reduced to face one; NaN where not observed."""
    second = group.constants[:, 1] == 2.0
    horizontal = group.observed[:, 0] - np.where(second, np.pi, 0.0)
    given = group.observed[:, 1]
    if group.type.key == "zenith_directions":
        vertical = np.where(second, given - 1.5 * np.pi, 0.5 * np.pi - given)
    else:
        vertical = np.where(second, np.pi - given, given)
    return horizontal, vertical
