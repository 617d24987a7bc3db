"""Links: activity (eq. 6), Oja's rule (eq. 5) and its fixed point."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from small_maps import UNIT_BOX, box, points

from calib.maps.lattice import Lattice
from calib.maps.links import BANDWIDTH, Wiring
from calib.maps.map import Map


def grid(n, m=None):
    shape = (n, m or n)
    lattice = Lattice(shape)
    return Map(lattice.positions() / (np.array(shape) - 1), lattice, UNIT_BOX, np.zeros((0, 4)))


def activity(network, u, bandwidth=BANDWIDTH, *, local=False):
    return Wiring(local=local, bandwidth=bandwidth).activity(network, u)


def link(a_motor, a_sensory, *, mutual=False):
    squares = (np.asarray(a.multiply(a).sum(axis=0)).ravel() for a in (a_motor, a_sensory))
    found = Wiring(mutual=mutual).link((a_motor.T @ a_sensory).tocsr(), *squares)
    return csr_array((found.data, found.indices, found.indptr), found.shape)


def equation_6(network, u, bandwidth):
    square = ((u[:, None] - network.units[None]) ** 2).sum(axis=2)
    a = np.exp(-square / (bandwidth * network.spacing) ** 2)
    return a / a.max(axis=1, keepdims=True)


def stationary(a_motor, a_sensory):
    return a_motor.T @ a_sensory / (a_sensory**2).sum(axis=0)


@pytest.fixture(scope="module")
def pair():
    """Activities of two 3x3 maps for samples of a smooth function."""
    u = points(400)
    v = np.stack([u[:, 1] ** 1.3, 1 - u[:, 0]], axis=1)
    return activity(grid(3), u).toarray(), activity(grid(3), v).toarray()


@pytest.mark.parametrize("bandwidth", [BANDWIDTH, 1.5])
def test_activity_is_equation_6_relative_to_the_winner(bandwidth):
    network, u = grid(3), points(20)
    a = activity(network, u, bandwidth).toarray()
    np.testing.assert_allclose(a, equation_6(network, u, bandwidth), rtol=1e-9, atol=1e-300)


def test_a_local_bandwidth_is_that_of_each_node():
    even, u = grid(5), points(30)
    np.testing.assert_allclose(
        activity(even, u, local=True).toarray(), activity(even, u).toarray(), rtol=1e-9, atol=1e-12
    )
    # nodes at 0, 1, 3: spacings 1, 1.5, 2
    line = Map(np.array([[0.0], [1.0], [3.0]]), Lattice((3,)), box(False), np.zeros((0, 4)))
    a = activity(line, np.array([[1.2]]), 0.8, local=True).toarray()[0]
    z = (np.array([1.2, 0.2, 1.8]) / (0.8 * np.array([1.0, 1.5, 2.0]))) ** 2
    np.testing.assert_allclose(a, np.exp(z.min() - z))


def test_activity_crosses_the_seam_of_a_joint_that_turns_round():
    ring = Map(
        np.array([[0.05], [0.35], [0.65], [0.95]]), Lattice((4,)), box(True), np.zeros((0, 4))
    )
    a = activity(ring, np.array([[0.0]])).toarray()[0]
    assert a[0] == pytest.approx(a[3])
    assert a[0] > 0.99 > a[1]


def test_links_are_the_fixed_point_of_ojas_rule_but_for_weak_ones(pair):
    dense = stationary(*pair)
    links = link(*(csr_array(a) for a in pair)).toarray()
    kept = links > 0
    np.testing.assert_allclose(links[kept], dense[kept], rtol=1e-6)
    weakest = np.minimum(dense.max(axis=1)[:, None], dense.max(axis=0)[None])
    assert (dense[~kept] < 0.02 * weakest[~kept] * 1.001).all()
    assert kept.any(axis=0).all()
    assert kept.any(axis=1).all()


def test_mutual_links_are_the_same_in_both_directions(pair):
    a_motor, a_sensory = (csr_array(a) for a in pair)
    there = link(a_motor, a_sensory, mutual=True).toarray()
    back = link(a_sensory, a_motor, mutual=True).toarray()
    np.testing.assert_allclose(there, back.T, rtol=1e-6)
    # the cosine between the activities of two nodes, where they have been active enough
    i, j = (np.asarray(a) / np.linalg.norm(a, axis=0) for a in pair)
    cosine = i.T @ j
    kept = there > 0
    np.testing.assert_allclose(there[kept], cosine[kept], rtol=1e-6)


def test_a_node_that_was_hardly_active_has_hardly_a_link():
    one = csr_array(np.array([[1.0]]))
    faint = csr_array(np.array([[1e-3]]))
    assert link(one, faint).toarray()[0, 0] == pytest.approx(1e-3, rel=1e-3)
    assert link(one, one).toarray()[0, 0] == pytest.approx(1 - np.exp(-1), rel=1e-6)
