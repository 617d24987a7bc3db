"""Trust: answers within the joints' range, where the bound on the position means something."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import measured, trained

from calib.common.scale import TURN, Scale
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.maps.node_bounds import blend_nodes
from calib.model.trust import MOST_SHARE, ROUNDED, Trust


def motor_map(shape, periodic):
    dof = len(shape)
    lattice = Lattice(shape)
    units = (lattice.positions() + 0.5) / np.array(shape)
    scale = Scale.of_range(np.zeros(dof), np.where(periodic, TURN, 1.0), (True,) * dof)
    return Map(units, lattice, scale, np.zeros((0, 4)))


SHAPES = st.sampled_from([(9,), (8, 8), (20, 12), (5, 6, 4)])


@settings(max_examples=40)
@given(SHAPES, st.integers(0, 2**32 - 1), st.floats(0.1, 3.0))
def test_a_query_is_answered_in_range_where_the_bound_is_small(shape, seed, most):
    rng = np.random.default_rng(seed)
    motor = motor_map(shape, rng.random(len(shape)) < 0.3)
    bounds = rng.uniform(0.0, 2.0, motor.size)
    u = rng.uniform(-0.2, 1.2, (400, len(shape)))
    u = motor.scale.to_unit(motor.scale.from_unit(u))
    # an encoder at its stop may read a hair beyond it
    inside = ((u >= -ROUNDED) & (u <= 1.0 + ROUNDED) | motor.scale.periodic).all(axis=1)
    small = blend_nodes(motor, bounds, np.clip(u, -ROUNDED, 1.0 + ROUNDED)) <= most
    np.testing.assert_array_equal(Trust(motor, bounds, most).covers(u), inside & small)


@settings(max_examples=20)
@given(SHAPES, st.integers(0, 2**32 - 1))
def test_where_every_bound_is_small_the_whole_range_is_answered(shape, seed):
    motor = motor_map(shape, np.zeros(len(shape), dtype=bool))
    u = np.random.default_rng(seed).random((200, len(shape)))
    assert Trust(motor, np.full(motor.size, 0.5), 0.5).covers(u).all()


def test_the_range_ends_at_the_limits_but_for_rounding():
    motor = motor_map((6, 6), np.zeros(2, dtype=bool))
    trust = Trust(motor, np.zeros(36), 1.0)
    u = np.array([[0.5, -0.5 * ROUNDED], [1 + 0.5 * ROUNDED, 0.5], [0.5, -2 * ROUNDED], [1.01, 0]])
    np.testing.assert_array_equal(trust.covers(u), [True, True, False, False])
    np.testing.assert_array_equal(trust.in_range(u)[2], [True, False])


def test_a_joint_that_turns_round_has_no_end():
    motor = motor_map((6, 6), np.array([True, False]))
    u = np.array([[-0.3, 0.5], [7.2, 0.5], [0.5, -0.3]])
    np.testing.assert_array_equal(Trust(motor, np.zeros(36), 1.0).covers(u), [True, True, False])


@pytest.mark.parametrize("far", [np.inf, -np.inf, 1e300])
def test_infinitely_far_is_not_answered(far):
    motor = motor_map((6, 6), np.zeros(2, dtype=bool))
    bounds = np.where(motor.units[:, 0] < 0.5, 0.0, 2.0)
    assert not Trust(motor, bounds, 1.0).covers(np.array([[far, 0.5]])).any()


def test_a_bound_grows_away_from_where_it_is_known():
    """Without a body a node's bound holds near it; beyond, the position may change."""
    motor = motor_map((6, 6), np.zeros(2, dtype=bool))
    known = np.full(36, 0.05)
    trust = Trust(motor, np.full(36, 0.1), 0.12, known, growth=2.0)
    node = motor.units[14]
    for away, bound in ((0.0, 0.1), (0.04, 0.1), (0.055, 0.11), (0.08, 0.16)):
        u = node[None] + [away, 0.0]
        np.testing.assert_allclose(trust.bound(trust.bounds, u), bound, atol=1e-12)
        assert trust.covers(u).all() == (bound <= 0.12 + 1e-9)


@pytest.mark.parametrize("make", [lambda: trained("two_link"), measured])
def test_a_model_trusts_its_bound_on_the_true_position_up_to_a_tenth_of_its_reach(make):
    model = make()
    assert model.trust.most == MOST_SHARE * model.reach == 0.1 * model.reach
    assert model.trust.bounds is model.model_bounds
    # two_link reaches 0.55 m; half of what it moves through is less
    assert 0.2 < model.reach < 0.55
