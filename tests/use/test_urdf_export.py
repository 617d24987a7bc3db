"""The exported URDF describes the arm as it really is."""

from dataclasses import replace

import numpy as np
import pytest
from drifting import arm, log, model

import calib
from calib import RobotError
from calib.use.geometry_fit import fit_geometry
from calib.use.urdf import corrected_urdf


def exported(tmp_path, adapted):
    path = tmp_path / "corrected.urdf"
    path.write_text(corrected_urdf(fit_geometry(adapted)))
    return calib.load_arm(path)


@pytest.mark.parametrize(
    "changes",
    [
        ("shoulder.length=+5%", "elbow.length=-3%"),
        ("shoulder.offset=0.03", "elbow.offset=-0.02"),
        ("tip.offset=0.01,0.02", "elbow.offset=0.02"),
    ],
)
def test_kinematics_of_the_changed_arm(tmp_path, changes):
    samples = log(*changes, n=100, noise=0.0)
    corrected = exported(tmp_path, calib.adapt(model(), samples, cause="joints").model)
    q = np.random.default_rng(0).uniform(arm().lower, arm().upper, (200, 2))
    assert np.abs(corrected.forward(q) - samples.simulation.exact(q)).max() < 1e-5
    assert np.abs(arm().forward(q) - samples.simulation.exact(q)).max() > 5e-3


def test_command(tmp_path, run):
    path = tmp_path / "m.calib"
    calib.adapt(model(), log("elbow.length=+4%", n=60, noise=0.0)).model.save(path)
    done = run("urdf", path, "-o", tmp_path / "c.urdf")
    assert done.code == 0, done.err
    assert "its link, along x" in done.out
    found = run("urdf", path, "-o", tmp_path / "c.urdf", "--json").document
    assert found["moved"]["elbow"]["value"][0] == pytest.approx(0.01, abs=1e-5)
    assert calib.load_arm(tmp_path / "c.urdf").link_lengths["elbow"] == pytest.approx(0.26)


def test_what_geometry_does_not_explain_is_not_written(tmp_path, run):
    """A log of another arm gave an elbow offset of 6,844 degrees and 277 mm rms, exit 0."""
    rng = np.random.default_rng(0)
    q = rng.uniform(arm().lower, arm().upper, (400, 2))
    x = np.stack([np.sin(3 * q[:, 0]) * q[:, 1], np.cos(2 * q[:, 1]) + q[:, 0] ** 2], axis=1)
    trained = calib.train(replace(log(n=400), q=q, x=x, simulation=None, arm=arm()), size=12)
    with pytest.raises(RobotError, match="% of the reach"):
        corrected_urdf(fit_geometry(trained))
    trained.save(tmp_path / "m.calib")
    (tmp_path / "old.urdf").write_text("old")
    done = run("urdf", tmp_path / "m.calib", "-o", tmp_path / "old.urdf", "--json")
    assert done.code == 3
    assert done.document["urdf"] is None
    assert (tmp_path / "old.urdf").read_text() == "old"
    assert "mesh" not in done.err


def test_the_users_own_file_is_never_written_over(tmp_path, run):
    path, nominal = tmp_path / "m.calib", tmp_path / "robot.urdf"
    model().save(path)
    nominal.write_text(arm().urdf)
    done = run("urdf", path, "-o", nominal)
    assert done.code == 1
    assert "never overwritten" in done.err
    assert nominal.read_text() == arm().urdf
