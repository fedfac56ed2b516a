"""Two epochs of one network: the same points, brought into one datum, and their movements tested."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.project.network.build import Network
from mor.quality.assess import Quality
from mor.quality.deformation.congruence import Congruence, congruence
from mor.quality.deformation.movements import compared
from mor.quality.precision.covariance import joint_cofactors
from mor.quality.solved import Solved


class Epochs(NamedTuple):
    """Outcome of the comparison of two epochs."""

    names: tuple[str, ...]
    result: Congruence
    movement: FloatArray
    """(n, 3) second minus first, in the datum of the stable points, internal axes."""


def common_points(first: Network, second: Network) -> tuple[str, ...]:
    """Names of the points that both networks have, in the order of the first."""
    return tuple(name for name in first.things["point"].ids if name in second.things["point"].numbers)


def over_points(network: Network, names: tuple[str, ...], coordinates: FloatArray) -> Network:
    """The network, free over named points, the datum referring to their coordinates (n, 3), internal axes."""
    points = network.things["point"]
    blocks = np.array([points.part(name, "position") for name in names], dtype=np.int64)
    mask = np.zeros_like(network.datum.mask)
    mask[blocks] = True
    reference = network.start["point"].copy()
    reference[blocks] = coordinates
    datum = network.datum._replace(
        name="free, inner constraints over common points",
        free=True,
        mask=mask,
        minimal=False,
        reference=reference,
    )
    return replace(network, datum=datum)


def blocks_of(network: Network, names: tuple[str, ...]) -> IntArray:
    """Point blocks of names."""
    points = network.things["point"]
    return np.array([points.part(name, "position") for name in names], dtype=np.int64)


def compare_epochs(
    names: tuple[str, ...],
    one: tuple[Quality, IntArray],
    other: tuple[Quality, IntArray],
    level: float,
    known: bool,
) -> Epochs:
    """Congruence test of two assessed epochs in the datum over their common points; blocks (n,) by epoch."""
    first, second = one[0], other[0]
    places = [q.adjustment.values["point"][blocks] for q, blocks in (one, other)]
    columns = [q.adjustment.problem.index.columns["point"][blocks].ravel() for q, blocks in (one, other)]
    cofactors = joint_cofactors(first, columns[0]) + joint_cofactors(second, columns[1])
    generators = np.concatenate(
        [_movements(q, own) for q, own in zip((first, second), columns, strict=True)], axis=1
    )
    redundancy = first.redundancy + second.redundancy
    variance = (first.omega + second.omega) / redundancy if redundancy else 1.0
    result = congruence(
        places[1] - places[0], cofactors, _basis(generators), variance, redundancy, level, known
    )
    return Epochs(names, result, np.array([test.movement for test in result.points]))


def compare_within(solved: Solved, first: int, second: int, level: float, known: bool) -> Epochs:
    """Congruence test of two epochs of one adjustment, over the points that move and were seen in both.

    What the network leaves open between the epochs is settled by the points that are stable.
    """
    quality = solved.quality
    assert quality is not None
    names, d, q, generators = compared(solved, first, second)
    variance = quality.omega / quality.redundancy if quality.redundancy else 1.0
    result = congruence(d, q, _basis(generators), variance, quality.redundancy, level, known)
    return Epochs(names, result, np.array([test.movement for test in result.points]))


def _movements(quality: Quality, columns: IntArray) -> FloatArray:
    """(3n, d) free movements of a network on some coordinates."""
    null = quality.adjustment.defect.datum
    return np.where((columns >= 0)[:, None], null[columns], 0.0)


def _basis(generators: FloatArray) -> FloatArray:
    if generators.shape[1] == 0:
        return generators
    vectors, sizes, _ = tolerant.svd(generators, full_matrices=False)
    basis: FloatArray = vectors[:, sizes > max(1e-6 * sizes[0], 1e-9)]
    return basis
