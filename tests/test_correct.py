"""Correct: the compensation that a controller takes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drifting import arm, log, model

import calib
from calib.errors import OptionError, QueryError
from calib.use.correct import correct

Q = np.random.default_rng(0).uniform([0.4, 0.7], [1.1, 2.0], (50, 2))


@pytest.mark.parametrize(
    "changes",
    [
        ("elbow.length=+5%",),
        ("shoulder.offset=0.03", "elbow.offset=-0.02"),
        ("shoulder.offset=0.02",),
        ("tip.offset=0.01,0.02",),
        ("elbow.gear=1.02",),
    ],
)
def test_the_real_arm_goes_where_the_nominal_one_would(changes):
    samples = log(*changes, n=100, noise=0.0)
    adapted = model().adapt(samples)
    truth = samples.simulation.exact
    wanted = arm().forward(Q)
    assert np.linalg.norm(truth(Q) - wanted, axis=1).mean() > 2e-3
    assert np.linalg.norm(truth(adapted.correct(Q)) - wanted, axis=1).max() < 1e-4


def test_nothing_to_correct():
    assert np.abs(model().correct(Q) - Q).max() < 1e-6
    assert model().correct(Q[0]).shape == (2,)


def test_a_sensor_that_moved_is_no_fault_of_the_arm():
    adapted = model().adapt(log("sensor.rotate=0.1", "sensor.shift=0.05,0", n=100, noise=0.0))
    assert np.abs(adapted.correct(Q) - Q).max() < 1e-4
    twice = adapted.adapt(log("sensor.mirror=x", n=100, noise=0.0))
    assert np.abs(twice.correct(Q) - Q).max() < 1e-4


def test_out_of_reach_is_nan():
    adapted = model().adapt(log("elbow.length=-20%", n=60))
    found = correct(adapted, [[0.3, 0.27], [0.6, 1.4]])
    assert found.reachable.tolist() == [False, True]
    assert np.isnan(found.q[0]).all()
    assert found.distance[0] > 0.03


def test_a_model_without_a_urdf():
    bare = calib.train(replace(log(n=60), arm=None, simulation=None), size=10)
    with pytest.raises(OptionError, match="no URDF"):
        bare.correct(Q)


def test_wrong_shape():
    with pytest.raises(QueryError, match="shoulder, elbow"):
        model().correct([0.1, 0.2, 0.3])


def test_command(tmp_path, run):
    path = tmp_path / "m.calib"
    model().adapt(log("elbow.length=+5%", n=60, noise=0.0)).save(path)
    table = tmp_path / "q.csv"
    table.write_text("shoulder,elbow\n0.5,1.0\nx,1\n0.6,1.2\n")
    done = run("correct", path, "--input", table, "--output", tmp_path / "q2.csv")
    assert done.code == 1
    assert "rows 2 of 3" in done.err
    lines = (tmp_path / "q2.csv").read_text().splitlines()
    assert lines[0] == "shoulder,elbow,x,y,distance,expected_error,reachable"
    expected = calib.load(path).correct([0.6, 1.2])
    assert [float(v) for v in lines[3].split(",")[:2]] == pytest.approx(expected, abs=1e-12)
    table.write_text("shoulder,elbow\n30,60\n")
    done = run("correct", path, "--input", table, "--degrees", "--json")
    assert done.code == 0
    shoulder = done.document["answers"]["shoulder"][0]
    assert shoulder == pytest.approx(np.rad2deg(calib.load(path).correct(np.deg2rad([30, 60])))[0])
