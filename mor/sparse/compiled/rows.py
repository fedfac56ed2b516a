"""Kernels that carry observation rows into a block matrix, and cofactors out of one."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.compilation import compile_kernel
from mor.sparse.compiled.patterns import find_block


@compile_kernel
def segments(
    columns: IntArray, block_of: IntArray, blocks: IntArray, starts: IntArray, ends: IntArray
) -> int:
    """Split one row of columns into runs of equal blocks; columns that are fixed (−1) are left out."""
    count = 0
    for k in range(columns.size):
        if columns[k] < 0:
            continue
        block = block_of[columns[k]]
        if count > 0 and blocks[count - 1] == block and ends[count - 1] == k:
            ends[count - 1] = k + 1
        else:
            blocks[count] = block
            starts[count] = k
            ends[count] = k + 1
            count += 1
    return count


@compile_kernel
def accumulate_rows(
    jacobian: FloatArray,
    misclosure: FloatArray,
    columns: IntArray,
    block_of: IntArray,
    offsets: IntArray,
    indptr: IntArray,
    indices: IntArray,
    position: IntArray,
    values: FloatArray,
    rhs: FloatArray,
) -> None:
    """Add JᵀJ and Jᵀl of whitened observations, (n, m, K) and (n, m), to a block matrix and its right-hand side."""
    n, m, width = jacobian.shape
    blocks = np.empty(width, dtype=np.int64)
    starts = np.empty(width, dtype=np.int64)
    ends = np.empty(width, dtype=np.int64)
    for i in range(n):
        count = segments(columns[i], block_of, blocks, starts, ends)
        for a in range(count):
            for k in range(starts[a], ends[a]):
                for c in range(m):
                    rhs[columns[i, k]] += jacobian[i, c, k] * misclosure[i, c]
            for b in range(count):
                if blocks[a] < blocks[b]:
                    continue
                size = offsets[blocks[b] + 1] - offsets[blocks[b]]
                start = position[find_block(indptr, indices, blocks[a], blocks[b])]
                for k in range(starts[a], ends[a]):
                    row = start + (columns[i, k] - offsets[blocks[a]]) * size - offsets[blocks[b]]
                    for k2 in range(starts[b], ends[b]):
                        total = 0.0
                        for c in range(m):
                            total += jacobian[i, c, k] * jacobian[i, c, k2]
                        values[row + columns[i, k2]] += total


@compile_kernel
def row_cofactors(
    jacobian: FloatArray,
    columns: IntArray,
    block_of: IntArray,
    offsets: IntArray,
    indptr: IntArray,
    indices: IntArray,
    position: IntArray,
    values: FloatArray,
    cofactors: FloatArray,
) -> None:
    """J Q Jᵀ (n, m, m) of observations, from the blocks of Q that the pattern holds."""
    n, m, width = jacobian.shape
    blocks = np.empty(width, dtype=np.int64)
    starts = np.empty(width, dtype=np.int64)
    ends = np.empty(width, dtype=np.int64)
    for i in range(n):
        count = segments(columns[i], block_of, blocks, starts, ends)
        for a in range(count):
            for b in range(count):
                upper = blocks[a] < blocks[b]
                high, low = max(blocks[a], blocks[b]), min(blocks[a], blocks[b])
                size = offsets[low + 1] - offsets[low]
                start = position[find_block(indptr, indices, high, low)]
                for k in range(starts[a], ends[a]):
                    for k2 in range(starts[b], ends[b]):
                        one, other = columns[i, k], columns[i, k2]
                        if upper:
                            one, other = other, one
                        q = values[start + (one - offsets[high]) * size + other - offsets[low]]
                        for c in range(m):
                            for d in range(m):
                                cofactors[i, c, d] += jacobian[i, c, k] * q * jacobian[i, d, k2]
