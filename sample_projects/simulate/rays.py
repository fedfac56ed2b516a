"""Who sees what: image points of a set of images, with dropped rays and noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from sample_projects.simulate.camera import Camera, image_of, in_axes
from sample_projects.simulate.geometry import Array, Frame, Mask


class ImagePoint(NamedTuple):
    """A measured image point, mm from the image centre, y up."""

    image: str
    point: str
    xy: Array


def measured(
    images: Mapping[str, tuple[Camera, Frame]],
    points: Mapping[str, Array],
    visible: Callable[[Camera, Frame], Mask],
    sigma: Array | float,
    random: np.random.RandomState,
    drop: Array | float = 0.06,
) -> list[ImagePoint]:
    """Image points of all images with noise of σ (mm); a share of the rays is dropped at random.

    σ and the share are numbers for all, or arrays with one for each point.
    """
    names, coordinates = list(points), np.stack(list(points.values()))
    spread = np.broadcast_to(np.asarray(sigma, dtype=float), len(names))
    result = []
    for image, (camera, frame) in images.items():
        seen = visible(camera, frame) & (random.uniform(size=len(names)) > drop)
        chosen = np.flatnonzero(seen)
        xy = image_of(camera, in_axes(frame, coordinates[chosen]))
        xy = xy + spread[chosen, None] * random.standard_normal(xy.shape)
        result += [ImagePoint(image, names[k], row) for k, row in zip(chosen, xy, strict=True)]
    return result


def with_enough_rays(rays: list[ImagePoint], least: int) -> list[ImagePoint]:
    """Rays of the points that are seen in at least so many images."""
    counts: dict[str, int] = {}
    for ray in rays:
        counts[ray.point] = counts.get(ray.point, 0) + 1
    return [ray for ray in rays if counts[ray.point] >= least]


def seen_points(rays: list[ImagePoint], points: Mapping[str, Array]) -> dict[str, Array]:
    """The points that have rays, in their old order."""
    names = {ray.point for ray in rays}
    return {name: xyz for name, xyz in points.items() if name in names}
