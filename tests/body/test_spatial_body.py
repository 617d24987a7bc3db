"""Spatial bodies: derivatives, what a fit finds, and what it says that it does not know."""

import json

import numpy as np
import pytest
from models import built, in_pixels

from calib.arm.loading import load_arm
from calib.arm.rotations import exponential, logarithm
from calib.body import body_fit
from calib.body.belief import Body
from calib.body.rows import Rows
from calib.body.spatial import structure_of, unknown_structure
from calib.body.starts import candidates
from calib.errors import LogError
from calib.model_file.fields import read, write
from calib.model_file.storage import KINDS


def rows(arm, n, seed=0):
    return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (n, arm.dof))


def spread(z):
    return float(np.sqrt(((z[:, :3] - z[:, :3].mean(axis=0)) ** 2).sum(axis=1).mean()))


def fitted(structure, q, z, **sensor):
    return body_fit.fit(structure.with_sensor(extent=spread(z), **sensor), [Rows(q, z)]).body


def measured(arm, structure, beta, n, noise):
    """Rows with what a noisy sensor read of them, and others with the truth."""
    q, fresh = rows(arm, n, 1), rows(arm, 300, 2)
    z = structure.predict(q, beta)
    z[:, :3] += np.random.default_rng(3).normal(0, noise, (n, 3))
    return q, z, fresh, structure.predict(fresh, beta)


def missed(body, q, true):
    """Errors (n,) of a body, and the share of them within its bound on the truth."""
    error = np.linalg.norm(body.predict(q)[:, :3] - true[:, :3], axis=1)
    return error, np.mean(error <= body.bound(q, noise=False))


def test_a_fit_finds_the_arm_and_its_bound_holds_the_errors():
    arm, structure, beta, _ = built()
    q, z, fresh, true = measured(arm, structure, beta, 80, 5e-5)
    body = fitted(structure, q, z)
    error, covered = missed(body, fresh, true)
    assert error.mean() < 1.5e-4
    assert covered > 0.93
    data, arrays = write(body, Body, KINDS)
    again = read(Body, json.loads(json.dumps(data)), arrays, KINDS)
    np.testing.assert_array_equal(again.predict(fresh), body.predict(fresh))
    np.testing.assert_allclose(again.bound(fresh), body.bound(fresh), rtol=1e-5)
    words = " ".join(body.describe())
    assert "zero by convention" in words
    assert "elbow" in words


def test_a_pose_tells_the_tools_orientation():
    arm, structure, beta, _ = built("pose")
    beta[structure.groups["tool.rotation"]] = (0.3, -1.0, 0.5)
    q, z, fresh, true = measured(arm, structure, beta, 60, 5e-5)
    turned = exponential(np.random.default_rng(4).normal(0, 1e-4, (len(q), 3)))
    z[:, 3:] = logarithm(turned @ exponential(z[:, 3:]))
    error = structure.residual(true, fitted(structure, q, z).predict(fresh))
    assert np.linalg.norm(error[:, :3], axis=1).mean() < 2e-4
    assert np.linalg.norm(error[:, 3:], axis=1).mean() < 5e-4


def test_millimetres_and_a_free_scale():
    arm, structure, beta, _ = built("similarity")
    beta[structure.groups["view.scale"]] = np.log(1000.0)
    q = rows(arm, 60, 1)
    z = structure.predict(q, beta)
    body = fitted(structure, q, z, unit="sensor")
    scale = np.exp(body.beta[structure.groups["view.scale"][0]])
    assert scale == pytest.approx(1000.0, rel=5e-3)
    with pytest.raises(LogError, match="does not explain the positions"):
        candidates(structure.with_sensor(view="rigid"), Rows(q, z))
    in_mm = structure_of(arm, "rigid", unit="mm", metre=1000.0, extent=spread(z))
    assert np.abs(body_fit.fit(in_mm, [Rows(q, z)]).held_out).mean() < 1.0


def test_rows_that_no_arm_explains_are_refused_in_one_line():
    arm, structure, beta, _ = built()
    q = rows(arm, 60, 1)
    z = structure.predict(q, beta)
    for bad, words in (
        ((q[:3], z[:3]), "3 rows cannot place"),
        ((q, z * 0.0), "same in every row"),
        ((q, np.random.default_rng(0).normal(0, 0.3, z.shape)), "does not explain"),
        ((q[:, ::-1], z), "does not explain"),
        ((q, z[:, [1, 0, 2]]), "does not explain"),
    ):
        with pytest.raises(LogError, match=words) as caught:
            candidates(structure, Rows(*bad))
        assert "\n" not in str(caught.value)


def test_shuffled_orientations_and_pixels_are_refused_in_one_line():
    arm, structure, beta, _ = built("pose")
    q, rng = rows(arm, 60, 1), np.random.default_rng(2)
    poses = structure.predict(q, beta)
    assert len(candidates(structure, Rows(q, poses))) == 1
    with pytest.raises(LogError, match="do not turn as the joints do"):
        candidates(structure, Rows(q, np.hstack([poses[:, :3], rng.permutation(poses[:, 3:])])))
    body = in_pixels().body
    pixels = body.predict(q)
    assert len(candidates(body.structure, Rows(q, pixels))) == 1
    with pytest.raises(LogError, match="does not explain the pixels"):
        candidates(body.structure, Rows(q, rng.permutation(pixels)))


@pytest.mark.parametrize(("n", "noise", "most"), [(60, 1e-4, 3e-4), (200, 0.0, 1e-12)])
def test_without_a_drawing_the_chain_is_found(n, noise, most):
    arm = load_arm("spatial_three")
    q, fresh = rows(arm, n, 1), rows(arm, 100, 2)
    z = arm.forward(q) + np.random.default_rng(0).normal(0, noise, (n, 3))
    exact = noise == 0.0
    unknown = unknown_structure(arm.joint_names, arm.revolute, spread(z), simulated=exact)
    body = body_fit.fit(unknown, [Rows(q, z)]).body
    error, covered = missed(body, fresh, arm.forward(fresh))
    assert error.mean() < most
    assert exact or covered > 0.9
    assert body.member == "chain" or not exact
