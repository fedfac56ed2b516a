"""Whether a point at infinity has a parallax after all, when poses may give way to it: a test at the solution.

A point that was put at infinity too early, with rough poses and cameras, bends these until its rays are parallel.
Asked at the poses so bent they are; asked of the whole adjustment they are not. With B the derivative of its
observations by the inverse distance ρ, the adjustment that had ρ as one more unknown would find

    ρ = BᵀPv̄ / (BᵀP Q_v P B),   σ_ρ² = 1 / (BᵀP Q_v P B),   Q_v = P⁻¹ − A Q Aᵀ,

v̄ = observed − computed at the solution without it: the test of an additional parameter (W. Baarda: A testing
procedure for use in geodetic networks, 1968), which needs one solution of the normal equations for every point.

A ρ that is significant, negative too, speaks against infinity: this point, or others there, have bent the network.
All that are significant are then unknowns together, B with a column for each: what one of them alone would explain of
what all have bent is told from what is its own, and they come to where the adjustment with all their ρ sees them.
Linearised so far from the solution that may be wrong; a ρ that comes out negative says by how much, and all come nearer
by twice that. Too near does no harm: with d' = d (2 − ρ/ρ₀) an iteration in coordinates at most doubles a distance, but
begun at more than twice the distance it ends behind the cameras.
"""

from __future__ import annotations

import numpy as np

from mor.adjustment.linearise import linearise, rotation_tangents
from mor.adjustment.state import Adjustment
from mor.approximate.points_at_infinity import RayPoints
from mor.arrays import FloatArray, IntArray
from mor.geometry import tolerant
from mor.observations import TURNED_AXIS, ObservationGroup, can_be_at_infinity, target_slot
from mor.parameters.index import Values
from mor.project.network.build import Network
from mor.project.reduction import nothing_marked, touches

_FAR = 1e-3
"""Inverse distance, in units of its σ at given poses, at which derivatives are taken."""
_AT_A_TIME = 64
"""Right-hand sides that are solved for together."""
_TOGETHER = 512
"""Inverse distances that are unknowns together."""


def with_free_poses(
    network: Network,
    reduced: Network,
    adjustment: Adjustment,
    values: Values,
    far: RayPoints,
    critical: float,
) -> RayPoints:
    """Inverse distances and their σ as the whole adjustment tells them.

    ``network`` has the points ``far`` as points, ``reduced`` and its ``adjustment`` as directions; ``values`` are those
    of the blocks of ``network`` at the solution; ``critical`` is the quantile of the test.
    """
    known = [k for k, p in enumerate(far.points.tolist()) if p in reduced.directions]
    if not known:
        return far
    distance = 1.0 / (_FAR * far.sigma)
    points = values["point"].copy()
    points[far.points] = far.centres + far.directions * distance[:, None]
    places = {**values, "point": points}
    inverse, sigma = far.inverse.copy(), far.sigma.copy()
    for first in range(0, len(known), _AT_A_TIME):
        some = np.array(known[first : first + _AT_A_TIME])
        size, product, through = _equations(network, reduced, adjustment, places, far, some)
        left = size - np.einsum("uk,uk->k", through, adjustment.inverse.solve(through))
        told = left > 0.0
        inverse[some[told]] = product[told] / left[told]
        sigma[some[told]] = 1.0 / np.sqrt(left[told])
    bent = np.zeros(len(inverse), dtype=bool)
    bent[known] = np.abs(inverse[known]) > critical * sigma[known]
    for some in np.array_split(np.flatnonzero(bent), 1 + np.count_nonzero(bent) // _TOGETHER):
        if len(some):
            size, product, through = _equations(network, reduced, adjustment, places, far, some)
            left = np.diag(size) - through.T @ adjustment.inverse.solve(through)
            together = tolerant.lstsq(left, product, rcond=None)
            inverse[some] = together + 2.0 * max(0.0, -float(together.min()))
    return far._replace(inverse=inverse, sigma=sigma)


def _equations(
    network: Network,
    reduced: Network,
    adjustment: Adjustment,
    places: Values,
    far: RayPoints,
    some: IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """BᵀPB (k,), BᵀPv̄ (k,) and AᵀPB (u, k) of some far points."""
    index = adjustment.problem.index
    tangent = rotation_tangents(index, adjustment.values)
    number = np.full(len(network.blocks["point"].ids), -1, dtype=np.int64)
    number[far.points[some]] = np.arange(len(some))
    left_out = {
        kind: reduced.absent[kind] if kind in reduced.absent and kind != "point" else none
        for kind, none in nothing_marked(network).items()
    }
    size, product, through = np.zeros(len(some)), np.zeros(len(some)), np.zeros((index.count, len(some)))
    for group in network.groups:
        if not can_be_at_infinity(group.type):
            continue
        there = number[group.blocks[target_slot(group.type)]] >= 0
        rows = np.flatnonzero(there & ~touches(group, left_out))
        if len(rows) == 0:
            continue
        point = group.blocks[target_slot(group.type)][rows]
        k = number[point]
        by_point = _by_point(group, places, rows)
        away = far.directions[some[k]]
        distance = 1.0 / (_FAR * far.sigma[some[k]])
        weight = group.sigma[rows] ** -2.0
        B = -(distance**2)[:, None] * np.einsum("nmi,ni->nm", by_point, away)
        lines = linearise(group, index, places, tangent, rows)
        np.add.at(size, k, np.sum(weight * B**2, axis=1))
        np.add.at(product, k, np.sum(weight * B * lines.misclosure, axis=1))
        block = np.array([reduced.directions[int(p)] for p in point])
        D = adjustment.values["rotation"][block]
        by_turn = distance[:, None, None] * (by_point @ np.swapaxes(D, 1, 2) @ TURNED_AXIS)
        for jacobian, columns in (
            (lines.jacobian, lines.columns),
            (by_turn, index.columns["rotation"][block]),
        ):
            moved = np.einsum("nm,nmc->nc", weight * B, jacobian)
            free = columns >= 0
            np.add.at(through, (columns[free], np.broadcast_to(k[:, None], columns.shape)[free]), moved[free])
    return size, product, through


def _by_point(group: ObservationGroup, values: Values, rows: IntArray) -> FloatArray:
    """(n, m, 3) derivatives by the sighted point."""
    blocks = [
        values[slot.kind][numbers[rows]] for slot, numbers in zip(group.type.slots, group.blocks, strict=True)
    ]
    computed = group.type.equation(blocks, group.constants[rows])
    return computed.jacobians[target_slot(group.type)]
