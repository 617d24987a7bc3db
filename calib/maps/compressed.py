"""Compressed rows: a sparse matrix as three arrays, for what is asked without SciPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index


class Compressed(NamedTuple):
    """A sparse matrix by rows; SciPy's `csr_array` has the same attributes."""

    data: Array  # (nnz,), entries, row by row
    indices: NDArray[np.integer]  # (nnz,), column of each entry
    indptr: NDArray[np.integer]  # (rows + 1,), where each row begins, and the end
    shape: tuple[int, int]  # rows and columns

    @property
    def rows(self) -> Index:
        """Row of each entry, (nnz,)."""
        return np.repeat(np.arange(self.shape[0]), np.diff(self.indptr))

    def transposed(self) -> Compressed:
        """The same by columns; rows stay ascending within each."""
        columns = self.shape[1]
        small = self.indices.astype(np.uint16 if columns <= 1 << 16 else np.uint32)
        order = small.argsort(kind="stable")  # of 16 bits linear in their number
        ends = np.cumsum(np.bincount(self.indices, minlength=columns))
        rows = self.rows[order].astype(self.indices.dtype)
        return Compressed(self.data[order], rows, np.append(0, ends), (columns, self.shape[0]))

    def take(self, rows: Index) -> Compressed:
        """Some of the rows, in this order."""
        counts = np.diff(self.indptr)[rows]
        ends = np.cumsum(counts)
        place = np.arange(counts.sum()) + np.repeat(self.indptr[rows] - ends + counts, counts)
        shape = (len(rows), self.shape[1])
        return Compressed(self.data[place], self.indices[place], np.append(0, ends), shape)
