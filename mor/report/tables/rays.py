"""The geometry of rays: who sees what, at which angles rays meet, how much of each image is measured."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.arrays import FloatArray, IntArray
from mor.report.view import View, is_ray

_CHUNK = 2_000_000
"""Pairs of rays looked at together."""


class Rays(NamedTuple):
    """Rays as pairs of numbers: frame (image or station, images first) and point."""

    frame: IntArray
    point: IntArray


def rays_of(view: View) -> Rays:
    """Every ray of an image and every sight of a station to a point of the table of points, once each."""
    points = _numbers(view.points["id"], "to", "point", 0)
    images = _numbers(view.images["id"], "from", "frame", 0)
    stations = _numbers(view.stations["id"], "from", "frame", view.images.height)
    seen = view.used.select("type", "from", "to")
    parts = [
        seen.filter(is_ray(seen)).join(images, on="from", maintain_order="left"),
        seen.filter(pl.col("type").str.ends_with("directions")).join(
            stations, on="from", maintain_order="left"
        ),
    ]
    pairs = pl.concat(parts).join(points, on="to", maintain_order="left").select("frame", "point")
    pairs = pairs.drop_nulls().unique(maintain_order=True)
    return Rays(pairs["frame"].to_numpy(), pairs["point"].to_numpy())


def _numbers(ids: pl.Series, key: str, name: str, first: int) -> pl.DataFrame:
    numbers = np.arange(first, first + len(ids), dtype=np.int64)
    return pl.DataFrame({key: ids.cast(pl.String), name: numbers}).unique(
        key, keep="first", maintain_order=True
    )


def centres(view: View) -> FloatArray:
    """(n, 3) places the rays start from: projection centres, then stations; NaN for images that were scanned.

    What was scanned along a trajectory has a place for every line, and that of the table is the first line's.
    """
    parts = [
        frame.select("x", "y", "z").to_numpy().copy()
        for frame in (view.images, view.stations)
        if frame.height
    ]
    if view.images.height:
        parts[0][view.images["id"].is_in(scanned_images(view)).to_numpy()] = np.nan
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def scanned_images(view: View) -> list[str]:
    """Images that line scanners took while they moved along a trajectory."""
    if not view.trajectories.height:
        return []
    lines = [
        camera["id"]
        for camera in view.cameras
        if camera["model"] != "panorama" and (camera.get("format") or {}).get("height") == 1
    ]
    return view.images.filter(pl.col("camera").is_in(lines))["id"].to_list()


def places(view: View) -> FloatArray:
    """(n, 3) coordinates of the table of points."""
    return view.points.select("x", "y", "z").to_numpy() if view.points.height else np.zeros((0, 3))


def intersection_angles(rays: Rays, start: FloatArray, end: FloatArray) -> FloatArray:
    """(p,) radians between those two rays of each point that meet best, at most π/2; NaN with fewer than two."""
    result = np.full(len(end), np.nan)
    along = end[rays.point] - start[rays.frame]
    length = np.linalg.norm(along, axis=1)
    known = np.flatnonzero(np.isfinite(length) & (length > 0.0))
    order = known[np.argsort(rays.point[known], kind="stable")]
    along, owner = along[order] / length[order, None], rays.point[order]
    numbers, first, count = np.unique(owner, return_index=True, return_counts=True)
    for k in np.unique(count[count > 1]):
        chosen = np.flatnonzero(count == k)
        for part in np.array_split(chosen, max(1, len(chosen) * k * k // _CHUNK)):
            bundle = along[first[part, None] + np.arange(k)]
            cosine = np.abs(bundle @ np.swapaxes(bundle, 1, 2)).reshape(len(part), -1).min(axis=1)
            result[numbers[part]] = np.arccos(np.clip(cosine, 0.0, 1.0))
    return result


class Window(NamedTuple):
    """The area image coordinates of a camera lie in, and whether y counts downwards."""

    x: tuple[float, float]
    y: tuple[float, float]
    down: bool
    known: bool
    """False if the camera says nothing of its format: the extent of what was measured."""


def window(camera: dict[str, Any], unit: str, xy: FloatArray) -> Window:
    """Window of a camera for image coordinates (n, 2) in ``unit``."""
    size = camera.get("format")
    if size is None:
        low, high = (xy.min(axis=0), xy.max(axis=0)) if len(xy) else (np.zeros(2), np.ones(2))
        return Window((float(low[0]), float(high[0])), (float(low[1]), float(high[1])), False, False)
    factor = 1.0 if unit == "px" else size["pixel"] * _per_camera_unit(camera["unit"], unit)
    width, height = size["width"] * factor, size["height"] * factor
    if size["height"] == 1 and len(xy):  # a line scanner: its images have as many rows as lines were taken
        across = (0.0, width) if size["origin"] == "corner" else (-width / 2.0, width / 2.0)
        return Window(
            across, (float(xy[:, 1].min()), float(xy[:, 1].max())), size["origin"] == "corner", False
        )
    if size["origin"] == "corner":
        return Window((0.0, width), (0.0, height), True, True)
    return Window((-width / 2.0, width / 2.0), (-height / 2.0, height / 2.0), False, True)


def _per_camera_unit(camera_unit: str, unit: str) -> float:
    from mor.units import LENGTH_UNITS

    return LENGTH_UNITS.get(camera_unit, 1.0) / LENGTH_UNITS.get(unit, 1.0)


def covered(xy: FloatArray, area: float) -> float:
    """Share of an image's area inside the convex hull of its points (n, 2); 0 with fewer than three."""
    if len(xy) < 3 or area <= 0.0:
        return 0.0
    from scipy.spatial import ConvexHull, QhullError  # no network without images waits for it

    try:
        return float(min(ConvexHull(xy).volume / area, 1.0))
    except QhullError:
        return 0.0
