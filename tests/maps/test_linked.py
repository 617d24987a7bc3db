"""Readouts of the links, by hand on hand-made maps and links."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from calib.common.scale import TURN, Scale
from calib.maps.association import Association
from calib.maps.lattice import Lattice
from calib.maps.links import Compressed
from calib.maps.map import Map
from calib.maps.settings import LINKS


def line(places, periodic=False, d=1):
    """Nodes on a line in `d` dimensions, joined in a row."""
    units = np.zeros((len(places), d))
    units[:, 0] = places
    scale = Scale(np.zeros(d), np.where(periodic, TURN, np.ones(d)), np.full(d, periodic))
    return Map(units, Lattice((len(places),)), scale, np.zeros((0, 4)))


def associate(motor, sensory, links):
    dense = np.zeros((motor.size, sensory.size))
    for (i, j), strength in links.items():
        dense[i, j] = strength
    return linked(motor, sensory, dense)


def linked(motor, sensory, dense):
    links = csr_array(dense)
    rows = Compressed(links.data, links.indices, links.indptr, links.shape)
    return Association(motor, sensory, rows)


@pytest.fixture
def one_to_one():
    """Three motor nodes, each linked to one of three sensory nodes."""
    links = {(0, 0): 1.0, (1, 1): 1.0, (2, 2): 1.0}
    return associate(line([0.0, 0.5, 1.0]), line([0.0, 0.5, 1.0], d=2), links)


@pytest.fixture
def two_branches():
    """One position that motor nodes 4, 5 and 35, 36 of 41 reach, and one in the middle."""
    links = {(4, 0): 1.0, (5, 0): 0.5, (35, 0): 0.25, (36, 0): 0.75, (20, 1): 1.0}
    return associate(line(np.linspace(0, 1, 41)), line([0.2, 0.8], d=2), links)


def test_winner_forward_is_the_winners_strongest_partner():
    sensory = line([0.1, 0.4, 0.9], d=2)
    links = {(0, 0): 0.2, (0, 2): 0.7, (1, 1): 0.5, (1, 0): 0.4}
    pair = associate(line([0.0, 1.0]), sensory, links)
    said = pair.forward(np.array([[0.2], [0.7]]), "winner")
    assert said.tolist() == [[0.9, 0.0], [0.4, 0.0]]


def test_activity_forward_is_the_mean_of_the_partners_weighted_through_the_links():
    sensory = line([0.1, 0.4, 0.9], d=2)
    c = np.array([[0.2, 0.0, 0.7], [0.4, 0.5, 0.0]])
    pair = linked(line([0.0, 1.0]), sensory, c)
    u = np.array([[0.3], [0.5]])
    a = np.exp(-((u - [[0.0, 1.0]]) ** 2) / LINKS.bandwidth**2)  # eq. 6, spacing 1
    expected = (a @ c @ [0.1, 0.4, 0.9]) / (a @ c).sum(axis=1)
    np.testing.assert_allclose(pair.forward(u, "activity")[:, 0], expected, rtol=1e-12)


def test_activity_inverse_blends_what_the_active_nodes_are_linked_to(one_to_one):
    v = np.array([[0.25, 0.0]])
    a = np.exp(-((0.25 - np.array([0.0, 0.5, 1.0])) ** 2) / (LINKS.bandwidth * 0.5) ** 2)
    expected = (a @ [0.0, 0.5, 1.0]) / a.sum()
    said = one_to_one.inverses(v, np.array([[0.5]]))["activity"]
    np.testing.assert_allclose(said, [[expected]], rtol=1e-9)


def test_winner_inverse_is_the_strongest_partner(one_to_one):
    v = np.array([[0.3, 0.0], [0.9, 0.0]])
    said = one_to_one.inverses(v, np.full((2, 1), 0.5))["winner"]
    assert said.tolist() == [[0.5], [1.0]]


@pytest.mark.parametrize(
    ("near", "winner", "activity"),
    [
        (0.0, 0.1, (0.1 * 1.0 + 0.125 * 0.5) / 1.5),
        (0.45, 0.1, (0.1 * 1.0 + 0.125 * 0.5) / 1.5),
        (0.55, 0.9, 0.875 * 0.25 + 0.9 * 0.75),
        (1.0, 0.9, 0.875 * 0.25 + 0.9 * 0.75),
    ],
)
def test_the_branch_near_to_the_wish_answers_and_branches_are_never_averaged(
    two_branches, near, winner, activity
):
    v, wish = np.array([[0.2, 0.0]]), np.array([[near]])
    assert two_branches.inverses(v, wish)["winner"][0, 0] == pytest.approx(winner)
    said = two_branches.inverses(v, wish)["activity"][0, 0]
    assert said == pytest.approx(activity)


def test_a_branch_across_the_seam_of_a_turn_is_one_branch():
    motor = line([0.05, 0.35, 0.65, 0.95], periodic=True)
    pair = associate(motor, line([0.2, 0.8], d=2), {(0, 0): 1.0, (3, 0): 1.0, (1, 1): 1.0})
    said = pair.inverses(np.array([[0.2, 0.0]]), np.array([[0.9]]))["activity"][0, 0]
    assert min(said % 1.0, -said % 1.0) < 0.05
