"""Evaluation: figures by hand, exact truth for a simulation, recorded rows for a log."""

from dataclasses import replace

import numpy as np
import pytest
from models import bare, lengths, log, measured, papers, trained
from refusals import refused
from scipy.spatial.transform import Rotation

import calib


def test_a_simulated_model_repeats_the_errors_of_its_training():
    for model in (trained("two_link"), papers(1e-3)):
        evaluation = calib.evaluate(model)
        assert (evaluation.rows, evaluation.left_out) == (1000, 0)
        assert evaluation.source == "fresh exact samples"
        assert evaluation.within == pytest.approx(model.about.within, rel=1e-6)
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
    for readout, column, error in (
        ("forward", "distance", lengths(missed)),
        ("forward", "y", np.abs(missed[:, 1])),
        ("inverse", "elbow", back[:, 1]),
    ):
        expected = {"mean": error.mean(), "max": error.max(), "p99": np.quantile(error, 0.99)}
        assert evaluation.errors["local"][readout][column] == pytest.approx(expected, rel=1e-5)
    assert (evaluation.rows, evaluation.left_out) == (400, 0)
    assert evaluation.source == "measured rows of the log"
    learned = measured()
    off = lengths(learned.forward(fresh.q) - fresh.x)
    covered = np.mean(off <= learned.expected_error(fresh.q))
    assert calib.evaluate(learned, fresh).within["covered"] == covered
    assert calib.evaluate(learned, replace(fresh, left_out=3)).left_out == 3  # by who read it
    of_few = calib.evaluate(learned, log(9, 2e-3, seed=3))  # no share of fewer than ten
    assert (of_few.within.keys(), of_few.bound_holds) == ({"p95"}, None)


def test_errors_of_orientations_are_what_a_tracker_adds():
    rows = bare("spatial_three", 120, 0, noise=0.0)
    noise = Rotation.from_rotvec(np.random.default_rng(0).normal(0, 2e-3, (120, 3)))
    orientation = (Rotation.from_quat(rows.arm.pose(rows.q)[1]) * noise).as_quat()
    rows = replace(rows, orientation=orientation)
    model = calib.train(rows.take(slice(0, 80)), size=3)
    evaluation = calib.evaluate(model, rows.take(slice(80, 120)))
    told = evaluation.errors["local"]["forward"]["orientation"]["mean"]
    assert told == pytest.approx(noise[80:].magnitude().mean(), rel=0.1)


def test_rows_outside_of_what_was_learned_and_repeated_ones_are_counted():
    rows = measured().rows
    some = replace(rows, q=rows.q[::2], x=rows.x[::2], held_out=rows.held_out[::2])
    assert calib.evaluate(replace(measured(), rows=some), log(1200, 1e-3)).learned == 1200
    repeated = log(8, 1e-3, seed=5).take(np.repeat(np.arange(8), 15))
    evaluation = calib.evaluate(papers(1e-3), repeated)
    assert (evaluation.rows, evaluation.notes) == (8, ("112 repeated rows count once",))
    arm = calib.load_arm("two_link")
    narrow = calib.train(calib.babble(arm.with_range({"elbow": (1.0, 2.0)}), 1000), size=10)
    fresh = log(500, seed=5)
    within = np.sum((fresh.q[:, 1] >= 1.0) & (fresh.q[:, 1] <= 2.0))
    evaluation = calib.evaluate(narrow, fresh)
    assert (evaluation.rows, evaluation.left_out) == (within, 500 - within)


def test_a_log_of_other_joints_is_refused_and_one_in_another_order_is_the_same_log():
    s, model = log(50), trained("two_link")
    other = replace(s, joint_names=("hip", "knee"), arm=None)
    words = "log's joints are hip, knee, the model's are shoulder"
    refused(calib.LogError, words, calib.evaluate, model, other)
    turned = calib.Samples(
        s.q[:, ::-1], s.x, s.joint_names[::-1], s.lower[::-1], s.upper[::-1], s.revolute[::-1]
    )
    assert calib.evaluate(model, turned).errors == calib.evaluate(model, s).errors
    assert calib.check(model, turned).score == calib.check(model, s).score


def test_a_frame_that_moved_is_told_and_can_be_found_anew():
    model = calib.train(bare("two_link", 200, 1, noise=1e-4), size=8)
    fresh = bare("two_link", 200, 2, noise=1e-4)
    rotation = Rotation.from_rotvec([0.0, 0.0, 0.1]).as_matrix()[:2, :2]
    moved = replace(fresh, x=fresh.x @ rotation.T + [0.02, -0.01])
    kept, free = calib.evaluate(model, moved), calib.evaluate(model, moved, frame="free")
    assert kept.errors["local"]["forward"]["distance"]["mean"] > 0.01
    assert free.errors["local"]["forward"]["distance"]["mean"] < 3e-4
    assert any("drifted: the sensor's frame moved" in note for note in kept.notes)
    assert kept.verdict.changed
    assert any("found anew" in note for note in free.notes)
    assert not any("frame" in note for note in calib.evaluate(model, fresh).notes)
