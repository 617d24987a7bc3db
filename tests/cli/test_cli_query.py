"""`calib query`: answers, batches, units and exit codes."""

import io
import re

import numpy as np
import pytest
from models import two_link
from reference import read

import calib


def test_what_has_no_answer_is_exit_code_3_with_one_line(run, model):
    done = run("query", "inverse", model, "2", "2", "--json")
    assert done.code == 3
    assert done.document["reachable"] is False
    assert done.document["solutions"][0]["distance"] > 2.0
    assert re.fullmatch(r"out of reach: .* [\d.]+ mm away\n", done.err)
    done = run("query", "forward", model, "0.5", "3.5")
    assert (done.code, done.out) == (3, "")
    outside = "elbow = 3.5 rad is outside of the learned range 0.261799 to 2.61799 rad"
    assert done.err == f"no answer: {outside}\n"
    done = run("query", "forward", model, "30", "200", "--degrees", "--json")
    assert done.document["position"] == [None, None]
    assert done.document["expected_error"] is done.document["model_error"] is None
    assert "elbow = 200 deg is outside of the learned range 15 to 150 deg" in done.err


def test_batch_forward_and_back_returns_the_positions(run, model, tmp_path):
    q = np.random.default_rng(0).uniform([0.2, 0.5], [1.3, 2.3], (50, 2))
    typed = "shoulder,elbow\n" + "\n".join(f"{a!r},{b!r}" for a, b in q.tolist()) + "\n"
    forward = run.done("query", "forward", model, "--input", "-", stdin=typed)
    answered, bounds = read(forward.out), ["expected_error", "model_error"]
    assert list(answered) == ["shoulder", "elbow", "x", "y", *bounds]
    assert (answered["shoulder"] == q[:, 0]).all()
    positions = np.c_[answered["x"], answered["y"]]
    assert (positions == calib.load(model).forward(q)).all()  # in full: not a bit is lost
    targets, answers = tmp_path / "targets.csv", tmp_path / "answers.csv"
    targets.write_text(forward.out)
    inverse = run("query", "inverse", model, "--input", targets, "--output", answers)
    assert (inverse.code, inverse.out, inverse.err) == (0, "", "")
    found = read(answers.read_text())
    assert list(found) == ["x", "y", "shoulder", "elbow", "distance", *bounds, "reachable"]
    assert (found["reachable"] == 1).all()
    joints = np.c_[found["shoulder"], found["elbow"]]
    assert np.abs(two_link(joints) - positions).max() < 1e-3


def test_batch_keeps_bad_rows_in_their_place(run, model):
    typed = "x,y\n0.1,0.4\nabc,1\n2,2\n,\n-0.1,0.3\n"
    done = run("query", "inverse", model, "--input", "-", stdin=typed)
    assert done.code == 1
    found = read(done.out)
    assert found["reachable"].tolist() == [1, 0, 0, 0, 1]
    assert np.isnan([found["shoulder"][1], found["distance"][1]]).all()
    assert np.isnan([found["shoulder"][2], found["elbow"][2]]).all()
    assert found["distance"][2] > 1.0
    assert "rows 2, 4 of 5" in done.err
    assert "row 3 of 5: out of reach" in done.err


@pytest.mark.parametrize("readout", ["linear", "activity", "winner"])
def test_the_bound_of_another_readout_covers_its_distance_from_the_truth(run, model, readout):
    rows, tables = "shoulder,elbow\n0.3,0.6\n0.4,0.9\n0.9,1.4\n", []
    for options in ([], ["--readout", readout]):
        done = run.done("query", "forward", model, "--input", "-", *options, stdin=rows)
        tables.append(np.loadtxt(io.StringIO(done.out), delimiter=",", skiprows=1))
    body, other = tables
    off = np.linalg.norm(other[:, 2:4] - body[:, 2:4], axis=1)
    assert (off > 1e-5).any()
    assert (other[:, 4] >= off).all()
    done = run("query", "forward", model, "0.3", "0.6", "--readout", readout, "--json")
    assert done.document["expected_error"] == pytest.approx(other[0, 4], rel=1e-6)
