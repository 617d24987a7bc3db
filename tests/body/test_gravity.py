"""Arms that sag, with and without masses in the drawing, on a wall; wrong gears."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from models import log_of
from reference import random_joints
from refusals import refused

import calib
from calib import OptionError
from calib.arm.gravity import Loads
from calib.arm.loading import arm_from_urdf

TEXT = (Path(__file__).parents[2] / "robots/six_axis.urdf").read_text(encoding="utf-8")
BARE = re.sub(r"<inertial>.*?</inertial>", "", TEXT, flags=re.DOTALL)
COMPLIANCE = np.array([0.8, 1.0, 1.2, 4.0, 5.0, 3.0])
NOISE = 1e-4  # [m]
FULL = arm_from_urdf(TEXT)
DOWN = (0.0, 0.0, -9.81)


def sagging(q, most, gravity=DOWN):
    """Positions (n, 3) [m] of an arm whose joints give way so that its tip moves by `most`."""
    torques = np.einsum("exn,x->ne", Loads.of_masses(FULL.chain).levers(q), gravity)
    bends = 1e-6 * COMPLIANCE * torques
    moved = np.linalg.norm(FULL.forward(q + bends) - FULL.forward(q), axis=1).max()
    return FULL.forward(q + most / moved * bends)


def trained(arm, q, x):
    """A model of rows (n, dof) and what a tracker saw."""
    return calib.train(log_of(arm, q, x, unit="m"), size=3)


@cache
def world(half=False):
    """Rows that are learned, with noise, and others, exact."""
    q = random_joints(FULL, 800)
    x = sagging(q, 3e-3)
    low = q[:, 1] < (FULL.lower[1] + FULL.upper[1]) / 2 if half else np.arange(len(q)) < 200
    noise = np.random.default_rng(0).normal(0.0, NOISE, (200, 3))
    return q[low][:200], x[low][:200] + noise, q[~low], x[~low]


def errors(model, q, x):
    """Mean distance [m], and the share of rows within the model's bound."""
    miss = np.linalg.norm(model.forward(q) - x, axis=1)
    return float(miss.mean()), float((miss <= model.model_error(q)).mean())


def test_an_arm_without_masses_is_as_accurate_as_with_them():
    q, x, others, truth = world()
    masses = errors(trained(FULL, q, x), others, truth)[0]
    model = trained(arm_from_urdf(BARE), q, x)
    bare = errors(model, others, truth)[0]
    assert bare < 1.2 * masses < 5e-5
    said = " ".join(model.body.describe(FULL.lower, FULL.upper))
    told = float(re.search(r"shoulder_lift: bends by up to ([\d.]+) mrad", said)[1])
    # the tip, 1 m away, moves by 3 mm, most of it by that joint
    assert 1.5 < told < 4.0


def test_the_other_half_of_a_sagging_arms_range_is_within_the_bound():
    q, x, others, truth = world(half=True)
    miss, covered = errors(trained(arm_from_urdf(BARE), q, x), others, truth)
    assert miss < 1e-4
    assert covered > 0.85


def test_an_arm_on_a_wall_is_believed_and_gravity_is_a_direction():
    q = random_joints(FULL, 250)
    x = sagging(q, 3e-3, (9.81, 0.0, 0.0)) + np.random.default_rng(0).normal(0.0, NOISE, (250, 3))
    arm = replace(arm_from_urdf(BARE), gravity=(9.81, 0.0, 0.0))
    assert errors(trained(arm, q[:100], x[:100]), q[100:], x[100:])[0] < 3e-4
    assert calib.load_arm("six_axis", gravity=(0, 0, 2)).gravity == (0.0, 0.0, 9.80665)
    refused(OptionError, r"gravity.*three numbers", calib.load_arm, "six_axis", gravity=(0, 0, 0))


@pytest.mark.parametrize("drawn", [True, False])
def test_a_gear_that_is_two_percent_wrong_is_found(drawn):
    """A chain alone missed by 7 mm of it."""
    q = random_joints(FULL, 300)
    gains = np.array([1.0, 1.0, 1.02, 1.0, 0.997, 1.0])
    x = FULL.forward(gains * q) + np.random.default_rng(0).normal(0.0, NOISE / 4, (len(q), 3))
    log = log_of(FULL, q[:150], x[:150], unit="m")
    model = calib.train(log if drawn else replace(log, arm=None), size=3)
    assert "geared" in model.body.member
    found = model.body.beta[model.body.structure.groups["gain"]]
    np.testing.assert_allclose(found[1:5], gains[1:5], atol=1e-3)
    miss, covered = errors(model, q[150:], FULL.forward(gains * q[150:]))
    assert miss < 1e-4
    assert covered > 0.93
