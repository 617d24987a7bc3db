"""Evaluation: figures by hand, exact truth for a simulation, recorded rows for a log."""

from dataclasses import replace

import numpy as np
import pytest
from models import log, log_of, measured, papers, trained
from scipy.spatial.transform import Rotation

import calib
from calib import LogError


def test_a_simulated_model_repeats_the_errors_of_its_training():
    for model in (trained("two_link"), papers(1e-3)):
        evaluation = calib.evaluate(model)
        assert evaluation.rows == 10_000
        assert evaluation.left_out == 0
        assert evaluation.source == "fresh exact samples"
        for readout, ways in evaluation.errors.items():
            for way, columns in ways.items():
                for column, figures in columns.items():
                    expected = model.about.errors[readout][way][column]
                    assert figures == pytest.approx(expected, rel=1e-6, abs=1e-12)


def test_another_log_is_compared_row_by_row():
    model, fresh = trained("two_link"), log(400, 1e-3, seed=5)
    evaluation = calib.evaluate(model, fresh)
    missed = model.forward(fresh.q) - fresh.x
    back = np.abs(model.inverse(fresh.x, near=fresh.q, nearest=True) - fresh.q)
    said = evaluation.errors["local"]
    for told, error in (
        (said["forward"]["distance"], np.linalg.norm(missed, axis=1)),
        (said["forward"]["y"], np.abs(missed[:, 1])),
        (said["inverse"]["elbow"], back[:, 1]),
    ):
        expected = {"mean": error.mean(), "max": error.max(), "p99": np.quantile(error, 0.99)}
        assert told == pytest.approx(expected, rel=1e-5)
    assert (evaluation.rows, evaluation.left_out) == (400, 0)
    assert evaluation.source == "measured rows of the log"
    learned = measured()
    off = np.linalg.norm(learned.forward(fresh.q) - fresh.x, axis=1)
    covered = np.mean(off <= learned.expected_error(fresh.q))
    assert calib.evaluate(learned, fresh).within["covered"] == covered
    assert calib.evaluate(learned, replace(fresh, left_out=3)).left_out == 3  # by who read it


def test_few_rows_are_covered_as_far_as_the_bound_of_each_reaches():
    model, few = measured(), log(8, 2e-3, seed=3)
    share = np.linalg.norm(model.forward(few.q) - few.x, axis=1) / model.expected_error(few.q)
    assert ((share > 1.0) & (share < 1.3)).any()
    assert calib.evaluate(model, few).within["covered"] == np.mean(share <= 1.0)


def test_errors_of_orientations_are_what_a_tracker_adds():
    arm, rng = calib.load_arm("spatial_three"), np.random.default_rng(0)
    q = rng.uniform(arm.lower, arm.upper, (120, 3))
    x, turns = arm.pose(q)
    noise = Rotation.from_rotvec(rng.normal(0, 2e-3, (120, 3)))
    rows = log_of(arm, q, x, orientation=(Rotation.from_quat(turns) * noise).as_quat())
    model = calib.train(rows.take(slice(0, 80)), size=3)
    evaluation = calib.evaluate(model, rows.take(slice(80, 120)))
    told = evaluation.errors["local"]["forward"]["orientation"]["mean"]
    assert told == pytest.approx(noise[80:].magnitude().mean(), rel=0.1)


def test_a_log_of_which_a_model_keeps_some_rows_is_learned_as_a_whole():
    rows = measured().rows
    some = replace(rows, **{name: getattr(rows, name)[::2] for name in ("q", "x", "held_out")})
    assert calib.evaluate(replace(measured(), rows=some), log(1200, 1e-3)).learned == 1200


def test_rows_outside_of_what_was_learned_are_left_out_and_counted():
    arm = calib.load_arm("two_link")
    narrow = calib.train(calib.babble(arm.with_range({"elbow": (1.0, 2.0)}), 1000), size=10)
    fresh = log(500, seed=5)
    known = (fresh.q[:, 1] >= 1.0) & (fresh.q[:, 1] <= 2.0)
    evaluation = calib.evaluate(narrow, fresh)
    assert (evaluation.rows, evaluation.left_out) == (known.sum(), 500 - known.sum())


def test_a_log_of_other_joints_is_refused_with_both_names():
    s = log(50)
    other = calib.Samples(s.q, s.x, ("hip", "knee"), s.lower, s.upper, s.revolute)
    with pytest.raises(LogError, match="log's joints are hip, knee, the model's are shoulder"):
        calib.evaluate(trained("two_link"), other)


def test_a_log_whose_columns_stand_in_another_order_is_the_same_log():
    s, model = log(50), trained("two_link")
    turned = calib.Samples(
        s.q[:, ::-1], s.x, s.joint_names[::-1], s.lower[::-1], s.upper[::-1], s.revolute[::-1]
    )
    assert calib.evaluate(model, turned).errors == calib.evaluate(model, s).errors
    assert calib.check(model, turned).score == calib.check(model, s).score


def test_a_frame_that_moved_is_told_and_can_be_found_anew(tmp_path, run):
    arm = calib.load_arm("two_link")
    rows = [calib.babble(arm, 200, seed=seed, noise=1e-4) for seed in (1, 2)]
    rows = [replace(each, simulation=None) for each in rows]
    model = calib.train(rows[0], size=8)
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    moved = replace(rows[1], x=rows[1].x @ turn.T + [0.02, -0.01])
    kept, free = calib.evaluate(model, moved), calib.evaluate(model, moved, frame="free")
    assert kept.errors["local"]["forward"]["distance"]["mean"] > 0.01
    assert free.errors["local"]["forward"]["distance"]["mean"] < 3e-4
    assert any("drifted: the sensor's frame moved" in note for note in kept.notes)
    assert kept.verdict.changed
    assert any("found anew" in note for note in free.notes)
    assert not any("frame" in note for note in calib.evaluate(model, rows[1]).notes)
    model.save(tmp_path / "m.calib")
    calib.write_log(moved, tmp_path / "moved.csv")
    words = ["evaluate", tmp_path / "m.calib", "--data", tmp_path / "moved.csv", "--json"]
    done = run(*words, "--frame", "free")
    assert done.document["errors"]["local"]["forward"]["distance"]["mean"] < 3e-4


def test_repeated_rows_count_once_where_they_are_few_too():
    fresh = log(8, 1e-3, seed=5)
    evaluation = calib.evaluate(papers(1e-3), fresh.take(np.repeat(np.arange(8), 15)))
    assert evaluation.rows == 8
    assert evaluation.notes == ("112 repeated rows count once",)
