"""Expected errors hold for 95 % of the queries, inside and at the border."""

import numpy as np
import pytest
from models import draw, measured, six, trained
from small_maps import grid, points

from calib.maps.node_bounds import blend_nodes, learn_bounds, near_border


def coverage(motor, bounds, u, errors):
    return float(np.mean(errors <= blend_nodes(motor, bounds, u)))


def uneven(u, seed):
    """Errors that are Rayleigh distributed, larger on one side and growing towards the rim."""
    rim = np.exp(-np.minimum(u, 1 - u).min(axis=1) / 0.05)
    size = 1e-4 + 1e-3 * u[:, 0] + 2e-3 * rim
    return size * np.linalg.norm(np.random.default_rng(seed).normal(size=(len(u), 2)), axis=1)


@pytest.mark.parametrize("seed", range(2))
def test_bounds_hold_for_95_percent_inside_and_at_the_border(seed):
    motor, u = grid(12), points(6000, seed)
    bounds = learn_bounds(motor, u, uneven(u, seed + 100))
    fresh = points(20_000, seed + 200)
    errors = uneven(fresh, seed + 300)
    border = near_border(motor, fresh)
    for group in (np.ones(len(fresh), dtype=bool), border, ~border):
        assert 0.93 <= coverage(motor, bounds, fresh[group], errors[group]) <= 0.97


def test_few_errors_give_bounds_that_hold_rather_too_often():
    """Averaged over many draws of 40 errors, as conformal prediction promises."""
    motor, held = grid(12), []
    for seed in range(30):
        u = points(40, seed)
        bounds = learn_bounds(motor, u, uneven(u, seed + 100))
        fresh = points(500, seed + 200)
        held.append(coverage(motor, bounds, fresh, uneven(fresh, seed + 300)))
    assert 0.90 <= np.mean(held) <= 0.99


def test_so_many_errors_are_within_their_bounds_as_conformal_prediction_asks():
    motor, u = grid(12), 0.3 + 0.4 * points(200)  # no sample is near a limit
    errors = np.random.default_rng(1).random(200)
    share = np.sort(errors / blend_nodes(motor, learn_bounds(motor, u, errors), u))
    rank = int(np.ceil(0.95 * (len(errors) + 1))) - 1  # a fresh error exceeds it in 5 %
    assert share[rank] == pytest.approx(1.0)


def test_info_says_in_which_session_the_bounds_of_a_log_hold(tmp_path, run):
    for model, told in ((measured(), True), (trained("two_link", 600, 6), False)):
        model.save(tmp_path / "m.calib")
        assert ("in the session of the log" in run("info", tmp_path / "m.calib").out) is told


def test_a_bound_in_space_is_the_same_alone_and_among_many():
    """A BLAS splits large products over threads, which round otherwise where sums cancel."""
    model = six()
    q = draw(model, 3000)
    together = model.expected_error(q)
    alone = np.array([model.expected_error(row) for row in q[::60]])
    np.testing.assert_allclose(together[::60], alone, rtol=2e-9)
