"""Rinner's auxiliary unknowns: linear, made compatible, adjusted; with the conditions and the corrections."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.relative_orientation.compatibility import compatible_unknowns, printed_conditions
from mor.approximate.relative_orientation.outcome import RelativeOrientation, SceneGeometry
from mor.approximate.relative_orientation.rinner import auxiliary_unknowns
from mor.approximate.relative_orientation.two_bundles import linear_system
from mor.arrays import FloatArray
from mor.geometry.rotations import cross_matrix

CONDITIONS = ("(13)", "(14)", "(15)", "(16) 1", "(16) 2", "(16) 3")
"""Numbers in the paper, in the order of :func:`printed_conditions`."""


class Auxiliary(NamedTuple):
    """The nine ik (3, 3) and the misclosures (6,) of the conditions.

    The linear ones are no numbers where the points lie in a plane.
    """

    linear: FloatArray
    corrections: FloatArray
    compatible: FloatArray
    adjusted: FloatArray
    sigma: FloatArray
    """(3, 3) of the adjusted ones."""
    misclosures: FloatArray
    """Of the linear ik."""
    remaining: FloatArray
    """Of the adjusted ik."""


def auxiliary_of(a: Bundle, b: Bundle, found: RelativeOrientation) -> Auxiliary:
    """All three for the homologous rays that ``found`` rests on."""
    nothing = np.full((3, 3), np.nan)
    linear = corrections = compatible = nothing
    misclosures = np.full(len(CONDITIONS), np.nan)
    if found.geometry is not SceneGeometry.PLANE:
        system = linear_system(a, b)
        sign = 1.0 if float(np.sum(system.ik * found.unknowns)) >= 0.0 else -1.0
        linear = sign * system.ik
        compatible, corrections, _ = compatible_unknowns(linear, system.normal)
        misclosures = printed_conditions(linear)
    return Auxiliary(
        linear,
        corrections,
        compatible,
        found.unknowns,
        _sigma(found),
        misclosures,
        printed_conditions(found.unknowns),
    )


def _sigma(found: RelativeOrientation) -> FloatArray:
    """Of ik = −[b]× D*ᵀ, by b and δ: D* ← exp(−[δ]×) D*."""
    columns = [auxiliary_unknowns(axis, found.rotation).ravel() for axis in np.eye(3)]
    columns += [
        auxiliary_unknowns(found.base, -cross_matrix(axis) @ found.rotation).ravel() for axis in np.eye(3)
    ]
    rows = np.stack(columns, axis=1)
    return np.sqrt(np.maximum(np.diag(rows @ found.covariance @ rows.T), 0.0)).reshape(3, 3)
