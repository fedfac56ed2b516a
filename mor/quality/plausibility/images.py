"""Rays that cannot be right: outside the format of their image, or of a point that the image has already."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.edge import split
from mor.project.network.build import Network
from mor.quality.plausibility.places import line_of, noted
from mor.quality.reliability.influence_on_position import OF_IMAGES


def rays(network: Network) -> list[ObservationGroup]:
    """Groups of image coordinates."""
    return [group for group in network.groups if group.type.key in OF_IMAGES and group.count]


def outside_the_format(network: Network) -> Iterator[Problem]:
    """Image coordinates more than a pixel beyond the edge of the format that their camera gives."""
    for group, out in _outside(network):
        words = "{}, outside the format of the camera"
        yield from noted(group, np.flatnonzero(out), _ray(group, words))


def count_outside_the_format(network: Network) -> int:
    """Number of image points beyond the format of their camera."""
    return sum(int(np.count_nonzero(out)) for _, out in _outside(network))


def _outside(network: Network) -> Iterator[tuple[ObservationGroup, BoolArray]]:
    """Groups of image coordinates, and which of their rows (n,) are outside the format."""
    images, half = network.things["image"], _half_formats(network)
    for group in rays(network):
        names = group.references[0]
        camera = np.full(len(names.known), -1)
        used = np.unique(names.numbers)
        camera[used] = [images.part(names.known[k], "camera") for k in used]
        with np.errstate(invalid="ignore"):
            out = (np.abs(group.observed) > half[camera[names.numbers]]).any(axis=1)
        yield group, np.asarray(out)


def _ray(group: ObservationGroup, words: str):  # type: ignore[no-untyped-def]
    image, point = group.references
    return lambda row: words.format(f"image {image[row]}, point {point[row]}")


def _half_formats(network: Network) -> FloatArray:
    """(cameras, 2) half of the format and a pixel, from the origin, in camera units; infinite where none is given."""
    ids = network.things["camera"].ids
    half = np.full((len(ids), 2), np.inf)
    for k, name in enumerate(ids):
        given, scale = network.project.cameras[name].image, network.scales[name]
        if given is None:
            continue
        size = np.array([split(text)[0] for text in (given.width, given.height)])
        pixel = scale.pixel if np.isfinite(scale.pixel) else 1.0
        beside = np.abs(0.5 * size - np.array(scale.centre)) if scale.corner else np.zeros(2)
        half[k] = (0.5 * size + beside + 1.0) * pixel
    return half


def measured_twice(network: Network) -> Iterator[Problem]:
    """Points that an image has twice in one table: the second row, and where the first one stands."""
    for group in rays(network):
        image, point = (names.numbers.astype(np.int64) for names in group.references)
        key = image * (int(point.max(initial=0)) + 1) + point
        order = np.argsort(key, kind="stable")
        same = key[order][1:] == key[order][:-1]
        if not same.any():
            continue
        before = dict(zip(order[1:][same].tolist(), order[:-1][same].tolist(), strict=True))
        yield from noted(group, np.sort(order[1:][same]), _again(group, before))


def _again(group: ObservationGroup, before: dict[int, int]):  # type: ignore[no-untyped-def]
    image, point = group.references

    def said(row: int) -> str:
        line = line_of(group, before[row])
        return f"image {image[row]} has point {point[row]} twice" + (f", in line {line}, too" if line else "")

    return said
