"""A model of several sensors: one file, one arm, and each sensor's own answers."""

from dataclasses import replace

import numpy as np
import pytest
from models import draw, in_space

import calib
from calib.errors import OptionError
from calib.model_file.storage import to_bytes


def two_eyed() -> calib.Model:
    """A model of two sensors, the second one with readings in a frame that is a metre away."""
    left = in_space()
    beta = left.body.beta.copy()
    beta[left.body.structure.groups["view.shift"]] += 1.0
    away = replace(left.body, beta=beta)
    right = replace(left, about=replace(left.about, sensor="right"), body=away)
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


def test_a_file_keeps_the_arm_once(tmp_path):
    model = two_eyed()
    model.save(tmp_path / "two.calib")
    loaded = calib.load(tmp_path / "two.calib")
    assert to_bytes(loaded) == to_bytes(model)
    alone = replace(model, others=())
    assert len(to_bytes(model)) < len(to_bytes(alone)) + 20_000
    q = draw(model, 5)
    for sensor in model.sensors:
        assert np.array_equal(loaded.forward(q, sensor=sensor), model.forward(q, sensor=sensor))
        bounds = [each.by(sensor).expected_error(q) for each in (loaded, model)]
        np.testing.assert_allclose(*bounds, rtol=1e-12)


def test_what_one_sensor_learns_of_the_arm_all_have():
    model = two_eyed()
    right = model.by("right")
    offset = right.body.structure.groups["offset"]
    beta = right.body.beta.copy()
    beta[offset[1]] += 0.01
    adapted = replace(right, body=replace(right.body, beta=beta))
    both = model.with_sensor(adapted)
    assert both.sensors == model.sensors
    assert both.body.beta[offset[1]] == beta[offset[1]]
    assert both.by("right").body is adapted.body
