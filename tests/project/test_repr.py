"""What an object says of itself in a shell or a notebook: a few lines, no arrays."""

import numpy as np
import pytest

import calib

ARM = calib.load_arm("two_link")
LOG = calib.babble(ARM, 200, seed=3)
MODEL = calib.train(LOG, motor_size=8, sensory_size=8)


@pytest.mark.parametrize(
    ("shown", "beginning"),
    [
        (ARM, "PlanarArm two_link: shoulder, elbow; tip tip"),
        (calib.load_arm("six_axis"), "SpatialArm six_axis: shoulder_pan"),
        (LOG, "Samples(200 rows of shoulder, elbow)"),
        (MODEL, "Model of two_link: shoulder, elbow; 200 samples, 8x8 nodes"),
        (MODEL.body, "Body of 200 rows\nshoulder: length 300.0"),
        (calib.check(MODEL, LOG), "Verdict: still calibrated"),
        (calib.adapt(MODEL, LOG), "Adaptation: not improved"),
        (calib.evaluate(MODEL, LOG), "Evaluation of 200 measured rows"),
        (calib.plan(MODEL, 5), "Plan of shoulder, elbow\n  5 poses"),
        (
            MODEL.path(np.array([[0.2, 0.3], [0.9, 0.3]])),
            "Path of 81 rows: 51 out of reach, 0 jumps",
        ),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, str) else "",
)
def test_an_object_says_what_it_is_in_a_few_lines(shown, beginning):
    assert repr(shown).startswith(beginning)
    assert len(repr(shown)) < 500
    assert "array" not in repr(shown)
