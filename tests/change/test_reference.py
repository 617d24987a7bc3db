"""The frame of a log: mirrors, senses, locks and units that are found before anything else."""

from __future__ import annotations

import numpy as np
import pytest
from beliefs import LOWER, UPPER, body, exact_body, joints, noise, tip

from calib.change.reference import carried_offset, kept_reference, reference_of
from calib.change.sanity import lag_behind_body

pytestmark = pytest.mark.usefixtures("one_blas_thread")


def test_a_log_in_the_old_frame_stays_there():
    q = joints(60, 3)
    reference = reference_of(body(), q, tip(q) + noise(60))
    assert not reference.new
    np.testing.assert_array_equal(reference.beta, body().beta)


@pytest.mark.parametrize(
    ("truth", "found"),
    [
        (lambda q: tip(q) * [-1.0, 1.0], ("mirrored", True)),
        (lambda q: tip(q * [1.0, -1.0]), ("turned", (1,))),
        (lambda q: tip(np.stack([q[:, 0], np.full(len(q), 0.8)], axis=1)), ("locked", (1,))),
        (lambda q: 1000.0 * tip(q) + [5.0, -80.0], ("scale", 1000.0)),
        (lambda q: 39.37 * tip(q) @ [[0.0, 1.0], [1.0, 0.0]], ("mirrored", True)),
    ],
)
def test_another_sense_or_unit_is_found_before_anything_else(truth, found):
    q = joints(80, 4)
    reference = reference_of(exact_body(), q, truth(q))
    name, value = found
    assert reference.new
    assert getattr(reference, name) == pytest.approx(value)
    said = reference.structure.predict(q, reference.beta)
    # a lock is known to a step of the search, all else exactly
    share = 0.05 if name == "locked" else 1e-6
    assert np.abs(said - truth(q)).max() < share * np.ptp(truth(q))


def test_a_turn_is_found_by_the_short_way_round():
    q = joints(80, 5)
    for angle in (-2.5, -0.4, 0.4, 3.0):
        c, s = np.cos(angle), np.sin(angle)
        reference = reference_of(exact_body(), q, tip(q) @ [[c, s], [-s, c]])
        rotation = reference.structure.groups["view.rotation"][0]
        change = reference.beta[rotation] - exact_body().beta[rotation]
        assert change == pytest.approx(angle, abs=1e-6)


def test_positions_that_follow_the_joints_are_found_out():
    t = np.linspace(0, 12, 300)
    u = 0.5 + 0.4 * np.stack([np.sin(t), np.sin(1.7 * t + 1)], axis=1)
    q = LOWER + u * (UPPER - LOWER)
    reference = kept_reference(body())
    assert lag_behind_body(reference, q, tip(q)) == 0
    for lag in (4, -9):
        shifted = np.roll(tip(q), lag, axis=0)
        rows = slice(20, 280)
        assert lag_behind_body(reference, q[rows], shifted[rows]) == lag
    assert lag_behind_body(reference, joints(300), tip(joints(300, 1))) == 0


def test_what_maps_add_turns_with_the_sensor():
    q = joints(50, 14)
    offset = 1e-3 * np.stack([np.sin(5 * q[:, 0]), np.cos(4 * q[:, 1])], axis=1)
    turned = body().beta.copy()
    turned[body().structure.groups["view.rotation"]] += 0.7
    turned[body().structure.groups["view.shift"]] += [0.2, -0.1]
    moved = carried_offset(body(), body(), turned, q, offset)
    c, s = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(moved, offset @ [[c, s], [-s, c]], atol=1e-12)
