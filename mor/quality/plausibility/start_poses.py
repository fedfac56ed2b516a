"""Images whose given start pose none of their points supports: turned away from all of them, or far beside.

A start pose is rough. But where points with given coordinates are measured in an image, its pose puts some of them
before the camera and somewhere near their measured places. One that has not a single one of at least three
within the width of what the camera measures is no rough value of this image.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.errors import Problem
from mor.observations import ObservationGroup, some_rows
from mor.project.network.build import Network
from mor.quality.plausibility.images import rays
from mor.quality.plausibility.places import line_of

_LEAST = 3
_SOME = 16
"""Rays for each image, in the mean, that are looked at before all of those that nothing supports yet."""


def unsupported_poses(network: Network) -> Iterator[Problem]:
    """Images with a given pose, and three given points at least, that all lie behind the camera or far beside."""
    for group in rays(network):
        if any(slot.part == "base" for slot in group.type.slots):
            continue
        image = group.references[0].numbers
        rows = np.flatnonzero(~_settled(network, group)[image])
        usable = _usable(network, group, rows)
        rows = rows[usable]
        count = np.bincount(image[rows], minlength=int(image.max()) + 1)
        good = np.bincount(image[rows[_support(network, group, rows)]], minlength=len(count))
        for k in np.flatnonzero((count >= _LEAST) & (good == 0)).tolist():
            row = int(np.flatnonzero(image == k)[0])
            words = (
                f"image {group.references[0].known[k]}: its start pose shows none of its {count[k]} points that have "
                "start coordinates"
            )
            yield Problem(words, group.file, line_of(group, row))


def _settled(network: Network, group: ObservationGroup) -> BoolArray:
    """(images,) that already some of their rays support: one is enough, so that hardly any needs all of them."""
    image = group.references[0].numbers
    images = int(image.max()) + 1
    some = np.arange(0, group.count, max(1, group.count // (_SOME * images)))
    some = some[_usable(network, group, some)]
    settled: BoolArray = np.zeros(images, dtype=bool)
    settled[image[some[_support(network, group, some)]]] = True
    return settled


def _usable(network: Network, group: ObservationGroup, rows: IntArray) -> BoolArray:
    """(k,) rays for which all start values are given."""
    usable: BoolArray = np.ones(len(rows), dtype=bool)
    for slot, own in zip(group.type.slots, group.blocks, strict=True):
        start = network.start[slot.kind]
        given = np.asarray(np.isfinite(start.reshape(len(start), -1)).all(axis=1), dtype=bool)
        usable = usable & given[own[rows]]
    return usable


def _support(network: Network, group: ObservationGroup, rows: IntArray) -> BoolArray:
    """(k,) rays, with all their start values, that point before the camera and near the place they were measured at."""
    if not len(rows):
        return np.zeros(0, dtype=bool)
    some = some_rows(group, rows)
    blocks = [network.start[slot.kind][own] for slot, own in zip(some.type.slots, some.blocks, strict=True)]
    slots = {(slot.of, slot.part): k for k, slot in enumerate(group.type.slots)}
    sight = blocks[-1] - blocks[slots["image", "position"]]
    axis = blocks[slots["image", "rotation"]][:, 2]
    along: FloatArray = np.einsum("nj,nj->n", axis, sight)
    with np.errstate(all="ignore"):
        computed = some.type.equation(blocks, some.constants).values
        width = np.fmax.reduce(np.fmax.reduce(group.observed) - np.fmin.reduce(group.observed))
        far = np.fmax.reduce(np.abs(computed - some.observed), axis=1)
    return np.asarray((along < 0.0) & (far < width))
