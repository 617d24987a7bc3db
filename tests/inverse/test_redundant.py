"""Redundant arms: near, the middle, connected families, four to seven joints."""

import numpy as np
import pytest
from chains import planar_chain
from models import draw, trained

import calib


def test_no_answer_is_further_than_joints_that_are_known_to_reach():
    model = trained("three_link")
    q = draw(model, 100, seed=6, margin=0.1)
    x, span = model.forward(q), model.about.upper - model.about.lower
    middle = (model.about.lower + model.about.upper) / 2
    for wish in (
        np.clip(q + 0.1 * span * [1, -1, 1], model.about.lower, model.about.upper),
        middle,
    ):
        joints = model.inverse(x, near=wish)
        np.testing.assert_allclose(model.forward(joints), x, atol=1e-8)
        here, there = (np.linalg.norm((rows - wish) / span, axis=1) for rows in (joints, q))
        assert (here <= there + 1e-4).all()


@pytest.mark.parametrize(("joints", "slide"), [(4, None), (5, 1), (7, None)])
def test_four_to_seven_joints(joints, slide, tmp_path):
    path = tmp_path / "chain.urdf"
    path.write_text(planar_chain(joints, slide))
    names = [f"j{k + 1}" for k in range(joints)]
    arm = calib.load_arm(path, joints=names, tip="tip")
    rows = {4: 600, 5: 900, 7: 4600}[joints]
    model = calib.train(calib.babble(arm, rows, seed=0), size=8)
    assert len(model.motor.lattice.shape) == 2
    q = draw(model, 100, seed=6)
    x = arm.forward(q)
    assert np.linalg.norm(model.forward(q) - x, axis=1).max() < 1e-8
    for said in (model.inverse(x), model.inverse(x, near=q)):
        assert np.linalg.norm(arm.forward(said) - x, axis=1).max() < 1e-8
    np.testing.assert_allclose(model.inverse(x, near=q), q, atol=1e-5)
    found = model.inverse_all(x[:3])
    for k, solutions in enumerate(found):
        assert 1 <= len(solutions) < 10
        assert np.linalg.norm(arm.forward(solutions) - x[k], axis=1).max() < 1e-8
