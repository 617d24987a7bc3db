"""Plans: within the limits, spread, in a short order; what is impossible is told; the command."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import calib
from calib.common.scale import TURN
from calib.use.plan import length, shortest_tour

DEGREE = math.radians(1.0)


@pytest.mark.parametrize("robot", ["three_link", "polar"])
def test_poses_keep_their_margin_and_touch_it(robot):
    arm = calib.load_arm(robot)
    plan = calib.plan(arm, 40)
    margin = np.minimum(DEGREE, 0.02 * (arm.upper - arm.lower))
    np.testing.assert_allclose(plan.q.min(axis=0), arm.lower + margin, atol=1e-12)
    np.testing.assert_allclose(plan.q.max(axis=0), arm.upper - margin, atol=1e-12)
    assert (plan.q >= arm.lower + margin - 1e-12).all()
    np.testing.assert_allclose(plan.x, arm.forward(plan.q), atol=1e-12)


def test_a_joint_without_limits_has_no_margin_and_its_ends_are_one_place(tmp_path):
    text = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/><link name="t"/>
    <joint name="base" type="continuous"><parent link="a"/><child link="b"/>
    <axis xyz="0 0 1"/></joint>
    <joint name="arm" type="revolute"><parent link="b"/><child link="c"/>
    <origin xyz="0.3 0 0"/><axis xyz="0 0 1"/><limit lower="0.3" upper="2.0"/></joint>
    <joint name="tool" type="fixed"><parent link="c"/><child link="t"/>
    <origin xyz="0.2 0 0"/></joint></robot>"""
    path = tmp_path / "turning.urdf"
    path.write_text(text)
    arm = calib.load_arm(path, tip="t")
    plan = calib.plan(arm, 30)
    assert np.abs(plan.q[:, 0]).max() <= math.pi + 1e-12
    gap = np.abs(plan.q[:, None] - plan.q[None])
    gap[..., 0] = np.minimum(gap[..., 0], TURN - gap[..., 0])
    apart = np.linalg.norm(gap / (arm.upper - arm.lower), axis=2)
    # no pose is measured twice, once at each end of the turn
    assert apart[~np.eye(30, dtype=bool)].min() > 0.08


def test_new_poses_go_where_measured_ones_are_not(arm):
    log = calib.babble(arm, 200, seed=1, ranges={"elbow": (0.3, 1.4)})
    plan = calib.plan(arm, 12, measured=log)
    u = (plan.q - arm.lower) / (arm.upper - arm.lower)
    old = (log.q - arm.lower) / (arm.upper - arm.lower)
    assert np.linalg.norm(u[:, None] - old[None], axis=2).min() > 0.1
    assert (plan.q[:, 1] > 1.4).all()
    swapped = calib.Samples(
        log.q[:, ::-1], log.x, ("elbow", "shoulder"), arm.lower, arm.upper, (True, True)
    )
    np.testing.assert_array_equal(calib.plan(arm, 12, measured=swapped).q, plan.q)


@given(st.integers(0, 2**32), st.integers(1, 7))
@settings(deadline=None, max_examples=40)
def test_tours_are_permutations_close_to_the_shortest(seed, n):
    u = np.random.default_rng(seed).random((n, 2))
    away = np.linalg.norm(u[:, None] - u[None], axis=2)
    order = shortest_tour(away)
    assert order[0] == 0
    assert sorted(order.tolist()) == list(range(n))
    best = min(length(away, np.array([0, *rest])) for rest in itertools.permutations(range(1, n)))
    assert best - 1e-12 <= length(away, order) <= 1.35 * best + 1e-12


def test_travel_is_that_of_the_rows_and_short(arm):
    plan = calib.plan(arm, 60, start=[1.0, 1.0])
    np.testing.assert_array_equal(plan.start, [1.0, 1.0])
    moves = np.abs(np.diff(np.vstack([plan.start, plan.q]), axis=0))
    np.testing.assert_allclose(plan.travel, moves.sum(axis=0))
    share = (moves / (arm.upper - arm.lower)).max(axis=1).sum()
    assert plan.length == pytest.approx(share)
    assert plan.length < 0.3 * plan.random_length
    # a random move is 0.47 of a range long in the mean of the larger of two uniform moves
    assert plan.random_length == pytest.approx(0.52 * 60, rel=0.15)


def test_a_written_plan_is_no_log_by_mistake(arm, tmp_path):
    path = tmp_path / "poses.csv"
    plan = calib.plan(arm, 12)
    plan.write(path)
    with pytest.raises(calib.LogError, match="x"):
        calib.read_log(path, arm)
    log = calib.read_log(path, arm, columns={"x": "expected_x", "y": "expected_y"})
    np.testing.assert_array_equal(log.q, plan.q)
    np.testing.assert_array_equal(log.x, plan.x)


@pytest.mark.parametrize("name", ["poses.csv", "poses.parquet"])
def test_command_writes_what_python_plans(run, tmp_path, arm, name):
    path = tmp_path / name
    done = run("plan", "two_link", "-n", "20", "--seed", "3", "--from", "0.5,1", "-o", path)
    assert done.code == 0, done.err
    assert "joints travel" in done.out
    log = calib.read_log(path, arm, columns={"x": "expected_x", "y": "expected_y"})
    np.testing.assert_array_equal(log.q, calib.plan(arm, 20, seed=3, start=[0.5, 1.0]).q)


def test_command_completes_a_log(run, log, tmp_path, arm):
    done = run("plan", "two_link", "-n", "6", "--data", log, "-o", "-")
    assert done.code == 0
    assert "beside the 400 measured ones" in done.err
    rows = [[float(v) for v in line.split(",")[:2]] for line in done.out.splitlines()[1:]]
    expected = calib.plan(arm, 6, measured=calib.read_log(log, arm)).q
    np.testing.assert_array_equal(rows, expected)
