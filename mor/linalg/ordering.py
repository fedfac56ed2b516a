"""Fill-reducing elimination order of the blocks of a sparse symmetric system.

The order is found on the *block* graph, which is much smaller than the graph of the scalar unknowns. Minimum
degree (J. W. H. Liu, Modification of the minimum-degree algorithm by multiple elimination, ACM TOMS 11, 1985)
comes out of SuperLU, which scipy carries.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from mor.linalg.block_matrix import BlockStructure
from mor.types import IntArray


def block_graph(structure: BlockStructure) -> scipy.sparse.csr_array:
    """Return the symmetric (b, b) graph of the off-diagonal blocks, all values 1, indices ascending."""
    beside = structure.indices != structure.columns
    rows, columns = structure.indices[beside], structure.columns[beside]
    lower = scipy.sparse.coo_array((np.ones(rows.size), (rows, columns)), shape=(structure.blocks,) * 2)
    graph = (lower + lower.T).tocsr()
    graph.sort_indices()
    return graph


def fill_reducing_order(graph: scipy.sparse.csr_array) -> IntArray:
    """Return the (b,) block numbers in the order of their elimination."""
    blocks = graph.shape[0]
    degree = np.diff(graph.indptr)
    # A block that meets more than 10 √b others is a hub (a camera shared by all images): it is eliminated last, where
    # it would end up anyway, because minimum degree spends most of its time on such vertices.
    hub = degree > max(16.0, 10.0 * np.sqrt(blocks))
    rest = np.flatnonzero(~hub)
    hubs = np.flatnonzero(hub)
    inner = _minimum_degree(graph[rest][:, rest] if hubs.size else graph)
    return np.concatenate((rest[inner], hubs[np.argsort(degree[hubs], kind="stable")])).astype(np.int64)


def _minimum_degree(graph: scipy.sparse.csr_array) -> IntArray:
    """Return SuperLU's minimum degree order of a symmetric graph.

    SuperLU gives its order only together with a factorisation. An incomplete factorisation that drops
    whatever it may costs next to nothing, and its order is that of the complete one.
    """
    blocks = graph.shape[0]
    if graph.nnz == 0:
        return np.arange(blocks, dtype=np.int64)
    dominant = scipy.sparse.diags_array(np.diff(graph.indptr) + 1.0) - graph
    incomplete = scipy.sparse.linalg.spilu(
        dominant.tocsc(),
        drop_tol=1.0,
        fill_factor=1.0,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(incomplete.perm_c).astype(np.int64)
