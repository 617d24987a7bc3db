"""Every branch, turn and family, none invented; the nearest point out of reach; steps and paths."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from chains import chain_urdf, planar_chain
from chains import turning as joint
from conftest import refused
from models import (
    ELBOW,
    bare,
    draw,
    lengths,
    log_of,
    trained,
    turning,
    two_link,
    two_link_inverse,
    warm,
)
from numpy.testing import assert_allclose, assert_array_equal
from reference import pinocchio_pose
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import calib
from calib.arm.loading import arm_from_urdf
from calib.common.scale import Scale
from calib.inverse.solutions import distinct
from calib.model.poses import solve_poses

TURN = 2 * np.pi
LIMITS = ((-1.2, 1.6), (-2.4, 2.4), (-2.0, 2.0))
"""Of three joints [rad], between which solutions fall into one to three families."""


def away(model, q, near):
    """Distances of joints in units of their ranges."""
    return np.linalg.norm((q - near) / (model.about.upper - model.about.lower), axis=-1)


@pytest.mark.parametrize("answering", [warm, lambda model: model], ids=["C", "batch"])
@pytest.mark.parametrize(("robot", "least"), [("two_link", 1.0), ("two_link_full", 1.1)])
def test_all_branches_and_no_others(robot, least, answering):
    model = answering(trained(robot))
    x = two_link(draw(model, 2000, seed=1))
    ways = np.stack([two_link_inverse(x, sign) for sign in (1.0, -1.0)], axis=1)
    inside = ((ways >= model.about.lower) & (ways <= model.about.upper)).all(axis=2)
    missed = invented = 0
    for k, found in enumerate(model.inverse_all(x)):
        gap = np.abs(found[:, None] - ways[k][inside[k]]).max(axis=2)
        missed += np.count_nonzero(gap.min(axis=0) > 2e-3)
        invented += np.count_nonzero(gap.min(axis=1) > 2e-3)
    assert inside.sum() > least * 2000 - 1
    assert invented == 0
    assert missed <= 1e-3 * inside.sum()


@pytest.mark.parametrize("robot", ["two_link_full", "scara"])
def test_near_is_the_closest_of_all_branches_without_it_the_middle_decides(robot):
    model = trained(robot)
    x, near = model.forward(draw(model, 100, seed=3)), draw(model, 100, seed=4)
    middle = (model.about.lower + model.about.upper) / 2
    nearest, central = model.inverse(x, near=near), model.inverse(x)
    assert_array_equal(central, model.inverse(x, near=middle))
    for i, branches in enumerate(model.inverse_all(x)):
        closest = away(model, branches, near[i]).min()
        assert away(model, nearest[i], near[i]) <= closest + 1e-6
        assert_allclose(central[i], branches[0], atol=1e-6)


def test_a_joint_that_turns_round_reaches_every_direction_across_its_seam():
    model = turning()
    q = draw(model, 300, seed=9, margin=0.01)
    q[:20, 0] = np.pi - 1e-3 * np.arange(20)
    q[20:40, 0] = -np.pi + 1e-3 * np.arange(20)
    x = two_link(q)
    answer = model.solve(x, near=q)
    assert answer.reachable.all()
    assert_allclose(two_link(answer.q), x, atol=1e-6)
    gap = answer.q - q
    gap[:, 0] -= TURN * np.round(gap[:, 0] / TURN)
    assert_allclose(gap, 0.0, atol=1e-5)
    assert (np.abs(answer.q[:, 0]) <= np.pi + 1e-12).all()
    on = np.array([TURN, 0])  # joint values a turn on are the same query
    assert_allclose(model.forward(q + on), model.forward(q), atol=1e-9)
    again = model.inverse(x[40:], near=q[40:] + on)
    assert_allclose(again, model.inverse(x[40:], near=q[40:]), atol=1e-9)
    across = model.inverse(x[:1], near=[-np.pi + 0.02, 1.0])  # the short way round
    assert np.abs((across - q[:1] + np.pi) % TURN - np.pi).max() < 2e-3


def test_where_both_elbows_meet_there_is_one_way():
    """Compiled C stopped on both sides of the fold, and named most of these ways twice."""
    model = warm(trained("two_link_full"))
    q = draw(model, 100) * [1.0, 0.0]
    assert [len(ways) for ways in model.inverse_all(model.forward(q))] == [1] * 100


@pytest.mark.parametrize(("joints", "slide"), [(4, None), (5, 1), (7, None)])
def test_four_to_seven_joints(joints, slide):
    names = [f"j{k + 1}" for k in range(joints)]
    arm = arm_from_urdf(planar_chain(joints, slide), names, tip="tip")
    model = calib.train(calib.babble(arm, {4: 600, 5: 900, 7: 4600}[joints], seed=0), size=8)
    assert len(model.motor.lattice.shape) == 2
    q = draw(model, 100, seed=6)
    x = arm.forward(q)
    assert lengths(model.forward(q) - x).max() < 1e-8
    for said in (model.inverse(x), model.inverse(x, near=q)):
        assert lengths(arm.forward(said) - x).max() < 1e-8
    assert_allclose(model.inverse(x, near=q), q, atol=1e-5)
    for target, solutions in zip(x, model.inverse_all(x[:3]), strict=False):
        assert 1 <= len(solutions) < 10
        assert lengths(arm.forward(solutions) - target).max() < 1e-8


def family_count(x, n=8001):
    """Connected parts of the solutions of three links, on a fine grid of the tip's direction."""
    turn = np.linspace(-np.pi, np.pi, n)
    wrist = x - 0.15 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    cosine = ((wrist**2).sum(axis=1) - 0.30**2 - 0.25**2) / (2 * 0.30 * 0.25)
    exists = np.abs(cosine) <= 1
    inside = []
    for side in (1, -1):
        elbow = side * np.arccos(np.clip(cosine, -1, 1))
        fore = np.arctan2(0.25 * np.sin(elbow), 0.30 + 0.25 * np.cos(elbow))
        shoulder = np.arctan2(wrist[:, 1], wrist[:, 0]) - fore
        q = np.stack([shoulder, elbow, turn - shoulder - elbow], axis=1)
        q = (q + np.pi) % (2 * np.pi) - np.pi
        lower, upper = np.transpose(LIMITS)
        inside.append(exists & ((q >= lower) & (q <= upper)).all(axis=1))
    edge = exists & ~(np.roll(exists, 1) & np.roll(exists, -1))
    folds = np.flatnonzero(edge & inside[0] & inside[1])  # both elbows meet
    pairs = [np.stack([folds, n + folds])]
    for k, here in enumerate(inside):
        rows = np.flatnonzero(here & np.roll(here, -1))
        pairs.append(k * n + np.stack([rows, (rows + 1) % n]))
    a, b = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(2 * n, 2 * n))
    label = connected_components(graph)[1]
    return len(np.unique(label[np.concatenate(inside)]))


def test_every_connected_family_is_named_once_whatever_else_is_asked():
    origins = ("0 0 0", "0.3 0 0", "0.25 0 0")
    joints = (joint("0 0 1", *each) for each in zip(origins, *np.transpose(LIMITS), strict=True))
    arm = arm_from_urdf(chain_urdf(*joints, tip="0.15 0 0"))
    model = calib.train(calib.babble(arm, 3000, seed=0), size=15)
    x = arm.forward(draw(model, 30, seed=1))
    ways = model.inverse_all(x)
    counts = [len(rows) for rows in ways]
    assert counts == [family_count(target) for target in x]
    assert set(counts) == {1, 2, 3}
    for k in range(5):  # the same alone
        assert_array_equal(model.inverse_all(x[k : k + 1])[0], ways[k])


@pytest.mark.parametrize("free", ["x", "y", "z"])
def test_ways_to_a_pose_with_an_open_turn_are_told_once_each(free):
    """Four ways were one: the nearest of many slid to one place."""
    model = trained("six_axis", n=400, size=4)
    down = np.array([0.0, 1.0, 0.0, 0.0])
    answers = solve_poses(model, np.array([[0.4, 0.1, 0.5]]), down, None, every=True, free=free)
    assert answers.reachable.all()
    apart = np.abs(answers.q[:, None] - answers.q[None]).max(axis=2)
    assert len(answers.q) > 1
    assert (apart + np.eye(len(answers.q)) > 1e-2).all()


def test_ways_beyond_a_fold_of_the_drawing_are_found():
    """Both starts stood on the fold, and the search left it to neither side: 383 of 400."""
    model = warm(calib.train(bare("six_axis", 300, 1, "elbow.length=+1%", noise=1e-4), size=5))
    q = draw(model, 400, seed=0, margin=0.2)
    q[:, 4] = np.random.default_rng(0).uniform(-0.05, 0.05, 400)  # a straight wrist
    answers = solve_poses(model, *model.pose(q), None, every=True)
    apart = np.remainder(answers.q - q[answers.target] + np.pi, TURN) - np.pi
    assert len(np.unique(answers.target[np.abs(apart).max(axis=1) < 1e-3])) > 0.97 * len(q)


def test_a_way_beside_one_that_went_stays():
    """Of .1, .16 and .22 the second is too near to the first; the third, to the second alone."""
    scale = Scale(np.zeros(1), np.full(1, TURN), np.array([True]))
    u = np.array([[0.1], [0.16], [0.22], [0.5], [0.22], [0.99], [0.02]])
    stays = distinct(scale, np.array([0, 0, 0, 0, 1, 1, 1]), u, 0.1)
    assert stays.tolist() == [True, False, True, True, True, True, False]


@pytest.mark.parametrize(("bound", "reached"), [(1e-3, 1e-3), (0.02, 1e-2)])
def test_a_target_counts_as_reached_within_the_expected_error_and_a_hundredth(bound, reached):
    """Within the smaller of the expected error and 1 % of the workspace's extent."""
    model = trained("two_link")
    q = np.array([[0.7, ELBOW[0]]])
    edge, extent = two_link(q), model.solver.extent
    unsure = replace(model, bounds=np.full(model.motor.size, bound * extent))
    outwards = edge / np.linalg.norm(edge)
    for share in (0.0, 0.5, 0.95):
        answer = unsure.solve(edge + share * reached * extent * outwards)
        assert answer.reachable.all()
        assert_allclose(answer.q, q, atol=1e-6)
    for share in (1.05, 3.0):
        assert not unsure.solve(edge + share * reached * extent * outwards).reachable.any()
    # an exact model promises no more than what it knows
    assert model.expected_error(q).max() < 1e-9 * extent
    beyond = edge + 1e-6 * extent * outwards
    assert not model.solve(beyond).reachable.any()
    assert [len(ways) for ways in model.inverse_all(beyond)] == [0]


@pytest.mark.parametrize("robot", ["two_link_full", "scara", "polar", "three_link"])
def test_no_attainable_point_is_closer_and_the_edge_is_reached(robot):
    model, arm = trained(robot), calib.load_arm(robot)
    rng = np.random.default_rng(1)
    grid = rng.uniform(arm.lower, arm.upper, (20_000, arm.dof))
    for k in range(arm.dof):  # the workspace ends where joints do
        grid[k::6, k] = rng.choice([arm.lower[k], arm.upper[k]], len(grid[k::6]))
    positions = arm.forward(grid)
    targets = rng.uniform(-0.9, 0.9, (80, 2))
    closest = np.array([lengths(positions - x).min() for x in targets])
    # from joints far away, too: of ways that miss the one that misses least
    for near in (grid[:80], None):
        answer = model.solve(targets, near)
        out = ~answer.reachable
        assert out.sum() > 15
        assert (answer.distance[out] <= closest[out] + 1e-6).all()
        assert answer.distance[~out].max() < 1e-12
    away = lengths(arm.forward(answer.q) - targets)
    assert_allclose(away, answer.distance, atol=1e-6)
    assert_allclose(arm.forward(answer.q), answer.position, atol=1e-9)
    assert ((answer.q >= arm.lower - 1e-12) & (answer.q <= arm.upper + 1e-12)).all()
    at_limits = model.solve(positions[: 6 * 40])
    assert at_limits.reachable.all()
    assert at_limits.distance.max() < 1e-8
    # one by one, places that a limit leaves out by a hair
    beyond = arm.forward(np.where(grid == arm.upper, grid + 3e-7, grid))
    for place in beyond[: 6 * arm.dof]:
        assert (model.solve(place).q <= arm.upper + 1e-12).all()


def test_a_small_step_goes_where_the_jacobian_says_and_a_gain_is_a_share_of_the_way():
    model = trained("two_link")
    q = draw(model, 50, seed=1, margin=0.2)
    gap = 1e-5 * np.random.default_rng(2).normal(size=(50, 2))
    x = two_link(q)
    moved = two_link(model.servo(x, x + gap, q, gain=1.0)) - x
    assert_allclose(moved, gap, rtol=0.05, atol=5e-7)
    assert_allclose(model.servo(x, x, q), q, atol=1e-12)  # on target
    for gain in (0.0, -1.0, 1.5, float("nan")):
        refused(calib.QueryError, "gain", model.servo, x, x, q, gain=gain)
    # a step keeps the limits and is never long
    q = draw(model, 100, seed=6)
    far = np.random.default_rng(7).uniform(-5, 5, (100, 2))
    after = model.servo(two_link(q), far, q, gain=1.0)
    assert (after >= model.about.lower - 1e-12).all()
    assert (after <= model.about.upper + 1e-12).all()
    assert (away(model, after, q) <= 0.1 + 1e-12).all()


SQUARE = [[0.30, 0.30], [0.25, 0.35], [0.15, 0.30], [0.30, 0.30]]


@pytest.fixture(scope="module")
def model():
    """An arm with both branches."""
    return trained("two_link_full", n=8000, size=40)


def one_sided(model, sign):
    """Return targets that only one branch reaches."""
    q = draw(model, 400, seed=1)
    q = q[np.sign(q[:, 1]) == sign]
    other = two_link_inverse(two_link(q), -sign)
    beyond = ((other < model.about.lower - 0.1) | (other > model.about.upper + 0.1)).any(axis=1)
    return two_link(q[beyond & (np.abs(q[:, 1]) > 0.5)])


def steps(path, model):
    """Largest move of a joint between two rows, as a share of its range."""
    span = model.about.upper - model.about.lower
    return np.abs(np.diff(path.q, axis=0) / span).max(axis=1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_path_stays_on_the_branch_where_it_starts(model, sign):
    waypoints = np.array([[0.33, 0.30], [0.30, 0.35], [0.33, 0.33]])
    path = model.path(waypoints, start=two_link_inverse(waypoints[:1], sign)[0])
    assert len(path.jumps) == 0
    assert (np.sign(path.q[:, 1]) == sign).all()
    assert_allclose(path.q, two_link_inverse(path.target, sign), atol=1e-6)
    assert steps(path, model).max() < 0.1


def test_a_jump_that_cannot_be_avoided_is_told_where_it_is(model):
    plus, minus = one_sided(model, 1.0), one_sided(model, -1.0)
    share = np.linspace(0, 1, 20)[:, None]
    told = tried = 0
    for a, b in itertools.product(plus[:15], minus[:15]):
        if tried == 6 or not model.solve(a + share * (b - a)).reachable.all():
            continue
        tried += 1
        path = model.path([a, b])
        # elbows change sides at the stretched pose, or by a jump that is told
        assert set(np.flatnonzero(steps(path, model) > 0.2) + 1) <= set(path.jumps.tolist())
        assert len(path.jumps) <= 1
        told += len(path.jumps)
    assert tried == 6
    assert told >= 1


def test_rows_lie_on_the_lines_at_most_a_step_apart(model):
    path = model.path(SQUARE, step=0.007)
    assert lengths(np.diff(path.target, axis=0)).max() <= 0.007 + 1e-12
    for k, waypoint in enumerate(SQUARE):
        assert_array_equal(path.target[np.flatnonzero(path.waypoint == k)[-1]], waypoint)
    assert (np.diff(path.waypoint) >= 0).all()
    assert_allclose(two_link(path.q), path.target, atol=1e-8)


def test_a_redundant_arm_follows_a_circle_without_a_jump():
    model, arm = trained("three_link"), calib.load_arm("three_link")
    turn = np.linspace(0, 2 * np.pi, 25)
    circle = np.stack([0.15 + 0.08 * np.cos(turn), 0.40 + 0.08 * np.sin(turn)], axis=1)
    path = model.path(circle)
    assert len(path.jumps) == 0
    assert path.reachable.all()
    assert lengths(arm.forward(path.q) - path.target).max() < 1e-7
    assert steps(path, model).max() < 0.1


def with_limits(model, limits):
    return replace(model, about=replace(model.about, limits=np.array(limits)))


def test_a_joint_goes_on_over_the_seam_where_it_can_and_is_told_where_it_turns_round():
    corners = two_link(np.array([[3.0, 1.0], [3.3, 1.0]]))
    model = turning()
    path = model.path(corners, step=0.01)
    assert len(path.jumps) == 1  # its log knows one turn
    row = path.jumps[0]
    assert abs(abs(path.q[row, 0] - path.q[row - 1, 0]) - TURN) < 0.1
    wide = with_limits(model, [[-TURN, TURN], [0.3, 2.5]])
    path = wide.path(corners, step=0.01)
    assert len(path.jumps) == 0
    assert np.abs(np.diff(path.q[:, 0])).max() < 0.1
    for turn in (-TURN, 0.0):  # of two turns on which it can go on the nearer one
        there = wide.path(corners, start=[3.0 + turn, 1.0])
        assert there.q[0, 0] == pytest.approx(3.0 + turn, abs=1e-5)
    near = [path.q[-1, 0], 1.0]
    assert abs(wide.inverse(corners[1], near=near)[0] - near[0]) < 1.0


def test_near_beyond_the_limits_of_several_turns_asks_for_the_turn_beside_them():
    model = with_limits(turning(), [[-TURN, TURN], [0.3, 2.5]])
    x = two_link(np.array([[-0.383, 1.0]]))
    for query in (x, x[0]):
        answer = model.inverse(query, near=[8.4, 1.0])  # 2.5 from 5.9, and 8.8 from -.383
        assert_allclose(np.ravel(answer), [-0.383 + TURN, 1.0], atol=1e-6)


def test_a_path_of_the_base_frame_is_followed_by_pinocchios_arm():
    arm = calib.load_arm("spatial_three")
    log = calib.babble(arm, 60, seed=0)
    turn = np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]])
    seen = 1e3 * (log.x @ turn.T + [0.2, -0.1, 0.4])  # a tracker of its own frame, in mm
    model = calib.train(log_of(arm, log.q, seen, unit="mm"), size=4)
    ends = pinocchio_pose(arm, np.array([[-0.5, 0.6, -1.0], [0.5, 0.8, -1.3]]))[0]
    path = model.path(ends, frame="base")
    assert path.reachable.all()
    assert len(path.jumps) == len(path.fast_turns) == 0
    assert_array_equal(path.target[[0, -1]], ends)
    assert_allclose(pinocchio_pose(arm, path.q)[0], path.target, atol=1e-9)


@pytest.mark.parametrize("frame", ["sensor", "base"])
def test_joints_that_turn_fast_beside_the_first_axis_are_told(frame):
    arm = calib.load_arm("spatial_three")
    model = trained("spatial_three", n=60, size=4)
    path = model.path([[0.25, 0.04, 0.6], [-0.25, 0.04, 0.6]], frame=frame)
    turn = np.abs(np.diff(path.q, axis=0)).max(axis=1)
    assert np.isfinite(path.expected_error).all()
    fast = np.flatnonzero(turn > 0.25) + 1
    assert len(fast)
    assert set(fast) <= set(path.fast_turns)
    assert turn[path.fast_turns - 1].min() > 0.2
    # beside the axis, of which the tip stays 4 cm away
    assert np.abs(arm.forward(path.q[path.fast_turns])[:, 0]).max() < 0.1
