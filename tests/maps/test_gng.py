"""Growing neural gas: ages, insertion, removal, growth, and what a gain does to it."""

import numpy as np
import pytest
from small_maps import points

import calib
from calib.maps.gng import Gas, insert, present_gng


def gas(weights, pairs, age=None, error=None):
    weights = np.array(weights, dtype=float)
    pairs = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    age = np.zeros(len(pairs)) if age is None else np.array(age, dtype=float)
    error = np.zeros(len(weights)) if error is None else np.array(error, dtype=float)
    return Gas(weights, error, pairs, age)


def edges(g):
    return {tuple(p): a for p, a in zip(g.pairs.tolist(), g.age.tolist(), strict=True)}


def test_one_sample_does_what_the_source_says():
    g = gas([[0.0], [1.0], [3.0]], [[0, 1], [0, 2]], age=[4, 7])
    present_gng(g, np.array([[0.2]]), decay=0.9)
    # node 0 wins, node 1 is second: the winner moves by epsilon_b, both neighbours by
    # epsilon_n, the edge to the second is renewed, the other edge of the winner ages
    np.testing.assert_allclose(g.weights[:, 0], [0.02, 1 - 0.0048, 3 - 0.0168], atol=1e-12)
    assert edges(g) == {(0, 1): 0.0, (0, 2): 8.0}
    np.testing.assert_allclose(g.error, [0.9 * 0.04, 0.0, 0.0])


def test_an_edge_beyond_the_oldest_age_is_removed_and_a_node_without_edges_too():
    g = gas([[0.0], [1.0], [5.0]], [[0, 1], [0, 2]], age=[0, 50])
    present_gng(g, np.array([[0.1]]))
    assert edges(g) == {(0, 1): 0.0}
    assert len(g.weights) == len(g.error) == 2


def test_a_node_is_inserted_between_the_worst_and_its_worst_neighbour():
    g = gas([[0.0], [1.0], [3.0], [9.0]], [[0, 1], [1, 2], [2, 3]], error=[1, 8, 4, 2])
    new = insert(g)
    assert g.weights[new] == pytest.approx(2.0)
    assert set(edges(g)) == {(0, 1), (2, 3), (1, new), (2, new)}
    np.testing.assert_allclose(g.error, [1, 4, 2, 2, 4])


def test_a_gas_grows_to_its_size_and_follows_its_samples():
    x = points(3000)
    network = calib.SOM((10, 10), "gng").fit(x)
    assert 95 <= network.size <= 100
    assert network.quantization_error(x) < 1.15 * 0.377 / 10
    assert network.topographic_error(x) < 0.05
    assert network.history[0, 0] < network.history[-1, 0]


def test_a_gas_leaves_a_hole_empty_that_a_lattice_crosses():
    x = points(6000)
    x = x[np.linalg.norm(x - 0.5, axis=1) > 0.3]
    gap = {}
    for name in ("som", "gng"):
        w = calib.SOM((10, 10), name).fit(x).weights
        gap[name] = int(np.sum(np.linalg.norm(w - 0.5, axis=1) < 0.22))
    assert gap["gng"] == 0 < gap["som"]
