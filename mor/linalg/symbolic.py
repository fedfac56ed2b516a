"""Symbolic factorisation: the elimination tree and the fronts."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mor.linalg.block_matrix import BlockStructure, ascending
from mor.linalg.compilation import compile_kernel
from mor.types import BoolArray, FloatArray, IntArray, ranges

if TYPE_CHECKING:
    import scipy.sparse


# ---- Kernels of the symbolic factorisation: elimination tree, counts, amalgamation, rows of the fronts.
#
# Vertices are numbered in the order of elimination ("steps"). ``indptr, indices`` is the whole symmetric
# graph by rows, indices ascending, no diagonal.


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
def places_in_parents(pivot_pointers: IntArray, row_pointers: IntArray, rows: IntArray, parent: IntArray) -> IntArray:
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


# ---- Symbolic factorisation: which unknowns are eliminated together, in which dense fronts, and where
# everything goes.
#
# The multifrontal method (I. S. Duff, J. K. Reid, ACM TOMS 9, 1983) turns a sparse factorisation into a tree
# of small dense ones. A *front* has k pivots, which it eliminates, and r further rows, which they meet and
# whose update it hands on to its parent. All of this depends on the pattern alone and is done once.

# Cost of a front: 1 per front, per entry of its square, per multiplication; in units of about 60
# microseconds.
_PRICES: FloatArray = np.array([1.0, 3e-5, 4e-6])


class Scalars(NamedTuple):
    """Entries of the matrix that go into one front, and their places in its two column-major arrays.

    Attributes:
        to_pivots, to_below: places in the flat array of values.
        in_pivots, in_below: places in the flat arrays of the front.
    """

    to_pivots: IntArray
    in_pivots: IntArray
    to_below: IntArray
    in_below: IntArray


class Entries(NamedTuple):
    """Positions of the stored blocks of the matrix, sorted by front.

    Attributes:
        pointers: (f+1,) the blocks of front i are ``pointers[i]:pointers[i+1]`` in what follows.
        start: start in the flat array of values.
        height, width: shape as stored.
        row, column: place of its first entry in the front (pivots first, then rows), the larger one is the
        row.
        transposed: whether the stored block enters the lower triangle of the front transposed.
        known: what was asked of single entries by front, remembered.
    """

    pointers: IntArray
    start: IntArray
    height: IntArray
    width: IntArray
    row: IntArray
    column: IntArray
    transposed: BoolArray
    known: dict[int, Scalars]

    def of_front(self, f: int) -> tuple[IntArray, IntArray, IntArray, IntArray, IntArray, BoolArray]:
        """Return (start, height, width, row, column, transposed) of the stored blocks that go into front f."""
        part = slice(self.pointers[f], self.pointers[f + 1])
        return (
            self.start[part],
            self.height[part],
            self.width[part],
            self.row[part],
            self.column[part],
            self.transposed[part],
        )

    def scalars_of_front(self, f: int, pivots: int, rows: int) -> Scalars:
        """Return the position of each entry of those blocks in a front of given pivots and further rows."""
        if f not in self.known:
            self.known[f] = _scalars(*self.of_front(f), pivots, rows)
        return self.known[f]


class Elimination(NamedTuple):
    """Plan of the factorisation of every matrix of one pattern.

    Attributes:
        structure: the pattern it was made for.
        permutation: (n,) the scalar unknown eliminated at each place.
        pivot_pointers: (f+1,) front i eliminates the places ``pivot_pointers[i]:pivot_pointers[i+1]``.
        row_pointers: (f+1,) its further rows are ``rows[row_pointers[i]:row_pointers[i+1]]``.
        rows: places in the order of elimination, ascending within a front.
        row_in_parent: for each of ``rows``, its place among the pivots and rows of the parent front.
        parent: (f,) parent front, larger than i; -1 for a root.
        entries: where the values of the matrix go.
    """

    structure: BlockStructure
    permutation: IntArray
    pivot_pointers: IntArray
    row_pointers: IntArray
    rows: IntArray
    row_in_parent: IntArray
    parent: IntArray
    entries: Entries

    @property
    def fronts(self) -> int:
        """Number of fronts."""
        return self.parent.size

    @property
    def pivots(self) -> IntArray:
        """(f,) number of pivots of each front."""
        return np.diff(self.pivot_pointers)

    @property
    def orders(self) -> IntArray:
        """(f,) order of each front."""
        order: IntArray = self.pivots + np.diff(self.row_pointers)
        return order

    @property
    def largest_front(self) -> int:
        """Order of the largest front."""
        return int(self.orders.max(initial=0))

    @property
    def most_waiting(self) -> int:
        """Numbers that wait for other fronts at a time: updates for their parent, or inverses for their children."""
        fronts, row_counts = np.arange(self.fronts), np.diff(self.row_pointers)
        children = np.flatnonzero(self.parent >= 0)
        parents, first_child = self.parent[children], fronts.copy()
        np.minimum.at(first_child, parents, children)
        most = 0
        for begin, end, size in (
            (children, parents, row_counts[children] ** 2),
            (first_child, fronts, self.orders**2),
        ):
            change = np.zeros(self.fronts + 1, dtype=np.int64)
            np.add.at(change, begin, size)
            np.subtract.at(change, end + 1, size)
            most = max(most, int(np.cumsum(change).max(initial=0)))
        return most


def analyse(structure: BlockStructure) -> Elimination:
    """Return the plan of the Cholesky factorisation of matrices with this pattern."""
    unknowns, blocks = structure.unknowns, structure.blocks
    stored = int(structure.position[-1])
    # From this share of stored scalars on, one dense front is cheaper than anything that looks at the pattern.
    if blocks <= 1 or stored > 0.4 * unknowns * (unknowns + 1) / 2:
        one_front = np.array([0, blocks] if blocks else [0], dtype=np.int64)
        order, root = np.arange(blocks, dtype=np.int64), np.full(one_front.size - 1, -1)
        nothing = np.zeros(blocks + 1, dtype=np.int64), np.zeros(0, dtype=np.int64)
        return _plan(structure, order, one_front, root, nothing)
    # Imported here: small systems are one dense front, and done before the sparse library is loaded.
    from mor.linalg.ordering import block_graph, fill_reducing_order

    graph = block_graph(structure)
    order, parent = _postordered_tree(graph, fill_reducing_order(graph))
    permuted = _permuted(graph, order)
    chain_of_step, chain_parent, into = _merged_chains(structure.sizes[order], parent, permuted)
    front_of_chain = into.copy()
    for chain in range(front_of_chain.size - 1, -1, -1):
        front_of_chain[chain] = front_of_chain[front_of_chain[chain]]
    stays, compact = np.unique(front_of_chain, return_inverse=True)
    upward = chain_parent[stays]
    front_parent = np.where(upward >= 0, compact[front_of_chain[upward]], -1)
    return _in_front_order(structure, graph, order, compact[chain_of_step], front_parent)


def _postordered_tree(graph: scipy.sparse.csr_array, order: IntArray) -> tuple[IntArray, IntArray]:
    """Return the order rearranged so that subtrees are contiguous, and the elimination tree in that order."""
    permuted = _permuted(graph, order)
    parent = elimination_tree(*_pattern(permuted))
    post = postorder(parent)
    return order[post], _relabelled(parent, post)


def _merged_chains(
    sizes: IntArray, parent: IntArray, permuted: scipy.sparse.csr_array
) -> tuple[IntArray, IntArray, IntArray]:
    orders = column_orders(*_pattern(permuted), parent, sizes)
    chain_of_step = chains(parent, orders, sizes)
    first = np.flatnonzero(np.diff(chain_of_step, prepend=-1))
    last = np.append(first[1:], parent.size) - 1
    chain_parent = np.where(parent[last] >= 0, chain_of_step[parent[last]], -1)
    pivots = np.add.reduceat(sizes, first)
    into = amalgamate(chain_parent, pivots, orders[first], _PRICES)
    return chain_of_step, chain_parent, into


def _in_front_order(
    structure: BlockStructure,
    graph: scipy.sparse.csr_array,
    order: IntArray,
    front_of_step: IntArray,
    front_parent: IntArray,
) -> Elimination:
    post = postorder(front_parent)
    place = np.empty_like(post)
    place[post] = np.arange(post.size)
    front = place[front_of_step]
    by_front = np.argsort(front, kind="stable")
    first_step = np.concatenate(([0], np.cumsum(np.bincount(front, minlength=post.size)))).astype(np.int64)
    final_order = order[by_front]
    pattern = _pattern(_permuted(graph, final_order))
    return _plan(structure, final_order, first_step, _relabelled(front_parent, post), pattern)


def _plan(
    structure: BlockStructure,
    order: IntArray,
    first_step: IntArray,
    parent: IntArray,
    pattern: tuple[IntArray, IntArray],
) -> Elimination:
    sizes = structure.sizes[order]
    starts = np.concatenate(([0], np.cumsum(sizes))).astype(np.int64)
    step_pointers, steps = rows_of_fronts(*pattern, first_step, parent)
    steps = ascending(step_pointers, steps)
    pivot_pointers = starts[first_step]
    rows = ranges(starts[steps], sizes[steps])
    row_pointers = np.concatenate(([0], np.cumsum(sizes[steps])))[step_pointers].astype(np.int64)
    return Elimination(
        structure,
        ranges(structure.offsets[order], sizes),
        pivot_pointers,
        row_pointers,
        rows,
        places_in_parents(pivot_pointers, row_pointers, rows, parent),
        parent,
        _entries(structure, order, starts, pivot_pointers, row_pointers, rows),
    )


def _entries(
    structure: BlockStructure,
    order: IntArray,
    starts: IntArray,
    pivot_pointers: IntArray,
    row_pointers: IntArray,
    rows: IntArray,
) -> Entries:
    """Return where each stored block goes: into the front that eliminates the earlier of its two blocks."""
    step = np.empty_like(order)
    step[order] = np.arange(order.size)
    columns = structure.columns
    row_start, column_start = starts[step[structure.indices]], starts[step[columns]]
    early, late = np.minimum(row_start, column_start), np.maximum(row_start, column_start)
    front = np.searchsorted(pivot_pointers, early, side="right") - 1
    place = places_of_unknowns(pivot_pointers, row_pointers, rows, front, late)
    by_front = np.argsort(front, kind="stable")
    counts = np.bincount(front, minlength=pivot_pointers.size - 1)
    sizes = structure.sizes
    return Entries(
        pointers=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        start=structure.position[:-1][by_front],
        height=sizes[structure.indices][by_front],
        width=sizes[columns][by_front],
        row=place[by_front],
        column=(early - pivot_pointers[front])[by_front],
        transposed=(row_start < column_start)[by_front],
        known={},
    )


def _scalars(
    start: IntArray,
    height: IntArray,
    width: IntArray,
    row: IntArray,
    column: IntArray,
    transposed: BoolArray,
    pivots: int,
    rows: int,
) -> Scalars:
    """Places of the entries of stored blocks, (height, width) row-major from ``start`` on, and in the front."""
    size = height * width
    block = np.repeat(np.arange(size.size), size)
    stored = ranges(start, size)
    down, across = np.divmod(stored - start[block], width[block])
    turned = transposed[block]
    r = row[block] + np.where(turned, across, down)
    c = column[block] + np.where(turned, down, across)
    inside = row[block] < pivots
    return Scalars(stored[inside], (r + c * pivots)[inside], stored[~inside], (r - pivots + c * rows)[~inside])


def _permuted(graph: scipy.sparse.csr_array, order: IntArray) -> scipy.sparse.csr_array:
    permuted = graph[order][:, order]
    permuted.sort_indices()
    return permuted


def _pattern(graph: scipy.sparse.csr_array) -> tuple[IntArray, IntArray]:
    return graph.indptr.astype(np.int64), graph.indices.astype(np.int64)


def _relabelled(parent: IntArray, order: IntArray) -> IntArray:
    place = np.empty_like(order)
    place[order] = np.arange(order.size)
    upward = parent[order]
    return np.where(upward >= 0, place[upward], -1)
