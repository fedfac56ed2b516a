"""The datum defect of a network in domains: it shows at the root alone, and is carried down from there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from mor.adjustment.datum.defect import explained_movements
from mor.adjustment.domains.tasks import Triangles, extent, keep_null, null_image, triangles
from mor.adjustment.domains.tree import Boundaries, Engine, Root, down
from mor.adjustment.inverse import HARDLY_DETERMINED, NULL
from mor.arrays import FloatArray, IntArray


class NullSpace(NamedTuple):
    """What the anchors at the root hold."""

    anchors: IntArray
    """(k,) places among the unknowns of the root."""
    movements: tuple[str, ...]
    weak: int
    """Directions that are not null, and hardly determined."""
    undetermined: int
    """Null directions that are no movements of the network."""


def explain(engine: Engine, boundaries: Boundaries, stage: str, root: Root, anchors: IntArray) -> NullSpace:
    """Split what the anchors hold; the movements of the network are kept by the domains."""
    k = len(anchors)
    domains = range(len(boundaries.numbers))
    if k == 0:
        for d, numbers in enumerate(boundaries.numbers):
            engine.result(engine.submit(keep_null, d, stage, np.zeros((len(numbers), 0)), np.zeros((0, 0))))
        return NullSpace(anchors, (), 0, 0)
    held = root.held(root.factor(anchors), anchors)
    outer = down(engine, boundaries, stage, root, held)

    def image(vectors: FloatArray) -> FloatArray:
        parts = [engine.submit(null_image, d, stage, outer[d], vectors) for d in domains]
        total: FloatArray = sum((engine.result(part) for part in parts), np.zeros((vectors.shape[1],) * 2))
        return total

    eigenvalues, vectors = scipy.linalg.eigh(image(np.eye(k)))
    small = eigenvalues < 1e-6 * eigenvalues[-1]
    if eigenvalues[-1] > HARDLY_DETERMINED and small.any():
        among, turned = scipy.linalg.eigh(image(vectors[:, small]))
        eigenvalues[small], vectors[:, small] = among, vectors[:, small] @ turned
    lengths = np.sum((held / root.scale[:, None] @ vectors) ** 2, axis=0)
    is_null = eigenvalues < NULL * lengths
    weak = int(np.count_nonzero(~is_null))
    null = vectors[:, is_null]
    found = _triangles(engine, boundaries, stage, [own @ null for own in outer])
    movements, combined = explained_movements(
        np.asarray(np.linalg.qr(np.concatenate([part.whole for part in found]), mode="r")),
        np.concatenate([part.points for part in found]),
    )
    for part in [engine.submit(keep_null, d, stage, outer[d] @ null, combined) for d in domains]:
        engine.result(part)
    return NullSpace(anchors, movements, weak, null.shape[1] - combined.shape[1])


def _triangles(
    engine: Engine, boundaries: Boundaries, stage: str, outer: list[FloatArray]
) -> list[Triangles]:
    domains = range(len(boundaries.numbers))
    boxes = [engine.result(part) for part in [engine.submit(extent, d, stage) for d in domains]]
    least = np.min([box[0] for box in boxes], axis=0)
    most = np.max([box[1] for box in boxes], axis=0)
    centre, size = 0.5 * (least + most), float(np.max(most - least)) or 1.0
    parts = [engine.submit(triangles, d, stage, outer[d], centre, size) for d in domains]
    return [engine.result(part) for part in parts]
