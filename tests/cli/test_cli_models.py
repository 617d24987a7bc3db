"""`calib train`, `evaluate`, `info`, `babble` and `robots`: what they write and print."""

import math

import numpy as np
import pytest

import calib

SMALL = ("--size", "10", "-n", "500")


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def check_errors(errors, joints):
    assert set(errors) - {"body"} == {"local", "linear", "activity", "winner"}
    for directions in errors.values():
        assert set(directions) == {"forward", "inverse"}
        assert set(directions["forward"]) == {"x", "y", "distance"}
        assert set(directions["inverse"]) == {*joints, "distance"}
        for quantities in directions.values():
            for error in quantities.values():
                assert set(error) == {"mean", "max", "p99"}
                assert 0.0 <= error["mean"] <= error["max"]
                assert error["p99"] <= error["max"]


def test_train_writes_the_robots_name_and_one_document(run, tmp_path):
    done = run("train", "two_link", *SMALL, "--json")
    assert done.code == 0, done.err
    document = done.document
    assert document["model"] == "two_link.calib"
    assert [path.name for path in tmp_path.iterdir()] == ["two_link.calib"]
    assert document["joints"] == ["shoulder", "elbow"]
    assert document["size"] == {"motor": [10, 10], "sensory": [10, 10]}
    assert document["plane"] == {"origin": [0, 0, 0], "x": [1, 0, 0], "y": [0, 1, 0]}
    assert (document["samples"], document["seed"], document["unit"]) == (500, 0, "m")
    assert document["seconds"]["total"] > 0.0
    check_errors(document["errors"], ["shoulder", "elbow"])
    joints = {"shoulder": "rad", "elbow": "rad"}
    assert document["units"] == {"joints": joints, "positions": "m", "seconds": "s"}


def test_train_says_how_accurate_what_limits_it_and_the_file(run):
    done = run("train", "two_link", *SMALL, "-o", "other.calib")
    assert (done.code, done.err) == (0, "")
    lines = done.out.splitlines()
    assert " mm on average, 95 % within " in lines[0]
    assert "bound covers" in lines[0]
    assert "10000 fresh exact samples" in lines[0]
    assert lines[-2].startswith("limited by ")
    assert lines[-1].startswith("other.calib: vdsom:residual, 10x10 nodes, 500 samples, ")
    told = run("train", "two_link", *SMALL, "-o", "other.calib", "-v").out
    for word in ("readout", "shoulder  deg", "linear", "winner"):
        assert word in told
    assert run("train", "two_link", *SMALL, "-o", "other.calib", "-q").out.count("\n") == 1


def test_what_a_log_differs_in_is_told_with_its_unit(run):
    moved = "elbow.offset=0.05"
    run("babble", "two_link", "-n", "200", "--noise", "1e-4", "--change", moved, "-o", "log.csv")
    done = run("train", "two_link", "--data", "log.csv", "-o", "m.calib")
    (found,) = (line for line in done.out.splitlines() if line.startswith("found: "))
    assert "elbow" in found
    assert "2.8" in found  # 0.05 rad
    assert "deg" in found
    assert "bounds" not in found
    assert "expected_error" in run("info", "m.calib").out


def test_options_reach_the_training(run):
    done = run(
        "train", "two_link", "-n", "500", "--motor-size", "8x9", "--sensory-size", "7",
        "--map", "som", "--rule", "online", "--epochs", "2", "--sigma", "3:0.5",
        "--noise", "0.001", "--range", "elbow=1:2", "--change", "elbow.length=+10%",
    )  # fmt: skip
    assert done.code == 0, done.err
    about = calib.load("two_link.calib").about
    assert about.options["map"] == "som"
    assert about.options["rule"] == "online"
    assert about.options["epochs"] == 2
    assert list(about.options["sigma"]) == [3.0, 0.5]
    assert about.simulation == {"noise": 0.001, "changes": ["elbow.length=+10%"]}
    assert (about.lower[1], about.upper[1]) == (1.0, 2.0)
    document = run("info", "two_link.calib", "--json").document
    assert document["size"] == {"motor": [8, 9], "sensory": [7, 7]}


def test_degrees_apply_to_ranges_locks_and_changes(run):
    done = run(
        "train", "polar", *SMALL, "--degrees", "--range", "shoulder=10:40",
        "--range", "slide=0.05:0.2", "--change", "shoulder.offset=3",
        "--change", "slide.offset=0.01",
    )  # fmt: skip
    assert done.code == 0, done.err
    about = calib.load("polar.calib").about
    assert about.lower == pytest.approx([math.radians(10), 0.05])
    assert about.upper == pytest.approx([math.radians(40), 0.2])
    offset, slide = about.simulation["changes"]
    assert float(offset.rpartition("=")[2]) == pytest.approx(math.radians(3))
    assert slide == "slide.offset=0.01"
    run("train", "three_link", *SMALL, "--joints", "shoulder,elbow", "--tip", "tip",
        "--degrees", "--lock", "wrist=30")  # fmt: skip
    assert calib.load("three_link.calib").about.locked["wrist"] == pytest.approx(math.radians(30))


def test_info_tells_what_and_whence(run, model):
    done = run("info", model, "--json")
    assert done.document["source"] == "simulation"
    assert done.document["ranges"]["shoulder"] == pytest.approx([0.0, math.pi / 2])
    assert "urdf" not in done.document
    text = run("info", model, "--degrees").out
    assert "0 to 90 deg" in text
    assert "500 simulated samples, seed 0, no noise" in text


def test_the_view_is_what_was_asked_for_and_what_was_found(run, log):
    train = ("train", "--data", log, "--joints", "shoulder,elbow", "--size", "6", "--json")
    rigid = run(*train).document["view"]
    assert (rigid["kind"], rigid["mirror"]) == ("rigid", False)
    assert set(rigid) == {"kind", "mirror", "rotation", "shift_x", "shift_y"}
    for name in ("rotation", "shift_x", "shift_y"):  # the log is in the robot's own frame
        low, high = rigid[name]["interval"]
        assert low - 1e-3 <= 0.0 <= high + 1e-3
    assert (rigid["rotation"]["unit"], rigid["shift_x"]["unit"]) == ("rad", "m")
    asked = run(*train, "--view", "similarity").document["view"]
    assert asked["kind"] == "similarity"
    assert "log_scale" in asked
    base = run("train", "two_link", *train[1:3], "--size", "6", "--json", "--view", "base")
    assert base.document["view"] == {"kind": "base", "mirror": False}
    assert run(*train, "--body", "none").document["view"] == {"kind": None}
    assert run(*train, "--view", "sideways").code == 2
    assert run(*train, "--body", "some").code == 2


def test_babble_writes_what_it_says(run, tmp_path):
    done = run("babble", "two_link", "-n", "20", "--seed", "3", "-o", "log.csv")
    assert (done.out, done.err) == ("log.csv: 20 rows of shoulder, elbow, x, y [rad, m]\n", "")
    read = calib.read_log("log.csv", calib.load_arm("two_link"))
    drawn = calib.babble(calib.load_arm("two_link"), 20, seed=3)
    assert (read.q == drawn.q).all()
    assert (read.x == drawn.x).all()
    streamed = run("babble", "two_link", "-n", "20", "--seed", "3", "-o", "-")
    assert streamed.out == (tmp_path / "log.csv").read_text()
    assert streamed.err.endswith("[rad, m]\n")
    document = run("babble", "two_link", "-n", "20", "-o", "log.parquet", "--json").document
    assert (document["log"], document["samples"], document["unit"]) == ("log.parquet", 20, "m")
    assert len(calib.read_log("log.parquet", calib.load_arm("two_link"))) == 20


@pytest.mark.parametrize(("factor", "offset"), [(1e3, 0.0), (640.0, 500.0), (1.0, 0.3)])
def test_a_log_that_does_not_fit_is_told(model, run, tmp_path, factor, offset):
    samples = calib.babble(calib.load_arm("two_link"), 40, seed=8, noise=1e-4)
    path = tmp_path / "log.csv"
    table = np.hstack([samples.q, factor * samples.x + offset])
    np.savetxt(path, table, delimiter=",", header="shoulder,elbow,x,y", comments="")
    done = run("evaluate", model, "--data", path)
    assert done.code == 3
    assert "does not hold for this log" in done.out
    if factor == 1e3:
        assert "--unit mm" in done.err
