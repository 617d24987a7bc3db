"""Expected errors hold for 95 % of the queries, inside and at the border."""

import numpy as np
import pytest
from models import measured, trained

from calib.common.scale import TURN, Scale
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.maps.node_bounds import blend_nodes, learn_bounds, near_border


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


def test_near_a_limit_is_within_one_and_a_half_spacings_and_a_turn_has_none():
    motor, turn = grid(), grid(periodic=True)
    u = np.array([[0.5, 0.5], [0.1, 0.5], [0.13, 0.5], [0.5, 0.95], [0.95, 0.5]])
    assert motor.spacing == pytest.approx(1 / 12)
    assert near_border(motor, u).tolist() == [False, True, False, True, True]
    assert near_border(turn, u).tolist() == [False, False, False, True, False]


def test_nodes_near_a_limit_have_a_bound_of_their_own():
    motor, (u, fresh) = grid(), (points(4000, seed) for seed in (0, 1))
    rng = np.random.default_rng(2)

    def errors(at):
        return np.where(near_border(motor, at), 4e-3, 1e-3) * np.abs(rng.normal(size=len(at)))

    bounds, later = learn_bounds(motor, u, errors(u)), errors(fresh)
    edge, border = near_border(motor, motor.units), near_border(motor, fresh)
    assert bounds[edge].mean() > 2.5 * bounds[~edge].mean()
    for of in (border, ~border):
        assert coverage(motor, bounds, fresh[of], later[of]) == pytest.approx(0.95, abs=0.02)


def test_a_joint_that_turns_round_has_no_limit_to_be_near():
    motor = grid(periodic=True)
    spacing = motor.spacing
    u = np.array([[0.0, 0.5], [0.5, 1.4 * spacing], [0.5, 1.6 * spacing], [0.5, 1.0]])
    assert near_border(motor, u).tolist() == [False, True, False, True]


def test_too_few_rows_near_a_limit_leave_it_the_factor_of_all_rows():
    motor, fresh = grid(), points(4000, 3)
    near = near_border(motor, fresh)
    rng = np.random.default_rng(0)
    held = []
    for _ in range(10):
        rim = np.column_stack([0.05 * rng.random(30), rng.random(30)])
        u = np.concatenate([0.15 + 0.7 * rng.random((970, 2)), rim])
        errors, later = (np.linalg.norm(rng.normal(size=(n, 2)), axis=1) for n in (1000, 4000))
        bounds = learn_bounds(motor, u, errors)
        held.append([coverage(motor, bounds, fresh[g], later[g]) for g in (near, ~near)])
    assert np.mean(held, axis=0) == pytest.approx([0.95, 0.95], abs=0.03)


def test_so_many_errors_are_within_their_bounds_as_conformal_prediction_asks():
    motor, u = grid(), 0.3 + 0.4 * points(200)  # no sample is near a limit
    errors = np.random.default_rng(1).random(200)
    share = np.sort(errors / blend_nodes(motor, learn_bounds(motor, u, errors), u))
    rank = int(np.ceil(0.95 * (len(errors) + 1))) - 1  # a fresh error exceeds it in 5 %
    assert share[rank] == pytest.approx(1.0)


def test_info_says_in_which_session_the_bounds_of_a_log_hold(tmp_path, run):
    for model, told in ((measured(), True), (trained("two_link", 600, 6), False)):
        model.save(tmp_path / "m.calib")
        assert ("in the session of the log" in run("info", tmp_path / "m.calib").out) is told
