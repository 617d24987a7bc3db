"""The one way from joints to readings: what it answers, and where it answers nothing."""

from dataclasses import replace

import numpy as np
import pytest
from models import draw, trained, turning

from calib.body.approach import Approach
from calib.model.prediction import predict
from calib.samples.motion import Motion


@pytest.mark.parametrize(
    "far", [[np.nan, 1.0], [np.inf, 1.0], [1e9, 1.0], [-1e30, 1.0], [9.5, 1.0]]
)
def test_beyond_a_turn_or_without_a_number_there_is_no_arm(far):
    model = turning()  # its first joint turns round and round, from -pi to pi
    for answer in (model.forward(far), model.expected_error(far), model.jacobian(far)):
        assert np.isnan(answer).all()
    near = model.forward([[3.3, 1.0], [3.3 - 2 * np.pi, 1.0], far])
    np.testing.assert_allclose(near[0], near[1], atol=1e-12)
    assert np.isnan(near[2]).all()
    assert np.isfinite(near[:2]).all()


@pytest.mark.parametrize("robot", ["two_link", "spatial_three", "six_axis"])
def test_a_known_side_is_never_less_sure(robot):
    """An unknown side adds the play of every joint, whatever number of joints there is."""
    model = trained(robot, n=300, size=6)
    play = np.linspace(0.0, 0.01, len(model.about.lower))
    model = replace(model, approach=Approach(play))
    q = draw(model, 30, margin=0.1)
    side = np.sign(np.random.default_rng(0).normal(size=q.shape))
    sure = predict(model, Motion(q, side))
    unsure = predict(model, Motion(q))
    assert (sure.bound < unsure.bound).all()
    assert (sure.true_bound < unsure.true_bound).all()
    moved = np.linalg.norm(sure.value - unsure.value, axis=1)
    assert (moved <= unsure.bound).all()
    unknown = predict(model, Motion(q, np.zeros_like(side)))
    assert np.array_equal(unknown.bound, unsure.bound)
    model.warm_up()  # the compiled kernel has the play too
    for row in range(3):
        assert model.expected_error(q[row]) == pytest.approx(unsure.bound[row], rel=1e-5)
        assert model.model_error(q[row]) == pytest.approx(unsure.true_bound[row], rel=1e-5)
