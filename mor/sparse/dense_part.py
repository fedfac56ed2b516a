"""A part of a block matrix as one dense matrix: some blocks, and everything that is stored between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray, ranges
from mor.sparse.block_matrix import BlockStructure


@dataclass(frozen=True)
class DensePart:
    """Some blocks of a pattern, their unknowns numbered from 0.

    Attributes:
        structure: the pattern.
        blocks: (b,) the blocks, ascending.
        unknowns: (n,) their unknowns, ascending.
        numbers: stored blocks of the pattern with both blocks among them.
    """

    structure: BlockStructure
    blocks: IntArray
    unknowns: IntArray
    numbers: IntArray

    @cached_property
    def stored(self) -> BoolArray:
        """(b, b) whether two blocks meet in the pattern."""
        found = np.zeros((self.blocks.size, self.blocks.size), dtype=np.bool_)
        one, other = (np.searchsorted(self.blocks, part) for part in self._rows_and_columns())
        found[one, other] = found[other, one] = True
        return found

    def numbers_of(self, unknowns: IntArray) -> IntArray:
        """Numbers, of the same shape, of unknowns of the whole matrix; n where they are -1."""
        found: IntArray = np.where(
            unknowns >= 0, np.searchsorted(self.unknowns, unknowns), self.unknowns.size
        )
        return found

    def add_to(self, values: FloatArray, dense: FloatArray) -> None:
        """Add a symmetric (n, n) matrix to the values of the whole one, in place; what is not stored is left out."""
        for places, rows, columns in self._places:
            values[places] += dense[rows[:, :, None], columns[:, None, :]]

    def of(self, values: FloatArray) -> FloatArray:
        """The (n, n) part of a matrix with these values, zero if nothing is stored."""
        dense = np.zeros((self.unknowns.size, self.unknowns.size))
        for places, rows, columns in self._places:
            stored = values[places]
            dense[rows[:, :, None], columns[:, None, :]] = stored
            dense[columns[:, :, None], rows[:, None, :]] = stored.transpose(0, 2, 1)
        return dense

    def _rows_and_columns(self) -> tuple[IntArray, IntArray]:
        """Block rows and block columns of the stored blocks."""
        column = np.searchsorted(self.structure.indptr, self.numbers, side="right") - 1
        return self.structure.indices[self.numbers], column

    @cached_property
    def _places(self) -> list[tuple[IntArray, IntArray, IntArray]]:
        """Shape by shape: places (m, r, c) in the flat values, rows (m, r) and columns (m, c) of blocks."""
        structure, sizes = self.structure, self.structure.sizes
        one, other = self._rows_and_columns()
        first_row, first_column = (self.numbers_of(structure.offsets[part]) for part in (one, other))
        base = int(sizes[self.blocks].max(initial=0)) + 1
        shapes = sizes[one] * base + sizes[other]
        found = []
        for shape in np.unique(shapes).tolist():
            here = np.flatnonzero(shapes == shape)
            r, c = divmod(shape, base)
            start = structure.position[self.numbers[here]]
            places = start[:, None, None] + np.arange(r * c).reshape(r, c)
            rows, columns = first_row[here, None] + np.arange(r), first_column[here, None] + np.arange(c)
            found.append((places, rows, columns))
        return found


def dense_part(structure: BlockStructure, blocks: IntArray) -> DensePart:
    """Some blocks (ascending) of a pattern, to be looked at as one dense matrix."""
    among = np.zeros(structure.blocks, dtype=np.bool_)
    among[blocks] = True
    numbers = ranges(structure.indptr[blocks], np.diff(structure.indptr)[blocks])
    unknowns = ranges(structure.offsets[blocks], structure.sizes[blocks])
    return DensePart(structure, blocks, unknowns, numbers[among[structure.indices[numbers]]])
