"""Plans: within the limits, spread, in a short order; the tip stays where it is kept."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import in_space, trained, two_link_inverse

import calib
from calib.common.scale import TURN, Scale
from calib.use.collisions import hits_itself
from calib.use.information import most_telling, tells
from calib.use.keep_inside import keep_of
from calib.use.pose_space import space_of
from calib.use.spread import candidates, farthest
from calib.use.tour import length, shortest_tour

DEGREE = math.radians(1.0)
UNIT = Scale(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))


def between(q, steps=200):
    """Return places along the straight moves from row to row."""
    share = np.linspace(0, 1, steps)[:, None, None]
    return (q[:-1] + share * np.diff(q, axis=0)).reshape(-1, q.shape[1])


def way(plan):
    """Return all places that the arm comes through, the start first."""
    return plan.q if plan.start is None else np.vstack([plan.start, plan.q])


@pytest.fixture(scope="module")
def arm():
    return calib.load_arm("two_link")


# --- limits -------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", ["two_link", "three_link", "polar", "scara"])
def test_poses_keep_their_margin_and_touch_it(robot):
    arm = calib.load_arm(robot)
    plan = calib.plan(arm, 40)
    margin = np.minimum(DEGREE, 0.02 * (arm.upper - arm.lower))
    np.testing.assert_allclose(plan.q.min(axis=0), arm.lower + margin, atol=1e-12)
    np.testing.assert_allclose(plan.q.max(axis=0), arm.upper - margin, atol=1e-12)
    assert (plan.q >= arm.lower + margin - 1e-12).all()
    np.testing.assert_allclose(plan.x, arm.forward(plan.q), atol=1e-12)
    assert not plan.via.any()


def test_a_margin_for_all_or_for_each(arm):
    for margin in (0.1, [0.1, 0.2]):
        plan = calib.plan(arm, 20, margin=margin)
        np.testing.assert_allclose(plan.q.min(axis=0), arm.lower + margin)
        np.testing.assert_allclose(plan.q.max(axis=0), arm.upper - margin)
    assert calib.plan(arm, 20, margin=0.0).q.max(axis=0) == pytest.approx(arm.upper)


def test_a_part_of_a_range_needs_no_margin(arm):
    plan = calib.plan(arm, 20, ranges={"elbow": (0.5, 1.5)})
    assert plan.q[:, 1].min() == pytest.approx(0.5)
    assert plan.q[:, 1].max() == pytest.approx(1.5)
    narrow = calib.plan(arm.with_range({"elbow": (0.5, 1.5)}), 20)
    assert (narrow.q[:, 1].min(), narrow.q[:, 1].max()) == pytest.approx((0.5, 1.5))


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


# --- spread -------------------------------------------------------------------------------


def test_farthest_points_of_a_square_by_hand():
    points = np.array([[0, 0], [1, 1], [0.5, 0.5], [1, 0], [0, 1], [0.5, 0.6], [0, 0]], float)
    chosen = farthest(UNIT, points, 5, np.zeros((0, 2)))
    assert chosen.tolist() == [0, 1, 3, 4, 2]
    assert farthest(UNIT, points, 1, points[[0]]).tolist() == [1]
    assert sorted(farthest(UNIT, points, 7, points[:3]).tolist()) == list(range(7))


@given(st.integers(0, 2**32), st.integers(2, 12), st.booleans())
@settings(deadline=None, max_examples=30)
def test_farthest_points_are_within_twice_the_best_spread(seed, n, periodic):
    """Gonzalez 1985: the distance of the last chosen is at least what is left uncovered."""
    points = np.random.default_rng(seed).random((60, 2))
    scale = Scale(np.zeros(2), np.ones(2), np.array([periodic, False]))
    chosen = points[farthest(scale, points, n, np.zeros((0, 2)))]
    gap = np.linalg.norm(scale.difference(points[:, None], chosen[None]), axis=2)
    apart = np.linalg.norm(scale.difference(chosen[:, None], chosen[None]), axis=2)
    assert gap.min(axis=1).max() <= apart[~np.eye(n, dtype=bool)].min() + 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_no_place_is_far_from_a_pose(arm, seed):
    plan = calib.plan(arm, 60, seed=seed)
    u = (plan.q - arm.lower) / (arm.upper - arm.lower)
    place = np.random.default_rng(9).random((4000, 2))
    away = np.linalg.norm(place[:, None] - u[None], axis=2).min(axis=1)
    # no 60 discs that are smaller than this cover a square: that takes 1.21 of its area
    assert math.sqrt(1.21 / (60 * math.pi)) < away.max() < 2 * math.sqrt(1.21 / (60 * math.pi))


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


# --- order --------------------------------------------------------------------------------


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


@given(st.integers(0, 2**32), st.integers(4, 40))
@settings(deadline=None, max_examples=20)
def test_no_single_turn_or_move_shortens_a_tour(seed, n):
    u = np.random.default_rng(seed).random((n, 3))
    away = np.abs(u[:, None] - u[None]).max(axis=2)
    order = shortest_tour(away)
    own = length(away, order)
    for i, j in itertools.combinations(range(1, n), 2):
        turned = order.copy()
        turned[i : j + 1] = turned[i : j + 1][::-1]
        assert length(away, turned) >= own - 1e-9
        rest = np.delete(order, i)
        assert length(away, np.insert(rest, j, order[i])) >= own - 1e-9


def test_points_on_a_line_are_visited_along_it():
    place = np.array([0.0, 5, 2, 9, 1, 7, 3, 8])
    order = shortest_tour(np.abs(place[:, None] - place[None]))
    assert place[order].tolist() == sorted(place)


def test_travel_is_that_of_the_rows_and_short(arm):
    plan = calib.plan(arm, 60, start=[1.0, 1.0])
    np.testing.assert_array_equal(plan.start, [1.0, 1.0])
    moves = np.abs(np.diff(way(plan), axis=0))
    np.testing.assert_allclose(plan.travel, moves.sum(axis=0))
    share = (moves / (arm.upper - arm.lower)).max(axis=1).sum()
    assert plan.length == pytest.approx(share)
    assert plan.length < 0.3 * plan.random_length
    # a random move is 0.47 of a range long in the mean of the larger of two uniform moves
    assert plan.random_length == pytest.approx(0.52 * 60, rel=0.15)


def test_the_start_is_neutral_within_the_limits(arm):
    np.testing.assert_allclose(calib.plan(arm, 5).start, [DEGREE, math.radians(15 + 1)])
    one = calib.plan(arm, 1)
    assert one.q.shape == (1, 2)
    assert one.length == one.random_length


# --- keeping ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "keep", "start"),
    [
        ("two_link", {"x": (0.0, 0.3), "y": (0.2, 0.5)}, None),
        ("two_link_full", {"x": (0.1, 0.4), "y": (0.1, 0.45)}, None),
        ("two_link_full", {"y": (0.1, 0.45)}, [0.5, 0.6]),
        ("polar", {"x": (-0.2, 0.3)}, None),
        ("three_link", {"x": (0.1, 0.4)}, None),
    ],
)
def test_the_tip_never_leaves_the_box(robot, keep, start):
    arm = calib.load_arm(robot)
    plan = calib.plan(arm, 40, keep=keep, start=start)
    x = arm.forward(between(way(plan)))
    for axis, (low, high) in keep.items():
        seen = x[:, "xy".index(axis)]
        assert seen.min() > low
        assert seen.max() < high
    assert np.count_nonzero(~plan.via) == 40
    assert plan.length < 0.5 * plan.random_length


def test_moves_that_would_leave_the_box_are_led_round():
    arm = calib.load_arm("two_link_full")
    box = {"x": (0.1, 0.45), "y": (0.1, 0.45)}
    keep = keep_of(space_of(arm), box)
    ends = np.array([[0.02, 1.3], [0.9, -1.3]])  # halfway the arm is stretched: x = 0.49
    u = (ends - arm.lower) / (arm.upper - arm.lower)
    assert keep.holds(u).all()
    assert arm.forward(ends.mean(axis=0))[0] > 0.49
    assert keep.clear(u[:1], u[1:]).tolist() == [False]
    plans = [calib.plan(arm, 40, keep=box, seed=seed) for seed in range(3)]
    for plan in plans:
        assert {-1.0, 1.0} <= set(np.sign(plan.q[:, 1]))
        assert not any("elbow" in note for note in plan.notes)
    assert any(plan.via.any() for plan in plans)


@given(st.integers(0, 2**32))
@settings(deadline=None, max_examples=30)
def test_a_move_said_to_be_clear_is_clear(seed):
    arm = calib.load_arm("two_link_full")
    rng = np.random.default_rng(seed)
    low, high = np.sort(rng.uniform(-0.3, 0.6, (2, 2)), axis=0)
    keep = keep_of(space_of(arm), {"x": (low[0], high[0]), "y": (low[1], high[1])})
    a, b = rng.random((2, 50, 2))
    b = a + 0.3 * (b - a)
    clear = keep.clear(a, b)
    for u, v in zip(a[clear], b[clear], strict=True):
        x = arm.forward(keep.space.scale.from_unit(between(np.stack([u, v]), 500)))
        assert (x >= low).all()
        assert (x <= high).all()
    # and what stays well inside is said to be clear
    share = np.linspace(0, 1, 300)[:, None, None]
    x = arm.forward(keep.space.scale.from_unit((a + share * (b - a)).reshape(-1, 2)))
    room = np.minimum(x - low, high - x).min(axis=1).reshape(300, 50).min(axis=0)
    assert clear[room > keep.step].all()


def test_places_keep_half_a_step_from_the_border():
    """A tip that goes out and back between two places a step apart goes no further than that."""
    space = replace(space_of(calib.load_arm("two_link")), position=lambda q: q, scale=UNIT)
    keep = keep_of(space, {"x": (0.2, 0.8)})
    assert keep.step == pytest.approx(0.01, rel=0.01)  # of the extent, which is 1
    x = np.array([0.2, 0.2 + 0.49 * keep.step, 0.2 + 0.51 * keep.step, 0.8 - 0.49 * keep.step])
    held = keep.holds(np.stack([x, np.full(4, 0.5)], axis=1))
    assert held.tolist() == [False, False, True, False]
    assert keep.holds(np.array([[np.nan, 0.5]])).tolist() == [False]


def test_a_tip_that_is_faster_than_was_thought_is_not_taken_to_be_inside():
    arm = calib.load_arm("two_link")
    keep = keep_of(space_of(arm), {"x": (-9.0, 9.0)})
    start, end = np.array([[0.1, 0.2]]), np.array([[0.9, 0.8]])
    assert keep.clear(start, end).tolist() == [True]
    assert replace(keep, reach=keep.reach / 10).clear(start, end).tolist() == [False]


def test_branches_that_the_box_parts_are_told():
    """Elbow up and elbow down meet where the arm is stretched, at 0.55 m: beyond this box."""
    arm = calib.load_arm("two_link_full")
    box = {"x": (0.25, 0.37), "y": (0.25, 0.37)}
    for sign in (1.0, -1.0):
        start = two_link_inverse(np.array([[0.3, 0.3]]), sign)[0]
        plan = calib.plan(arm, 20, keep=box, start=start)
        assert (np.sign(plan.q[:, 1]) == sign).all()
        assert any("`start`" in note for note in plan.notes)


def test_a_model_keeps_its_tip_too():
    model = trained("two_link", n=3000, size=20)
    keep = {"x": (0.0, 0.3), "y": (0.2, 0.5)}
    plan = calib.plan(model, 15, keep=keep)
    x = model.forward(between(way(plan)))
    assert (x > [0.0, 0.2]).all()
    assert (x < [0.3, 0.5]).all()


# --- models -------------------------------------------------------------------------------


def test_plan_of_a_model_tells_what_it_expects():
    model = trained("two_link", n=3000, size=20)
    plan = calib.plan(model, 25)
    np.testing.assert_array_equal(plan.x, model.forward(plan.q))
    np.testing.assert_array_equal(plan.expected_error, model.expected_error(plan.q))
    assert list(plan.columns()) == [
        "shoulder",
        "elbow",
        "expected_x",
        "expected_y",
        "expected_error",
    ]
    # its URDF tells the limits
    np.testing.assert_allclose(plan.q.min(axis=0), model.about.lower + DEGREE)


def test_a_model_of_a_log_plans_within_what_was_measured():
    log = calib.babble(calib.load_arm("two_link"), 60, seed=2, noise=1e-3)
    free = calib.Samples(log.q, log.x, log.joint_names, log.q.min(0), log.q.max(0), log.revolute)
    model = calib.train(free, size=8)
    plan = calib.plan(model, 10)
    np.testing.assert_allclose(plan.q.min(axis=0), log.q.min(axis=0))
    np.testing.assert_allclose(plan.q.max(axis=0), log.q.max(axis=0))


def test_planned_poses_teach_more_than_random_ones(arm):
    """The prediction variance of a trend of the second harmonics, to which maps are fitted."""
    from calib.body.basis import Basis

    basis = Basis(tuple((arm.upper - arm.lower).tolist()), 2)
    place = basis.values(np.random.default_rng(0).random((2000, 2)))

    def variance(q):
        features = basis.values((q - arm.lower) / (arm.upper - arm.lower))
        inverse = np.linalg.inv(features.T @ features)
        return float(np.einsum("ni,ij,nj->n", place, inverse, place).mean())

    planned = [variance(calib.plan(arm, 30, seed=s).q) for s in range(10)]
    random = [variance(calib.babble(arm, 30, seed=s).q) for s in range(10)]
    sobol = [variance(calib.babble(arm, 30, seed=s, method="sobol").q) for s in range(10)]
    assert max(planned) < min(random)
    assert np.mean(planned) < 0.9 * np.mean(sobol)


# --- Python's errors and the file ---------------------------------------------------------


def test_the_same_seed_gives_the_same_plan(arm):
    a, b, c = (calib.plan(arm, 30, seed=s) for s in (4, 4, 5))
    np.testing.assert_array_equal(a.q, b.q)
    assert not np.array_equal(a.q, c.q)
    with pytest.raises(ValueError, match="read-only"):
        a.q[0] = 0


@pytest.mark.parametrize(
    ("n", "options", "part"),
    [
        (0, {}, "n is 0"),
        (1001, {}, "expected 1 to 1,000"),
        (2.5, {}, "whole number"),
        (5, {"seed": -1}, "seed is -1"),
        (5, {"margin": -0.1}, "margin -0.1"),
        (5, {"margin": float("nan")}, "margin nan"),
        (5, {"margin": [0.1, 0.1, 0.1]}, "one for each of shoulder, elbow"),
        (5, {"margin": 2.0}, "no room is left in shoulder"),
        (5, {"ranges": {"elbow": (0.0, 1.0)}}, "outside the joint's limits"),
        (5, {"ranges": {"ellbow": (0.5, 1.0)}}, "did you mean elbow"),
        (5, {"start": [0.5]}, "expected 2 finite joint values"),
        (5, {"start": ["a", "b"]}, "expected 2 finite joint values"),
        (5, {"start": [0.5, 9.0]}, "elbow = 9 is outside of its range"),
        (5, {"keep": {"z": (0.0, 1.0)}}, "expected x or y"),
        (5, {"keep": {"x": (1.0, 0.0)}}, "the lower one first"),
        (5, {"keep": {"x": (float("nan"), 0.0)}}, "the lower one first"),
        (5, {"keep": {"x": (2.0, 3.0)}}, "no pose of the 5 wanted"),
        (5, {"keep": {"x": (0.1, 0.1001)}}, "give a wider box"),
        (5, {"keep": {"x": (0.0, 0.2)}, "start": [0.0, 0.3]}, "start's tip is at"),
    ],
)
def test_what_is_impossible_is_told_in_one_line(arm, n, options, part):
    with pytest.raises(calib.OptionError) as told:
        calib.plan(arm, n, **options)
    assert part in str(told.value)
    assert "\n" not in str(told.value)


def test_a_log_of_other_joints_is_refused(arm):
    log = calib.babble(calib.load_arm("polar"), 20)
    with pytest.raises(calib.OptionError, match="have the joints"):
        calib.plan(arm, 5, measured=log)


def test_a_written_plan_is_no_log_by_mistake(arm, tmp_path):
    path = tmp_path / "poses.csv"
    plan = calib.plan(arm, 12)
    plan.write(path)
    with pytest.raises(calib.LogError, match="x"):
        calib.read_log(path, arm)
    log = calib.read_log(path, arm, columns={"x": "expected_x", "y": "expected_y"})
    np.testing.assert_array_equal(log.q, plan.q)
    np.testing.assert_array_equal(log.x, plan.x)


def test_a_joint_is_not_taken_for_what_is_expected(arm):
    plan = replace(calib.plan(arm, 5), joint_names=("shoulder", "expected_y"))
    with pytest.raises(calib.OptionError, match="cannot be told from the plan's own column"):
        plan.columns()


# --- the command --------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["poses.csv", "poses.parquet"])
def test_command_writes_what_python_plans(run, tmp_path, arm, name):
    path = tmp_path / name
    done = run("plan", "two_link", "-n", "20", "--seed", "3", "--from", "0.5,1", "-o", path)
    assert done.code == 0, done.err
    assert "joints travel" in done.out
    log = calib.read_log(path, arm, columns={"x": "expected_x", "y": "expected_y"})
    np.testing.assert_array_equal(log.q, calib.plan(arm, 20, seed=3, start=[0.5, 1.0]).q)


def test_command_in_degrees(run, arm):
    done = run("plan", "two_link", "-n", "8", "--degrees", "--margin", "2", "-o", "-")
    header, *rows = done.out.splitlines()
    assert header == "shoulder,elbow,expected_x,expected_y"
    table = np.array([[float(v) for v in row.split(",")] for row in rows])
    same = calib.plan(arm, 8, margin=math.radians(2)).q
    np.testing.assert_allclose(table[:, :2], np.degrees(same), atol=1e-9)
    assert table[:, 0].min() == pytest.approx(2.0)
    half = run("plan", "two_link", "-n", "8", "--margin", "10%", "-o", "-").out.splitlines()[1:]
    first = [float(row.split(",")[0]) for row in half]
    assert (min(first), max(first)) == pytest.approx((0.05 * math.pi, 0.45 * math.pi))


def test_command_prints_one_document(run, tmp_path):
    path = tmp_path / "p.csv"
    done = run("plan", "polar", "-n", "9", "--keep", "x=-0.1:0.3", "-o", path, "--json")
    assert done.code == 0, done.err
    found = done.document
    assert found["joints"] == ["base", "slide"] or len(found["joints"]) == 2
    assert found["rows"] == 9 + len(found["via"]) == len(found["poses"]["expected_x"])
    assert min(found["poses"]["expected_x"]) > -0.1
    assert len(path.read_text().splitlines()) == 1 + found["rows"]


def test_command_plans_for_a_model_whatever_its_name(run, model, tmp_path):
    other = tmp_path / "renamed.bin"
    other.write_bytes(model.read_bytes())
    documents = []
    for path in (model, other):
        done = run("plan", path, "-n", "6", "-o", tmp_path / "p.csv", "--json")
        assert done.code == 0, done.err
        documents.append(done.document["poses"])
    assert documents[0] == documents[1]
    assert "expected_error" in documents[0]


def test_command_completes_a_log(run, log, tmp_path, arm):
    done = run("plan", "two_link", "-n", "6", "--data", log, "-o", "-")
    assert done.code == 0
    assert "from the 400 measured ones" in done.err
    rows = [[float(v) for v in line.split(",")[:2]] for line in done.out.splitlines()[1:]]
    expected = calib.plan(arm, 6, measured=calib.read_log(log, arm)).q
    np.testing.assert_array_equal(rows, expected)


@pytest.mark.parametrize(
    ("args", "code", "part"),
    [
        (["two_link"], 2, "-o"),
        (["two_link", "-n", "0"], 2, "1 or more"),
        (["two_link", "-n", "5000"], 2, "at most 1000"),
        (["two_link", "--margin", "60%"], 2, "below 50%"),
        (["two_link", "--margin", "-1"], 2, "zero or more"),
        (["two_link", "--keep", "z=0:1"], 2, "x=LOW:HIGH"),
        (["two_link", "--keep", "x=0:1", "--keep", "x=0:2"], 2, "twice"),
        (["two_link", "--keep", "x=2:3"], 1, "the tip reaches"),
        (["two_link", "--from", "1"], 2, "2 values"),
        (["two_link", "--from", "1,9"], 1, "elbow = 9"),
        (["two_link", "--columns", "x=u"], 2, "--data"),
        (["two_linc"], 1, "did you mean two_link"),
        (["no.calib"], 1, "no.calib"),
        (["MODEL", "--tip", "t"], 2, "--tip is for ROBOT"),
        (["MODEL", "--range", "elbow=0:9"], 1, "outside"),
    ],
)
def test_command_errors_are_one_line_and_write_nothing(run, model, tmp_path, args, code, part):
    path = tmp_path / "p.csv"
    words = [str(model) if arg == "MODEL" else arg for arg in args]
    output = [] if part == "-o" else ["-o", str(path)]
    done = run("plan", *words, *output)
    assert done.code == code
    assert part in done.err
    assert len(done.err.strip().splitlines()) == 1
    assert done.out == ""
    assert not path.exists()


# --- arms in space -----------------------------------------------------------------------------


def test_the_most_telling_poses_are_those_of_the_posterior():
    """Greedy choice by downdates is greedy choice by determinants."""
    rng = np.random.default_rng(0)
    told = rng.normal(size=(12, 3, 7)) * rng.uniform(0.2, 2.0, (12, 1, 1))
    precision, left, chosen = np.eye(7), list(range(12)), []
    for _ in range(5):
        volumes = [np.linalg.slogdet(precision + told[k].T @ told[k])[1] for k in left]
        chosen.append(left.pop(int(np.argmax(volumes))))
        precision = precision + told[chosen[-1]].T @ told[chosen[-1]]
    assert most_telling(told, 5).tolist() == chosen


def test_a_plan_in_space_tells_more_than_a_spread_one():
    arm = calib.load_arm("spatial_three")
    plan = calib.plan(arm, 12)
    points = candidates(space_of(arm), np.random.default_rng(0))
    none = np.zeros((0, 3))
    spread = space_of(arm).scale.from_unit(points[farthest(space_of(arm).scale, points, 12, none)])
    volumes = []
    for q in (plan.q, spread):
        rows = tells(arm, q, none).reshape(36, -1)
        volumes.append(np.linalg.slogdet(np.eye(36) + rows @ rows.T)[1])
    assert volumes[0] > volumes[1] + 5
    assert list(plan.columns())[3:] == ["expected_x", "expected_y", "expected_z"]
    assert any("hits itself" in note for note in plan.notes)
    hits = hits_itself(arm.urdf, arm.joint_names, arm.locked, plan.q)
    assert hits is not None
    assert not hits.any()


def test_a_model_in_space_is_asked_what_it_does_not_know():
    model = in_space()
    told = calib.plan(model, 5)
    assert told.why[0].startswith("5 poses, chosen to reduce the model's uncertainty most")


def test_links_that_meet_are_seen_and_those_that_are_built_so_are_not():
    arm = calib.load_arm("six_axis")
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (300, 6))
    q[0] = 0.0  # stretched
    hits = hits_itself(arm.urdf, arm.joint_names, arm.locked, q)
    assert not hits[0]
    assert 0 < hits.mean() < 0.2
    folded = np.abs(q[:, 2])
    assert np.median(folded[hits]) > np.median(folded[~hits]) + 0.5
    flat = calib.load_arm("two_link_full")
    assert hits_itself(flat.urdf, flat.joint_names, flat.locked, np.zeros((3, 2))) is None
