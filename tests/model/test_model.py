"""Queries of a model: shapes, what is outside, what is no query, and bounds that hold."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import refused
from models import accuracy, draw, lengths, log, trained, turning, two_link

import calib

NO_QUERIES = [
    (lambda m: m.forward([0.1]), r"joint values of shape \(1,\): expected \(2,\) or \(n, 2\)"),
    (lambda m: m.forward([[0.1, 0.2, 0.3]]), "one column each for shoulder, elbow"),
    (lambda m: m.forward(np.zeros((2, 2, 2))), r"shape \(2, 2, 2\)"),
    (lambda m: m.inverse([0.1, np.nan]), r"\[0.1, nan\] is not finite"),
    (lambda m: m.inverse([[0, 0.3], [0, np.inf]]), "positions in row 1: .* is not finite"),
    (lambda m: m.inverse([0.1]), r"positions of shape \(1,\)"),
    (lambda m: m.expected_error([1, 2, 3]), "joint values of shape"),
    (lambda m: m.inverse([0.3, 0.3], near=[0.1]), "near of shape"),
    (lambda m: m.inverse([[0.3, 0.3]] * 3, near=[[0.1, 1]] * 2), "near has 2 rows for 3"),
    (lambda m: m.inverse([0.3, 0.3], near=[9, 1]), "near has shoulder = 9: expected a value"),
    (lambda m: m.path([[0.3, 0.3]]), "2 waypoints or more, got 1"),
    (lambda m: m.path([[0.3, 0.3], [np.nan, 0.1]]), "row 1"),
    (lambda m: m.path([[0.3, 0.3], [0.2, 0.3]], start=[9.0, 0.0]), "shoulder = 9"),
    (lambda m: m.path([[0.3, 0.3], [0.2, 0.3]], step=0.0), "greater than zero"),
    (lambda m: m.path([[0.3, 0.3], [0.2, 0.3]], step=1e-9), "give a longer one"),
]


@pytest.fixture(scope="module")
def model():
    return trained("two_link")


def test_a_single_vector_answers_as_its_row_where_local_models_speak_too():
    """Rows that are denser in a part of the box: some nodes speak only near themselves."""
    rows = log(1200)
    part = rows.take(rows.q[:, 0] ** 2 + 0.1 > np.random.default_rng(0).random(1200))
    x = part.x + 1e-3 * np.sin(30 * part.q[:, :1])
    model = calib.train(replace(part, x=x, arm=None), size=14)
    assert model.predictor.models.degree >= 1
    q = draw(model, 200, seed=3)
    single = np.array([model.forward(row) for row in q])
    np.testing.assert_allclose(single, model.forward(q), atol=1e-12)
    for bound in (model.expected_error, model.model_error):
        np.testing.assert_allclose([bound(row) for row in q], bound(q), rtol=1e-9)
    known = q[np.isfinite(single[:, 0])][:40]
    targets = model.forward(known)
    found = np.array([model.inverse(x, near=near) for x, near in zip(targets, known, strict=True)])
    np.testing.assert_allclose(found, model.inverse(targets, near=known), atol=1e-9)


def test_outside_of_the_range_of_a_joint_there_is_no_answer(model):
    lower, span = model.about.lower, model.about.upper - model.about.lower
    for axis in range(2):
        for end, sign in ((0.0, -1), (1.0, 1)):
            u = np.array([0.5, 0.5])
            for beyond, known in ((-1e-6, True), (0.0, True), (1e-6, True), (1e-4, False)):
                u[axis] = end + sign * beyond
                q = lower + u * span
                for answer in (model.forward, model.expected_error, model.model_error):
                    assert np.isfinite(answer(q)).all() == known
                assert (model.outside(q) is None) == known
    said = model.outside(lower + [1.5, 0.5] * span)
    assert said == "shoulder = 2.35619 rad is outside of the learned range 0 to 1.5708 rad"


def with_a_hole(size):
    """A model of a log of two_link with 1 mm noise that leaves out a middle; its rows."""
    s = log(1500, 1e-3)
    kept = s.take(lengths((s.q - [0.8, 1.4]) / (s.upper - s.lower)) > size)
    return calib.train(replace(kept, arm=None), size=14, body="none"), kept


def test_without_a_body_there_is_no_answer_far_from_every_row():
    """The bound grows with the distance; beyond a tenth of the reach there is no answer."""
    model, kept = with_a_hole(0.45)
    for answer in (model.forward, model.expected_error, model.model_error):
        assert np.isnan(answer([0.8, 1.4])).all()
    assert model.outside([0.8, 1.4]).startswith("no row was measured near these joint values")
    assert np.isfinite(model.forward(kept.q[::10])).all()
    assert model.model_error(kept.q[::10]).max() <= 0.1 * model.reach
    # what is answered all over the box keeps its bound
    q = draw(model, 5000, seed=9)
    x = two_link(q) + np.random.default_rng(9).normal(scale=1e-3, size=q.shape)
    smaller, _ = with_a_hole(0.3)
    said, bound = smaller.forward(q), smaller.expected_error(q)
    known = np.isfinite(said[:, 0])
    assert 0.6 < known.mean() < 0.95
    assert (np.isfinite(bound) == known).all()
    assert np.mean(lengths(said - x)[known] <= bound[known]) >= 0.93


@pytest.mark.parametrize(("query", "message"), NO_QUERIES)
def test_what_is_no_query_is_refused_in_one_line(model, query, message):
    assert isinstance(refused(calib.QueryError, message, query, model), calib.CalibError)


@pytest.mark.parametrize("far", [[np.nan, 1], [np.inf, 1], [1e9, 1], [-1e30, 1], [9.5, 1]])
def test_beyond_a_turn_or_without_a_number_there_is_no_arm(far):
    model = turning()  # its first joint turns round and round, from -pi to pi
    for answer in (model.forward(far), model.expected_error(far), model.jacobian(far)):
        assert np.isnan(answer).all()
    near = model.forward([[3.3, 1.0], [3.3 - 2 * np.pi, 1.0], far])
    np.testing.assert_allclose(near[0], near[1], atol=1e-12)
    assert np.isnan(near[2]).all()
    assert np.isfinite(near[:2]).all()


@pytest.mark.parametrize(
    ("robot", "noise"),
    [("two_link", 0.0), ("two_link", 1e-3), ("two_link_full", 1e-3), ("polar", 1e-3)],
)
def test_bounds_of_a_simulation_hold_in_both_directions(robot, noise, all_points):
    model = trained(robot, n=3000, size=15, noise=noise)
    arm, rng = calib.load_arm(robot), np.random.default_rng(99)
    q = rng.uniform(arm.lower, arm.upper, (8000, arm.dof))
    x = arm.forward(q)
    forward = lengths(model.forward(q) - x) <= model.expected_error(q)
    answer = model.solve(x, near=q[rng.permutation(len(q))])
    reached = answer.reachable
    assert reached.mean() > 0.99
    away = lengths(arm.forward(answer.q) - x)
    inverse = (away <= answer.expected_error)[reached]
    if noise == 0.0:  # errors of rounding: of the map, and of the search that ends beside a target
        assert forward.all()
        assert (away <= answer.expected_error + answer.distance)[reached].all()
        assert away[reached].max() < 1e-12
        return
    assert 0.93 <= forward.mean() <= 0.97
    assert calib.evaluate(model).within["covered"] == pytest.approx(forward.mean(), abs=0.015)
    assert 0.93 <= inverse.mean() <= 0.97
    border = (np.abs(model.motor.scale.to_unit(q) - 0.5) > 0.45).any(axis=1)
    assert 0.91 <= forward[border].mean() <= 0.98
    if robot == "two_link":
        maps = trained(robot, n=3000, size=15, noise=noise, body="none")
        assert 0.93 <= accuracy(maps, q, x, "expected_error")[1] <= 0.97


@pytest.mark.parametrize("rows", [200, 800])
def test_a_logs_bound_on_what_the_sensor_will_read_holds_for_95_percent(rows):
    held = []
    for seed in range(2):
        model = calib.train(log(rows, 1e-3, seed), size=8, seed=seed)
        assert model.about.bound_of == "sensor reading"
        fresh = log(5000, 1e-3, seed + 70)
        assert np.isfinite(model.expected_error(fresh.q)).mean() > 0.95
        held.append(accuracy(model, fresh.q, fresh.x, "expected_error")[1])
    assert 0.93 <= np.mean(held) <= 0.98
