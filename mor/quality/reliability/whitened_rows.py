"""Some observations as whitened rows: W A x and (W A)ᵀ z for them alone, correlated or not.

With W Σ Wᵀ = I, Q the cofactors of the unknowns and R = I − W A Q Aᵀ Wᵀ, whitened residuals W v have the cofactors R.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mor.adjustment.correlated_rows import ClusterRows, cluster_rows
from mor.adjustment.linearise import linearise, rotation_tangents
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.quality.assess import Quality
from mor.quality.reliability.local_system import LocalSystem, local_system


class _Part(NamedTuple):
    """Rows with Jacobians (n, m, K), whitened, and their columns (n, K), −1 where fixed; those in use (n, m)."""

    jacobian: FloatArray
    columns: IntArray
    use: BoolArray
    whitening: FloatArray | None
    """(m, m) of a cluster, which is one row; ``None``: the weights below."""
    weight: FloatArray
    """(n, m) 1/σ."""
    group: IntArray
    """(n, m) where each entry stands."""
    row: IntArray
    component: IntArray


class WhitenedRows(NamedTuple):
    """N chosen observations; arrays over them come in one order, that of the parts."""

    system: LocalSystem
    """The unknowns they refer to, of which there are c."""
    parts: tuple[_Part, ...]

    @property
    def size(self) -> int:
        """N."""
        return int(sum(np.count_nonzero(part.use) for part in self.parts))

    def whitened(self, values: Sequence[FloatArray]) -> FloatArray:
        """(N,) W y, for y given as one array (n, m) for each group; what is not chosen counts as 0."""
        found = [np.zeros(0)]
        for part in self.parts:
            own = np.zeros(part.use.shape)
            for number in np.unique(part.group):
                here = (part.group == number) & part.use
                own[here] = values[number][part.row[here], part.component[here]]
            white = own @ part.whitening.T if part.whitening is not None else own * part.weight
            found.append(white[part.use])
        return np.concatenate(found)

    def of_rows(self, x: FloatArray) -> FloatArray:
        """(N, k) W A x for changes x (c, k) of the unknowns."""
        found = [np.zeros((0, x.shape[1]))]
        for part in self.parts:
            moved = np.where((part.columns >= 0)[:, :, None], x[self._places(part)], 0.0)
            found.append((part.jacobian @ moved)[part.use])
        return np.concatenate(found)

    def of_unknowns(self, z: FloatArray) -> FloatArray:
        """(c, k) (W A)ᵀ z for z (N, k)."""
        count = len(self.system.columns)
        result, first = np.zeros((count + 1, z.shape[1])), 0
        for part in self.parts:
            own = np.zeros((*part.use.shape, z.shape[1]))
            size = int(np.count_nonzero(part.use))
            own[part.use] = z[first : first + size]
            first += size
            products = np.einsum("nmc,nmk->nck", part.jacobian, own)
            place = np.where(part.columns >= 0, self._places(part), count)
            np.add.at(result, place.ravel(), products.reshape(-1, z.shape[1]))
        return result[:count]  # what is fixed has gathered in the last row

    def residuals_of(self, z: FloatArray) -> FloatArray:
        """R z (N, k) for the chosen rows of R and z (N, k) there, 0 elsewhere."""
        return z - self.of_rows(self.system.solve(self.of_unknowns(z)))

    def _places(self, part: _Part) -> IntArray:
        """(n, K) places of the columns among the unknowns; anything where fixed."""
        places = np.searchsorted(self.system.columns, part.columns)
        return np.minimum(places, max(len(self.system.columns) - 1, 0))


def whitened_rows(quality: Quality, chosen: Sequence[BoolArray]) -> WhitenedRows:
    """The chosen observations (n, m) of each group. Of a correlated cluster all have to be chosen, or none."""
    adjustment = quality.adjustment
    tangent = rotation_tangents(adjustment.problem.index, adjustment.inverse.values)
    alone = [mask.copy() for mask in chosen]
    parts = []
    for cluster in adjustment.plan.clusters:
        inside = _entries(cluster, chosen)
        for number, mask in enumerate(alone):
            here = cluster.groups == number
            mask[cluster.rows[here], cluster.components[here]] = False
        if inside.any():
            parts.append(_correlated(quality, cluster, inside, tangent))
    for number, mask in enumerate(alone):
        rows = np.flatnonzero(mask.any(axis=1))
        if len(rows):
            parts.append(_uncorrelated(quality, number, rows, mask[rows], tangent))
    columns = [part.columns.ravel() for part in parts]
    return WhitenedRows(
        local_system(adjustment, np.concatenate([np.zeros(0, dtype=np.int64), *columns])), tuple(parts)
    )


def _entries(cluster: ClusterRows, chosen: Sequence[BoolArray]) -> BoolArray:
    """(k,) entries of a cluster that are chosen."""
    places = zip(cluster.groups, cluster.rows, cluster.components, strict=True)
    return np.array([chosen[group][row, component] for group, row, component in places], dtype=bool)


def _uncorrelated(
    quality: Quality, number: int, rows: IntArray, use: BoolArray, tangent: FloatArray | None
) -> _Part:
    adjustment = quality.adjustment
    group, index = adjustment.problem.groups[number], adjustment.problem.index
    part = linearise(group, index, adjustment.inverse.values, tangent, rows)
    weight = np.where(use, 1.0 / group.sigma[rows], 0.0)
    row, component = np.broadcast_arrays(rows[:, None], np.arange(use.shape[1])[None])
    place = np.full(use.shape, number), row, component
    return _Part(part.jacobian * weight[:, :, None], part.columns, use, None, weight, *place)


def _correlated(
    quality: Quality, cluster: ClusterRows, inside: BoolArray, tangent: FloatArray | None
) -> _Part:
    adjustment, W = quality.adjustment, cluster.whitening
    _, jacobian, columns = cluster_rows(adjustment.problem, cluster, adjustment.inverse.values, tangent)
    place = cluster.groups[None], cluster.rows[None], cluster.components[None]
    return _Part((W @ jacobian)[None], columns[None], inside[None], W, np.ones(inside[None].shape), *place)
