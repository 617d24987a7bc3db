"""Plans for models and for arms in space: the poses that tell most."""

import math

import numpy as np
from models import in_pixels, trained

import calib
from calib.use.pose_space import hits_itself

DEGREE = math.radians(1.0)


def test_plan_of_a_model_tells_what_it_expects():
    model = trained("two_link", n=3000, size=20)
    plan = calib.plan(model, 25)
    np.testing.assert_array_equal(plan.x, model.forward(plan.q))
    np.testing.assert_array_equal(plan.expected_error, model.expected_error(plan.q))
    names = ["shoulder", "elbow", "expected_x", "expected_y", "expected_error"]
    assert list(plan.columns()) == names
    # its URDF tells the limits
    np.testing.assert_allclose(plan.q.min(axis=0), model.about.lower + DEGREE)


def test_a_model_of_a_log_plans_within_what_was_measured():
    log = calib.babble(calib.load_arm("two_link"), 60, seed=2, noise=1e-3)
    free = calib.Samples(log.q, log.x, log.joint_names, log.q.min(0), log.q.max(0), log.revolute)
    model = calib.train(free, size=8)
    plan = calib.plan(model, 10)
    np.testing.assert_allclose(plan.q.min(axis=0), log.q.min(axis=0))
    np.testing.assert_allclose(plan.q.max(axis=0), log.q.max(axis=0))


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


def test_a_plan_for_a_camera_keeps_the_tip_in_its_picture():
    model = in_pixels()
    plan = calib.plan(model, 20)
    width, height = model.about.picture or (1280, 960)
    assert ((plan.x > 0) & (plan.x < [width, height])).all()
    assert "picture" in plan.notes[-1]
