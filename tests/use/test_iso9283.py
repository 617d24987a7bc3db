"""ISO 9283: poses that the model has not learned take no part."""

from dataclasses import replace

import numpy as np
import pytest
from models import log_of

import calib
from calib.use.iso9283 import iso9283


def test_poses_outside_of_what_was_learned_are_left_out_aloud():
    """Their accuracy is no number: whether it was the worst depended on the poses' order."""
    arm = calib.load_arm("two_link")
    rng = np.random.default_rng(0)
    poses = np.array([[1.2, 2.0], [0.3, 0.8], [1.0, 1.5]])
    part = calib.load_arm("two_link", ranges={"shoulder": (0.0, 1.1)})
    rows = calib.babble(part, 200, seed=0, noise=1e-4)
    model = calib.train(replace(rows, simulation=None), size=4)
    q = np.tile(poses, (4, 1))
    x = arm.forward(q) + rng.normal(0.0, 1e-4, (12, 2))
    standard = iso9283(model, log_of(arm, q, x))
    assert len(standard.poses) == 2
    centres = x.reshape(4, 3, 2)[:, 1:].mean(axis=0)
    away = np.linalg.norm(model.forward(poses[1:]) - centres, axis=1)
    assert standard.corrected == pytest.approx(away.max(), rel=1e-9)
    assert any("1 of 3 poses" in note for note in standard.notes)
    q = np.tile([[1.2, 2.0], [1.3, 1.9]], (4, 1))
    with pytest.raises(calib.LogError, match="the 2 poses"):
        iso9283(model, log_of(arm, q, arm.forward(q)))
