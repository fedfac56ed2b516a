"""Normal equations of parts of a system joined where they meet (F. R. Helmert, 1880), dense.

A part hands up what its elimination has left: a *share* in the unknowns that it has in common with others. Two shares
are added up; unknowns that no other part has are eliminated, and what that leaves is the share of both together. At the
root nothing is left over. Solutions and cofactors come back down the same way, each node handing its children the part
they meet.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dgemm, dsyrk, dtrsm
from scipy.linalg.lapack import dpotri

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.sparse.block_matrix import BlockMatrix, BlockStructure
from mor.sparse.cholesky import factorise
from mor.sparse.symbolic_factorisation import analyse


class Share(NamedTuple):
    """What a part of a system leaves of its normal equations to the unknowns it has in common with others."""

    numbers: IntArray
    """(s,) common numbers of the unknowns, in any order."""
    matrix: FloatArray
    """(s, s) lower triangle."""
    rhs: FloatArray
    """(s, k) right-hand sides."""
    diagonal: FloatArray
    """(s,) diagonal before anything was eliminated: the measure of what vanishes."""


class Node(NamedTuple):
    """Unknowns that were eliminated where shares met, for the way down.

    With the pivots scaled to unit diagonal before elimination, L11 and L21 are the factor of its dense front.
    """

    pivots: IntArray
    """(p,) numbers of the eliminated unknowns."""
    rows: IntArray
    """(r,) numbers of those handed on."""
    scale: FloatArray
    """(p,) 1/√ of the diagonal of the pivots."""
    factor: FloatArray
    """(p, p) L11, lower triangle."""
    below: FloatArray
    """(r, p) L21."""
    y: FloatArray
    """(p, k) L11⁻¹ of the scaled right-hand sides."""
    vanished: IntArray
    """(v,) numbers of unknowns that nothing determines here, held at zero."""

    def forward(self, rhs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """y (p, k) and what is left for the rows (r, k) of further right-hand sides (p + r, k), pivots first."""
        p = len(self.pivots)
        b = self.scale[:, None] * rhs[:p]
        b[np.isin(self.pivots, self.vanished)] = 0.0
        y = dtrsm(1.0, self.factor, b, lower=1)
        return y, rhs[p:] - self.below @ y

    def backward(self, y: FloatArray, of_rows: FloatArray) -> FloatArray:
        """Solutions (p, k) of the pivots, those of the rows (r, k) given."""
        found = dtrsm(1.0, self.factor, y - self.below.T @ of_rows, lower=1, trans_a=1)
        return np.asarray(self.scale[:, None] * found)

    def inverse(self, of_rows: FloatArray) -> FloatArray:
        """Cofactors (p + r, p + r) of pivots and rows, those of the rows (r, r) given (K. Takahashi, 1973)."""
        p = len(self.pivots)
        found = np.empty((p + len(self.rows),) * 2, order="F")
        own = dpotri(self.factor, lower=1)[0] if p else self.factor
        own = np.tril(own) + np.tril(own, -1).T
        gone = np.isin(self.pivots, self.vanished)
        own[gone, gone] = 0.0
        if len(self.rows):
            ratio = dtrsm(1.0, self.factor, self.below, side=1, lower=1)
            across = dgemm(-1.0, of_rows, ratio)
            own = own - ratio.T @ across
            found[p:, :p] = across * self.scale
            found[:p, p:] = found[p:, :p].T
        found[:p, :p] = own * self.scale[:, None] * self.scale
        found[p:, p:] = of_rows
        return found


def added(shares: list[Share], order: IntArray) -> Share:
    """The sum of shares, its unknowns in the given order of their numbers; they need not ascend."""
    place = {int(number): k for k, number in enumerate(order)}
    n, width = len(order), shares[0].rhs.shape[1]
    whole = Share(order, np.zeros((n, n), order="F"), np.zeros((n, width)), np.zeros(n))
    columns = whole.matrix.T  # what is symmetric has the same rows as columns, which lie together
    for share in shares:
        at = np.array([place[int(number)] for number in share.numbers], dtype=np.int64)
        full = np.tril(share.matrix)
        full += np.tril(full, -1).T
        for row, k in zip(full, at.tolist(), strict=True):  # in a quarter of the time of all at once
            columns[k, at] += row
        whole.rhs[at] += share.rhs
        whole.diagonal[at] += share.diagonal
    return whole


def order_of(numbers: list[IntArray], complete: BoolArray) -> tuple[IntArray, IntArray]:
    """Pivots and rows among the unknowns of some shares; ``complete`` (n,) is true where no other part has them."""
    union = np.unique(np.concatenate(numbers)) if numbers else np.zeros(0, dtype=np.int64)
    return union[complete[union]], union[~complete[union]]


def join(shares: list[Share], complete: BoolArray) -> tuple[Node, Share]:
    """Add up shares and eliminate what is complete, (n,) by number; the node, and the share that is left."""
    pivots, rows = order_of([share.numbers for share in shares], complete)
    whole = added(shares, np.concatenate([pivots, rows]))
    p = len(pivots)
    scale = 1.0 / np.sqrt(np.where(whole.diagonal[:p] > 0.0, whole.diagonal[:p], 1.0))
    factor, vanished = np.zeros((0, 0), order="F"), np.zeros(0, dtype=np.int64)
    if p:
        found = factorise(dense(whole.matrix[:p, :p] * scale[:, None] * scale), analyse(one_block(p)))
        factor, vanished = found.pivots[0], found.set_aside
    below = np.zeros((len(rows), p), order="F")
    if p and len(rows):
        below = dtrsm(1.0, factor, whole.matrix[p:, :p] * scale, side=1, lower=1, trans_a=1)
        below[:, vanished] = 0.0
    left = np.asfortranarray(whole.matrix[p:, p:])
    if below.size:
        left = dsyrk(-1.0, below, beta=1.0, c=left, lower=1, overwrite_c=1)
    node = Node(pivots, rows, scale, factor, below, np.zeros((p, 0)), pivots[vanished])
    y, rhs = node.forward(whole.rhs)
    node = Node(pivots, rows, scale, factor, below, y, pivots[vanished])
    return node, Share(rows, left, rhs, whole.diagonal[p:])


def one_block(size: int) -> BlockStructure:
    """The pattern of a dense matrix."""
    nothing = np.array([0])
    return BlockStructure(np.array([0, size]), np.array([0, 1]), nothing, np.array([0, size * size]))


def dense(matrix: FloatArray) -> BlockMatrix:
    """A dense symmetric matrix (n, n) as a block matrix of one block."""
    return BlockMatrix(one_block(len(matrix)), np.ascontiguousarray(matrix).ravel())
