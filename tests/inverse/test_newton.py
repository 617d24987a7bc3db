"""Steps in joint space on arms whose forward map is a closed form, not a learned one."""

import numpy as np
import pytest
from closed_arms import THREE, TWO, around, elbow_of, newton_of

from calib.inverse.closest import closest
from calib.inverse.newton import CLOSE


@pytest.fixture
def two():
    return newton_of(TWO, [0.0, 0.2], [np.pi / 2, 2.7])


@pytest.fixture
def three():
    return newton_of(THREE, [0.0, 0.26, -1.57], [1.57, 2.6, 1.57])


# --- refine -----------------------------------------------------------------------------


def test_from_nearby_the_closed_form_is_met_in_a_few_steps(two):
    goal = around(200, 2)
    x = two.task.forward.value(goal)
    two.task.forward.asked = 0
    u, left = two.refine(goal + 0.03 * (around(200, 2, 1) - 0.5), x)
    np.testing.assert_allclose(u, goal, atol=1e-12)
    np.testing.assert_allclose(
        left, np.linalg.norm(two.task.forward.value(u) - x, axis=1), atol=1e-17
    )
    assert two.task.forward.asked <= 9  # quadratic: 1e-2, 1e-4, 1e-8, 1e-16 and a few more


def test_from_far_away_the_target_is_met_on_one_of_its_branches():
    newton = newton_of(TWO, [-3.0, -2.9], [3.0, 2.9])
    start, x = around(300, 2, 2), newton.task.forward.value(around(300, 2, 3))
    u, left = newton.refine(start, x)
    met = left < 1e-12
    assert met.mean() > 0.75  # the others came to rest where the arm is stretched, or at a limit
    elbow = newton.scale.from_unit(u)[met, 1]
    np.testing.assert_allclose(np.abs(elbow), elbow_of(x[met]), atol=1e-6)
    np.testing.assert_allclose(
        left, np.linalg.norm(newton.task.forward.value(u) - x, axis=1), atol=1e-15
    )
    assert newton.task.forward.asked <= 43  # forty steps, the first look, and both calls here


def test_a_start_on_its_target_stays(two):
    goal = around(20, 2)
    u, left = two.refine(goal, two.task.forward.value(goal))
    np.testing.assert_array_equal(u, goal)
    np.testing.assert_array_equal(left, 0.0)
    mixed = goal.copy()
    mixed[::2] += 0.02
    again, left = two.refine(mixed, two.task.forward.value(goal))
    np.testing.assert_array_equal(again[1::2], goal[1::2])
    np.testing.assert_allclose(again, goal, atol=1e-12)
    assert left.max() < 1e-14


def test_a_tolerance_saves_steps_and_is_kept(two):
    goal = around(100, 2)
    x, start = two.task.forward.value(goal), around(100, 2, 5)
    two.task.forward.asked = 0
    _, left = two.refine(start, x, 1e-3)
    coarse = two.task.forward.asked
    assert left.max() <= 1e-3 * two.extent
    assert left.max() > 1e-6 * two.extent
    two.task.forward.asked = 0
    two.refine(start, x)
    assert coarse < two.task.forward.asked


def test_what_was_given_is_left_as_it_was(two):
    start, x = around(10, 2), two.task.forward.value(around(10, 2, 1))
    kept = start.copy(), x.copy()
    two.refine(start, x)
    two.settle(start, x, start)
    closest(two, start, x)
    np.testing.assert_array_equal(start, kept[0])
    np.testing.assert_array_equal(x, kept[1])


def test_many_rows_are_a_few_rows_often(two):
    start, goal = around(4200, 2), around(4200, 2, 1)
    x = two.task.forward.value(goal)
    u, left = two.refine(start, x)
    some = [0, 1, 4094, 4095, 4096, 4199]
    again, left_again = two.refine(start[some], x[some])
    np.testing.assert_allclose(u[some], again, atol=1e-9)
    np.testing.assert_allclose(left[some], left_again, atol=1e-9)
    assert (len(u), len(left)) == (4200, 4200)


def test_joints_stay_inside_and_the_others_take_over():
    newton = newton_of(THREE, [0.0, 0.26, -1.57], [1.57, 2.6, 1.57])
    goal = around(200, 3, 4)
    goal[:, 0] = 0.0  # the shoulder at its limit
    start = np.clip(goal + 0.1 * (around(200, 3, 5) - 0.5), 0, 1)
    start[:, 0] = 0.0
    u, left = newton.refine(start, newton.task.forward.value(goal))
    assert left.max() < 1e-12
    assert u.min() >= 0.0
    assert u.max() <= 1.0


def test_out_of_reach_the_arm_comes_to_rest_as_close_as_it_can(two):
    x = np.array([[0.5, 0.5], [0.7, 0.1]])  # beyond the limited elbow: 0.2 rad at least
    reach = np.linalg.norm(two.task.forward.value(np.array([[0.3, 0.0]])))
    u, left = two.refine(np.full((2, 2), 0.4), x)
    np.testing.assert_allclose(left, np.linalg.norm(x, axis=1) - reach, atol=1e-7)
    np.testing.assert_allclose(u[:, 1], 0.0, atol=1e-6)


def test_a_joint_that_turns_round_goes_the_short_way_through_its_seam():
    newton = newton_of(TWO, [-np.pi, 0.2], [np.pi, 2.7])
    goal = np.array([[0.99, 0.5], [0.01, 0.5]])
    u, left = newton.refine(goal[::-1].copy(), newton.task.forward.value(goal))
    assert left.max() < 1e-12
    np.testing.assert_allclose(newton.scale.difference(u, goal), 0.0, atol=1e-9)
    assert u.min() >= 0.0
    assert u.max() < 1.0
    np.testing.assert_allclose(
        newton.clip(np.array([[1.25, 1.25], [-0.25, -0.25]])), [[0.25, 1.0], [0.75, 0.0]]
    )


# --- rate, tangent, settle --------------------------------------------------------------


def test_a_rate_is_damped_least_squares(three):
    u, gap = around(30, 3), 0.01 * (around(30, 2, 1) - 0.5)
    slope = three.task.forward.value_and_slope(u)[1]
    power = np.einsum("noi,noi->n", slope, slope)
    square = slope @ np.swapaxes(slope, 1, 2) + 1e-3 * power[:, None, None] * np.eye(2)
    expected = np.einsum("noi,no->ni", slope, np.linalg.solve(square, gap[..., None])[..., 0])
    np.testing.assert_allclose(three.rate(u, gap), expected, rtol=1e-9)


def test_at_a_limit_a_rate_moves_the_other_joints_alone(three):
    u = np.array([[0.5, 1.0, 0.5]])
    slope = three.task.forward.value_and_slope(u)[1][0]
    out = 0.01 * slope[:, 1] / np.linalg.norm(slope[:, 1])
    assert three.rate(u, out[None])[0, 1] == 0.0
    assert three.rate(u, -out[None])[0, 1] < 0.0
    np.testing.assert_array_equal(three.rate(u, out[None])[0, [0, 2]] != 0.0, True)
    low = np.array([[0.5, 0.0, 0.5]])
    slope = three.task.forward.value_and_slope(low)[1][0]
    assert three.rate(low, -0.01 * slope[None, :, 1])[0, 1] == 0.0
    assert three.rate(low, 0.01 * slope[None, :, 1])[0, 1] > 0.0


def test_a_tangent_is_the_projection_onto_the_null_space(three):
    u, wish = around(50, 3), around(50, 3, 1) - 0.5
    slope = three.task.forward.value_and_slope(u)[1]
    expected = wish - np.einsum("nio,noj,nj->ni", np.linalg.pinv(slope), slope, wish)
    move = three.tangent(u, wish)
    np.testing.assert_allclose(move, expected, atol=1e-9)
    np.testing.assert_allclose(np.einsum("noi,ni->no", slope, move), 0.0, atol=1e-9)


def test_a_tangent_never_leads_over_a_limit_and_stays_a_tangent():
    newton = newton_of((0.3, 0.25, 0.2, 0.15), [0, 0.2, 0.2, -1.5], [1.57, 2.5, 2.5, 1.5])
    u, wish = around(200, 4), around(200, 4, 1) - 0.5
    u[:, 1], u[::2, 3] = 1.0 - 1e-6, 1e-6  # as good as at a limit
    move = newton.tangent(u, wish)
    assert move[:, 1].max() <= 0.0
    assert move[::2, 3].min() >= 0.0
    # blocked joints rest, and what the others do is the projection with those joints alone
    slope = newton.task.forward.value_and_slope(u)[1]
    blocked = np.zeros(u.shape, dtype=bool)
    blocked[:, 1], blocked[::2, 3] = move[:, 1] == 0.0, move[::2, 3] == 0.0
    assert 20 < np.count_nonzero(blocked[:, 1]) < 180
    free = np.where(blocked[:, None], 0.0, slope)
    wanted = np.where(blocked, 0.0, wish)
    expected = wanted - np.einsum("nio,noj,nj->ni", np.linalg.pinv(free, 1e-9), free, wanted)
    np.testing.assert_allclose(move, expected, atol=1e-6)


def test_a_joint_that_turns_round_has_no_limit_to_keep():
    newton = newton_of(THREE, [-np.pi, 0.2, 0.2], [np.pi, 2.7, 2.7])
    u, wish = np.array([[0.0, 0.5, 0.5]]), np.array([[-0.5, 0.1, 0.0]])
    slope = newton.task.forward.value_and_slope(u)[1]
    expected = wish - np.einsum("nio,noj,nj->ni", np.linalg.pinv(slope), slope, wish)
    assert expected[0, 0] < 0.0
    np.testing.assert_allclose(newton.tangent(u, wish), expected, atol=1e-9)


def test_settling_ends_on_target_where_no_move_leads_closer_to_the_wish(three):
    goal, near = around(150, 3, 1), around(150, 3, 2)
    x = three.task.forward.value(goal)
    three.task.forward.asked = 0
    u, left = three.settle(goal, x, near)
    assert left.max() < 1e-14
    assert three.task.forward.asked <= 400
    pull = np.linalg.norm(three.tangent(u, three.scale.difference(near, u)), axis=1)
    assert np.quantile(pull, 0.95) < 1e-5
    before, now = (np.linalg.norm(part - near, axis=1) for part in (goal, u))
    assert (now <= before + 1e-9).all()
    assert now.mean() < 0.8 * before.mean()


def test_settling_on_the_wish_itself_stays(three):
    goal = around(20, 3)
    u, left = three.settle(goal, three.task.forward.value(goal), goal)
    np.testing.assert_allclose(u, goal, atol=1e-12)
    assert left.max() < 1e-14


def test_two_joints_have_nothing_to_settle(two):
    start, x = around(50, 2), two.task.forward.value(around(50, 2, 1))
    said, plain = two.settle(start, x, around(50, 2, 2)), two.refine(start, x)
    np.testing.assert_array_equal(said[0], plain[0])
    np.testing.assert_array_equal(said[1], plain[1])


def test_short_slides_end_in_the_same_places(three):
    goal = around(60, 3, 1)
    near = goal + 0.1 * (around(60, 3, 2) - 0.5)
    x = three.task.forward.value(goal)
    np.testing.assert_allclose(
        three.settle(goal, x, near, longest=0.02)[0], three.settle(goal, x, near)[0], atol=1e-4
    )


def test_what_misses_its_target_does_not_slide(three):
    far = np.array([[2.0, 1.0]])
    start = np.full((1, 3), 0.5)
    u, left = three.settle(start, far, np.full((1, 3), 0.1))
    assert left[0] > 1.0
    # refined twice, the wish plays no part
    once, _ = three.refine(start, far, CLOSE)
    np.testing.assert_array_equal(u, three.refine(once, far)[0])
