"""Corners of a board: the camera in the hand, the board in the hand, against a known truth."""

from dataclasses import replace

import numpy as np
import pytest
from boards import Rig

from calib.arm.rotations import logarithm
from calib.body.corners import fit_corners, held_of
from calib.body.sensor import SensorPose


def fitted(rig):
    return fit_corners(
        rig.structure, rig.q, rig.poses, rig.rows, rig.corners, rig.seen, rig.in_hand
    )


@pytest.mark.parametrize("in_hand", [True, False])
def test_pixels_are_differentiated_rightly(in_hand):
    rig = Rig(in_hand, pictures=3)
    rows = np.column_stack([rig.q[rig.rows], rig.corners])[::7]
    active = np.flatnonzero(np.arange(rig.truth.size) < rig.truth.groups["curve.0"][0])
    active = np.setdiff1d(active, rig.truth.groups["view.scale"])
    _, slope = rig.truth.linearise(rows, rig.beta, active)
    for k, index in enumerate(active):
        step = np.zeros(rig.truth.size)
        step[index] = 1e-6
        ahead, back = (
            rig.truth.predict(rows, rig.truth.retract(rig.beta, sign * step)) for sign in (1, -1)
        )
        assert np.allclose(slope[:, :, k], (ahead - back) / 2e-6, rtol=1e-5, atol=1e-3), index


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("in_hand", [True, False])
def test_camera_and_board_are_found_with_an_arm_that_is_off(in_hand, known):
    rig = Rig(in_hand, seed=3, known=known)
    fit, body = fitted(rig)
    (p, turn), (p0, turn0) = rig.hand(body.beta), rig.hand(rig.beta)
    assert np.linalg.norm(p - p0) < (0.5e-3 if known else 1e-3)
    assert np.linalg.norm(logarithm((turn.T @ turn0)[None])) < np.radians(0.08 if known else 0.15)
    own = rig.structure.groups["tool"]
    assert (abs(body.beta[own] - rig.beta[own]) < 2.5 * body.deviations[own]).all()
    assert 1.96 * body.deviations[own].max() < 3e-3
    assert fit.body.noise[0] == pytest.approx(rig.noise, rel=0.35)
    sensor, (there, _) = SensorPose.of(body), rig.base
    assert np.linalg.norm(sensor.position - there) < 3e-3


@pytest.mark.parametrize("in_hand", [True, False])
def test_the_hand_is_told_as_the_last_encoder_says(in_hand):
    rig = Rig(in_hand, seed=4, pictures=16, last=True, off=2.0)
    _, body = fitted(rig)
    found, true = held_of(body), held_of(replace(body, beta=rig.beta))
    turned = logarithm((found.rotation @ true.rotation.T)[None])[0]
    assert (abs(found.position - true.position) < 4 * found.told_sd).all()
    assert (abs(turned) < 4 * found.told_turn_sd).all()
    assert np.linalg.norm(turned) < np.radians(0.05)
    # of the true last link it is as far turned as its encoder is off, which the interval says
    away = logarithm((rig.hand(rig.beta)[1] @ true.rotation.T)[None])[0]
    assert np.linalg.norm(away) > np.radians(0.2)
    assert (abs(away) < 1.96 * body.kappa * found.turn_sd + 1e-4).all()
