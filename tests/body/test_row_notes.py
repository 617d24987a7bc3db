"""What the rows of a log cannot tell: joints that stand still, or move together."""

import numpy as np
from models import log_of

import calib

ARM = calib.load_arm("six_axis")


def notes(q):
    """Notes of a model of rows (n, 6) on joints that tell too little."""
    model = calib.train(log_of(ARM, q, ARM.forward(q)), size=3)
    words = ("move together", "never moves")
    return [note for note in model.about.notes if any(word in note for word in words)]


def test_only_joints_that_move_together_are_named():
    q = np.random.default_rng(0).uniform(-1, 1, (60, 6))
    assert notes(q) == []
    q[:, 3] = 0.5 * q[:, 1]
    (note,) = notes(q)
    assert note.startswith("shoulder_lift, wrist_1 move together along 1 of 2 directions")
    q[:, 0] = 0.3
    still, together = notes(q)
    assert still.startswith("shoulder_pan never moves")
    assert together == note


def test_joints_that_are_tied_but_for_a_fraction_of_a_degree_are_named():
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (60, 4))
    q[:, 3] = q[:, 1] + np.radians(0.3) * rng.uniform(-1, 1, 60)
    (note,) = notes(q)
    assert note.startswith("lift, roll move together")
    q[:, 3] = q[:, 1] + np.radians(3.0) * rng.uniform(-1, 1, 60)
    assert notes(q) == ()
