"""Directions that are determined, but hardly: which unknowns move together, and how far."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.quality.assess import Quality

_MOST = 6
_SHARE = 0.5
"""Part of the variance of an unknown that must come from a weak direction for the unknown to be told."""


class WeakDirection(NamedTuple):
    """A direction that the observations hardly determine."""

    unknowns: tuple[tuple[str, str, str], ...]
    """(kind, block, component), those first of whose variance it makes up most."""
    sigmas: tuple[float, ...]
    """Standard deviation of each along this direction, internal units, with its sign: they move together."""


def weak_directions(quality: Quality) -> list[WeakDirection]:
    """Weak directions that the datum leaves, the weakest first."""
    adjustment = quality.adjustment
    weak = adjustment.inverse.weak
    if weak.shape[1] == 0:
        return []
    datum = quality.datum
    if datum.null.shape[1]:
        weak = weak - datum.null @ (datum.binding @ (adjustment.constraint.normals.T @ weak))
    index = adjustment.problem.index
    variance = np.zeros(index.count)
    for kind, columns in index.columns.items():
        diagonal = np.diagonal(quality.cofactors[kind], axis1=1, axis2=2)
        variance[columns[columns >= 0]] = diagonal[columns >= 0]
    share = weak**2 / np.maximum(variance, 1e-300)[:, None]
    directions = []
    for k in range(weak.shape[1]):
        order = np.argsort(-share[:, k], kind="stable")[:_MOST]
        told = order[share[order, k] > _SHARE]
        if len(told):
            directions.append(
                WeakDirection(
                    tuple(index.label(int(column)) for column in told),
                    tuple(float(quality.sigma_factor * weak[column, k]) for column in told),
                )
            )
    return directions
