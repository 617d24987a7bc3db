"""Expected errors hold for 95 % of the queries, inside and at the border."""

import numpy as np
import pytest
from models import draw, log, two_link

import calib
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.readouts.bounds import blend_nodes, learn_bounds, near_border
from calib.scale import TURN, Scale


def grid(n=12, periodic=False):
    lattice = Lattice((n, n))
    span = np.array([TURN if periodic else 1.0, 1.0])
    scale = Scale(np.zeros(2), span, np.array([periodic, False]))
    return Map((lattice.positions() + 0.5) / n, lattice, scale, np.zeros((0, 4)))


def points(n, seed=0):
    return np.random.default_rng(seed).random((n, 2))


def coverage(motor, bounds, u, errors):
    return float(np.mean(errors <= blend_nodes(motor, bounds, u)))


def uneven(u, seed):
    """Errors that are Rayleigh distributed, larger on one side and growing towards the rim."""
    rim = np.exp(-np.minimum(u, 1 - u).min(axis=1) / 0.05)
    size = 1e-4 + 1e-3 * u[:, 0] + 2e-3 * rim
    return size * np.linalg.norm(np.random.default_rng(seed).normal(size=(len(u), 2)), axis=1)


def test_errors_that_are_all_the_same_are_their_own_bound():
    motor = grid()
    bounds = learn_bounds(motor, points(500), np.full(500, 3e-3))
    np.testing.assert_allclose(bounds, 3e-3)


def test_errors_twice_as_large_have_bounds_twice_as_large():
    u = points(2000)
    a, b = (learn_bounds(grid(), u, k * uneven(u, 1)) for k in (1, 2))
    np.testing.assert_allclose(b, 2 * a)


def test_errors_of_zero_have_bounds_of_next_to_nothing():
    bounds = learn_bounds(grid(), points(200), np.zeros(200))
    assert (bounds >= 0).all()
    assert bounds.max() < 1e-12


def test_bounds_follow_where_the_errors_are():
    u = points(4000)
    bounds = learn_bounds(grid(), u, uneven(u, 1)).reshape(12, 12)
    assert bounds[8:10, 4:8].mean() > 2 * bounds[2:4, 4:8].mean()
    assert bounds[0, 4:8].mean() > 2 * bounds[3, 4:8].mean()


@pytest.mark.parametrize("seed", range(4))
def test_bounds_hold_for_95_percent_inside_and_at_the_border(seed):
    motor, u = grid(), points(6000, seed)
    bounds = learn_bounds(motor, u, uneven(u, seed + 100))
    fresh = points(20_000, seed + 200)
    errors = uneven(fresh, seed + 300)
    border = near_border(motor, fresh)
    for group in (np.ones(len(fresh), dtype=bool), border, ~border):
        assert 0.93 <= coverage(motor, bounds, fresh[group], errors[group]) <= 0.97


def test_few_errors_give_bounds_that_hold_rather_too_often():
    """Averaged over many draws of 40 errors, as conformal prediction promises."""
    motor, held = grid(), []
    for seed in range(30):
        u = points(40, seed)
        bounds = learn_bounds(motor, u, uneven(u, seed + 100))
        fresh = points(500, seed + 200)
        held.append(coverage(motor, bounds, fresh, uneven(fresh, seed + 300)))
    assert 0.90 <= np.mean(held) <= 0.99


def test_the_doubt_of_a_teacher_shapes_the_bounds():
    motor, u = grid(), points(3000)
    size = 1e-3 * (1 + 9 * u[:, 1])
    errors = size * np.abs(np.random.default_rng(1).normal(size=3000))
    doubt = 1 + 9 * np.concatenate([motor.units, u])[:, 1]
    bounds = learn_bounds(motor, u, errors, doubt)
    inside = ~near_border(motor, motor.units)
    ratio = (bounds / doubt[: motor.size])[inside]
    np.testing.assert_allclose(ratio, ratio[0])
    assert 1.7e-3 < ratio[0] < 2.3e-3  # 1.96 standard deviations


def test_near_a_limit_is_within_one_and_a_half_spacings_and_a_turn_has_none():
    motor, turn = grid(), grid(periodic=True)
    u = np.array([[0.5, 0.5], [0.1, 0.5], [0.13, 0.5], [0.5, 0.95], [0.95, 0.5]])
    assert motor.spacing == pytest.approx(1 / 12)
    assert near_border(motor, u).tolist() == [False, True, False, True, True]
    assert near_border(turn, u).tolist() == [False, False, False, True, False]


@pytest.mark.parametrize("seed", range(3))
def test_a_simulated_models_bound_on_the_true_position_holds_for_95_percent(seed):
    samples = calib.babble(calib.load_arm("two_link"), 1500, seed=seed, noise=1e-3)
    model = calib.train(samples, size=15, seed=seed)
    assert model.about.bound_of == "true position"
    q = draw(model, 20_000, seed=seed + 50)
    errors = np.linalg.norm(model.forward(q) - two_link(q), axis=1)
    bound = model.expected_error(q)
    border = near_border(model.motor, model.motor.scale.to_unit(q))
    for group in (np.ones(len(q), dtype=bool), border, ~border):
        assert 0.93 <= np.mean(errors[group] <= bound[group]) <= 0.97


@pytest.mark.parametrize("rows", [200, 800])
def test_a_logs_bound_on_what_the_sensor_will_read_holds_for_95_percent(rows):
    held = []
    for seed in range(2):
        model = calib.train(log(rows, 1e-3, seed), size=8, seed=seed)
        assert model.about.bound_of == "sensor reading"
        fresh = log(5000, 1e-3, seed + 70)
        known = np.isfinite(model.forward(fresh.q)[:, 0])
        assert known.mean() > 0.95
        errors = np.linalg.norm(model.forward(fresh.q[known]) - fresh.x[known], axis=1)
        held.append(np.mean(errors <= model.expected_error(fresh.q[known])))
    assert 0.93 <= np.mean(held) <= 0.98


def test_nodes_near_a_limit_have_a_bound_of_their_own():
    motor, u = grid(), points(4000)
    border = near_border(motor, u)
    errors = np.where(border, 4e-3, 1e-3)
    bounds = learn_bounds(motor, u, errors, np.full(motor.size + 4000, 1.0))
    edge = near_border(motor, motor.units)
    # each group shares one doubt, so one bound; both hold where they speak
    assert np.ptp(bounds[edge]) == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(bounds[~edge]) == pytest.approx(0.0, abs=1e-12)
    assert bounds[edge].mean() > 3e-3 > 2e-3 > bounds[~edge].mean()
    for of in (border, ~border):
        assert coverage(motor, bounds, u[of], errors[of]) >= 0.95


def test_a_joint_that_turns_round_has_no_limit_to_be_near():
    motor = grid(periodic=True)
    spacing = motor.spacing
    u = np.array([[0.0, 0.5], [0.5, 1.4 * spacing], [0.5, 1.6 * spacing], [0.5, 1.0]])
    assert near_border(motor, u).tolist() == [False, True, False, True]
