"""Compressed rows: a sparse matrix as three arrays, for what is asked without SciPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Compressed(NamedTuple):
    """A sparse matrix by rows; SciPy's `csr_array` has the same attributes.

    Attributes
    ----------
    data : (nnz,) array
        Entries, row by row.
    indices : (nnz,) int array
        Column of each entry.
    indptr : (rows + 1,) int array
        Where each row begins, and the end.
    shape : (int, int)
        Rows and columns.
    """

    data: Array
    indices: NDArray[np.integer]
    indptr: NDArray[np.integer]
    shape: tuple[int, int]

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
