"""Correct: the compensation that a controller takes."""

import csv
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import refused
from models import arm, babbled, bare, lengths, model, of_the_drawing, six, wide

import calib

Q = np.random.default_rng(0).uniform([0.4, 0.7], [1.1, 2.0], (50, 2))
CHANGES = ["elbow.length=+5%", "shoulder.offset=0.03 elbow.offset=-0.02", "elbow.gear=1.02"]


@pytest.mark.parametrize("changes", CHANGES)
def test_the_real_arm_goes_where_the_nominal_one_would(changes):
    samples = babbled(*changes.split(), n=100, noise=0.0)
    adapted = calib.adapt(model(), samples, cause="joints").model
    truth = samples.simulation.exact
    wanted = arm().forward(Q)
    assert lengths(truth(Q) - wanted).mean() > 2e-3
    found = calib.correct(adapted, Q)
    assert lengths(truth(found.q) - wanted).max() < 1e-4


def test_a_sensor_that_moved_is_no_fault_of_the_arm():
    adapted = model()
    for changes in (("sensor.rotate=0.1", "sensor.shift=0.05,0"), ("sensor.mirror=x",)):
        adapted = calib.adapt(adapted, babbled(*changes, n=100, noise=0.0)).model
        assert np.abs(calib.correct(adapted, Q).q - Q).max() < 1e-4


def test_out_of_reach_is_nan_and_without_a_urdf_an_error():
    adapted = calib.adapt(model(), babbled("elbow.length=-20%", n=60)).model
    found = calib.correct(adapted, [[0.3, 0.27], [0.6, 1.4]])
    assert found.reachable.tolist() == [False, True]
    assert np.isnan(found.q[0]).all()
    assert found.distance[0] > 0.03
    undrawn = calib.train(replace(babbled(n=60), arm=None, simulation=None), size=10)
    refused(calib.OptionError, "no URDF", calib.correct, undrawn, Q)


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """A model of an arm whose first joint turns all the way round, adapted to an offset; a file."""
    trained = calib.train(calib.babble(wide(), 3000, seed=0), size=15)
    changed = calib.babble(wide(), 200, seed=1, changes=["elbow.offset=0.02"])
    adapted, path = calib.adapt(trained, changed).model, tmp_path_factory.mktemp("m") / "m.calib"
    adapted.save(path)
    return adapted, path


def test_answers_stay_on_the_turn_of_the_input(turning):
    """A sweep from -3.1 to -3.2 rad came back as -3.099 .. +3.084."""
    about = turning[0].about
    assert about.upper[0] - about.lower[0] == pytest.approx(2 * np.pi)
    for start, end in ((-3.1, -3.2), (3.0, 3.4), (-6.0, 6.0)):
        q = np.linspace([start, 1.0], [end, 1.3], 200)
        found = calib.correct(turning[0], q)
        assert not found.exceeded.any()
        assert np.abs(found.q - q).max() < 0.05
        step = np.abs(np.diff(q, axis=0)).max()
        assert np.abs(np.diff(found.q, axis=0)).max() < step + 0.01


def test_a_change_beyond_the_limit_is_marked_and_not_written(tmp_path, run, turning):
    model, path = turning
    found = calib.correct(model, [[0.3, 1.0], [0.4, 2.4]], limit=1e-4)
    assert found.exceeded.all()
    assert np.isnan(found.q).all()  # what exceeds the limit is no command
    assert np.isfinite(found.nearest).all()
    (tmp_path / "q.csv").write_text("shoulder,elbow\n0.3,1.0\n0.4,2.4\n")
    old = tmp_path / "out.csv"
    old.write_text("old")
    line = f"correct {path} --input {tmp_path}/q.csv --output {old}"
    done = run(f"{line} --limit 0.0001 --json")
    assert done.code == 3
    assert old.read_text() == "old"
    assert "rows 1, 2 of 2" in done.err
    assert "--limit" in done.err
    assert done.document["beyond_limit"] == [1, 2]
    change = done.document["change"]["elbow"]
    assert change["max"] == pytest.approx(0.02, abs=2e-3)
    between = np.abs(found.change).max(axis=1).mean()
    some = run(f"{line} --limit {between:.12f} --json").document
    assert some["beyond_limit"] == [2]  # a refused change is no part of the mean one
    assert all(joint["max"] <= between for joint in some["change"].values())
    done = run.done(line)
    assert np.isfinite(np.loadtxt(old, delimiter=",", skiprows=1)).all()
    told = re.search(r"elbow ([\d.]+) deg \(largest ([\d.]+) deg\)", done.out)
    sizes = np.degrees([change["mean"], change["max"]])
    assert [*map(float, told.groups())] == pytest.approx(sizes, rel=5e-3)


def test_command_answers_row_by_row_and_other_columns_go_along(tmp_path, run, turning):
    model, path = turning
    table, out = tmp_path / "q.csv", tmp_path / "q2.csv"
    table.write_text('time,elbow,note,shoulder,x\n0.10,1.0,"a, b",0.3,9\n0.20,x,,0.4,9\n')
    run.refused(1, "row 2 of 2", f"correct {path} --input {table} --output {out}")
    lines = out.read_text().splitlines()
    assert lines[0] == "time,elbow,note,shoulder,x,y,distance,expected_error,reachable"
    row = next(csv.reader([lines[1]]))
    assert (row[0], row[2]) == ("0.10", "a, b")
    expected = calib.correct(model, [0.3, 1.0]).q[0]
    assert [float(row[3]), float(row[1])] == pytest.approx(expected, abs=1e-12)
    table.write_text("shoulder,elbow\n30,60\n")
    answers = run(f"correct {path} --input {table} --degrees --json").document["answers"]
    expected = calib.correct(model, np.deg2rad([30, 60])).q[0, 0]  # in rad
    assert answers["shoulder"][0] == pytest.approx(expected)


def test_the_frame_of_a_tracker_is_not_corrected():
    """Rows of a log in a tracker's own frame moved by a median of 12 degrees."""
    changed = babbled("elbow.length=+2%", "elbow.offset=0.01", n=400, noise=1e-4)
    truth = changed.simulation.exact
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    seen = replace(changed, x=changed.x @ turn.T + [3.0, -2.0], simulation=None, arm=arm())
    found = calib.correct(calib.train(seen, size=12), Q)
    assert "first joint's offset is taken as zero; if the log is in the" in found.notes[0]
    pixels = calib.correct(calib.train(replace(seen, unit="px"), size=12), Q)
    assert pixels.notes[0].endswith("taken as zero")
    assert lengths(truth(found.q) - arm().forward(Q)).max() < 1e-3
    assert np.abs(found.change).max() < np.radians(3.0)
    based = calib.correct(calib.train(replace(changed, simulation=None), size=12, view="base"), Q)
    assert based.notes == ()
    assert lengths(truth(based.q) - arm().forward(Q)).max() < 1e-3


def test_six_joints_keep_the_tools_orientation():
    model = six()
    structure, beta = model.body.structure, model.body.beta
    middle = np.array([0.3, -1.2, 1.4, -0.8, 1.2, 0.4])
    q = middle + np.random.default_rng(1).uniform(-0.3, 0.3, (100, 6))
    found = calib.correct(model, q)
    assert found.reachable.all()
    wanted, reached = structure.pose(q, of_the_drawing(model.body)), structure.pose(found.q, beta)
    np.testing.assert_allclose(reached[0], wanted[0], rtol=0, atol=1e-8)
    np.testing.assert_allclose(reached[1], wanted[1], rtol=0, atol=1e-8)
    assert found.angle.max() < 1e-7
    assert np.abs(found.change).max() > 1e-4


def test_beside_a_wrist_singularity_no_tool_is_tilted_without_a_word():
    """A UR5 with wrist_2 at -0.01 rad was tilted by 5.5 deg with `reachable=1`."""
    model = six()
    q = np.array([0.3, -1.2, 1.4, -0.8, 0.0, 0.4]) + np.zeros((9, 6))
    q[:, 4] = np.linspace(-0.02, 0.02, 9)
    found = calib.correct(model, q)
    answered = found.reachable & ~found.exceeded
    assert found.angle[found.reachable].max() < 1e-5
    assert not answered.all()
    assert (np.isfinite(found.q).all(axis=1) == answered).all()
    assert np.isfinite(found.nearest).all()
    assert (found.distance[~found.reachable] + found.angle[~found.reachable] > 0).all()
    model.warm_up()
    if model.warm:
        for row, together, one_answers in zip(q, found.q, answered, strict=True):
            alone = calib.correct(model, row)
            assert (alone.reachable[0] and not alone.exceeded[0]) == one_answers
            if one_answers:
                np.testing.assert_allclose(alone.q[0], together, atol=1e-6)


def test_a_correction_meets_a_nearly_singular_wrist_and_no_stop():
    arm = calib.load_arm("six_axis")
    changes = ("shoulder_lift.offset=0.01", "elbow.length=+1%")
    model = calib.train(bare(arm, 150, 1, *changes, noise=1e-4), view="base", size=3)
    q = calib.babble(arm, 600, seed=7).q
    corrected = calib.correct(model, q)
    lower, upper = np.transpose(arm.limits)
    assert np.isfinite(corrected.q).all(axis=1).mean() > 0.99
    assert ((corrected.nearest >= lower - 1e-9) & (corrected.nearest <= upper + 1e-9)).all()
    wrist = [28, 45, 561]  # whose joints change by 0.02 to 0.06 rad
    assert corrected.reachable[wrist].all()
    reached = calib.Simulation(arm, changes=changes).exact(corrected.q[wrist])
    assert lengths(reached - arm.forward(q[wrist])).max() < 2e-4
    assert corrected.angle[wrist].max() < 1e-6
