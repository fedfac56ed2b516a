"""Kernels of the symbolic factorisation: elimination tree, counts, amalgamation, rows of the fronts.

Vertices are numbered in the order of elimination ("steps"). ``indptr, indices`` is the whole symmetric
graph by rows, indices ascending, no diagonal.
"""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_kernel


@compile_kernel
def elimination_tree(indptr: IntArray, indices: IntArray) -> IntArray:
    """Return the parent of each step, -1 for roots (J. W. H. Liu, SIAM J. Matrix Anal. 11, 1990)."""
    steps = indptr.size - 1
    parent = np.full(steps, -1, dtype=np.int64)
    ancestor = np.full(steps, -1, dtype=np.int64)
    for i in range(steps):
        for k in indices[indptr[i] : indptr[i + 1]]:
            if k >= i:
                break
            while k != -1 and k != i:
                above = ancestor[k]
                ancestor[k] = i
                if above == -1:
                    parent[k] = i
                k = above
    return parent


@compile_kernel
def postorder(parent: IntArray) -> IntArray:
    """Return the vertices of a forest, children before their parent and every subtree in one piece."""
    count = parent.size
    first_child = np.full(count + 1, -1, dtype=np.int64)
    sibling = np.full(count + 1, -1, dtype=np.int64)
    for v in range(count - 1, -1, -1):
        owner = parent[v] if parent[v] >= 0 else count
        sibling[v] = first_child[owner]
        first_child[owner] = v
    order = np.empty(count, dtype=np.int64)
    done = 0
    v = count
    while True:
        while first_child[v] != -1:  # descend, unlinking the way down
            child = first_child[v]
            first_child[v] = sibling[child]
            v = child
        if v == count:
            return order
        order[done] = v
        done += 1
        v = parent[v] if parent[v] >= 0 else count


@compile_kernel
def column_orders(indptr: IntArray, indices: IntArray, parent: IntArray, sizes: IntArray) -> IntArray:
    """Return the number of scalar rows, diagonal block included, that each step's column of the factor has.

    Row i of the factor is the subtree of the elimination tree spanned by the entries of row i of the matrix.
    """
    orders = sizes.copy()
    seen = np.full(parent.size, -1, dtype=np.int64)
    for i in range(parent.size):
        seen[i] = i
        for k in indices[indptr[i] : indptr[i + 1]]:
            if k >= i:
                break
            while seen[k] != i:
                seen[k] = i
                orders[k] += sizes[i]
                k = parent[k]
    return orders


@compile_kernel
def chains(parent: IntArray, orders: IntArray, sizes: IntArray) -> IntArray:
    """Return the chain each step belongs to: neighbours whose columns have the same rows below them."""
    chain = np.zeros(parent.size, dtype=np.int64)
    for j in range(1, parent.size):
        same = parent[j - 1] == j and orders[j - 1] - sizes[j - 1] == orders[j]
        chain[j] = chain[j - 1] if same else chain[j - 1] + 1
    return chain


@compile_kernel
def amalgamate(parent: IntArray, pivots: IntArray, orders: IntArray, prices: FloatArray) -> IntArray:
    """Return for each chain the chain it is merged into (itself if it stays), children before parents.

    A front with k pivots and m rows costs ``prices @ (1, m², flops)``; a chain joins its parent wherever
    one front is not dearer than two, and the pivots of the parent not dearer than its own: a long chain of small ones
    becomes fronts that are cheapest for each pivot. ``pivots`` and ``orders`` are k and m of the chains.
    """
    into = np.arange(parent.size)
    k = pivots.astype(np.float64)
    m = orders.astype(np.float64)
    for child in range(parent.size):
        p = parent[child]
        if p < 0:
            continue
        alone = front_cost(k[child], m[child], prices)
        further = front_cost(k[child] + k[p], k[child] + m[p], prices) - alone
        if further <= front_cost(k[p], m[p], prices) and further * k[child] <= alone * k[p]:
            into[child] = p
            m[p] += k[child]
            k[p] += k[child]
    return into


@compile_kernel
def front_cost(k: float, m: float, prices: FloatArray) -> float:
    """Return the cost of a front of order m with k pivots: fixed, by area, by multiplications."""
    flops = k * m * m - k * k * m + k * k * k / 3.0
    return prices[0] + prices[1] * m * m + prices[2] * flops  # type: ignore[no-any-return]


@compile_kernel
def rows_of_fronts(
    indptr: IntArray, indices: IntArray, first_step: IntArray, parent: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the steps below the pivots of each front, in no order: pointers (f+1,) and steps.

    Front f has the pivots ``first_step[f]:first_step[f+1]``. Its rows are what its pivots meet in the
    matrix, and what its children hand on.
    """
    fronts = parent.size
    pointers = np.zeros(fronts + 1, dtype=np.int64)
    steps = np.empty(indices.size + 16, dtype=np.int64)
    seen = np.full(indptr.size - 1, -1, dtype=np.int64)
    last_child = np.full(fronts, -1, dtype=np.int64)
    elder = np.full(fronts, -1, dtype=np.int64)
    count = 0
    for f in range(fronts):
        end = first_step[f + 1]
        if count + seen.size - end > steps.size:
            larger = np.empty(2 * steps.size + seen.size, dtype=np.int64)
            larger[:count] = steps[:count]
            steps = larger
        for i in indices[indptr[first_step[f]] : indptr[end]]:
            if i >= end and seen[i] != f:
                seen[i] = f
                steps[count] = i
                count += 1
        child = last_child[f]
        while child >= 0:
            for i in steps[pointers[child] : pointers[child + 1]]:
                if i >= end and seen[i] != f:
                    seen[i] = f
                    steps[count] = i
                    count += 1
            child = elder[child]
        pointers[f + 1] = count
        if parent[f] >= 0:
            elder[f] = last_child[parent[f]]
            last_child[parent[f]] = f
    return pointers, steps[:count].copy()


@compile_kernel
def places_in_parents(
    pivot_pointers: IntArray, row_pointers: IntArray, rows: IntArray, parent: IntArray
) -> IntArray:
    """Return for each scalar row of each front its place among the pivots and rows of the parent front."""
    places = np.empty(rows.size, dtype=np.int64)
    for f in range(parent.size):
        p = parent[f]
        if p < 0:
            continue
        first, end = pivot_pointers[p], pivot_pointers[p + 1]
        at = row_pointers[p]
        for k in range(row_pointers[f], row_pointers[f + 1]):
            if rows[k] < end:
                places[k] = rows[k] - first
            else:
                while rows[at] < rows[k]:
                    at += 1
                places[k] = end - first + at - row_pointers[p]
    return places


@compile_kernel
def places_of_unknowns(
    pivot_pointers: IntArray, row_pointers: IntArray, rows: IntArray, fronts: IntArray, unknowns: IntArray
) -> IntArray:
    """Return the place of ``unknowns[i]`` (in elimination order) in the rows of ``fronts[i]``."""
    places = np.empty(unknowns.size, dtype=np.int64)
    for i in range(unknowns.size):
        f = fronts[i]
        if unknowns[i] < pivot_pointers[f + 1]:
            places[i] = unknowns[i] - pivot_pointers[f]
        else:
            below = rows[row_pointers[f] : row_pointers[f + 1]]
            places[i] = pivot_pointers[f + 1] - pivot_pointers[f] + np.searchsorted(below, unknowns[i])
    return places
