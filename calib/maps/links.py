"""Links: Oja-Hebbian connections between the nodes of two maps, used in both directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index, ReadOnly, Shape
from ..common.choices import check_choice
from ..common.rows import group_sums
from .map import Map
from .settings import LINK

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True)
class Wiring:
    """How links are learned (eq. 5) and read (eq. 6), where the paper does not define it."""

    # whether the bandwidth of eq. 6 is in units of each node's own spacing, so that a dense region
    # is read as finely as its nodes lie; else in units of the map's mean spacing
    local: bool = True
    # whether links are normalised on both sides, c_ij = <a_i a_j> / (<a_i^2> <a_j^2>)^(1/2), the
    # same for both directions; else on the sensory side alone, as eq. 5 has it from motor to
    # sensory nodes
    mutual: bool = True
    bandwidth: float = LINK.bandwidth  # of eq. 6, in units of the spacing.

    def widths(self, network: Map) -> Array:
        """Sigma of eq. 6 of each node, (nodes,), in the unit box."""
        if self.local:
            return self.bandwidth * network.spacings
        return np.full(network.size, self.bandwidth * network.spacing)

    def active_nodes(self, network: Map, u: Array) -> tuple[Index, Array]:
        """Nodes nearest to places (n, d) of the unit box, and their activities, (n, k) (eq. 6).

        They are relative to the winner's, which is never zero even far from every node.
        """
        k = min(LINK.nearest, network.size)
        distance, nodes = network.nearest(u, k)
        exponent = (distance / self.widths(network)[nodes]) ** 2
        least = exponent.min(axis=1, keepdims=True)
        return nodes, np.exp(least - exponent)  # eq. 6

    def activity(self, network: Map, u: Array) -> csr_array:
        """Activity a_j (n, nodes) of the nodes at places (n, d) of the unit box (eq. 6)."""
        from scipy.sparse import csr_array

        nodes, a = self.active_nodes(network, u)
        rows = np.arange(0, a.size + 1, a.shape[1])
        shape = (len(u), network.size)
        entries = (a.ravel(), nodes.ravel(), rows)
        return csr_array(entries, shape=shape)

    def link(self, a_i: csr_array, a_j: csr_array) -> SparseRows:
        """Links (motor nodes, sensory nodes) at the fixed point of Oja's rule (eq. 5).

        Where its mean change vanishes, c_ij = <a_i a_j> / <a_j^2>, or with both sides
        <a_i a_j> / (<a_i^2> <a_j^2>)^(1/2).  Links of a node that was hardly ever active are the
        share 1 - exp(-sum a_j^2) of that, as far as the rule gets at a learning rate of one.

        a_i, a_j : activities (n, nodes) of the motor and of the sensory nodes
        """
        links = (a_i.T @ a_j).tocsr()  # sums of a_i a_j
        rows = entry_rows(links.indptr)
        factor = _oja_factor(a_j)[links.indices]
        if self.mutual:
            factor = np.sqrt(factor * _oja_factor(a_i)[rows])
        links.data *= factor
        return without_weak(links)


WIRINGS = {
    "oja": Wiring(local=False, mutual=False),
    "local": Wiring(local=True, mutual=False),
    "mutual": Wiring(local=False, mutual=True),
    "reciprocal": Wiring(local=True, mutual=True),
}
"""Wirings by name: eq. 5 and 6 with one bandwidth, each refinement alone, and both."""


def wiring_of(links: str) -> Wiring:
    """The wiring of a name."""
    check_choice("links", links, WIRINGS)
    return WIRINGS[links]


def without_weak(links: csr_array | NDArray[np.floating]) -> SparseRows:
    """Links (motor nodes, sensory nodes) without those that are weak for both of their nodes.

    links : sparse or dense
    """
    from scipy.sparse import csr_array

    links = csr_array(links)
    row_max = links.max(axis=1).toarray().ravel()
    column_max = links.max(axis=0).toarray().ravel()
    rows = entry_rows(links.indptr)
    lower_max = np.minimum(row_max[rows], column_max[links.indices])
    nothing = LINK.nothing * links.data.max(initial=0.0)
    weak = links.data < LINK.weak * lower_max
    weak |= links.data <= nothing
    links.data[weak] = 0.0
    links.eliminate_zeros()
    links.sort_indices()
    # as a model file keeps them
    data = links.data.astype(np.float32).astype(float)
    return SparseRows(data, links.indices, links.indptr, links.shape)


def entry_rows(indptr: NDArray[np.integer]) -> Index:
    """Row of each entry (nnz,) of a sparse matrix by rows, from where each row begins."""
    counts = np.diff(indptr)
    return np.repeat(np.arange(len(counts)), counts)


def _oja_factor(a: csr_array) -> Array:
    """Factor (nodes,) on sums of a_i a_j that gives the links of Oja's rule, of one side's a."""
    nodes = a.shape[1]
    square = group_sums(a.indices, a.data**2, nodes)
    active = square > 0
    reached = -np.expm1(-square)
    return np.divide(reached, square, out=np.zeros_like(square), where=active)


@dataclass(frozen=True, eq=False)
class SparseRows(ReadOnly):
    """A sparse matrix by rows; SciPy's `csr_array` has the same attributes."""

    data: Annotated[Array, Shape("nnz", storage="f4")]  # entries, row by row
    indices: Annotated[NDArray[np.int32], Shape("nnz")]  # column of each entry
    # where each row begins, and the end
    indptr: Annotated[NDArray[np.int32], Shape("ends")]
    shape: tuple[int, int]  # rows and columns

    @property
    def rows(self) -> Index:
        """Row of each entry, (nnz,)."""
        return entry_rows(self.indptr)

    def transposed(self) -> SparseRows:
        """The transpose; entries of a row stay in ascending order."""
        columns = self.shape[1]
        # NumPy sorts integers of 16 bits in linear time
        small = np.uint16 if columns <= 1 << 16 else np.uint32
        order = self.indices.astype(small).argsort(kind="stable")
        counts = np.bincount(self.indices, minlength=columns)
        ends = np.cumsum(counts)
        rows = self.rows[order].astype(self.indices.dtype)
        shape = (columns, self.shape[0])
        return SparseRows(self.data[order], rows, np.append(0, ends), shape)

    def take(self, rows: Index) -> SparseRows:
        """Some of the rows, in this order."""
        counts = np.diff(self.indptr)[rows]
        ends = np.cumsum(counts)
        # from each entry's place in the result to its place here
        shift = self.indptr[rows] - (ends - counts)
        shifts = np.repeat(shift, counts)
        place = np.arange(counts.sum()) + shifts
        shape = (len(rows), self.shape[1])
        data = self.data[place]
        columns = self.indices[place]
        return SparseRows(data, columns, np.append(0, ends), shape)
