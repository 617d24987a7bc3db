"""The exported URDF describes the arm as it really is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drifting import arm, log, model

import calib
from calib.errors import OptionError
from calib.use.geometry import fit_geometry
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
    corrected = exported(tmp_path, model().adapt(samples))
    q = np.random.default_rng(0).uniform(arm().lower, arm().upper, (200, 2))
    assert np.abs(corrected.forward(q) - samples.simulation.exact(q)).max() < 1e-5
    assert np.abs(arm().forward(q) - samples.simulation.exact(q)).max() > 5e-3


def test_offsets_and_lengths_come_out_apart():
    adapted = model().adapt(log("elbow.length=+4%", "elbow.offset=0.02", n=100, noise=0.0))
    geometry = fit_geometry(adapted)
    assert geometry.offsets == pytest.approx([0.0, 0.02], abs=1e-4)
    assert geometry.moved[1] == pytest.approx([0.01, 0.0], abs=1e-4)
    assert geometry.base == pytest.approx([0.0, 0.0], abs=1e-4)
    assert geometry.residual < 1e-5


def test_nothing_to_change(tmp_path):
    geometry = fit_geometry(model())
    assert np.abs(geometry.offsets).max() < 1e-6
    corrected = exported(tmp_path, model())
    assert corrected.joint_names == arm().joint_names
    assert np.allclose(corrected.lower, arm().lower)


def test_a_sensor_that_moved_is_not_put_into_the_urdf():
    geometry = fit_geometry(
        model().adapt(log("sensor.rotate=0.1", "sensor.shift=0.1,0", n=100, noise=0.0))
    )
    assert np.abs(geometry.offsets).max() < 1e-5


def test_intervals_hold_the_truth():
    samples = log("elbow.length=+4%", n=100, noise=5e-4)
    geometry = fit_geometry(model().adapt(samples))
    assert abs(geometry.moved[1, 0] - 0.01) < 2 * geometry.interval_moved[1, 0]
    assert geometry.interval_moved[1, 0] < 2e-3


def test_what_no_geometry_explains():
    geometry = fit_geometry(model().adapt(log("elbow.gear=1.05", n=100, noise=0.0)))
    assert geometry.residual > 1e-4


def test_positions_must_be_metres():
    about = replace(model().about, unit="px")
    with pytest.raises(OptionError, match=r"'px'.*in m"):
        fit_geometry(replace(model(), about=about))


@pytest.mark.parametrize("robot", ["polar", "scara", "three_link"])
def test_other_robots(tmp_path, robot):
    chosen = calib.load_arm(robot)
    truth = calib.babble(chosen, 400, seed=1, changes=[f"{chosen.joint_names[0]}.offset=0.02"])
    trained = calib.train(calib.babble(chosen, 3000, seed=0), size=15)
    corrected = exported(tmp_path, trained.adapt(truth))
    q = np.random.default_rng(0).uniform(chosen.lower, chosen.upper, (100, chosen.dof))
    before = np.abs(chosen.forward(q) - truth.simulation.exact(q)).max()
    assert np.abs(corrected.forward(q) - truth.simulation.exact(q)).max() < 0.02 * before


def test_command(tmp_path, run):
    path = tmp_path / "m.calib"
    model().adapt(log("elbow.length=+4%", n=60, noise=0.0)).save(path)
    done = run("urdf", path, "-o", tmp_path / "c.urdf")
    assert done.code == 0, done.err
    assert "its link, along x" in done.out
    found = run("urdf", path, "-o", tmp_path / "c.urdf", "--json").document
    assert found["moved"]["elbow"]["value"][0] == pytest.approx(0.01, abs=1e-5)
    assert calib.load_arm(tmp_path / "c.urdf").link_lengths["elbow"] == pytest.approx(0.26)
