"""Links: activity (eq. 6), Oja's rule (eq. 5) and its fixed point."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csr_array
from small_maps import box, grid, network, points

from calib import SOM, Association
from calib.maps.links import WIRINGS, SparseRows, Wiring

BANDWIDTH = WIRINGS["oja"].bandwidth


def activity(nodes, u, bandwidth=BANDWIDTH, *, local=False):
    return Wiring(local=local, bandwidth=bandwidth).activity(nodes, u)


def link(a_motor, a_sensory, *, mutual=False):
    found = Wiring(mutual=mutual).link(a_motor, a_sensory)
    return csr_array((found.data, found.indices, found.indptr), found.shape)


@pytest.fixture(scope="module")
def pair():
    """Activities of two 3x3 maps for samples of a smooth function."""
    u = points(400)
    v = np.stack([u[:, 1] ** 1.3, 1 - u[:, 0]], axis=1)
    return activity(grid(3), u), activity(grid(3), v)


@pytest.mark.parametrize("bandwidth", [BANDWIDTH, 1.5])
def test_activity_is_equation_6_relative_to_the_winner(bandwidth):
    nodes, u = grid(3), points(20)
    square = ((u[:, None] - nodes.units[None]) ** 2).sum(axis=2)
    expected = np.exp(-square / (bandwidth * nodes.spacing) ** 2)
    expected /= expected.max(axis=1, keepdims=True)
    found = activity(nodes, u, bandwidth).toarray()
    assert_allclose(found, expected, rtol=1e-9, atol=1e-300)


def test_a_local_bandwidth_is_that_of_each_node():
    even, u = grid(5), points(30)
    own, common = (activity(even, u, local=local).toarray() for local in (True, False))
    assert_allclose(own, common, rtol=1e-9, atol=1e-12)
    # nodes at 0, 1, 3: spacings 1, 1.5, 2
    uneven = network([[0.0], [1.0], [3.0]], (3,), box(False))
    a = activity(uneven, np.array([[1.2]]), 0.8, local=True).toarray()[0]
    z = (np.array([1.2, 0.2, 1.8]) / (0.8 * np.array([1.0, 1.5, 2.0]))) ** 2
    assert_allclose(a, np.exp(z.min() - z))


def test_links_are_the_fixed_point_of_ojas_rule_but_for_weak_ones(pair):
    a_motor, a_sensory = (a.toarray() for a in pair)
    dense = a_motor.T @ a_sensory / (a_sensory**2).sum(axis=0)
    links = link(*pair).toarray()
    kept = links > 0
    assert_allclose(links[kept], dense[kept], rtol=1e-6)
    weakest = np.minimum(dense.max(axis=1)[:, None], dense.max(axis=0)[None])
    assert (dense[~kept] < 0.02 * weakest[~kept] * 1.001).all()
    assert kept.any(axis=0).all()
    assert kept.any(axis=1).all()
    # a node that was hardly active has hardly a link
    one, faint = csr_array(np.array([[1.0]])), csr_array(np.array([[1e-3]]))
    assert link(one, faint).toarray()[0, 0] == pytest.approx(1e-3, rel=1e-3)
    assert link(one, one).toarray()[0, 0] == pytest.approx(1 - np.exp(-1), rel=1e-6)


def test_mutual_links_are_the_same_in_both_directions(pair):
    there = link(*pair, mutual=True).toarray()
    back = link(*pair[::-1], mutual=True).toarray()
    assert_allclose(there, back.T, rtol=1e-6)
    # the cosine between the activities of two nodes, where they have been active enough
    i, j = (a.toarray() / np.linalg.norm(a.toarray(), axis=0) for a in pair)
    kept = there > 0
    assert_allclose(there[kept], (i.T @ j)[kept], rtol=1e-6)


def line(places, periodic=False, d=1):
    """Nodes on a line in `d` dimensions, joined in a row."""
    units = np.zeros((len(places), d))
    units[:, 0] = places
    return network(units, (len(places),), box(*[periodic] * d))


def linked(motor, sensory, dense):
    links = csr_array(np.array(dense))
    rows = SparseRows(links.data, links.indices, links.indptr, links.shape)
    return Association(motor, sensory, rows)


FORKED = linked(line([0.0, 1.0]), line([0.1, 0.4, 0.9], d=2), [[0.2, 0.0, 0.7], [0.4, 0.5, 0.0]])
"""Two motor nodes, each linked to two of three sensory nodes."""
ONE_TO_ONE = linked(line([0.0, 0.5, 1.0]), line([0.0, 0.5, 1.0], d=2), np.eye(3))


def active(u, nodes):
    """Equation 6 of nodes that are evenly apart."""
    return np.exp(-((u - nodes) ** 2) / (BANDWIDTH * (nodes[1] - nodes[0])) ** 2)


def test_the_winner_answers_with_its_strongest_partner_and_activity_with_the_weighted_mean():
    said = FORKED.forward(np.array([[0.2], [0.7]]), "winner")
    assert said.tolist() == [[0.9, 0.0], [0.4, 0.0]]
    said = ONE_TO_ONE.inverses(np.array([[0.3, 0.0], [0.9, 0.0]]), np.full((2, 1), 0.5))["winner"]
    assert said.tolist() == [[0.5], [1.0]]
    # of the partners, through the links
    u = np.array([[0.3], [0.5]])
    shares = active(u, np.array([0.0, 1.0])) @ [[0.2, 0.0, 0.7], [0.4, 0.5, 0.0]]
    expected = shares @ [0.1, 0.4, 0.9] / shares.sum(axis=1)
    assert_allclose(FORKED.forward(u, "activity")[:, 0], expected, rtol=1e-12)
    nodes = np.array([0.0, 0.5, 1.0])
    a = active(0.25, nodes)
    said = ONE_TO_ONE.inverses(np.array([[0.25, 0.0]]), np.array([[0.5]]))["activity"]
    assert_allclose(said, [[a @ nodes / a.sum()]], rtol=1e-9)


@pytest.mark.parametrize(
    ("wishes", "winner", "activity"),
    [
        ([0.0, 0.45], 0.1, (0.1 * 1.0 + 0.125 * 0.5) / 1.5),
        ([0.55, 1.0], 0.9, 0.875 * 0.25 + 0.9 * 0.75),
    ],
)
def test_the_branch_near_the_wish_answers_and_branches_are_never_averaged(wishes, winner, activity):
    # motor nodes 4, 5 and 35, 36 of 41 reach one position, the middle one another
    links = np.zeros((41, 2))
    links[[4, 5, 35, 36], 0] = 1.0, 0.5, 0.25, 0.75
    links[20, 1] = 1.0
    branching = linked(line(np.linspace(0, 1, 41)), line([0.2, 0.8], d=2), links)
    said = branching.inverses(np.array([[0.2, 0.0]] * 2), np.array(wishes)[:, None])
    assert_allclose(said["winner"], winner, rtol=1e-6)
    assert_allclose(said["activity"], activity, rtol=1e-6)


def test_a_branch_across_the_seam_of_a_turn_is_one_branch():
    motor = line([0.05, 0.35, 0.65, 0.95], periodic=True)
    pair = linked(motor, line([0.2, 0.8], d=2), [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
    said = pair.inverses(np.array([[0.2, 0.0]]), np.array([[0.9]]))["activity"][0, 0]
    assert min(said % 1.0, -said % 1.0) < 0.05


@pytest.mark.parametrize("rule", ["batch", "online"])
def test_samples_at_one_place_leave_readouts_without_a_hole(rule):
    """All nodes of a map at one place have no spacing: nothing is divided by it."""
    q = points(200, seed=1)
    pair = SOM(4, rule=rule, epochs=1).fit_pair(q, np.ones_like(q))
    assert_allclose(pair.predict(q, "linear"), 1.0, atol=1e-9)
    v = pair.sensory.scale.to_unit(np.ones_like(q))
    for answer in pair.inverses(v, pair.motor.scale.to_unit(q)).values():
        assert np.isfinite(answer).all()
