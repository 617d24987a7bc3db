"""`calib query`: answers, batches, units and exit codes."""

import csv
import io
import re

import numpy as np
import pytest
from models import two_link

import calib


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_what_has_no_answer_is_exit_code_3_with_one_line(run, model):
    done = run("query", "inverse", model, "2", "2", "--json")
    assert done.code == 3
    assert done.document["reachable"] is False
    assert done.document["solutions"][0]["distance"] > 2.0
    assert re.fullmatch(r"out of reach: .* [\d.]+ mm away\n", done.err)
    done = run("query", "forward", model, "0.5", "3.5")
    assert (done.code, done.out) == (3, "")
    assert done.err == (
        "no answer: elbow = 3.5 rad is outside of the learned range 0.261799 to 2.61799 rad\n"
    )
    done = run("query", "forward", model, "30", "200", "--degrees", "--json")
    assert done.document["position"] == [None, None]
    assert done.document["expected_error"] is done.document["model_error"] is None
    assert "elbow = 200 deg is outside of the learned range 15 to 150 deg" in done.err


def test_batch_forward_and_back_returns_the_positions(run, model, tmp_path):
    q = np.random.default_rng(0).uniform([0.2, 0.5], [1.3, 2.3], (50, 2))
    typed = "shoulder,elbow\n" + "\n".join(f"{a!r},{b!r}" for a, b in q.tolist()) + "\n"
    forward = run.done("query", "forward", model, "--input", "-", stdin=typed)
    rows = rows_of(forward.out)
    assert list(rows[0]) == ["shoulder", "elbow", "x", "y", "expected_error", "model_error"]
    assert [float(row["shoulder"]) for row in rows] == q[:, 0].tolist()
    positions = np.array([[float(row["x"]), float(row["y"])] for row in rows])
    assert (positions == calib.load(model).forward(q)).all()  # in full: not a bit is lost
    targets, answers = tmp_path / "targets.csv", tmp_path / "answers.csv"
    targets.write_text(forward.out)
    inverse = run("query", "inverse", model, "--input", targets, "--output", answers)
    assert (inverse.code, inverse.out, inverse.err) == (0, "", "")
    rows = rows_of(answers.read_text())
    bounds = ["expected_error", "model_error"]
    assert list(rows[0]) == ["x", "y", "shoulder", "elbow", "distance", *bounds, "reachable"]
    assert {row["reachable"] for row in rows} == {"1"}
    found = np.array([[float(row["shoulder"]), float(row["elbow"])] for row in rows])
    assert np.abs(two_link(found) - positions).max() < 1e-3


def test_batch_keeps_bad_rows_in_their_place(run, model):
    typed = "x,y\n0.1,0.4\nabc,1\n2,2\n,\n-0.1,0.3\n"
    done = run("query", "inverse", model, "--input", "-", stdin=typed)
    assert done.code == 1
    rows = rows_of(done.out)
    assert [row["reachable"] for row in rows] == ["1", "0", "0", "0", "1"]
    assert rows[1]["shoulder"] == rows[1]["distance"] == "nan"
    assert rows[2]["shoulder"] == rows[2]["elbow"] == "nan"
    assert float(rows[2]["distance"]) > 1.0
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
