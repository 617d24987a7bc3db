"""Derivatives of every structure and measurement are differences of its predictions."""

from dataclasses import replace

import numpy as np
import pytest
from models import seen_by_two

import calib
from calib.body.planar import planar_structure
from calib.body.spatial import structure_of

STEP = 1e-6


def in_plane(revolute=(True, True), view="rigid", signs=(1, 1), mirror=1):
    names = tuple(f"j{k}" for k in range(len(revolute)))
    structure = planar_structure(np.eye(2), names, revolute, view=view)
    sensor = {"extent": 0.4, "mirror": mirror, "centre": (0.1, -0.2)}
    structure = replace(structure.with_sensor(**sensor), signs=signs)
    rng = np.random.default_rng(0)
    beta = structure.prior(structure.members()[-1][1]).mean + rng.normal(0, 0.02, structure.size)
    beta[structure.groups["length"]] = 0.3
    beta[structure.groups["view.shift"]] = 0.5, -0.3
    return structure, rng.uniform(-1, 1, (4, structure.dof)), beta


def in_space(robot, view, sensors=1):
    """An arm a little off everywhere, before a sensor that stands somewhere."""
    arm = calib.load_arm(robot)
    alone = sensors == 1
    structure = structure_of(arm, view) if alone else seen_by_two().by("right").body.structure
    rng, groups = np.random.default_rng(0), structure.groups
    beta = structure.neutral() + rng.normal(0, 1e-2, structure.size)
    beta[groups["lens"]] = (900.0, 640.0, 360.0, -0.1)
    if view == "pinhole":
        beta[groups["view.shift"]] = (0.1, 0.2, 3.0)
    else:
        beta[groups["view.rotation"]] = rng.normal(0, 1, 3)
    return structure, rng.uniform(arm.lower, arm.upper, (5, arm.dof)), beta


@pytest.mark.parametrize(
    ("world", "case"),
    [
        (in_plane, ((True, True), "rigid", (1, 1), 1)),
        (in_plane, ((True, True, True), "homography", (1, -1, 1), -1)),
        (in_plane, ((True, False, True), "affine", (1, 1, -1), 1)),
        (in_plane, ((False, True), "homography", (1, 1), -1)),
        *((in_space, ("spatial_three", view)) for view in ("base", "rigid", "similarity")),
        (in_space, ("spatial_three", "pinhole")),
        (in_space, ("spatial_three", "rigid", 2)),
        (in_space, ("six_axis", "pose")),
    ],
)
def test_derivatives_are_differences(world, case):
    structure, q, beta = world(*case)
    seen, by_beta = structure.linearise(q, beta)
    np.testing.assert_array_equal(seen, structure.predict(q, beta))

    def agrees(up, down, exact):
        difference = (structure.residual(up, seen) - structure.residual(down, seen)) / (2 * STEP)
        atol = 1e-6 * (1 + np.abs(exact).max())
        np.testing.assert_allclose(difference, exact, atol=atol, rtol=1e-6)

    # harmonics are many, and alike
    harmonics = [structure.groups[f"curve.{k}"][5:] for k in range(structure.dof)]
    for k in np.setdiff1d(np.arange(structure.size), np.concatenate(harmonics)):
        step = STEP * np.eye(structure.size)[k]
        up = structure.predict(q, structure.retract(beta, step))
        down = structure.predict(q, structure.retract(beta, -step))
        agrees(up, down, by_beta[:, :, k])
    by_joint = structure.slope(q, beta)
    for k, step in enumerate(STEP * np.eye(structure.dof)):
        up, down = structure.predict(q + step, beta), structure.predict(q - step, beta)
        agrees(up, down, by_joint[:, :, k])
