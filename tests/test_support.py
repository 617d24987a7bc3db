"""Support: where samples were."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.common.scale import TURN, Scale
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.maps.support import Support


def motor_map(shape, periodic):
    dof = len(shape)
    lattice = Lattice(shape)
    units = (lattice.positions() + 0.5) / np.array(shape)
    scale = Scale.of_range(np.zeros(dof), np.where(periodic, TURN, 1.0), (True,) * dof)
    return Map(units, lattice, scale, np.zeros((0, 4)))


def by_hand(motor, visited, u):
    """Distances to all visited nodes, and the box with its margin."""
    gap = motor.scale.difference(u[:, None], motor.units[visited][None])
    nearest = np.linalg.norm(gap, axis=2).min(axis=1)
    apart = (motor.size / np.count_nonzero(visited)) ** (1 / u.shape[1])
    inside = (u >= -motor.spacing) & (u <= 1 + motor.spacing) | motor.scale.periodic
    return inside.all(axis=1) & (nearest <= 3.0 * apart * motor.spacing)


@settings(max_examples=40)
@given(
    st.sampled_from([(9,), (8, 8), (20, 12), (5, 6, 4)]),
    st.integers(0, 2**32 - 1),
    st.floats(0.01, 0.9),
)
def test_a_query_is_known_near_a_visited_node_and_hardly_outside_of_the_box(shape, seed, share):
    rng = np.random.default_rng(seed)
    motor = motor_map(shape, rng.random(len(shape)) < 0.3)
    # a part of the lattice was never visited
    visited = motor.units[:, 0] <= max(share, motor.units[:, 0].min())
    margin = 2.0 * motor.spacing
    u = motor.scale.to_unit(
        motor.scale.from_unit(rng.uniform(-margin, 1 + margin, (400, len(shape))))
    )
    known = Support(motor, visited).covers(u)
    np.testing.assert_array_equal(known, by_hand(motor, visited, u))


def test_where_every_node_was_visited_the_box_and_its_margin_are_known():
    motor = motor_map((6, 6), np.zeros(2, dtype=bool))
    s = motor.spacing
    u = np.array([[0.5, 0.5], [-0.99 * s, 1.0], [-1.01 * s, 1.0], [0.0, 1 + 1.01 * s], [1e300, 0]])
    known = Support(motor, np.ones(36, dtype=bool)).covers(u)
    np.testing.assert_array_equal(known, [True, True, False, False, False])


def test_a_lattice_of_fewer_dimensions_than_joints_leaves_gaps_that_tell_nothing():
    lattice = Lattice((4, 4))
    scale = Scale(np.zeros(3), np.ones(3), np.zeros(3, dtype=bool))
    units = np.column_stack([(lattice.positions() + 0.5) / 4, np.full(16, 0.1)])
    flat = Map(units, lattice, scale, np.zeros((0, 4)))
    visited = np.arange(16) == 0
    assert Support(flat, visited).covers(np.array([[0.9, 0.9, 0.9]])).all()


@pytest.mark.parametrize("far", [np.inf, -np.inf, 1e300])
def test_infinitely_far_is_not_known(far):
    motor = motor_map((6, 6), np.zeros(2, dtype=bool))
    visited = motor.units[:, 0] < 0.5
    assert not Support(motor, visited).covers(np.array([[far, 0.5]])).any()
