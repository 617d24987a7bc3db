"""Lattices: where nodes stand, who is whose neighbour, and finer lattices from coarse ones."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from calib.maps.lattice import Lattice

shapes = st.lists(st.integers(2, 6), min_size=1, max_size=3).map(tuple)


@given(shapes)
def test_edges_join_exactly_the_nodes_at_lattice_distance_one(shape):
    lattice = Lattice(shape)
    r = lattice.positions()
    distance = np.abs(r[:, None] - r[None]).sum(axis=2)
    expected = {(i, j) for i, j in np.argwhere(distance == 1).tolist() if i < j}
    edges = [tuple(e) for e in lattice.edges().tolist()]
    assert set(edges) == expected
    assert len(edges) == len(expected)


@given(shapes, shapes)
def test_resampling_keeps_linear_functions_of_the_cell_middles(coarse, fine):
    if len(coarse) != len(fine):
        fine = (fine * 3)[: len(coarse)]
    slope = np.arange(1.0, len(coarse) + 1)

    def plane(lattice):
        middles = (lattice.positions() + 0.5) / lattice.shape
        return np.stack([middles @ slope, 1 - middles @ slope], axis=1)

    old, new = Lattice(coarse), Lattice(fine)
    np.testing.assert_allclose(old.resample(plane(old), new), plane(new), atol=1e-12)
