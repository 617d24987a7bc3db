"""A model of several sensors: one file, one arm, and each sensor's own answers."""

from dataclasses import replace

import numpy as np
import pytest
from models import draw, in_space

import calib
from calib import OptionError


def two_eyed() -> calib.Model:
    """A model of two sensors, the second one with readings in a frame that is a metre away."""
    left = in_space()
    shift = np.zeros(left.body.structure.size)
    shift[left.body.structure.groups["view.shift"]] = 1.0
    second = left.body.second
    if second is not None:
        second = replace(second, beta=second.beta + shift)
    away = replace(left.body, beta=left.body.beta + shift, second=second)
    scale = left.sensory.scale
    sensory = replace(left.sensory, scale=replace(scale, lower=scale.lower + 1.0))
    right = replace(
        left,
        about=replace(left.about, sensor="right"),
        body=away,
        association=replace(left.association, sensory=sensory),
        rows=None,
    )
    return replace(left, about=replace(left.about, sensor="left"), others=(right,))


def test_each_sensor_answers_in_its_own_frame():
    model = two_eyed()
    q = draw(model, 5)
    assert model.sensors == ("left", "right")
    assert model.by("left") is model.by("") is model
    right = model.by("right")
    assert right is model.by("right")
    assert right.sensors == ("right",)
    np.testing.assert_allclose(right.forward(q), model.forward(q) + 1.0, atol=1e-12)
    assert np.array_equal(model.forward(q, sensor="right"), right.forward(q))
    with pytest.raises(OptionError, match="'top': expected one of left, right"):
        model.by("top")
    alone = replace(model, others=(), about=replace(model.about, sensor=""))
    assert alone.by("any") is alone


def test_a_log_is_judged_as_its_sensor_sees_the_arm():
    model = two_eyed()
    right = model.by("right")
    rng = np.random.default_rng(3)
    q = draw(model, 40, seed=3)
    arm = calib.load_arm("spatial_three")
    log = calib.Samples(
        q, right.forward(q) + rng.normal(0.0, 2e-5, q.shape), arm.joint_names, sensor="right"
    )
    assert not calib.check(model, log).drifted
    assert calib.check(model, replace(log, sensor="left")).drifted
    turned = replace(log, q=log.q - np.array([0.0, 0.01, 0.0]))  # the shoulder was put on anew
    adapted = calib.adapt(model, turned)
    assert adapted.improved, adapted.notes
    assert adapted.model.sensors == ("left", "right")
    moved = adapted.model.forward(turned.q, sensor="right")
    assert np.median(np.linalg.norm(moved - right.forward(q), axis=1)) < 3e-4
