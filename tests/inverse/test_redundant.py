"""Redundant arms: near, the middle, connected families, four to seven joints."""

import numpy as np
import pytest
from models import draw, six, trained
from planar import chain_urdf, families_3r

import calib

LINKS = (0.30, 0.25, 0.15)


def test_no_move_along_the_self_motion_leads_closer():
    model = trained("three_link", n=8000)
    x, near = model.forward(draw(model, 200, seed=2)), draw(model, 200, seed=3)
    scale, newton = model.motor.scale, model.solver.newton
    u, wish = scale.to_unit(model.inverse(x, near=near)), scale.to_unit(near)
    slope = newton.task.residual(u, x)[1]
    assert np.abs(newton.tangent(u, slope, wish - u)).max() < 1e-4


def test_each_family_has_one_representative():
    model = trained("three_link", n=8000)
    lower, upper = model.about.lower, model.about.upper
    x = model.forward(draw(model, 120, seed=4, margin=0.05))
    whole = several = 0
    for target, found in zip(x, model.inverse_all(x), strict=True):
        curves = families_3r(LINKS, lower, upper, target)
        near = np.array([[np.abs(c - q).max(axis=1).min() for c in curves] for q in found])
        assert (near.min(axis=1) < 5e-3).all()  # none is invented
        hits = np.count_nonzero(near < 5e-3, axis=0)
        # a curve shorter than a node spacing may be overlooked
        long = np.array([np.ptp(c, axis=0).max() > 0.1 for c in curves])
        whole += (hits[long] == 1).all()
        several += len(curves) > 1
    assert several >= 3
    assert whole >= 118


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
    path.write_text(chain_urdf(joints, slide=slide))
    names = [f"joint_{k + 1}" for k in range(joints)]
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


def test_a_move_is_damped_least_squares_and_the_projection_onto_the_null_space():
    newton = trained("three_link").solver.newton
    rng = np.random.default_rng(0)
    u, wish = rng.uniform(0.1, 0.9, (50, 3)), rng.uniform(-0.5, 0.5, (50, 3))
    gap = rng.uniform(-5e-3, 5e-3, (50, 2))
    slope = newton.task.residual(u, gap)[1]
    power = np.einsum("noi,noi->n", slope, slope)
    square = slope @ np.swapaxes(slope, 1, 2) + 1e-3 * power[:, None, None] * np.eye(2)
    expected = np.einsum("noi,no->ni", slope, np.linalg.solve(square, gap[..., None])[..., 0])
    damping = np.full(50, 1e-3)
    np.testing.assert_allclose(newton.move(u, gap, slope, damping), expected, rtol=1e-9)
    expected = wish - np.einsum("nio,noj,nj->ni", np.linalg.pinv(slope), slope, wish)
    np.testing.assert_allclose(newton.tangent(u, slope, wish), expected, atol=1e-9)


def test_a_step_ends_on_its_target_within_the_limits():
    model = trained("three_link")
    q = draw(model, 200, seed=4, margin=0.1)
    q[:, 0] = model.about.lower[0]  # the shoulder at its limit
    near = np.clip(q + 0.1, model.about.lower, model.about.upper)
    joints = model.inverse(model.forward(q), near=near)
    np.testing.assert_allclose(model.forward(joints), model.forward(q), atol=1e-12)
    assert (joints >= model.about.lower).all()
    assert (joints <= model.about.upper).all()


def test_positions_of_six_joints_name_each_family_once():
    """Three or four of up to nine families were found, and one of them twice."""
    arm, model = calib.load_arm("six_axis"), six()
    span, x = arm.upper - arm.lower, model.forward(draw(model, 3, seed=8, margin=0.2))

    def joined(u, goal, target):
        """Whether small steps that keep the position lead from joints to others."""
        for _ in range(75):
            wish = goal - u
            slope = model.jacobian(arm.lower + u * span) * span
            move = wish - np.linalg.pinv(slope) @ (slope @ wish)
            length = np.linalg.norm(move)
            if np.linalg.norm(wish) < 0.02 or length < 0.02 * np.linalg.norm(wish):
                return np.linalg.norm(wish) < 0.02
            u = np.clip(u + move * min(1.0, 0.04 / length), 0.0, 1.0)
            slope = model.jacobian(arm.lower + u * span) * span
            u = u + np.linalg.pinv(slope) @ (target - model.forward(arm.lower + u * span))
            if u.min() < 0.0 or u.max() > 1.0:
                return False
        return False

    for target, found in zip(x, model.inverse_all(x), strict=True):
        assert len(found) >= 1
        np.testing.assert_allclose(
            model.forward(found), np.tile(target, (len(found), 1)), atol=1e-8
        )
        units = (found - arm.lower) / span
        for i, a in enumerate(units):
            for j, b in enumerate(units):
                assert i <= j or not joined(a, b, target)
