"""Images whose given start pose none of their points supports: turned away from all of them, or far beside.

A start pose is rough. But where points with given coordinates are measured in an image, its pose puts some of them
before the camera and somewhere near their measured places. One that has not a single one of at least three
within the width of what the camera measures is no rough value of this image.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.errors import Problem
from mor.observations import ObservationGroup
from mor.project.network.build import Network
from mor.quality.plausibility.images import rays
from mor.quality.plausibility.places import line_of

_LEAST = 3


def unsupported_poses(network: Network) -> Iterator[Problem]:
    """Images with a given pose, and three given points at least, that all lie behind the camera or far beside."""
    for group in rays(network):
        if any(slot.part == "base" for slot in group.type.slots):
            continue
        supported, usable = _support(network, group)
        image = group.references[0].numbers
        count = np.bincount(image[usable], minlength=int(image.max()) + 1)
        good = np.bincount(image[usable & supported], minlength=len(count))
        for k in np.flatnonzero((count >= _LEAST) & (good == 0)).tolist():
            row = int(np.flatnonzero(image == k)[0])
            words = (
                f"image {group.references[0].known[k]}: its start pose shows none of its {count[k]} points that have "
                "start coordinates"
            )
            yield Problem(words, group.file, line_of(group, row))


def _support(network: Network, group: ObservationGroup) -> tuple[BoolArray, BoolArray]:
    """(n,) rays that the start values support, and those for which all start values are given."""
    usable: BoolArray = np.ones(group.count, dtype=bool)
    blocks: list[FloatArray] = []
    for slot, own in zip(group.type.slots, group.blocks, strict=True):
        start = network.start[slot.kind]
        given = np.asarray(np.isfinite(start.reshape(len(start), -1)).all(axis=1), dtype=bool)
        usable = usable & given[own]
        blocks.append(np.nan_to_num(start[own]))
    if not usable.any():
        return usable, usable
    slots = {(slot.of, slot.part): k for k, slot in enumerate(group.type.slots)}
    sight = blocks[-1] - blocks[slots["image", "position"]]
    axis = blocks[slots["image", "rotation"]][:, 2]
    along: FloatArray = np.einsum("nj,nj->n", axis, sight)
    with np.errstate(all="ignore"):
        computed = group.type.equation(blocks, group.constants).values
        width = float(np.max(np.nanmax(group.observed, axis=0) - np.nanmin(group.observed, axis=0)))
        far = np.max(np.abs(computed - group.observed), axis=1)
    return (along < 0.0) & (far < width), usable
