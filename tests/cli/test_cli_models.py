"""`calib train`, `info` and `babble`: what options do, what is written and printed."""

import math

import pytest

import calib

SMALL = ("--size", "10", "-n", "500")


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_train_says_how_accurate_what_limits_it_and_the_file(run, tmp_path):
    done = run("train", "two_link", *SMALL)
    assert (done.code, done.err) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["two_link.calib"]
    lines = done.out.splitlines()
    assert " mm on average, 95 % within " in lines[0]
    assert "bound covers" in lines[0]
    assert "10000 fresh exact samples" in lines[0]
    assert lines[-2].startswith("limited by ")
    assert lines[-1].startswith("two_link.calib: vdsom:residual, 10x10 nodes, 500 samples, ")
    told = run("train", "two_link", *SMALL, "-v").out
    for word in ("readout", "shoulder  deg", "linear", "winner"):
        assert word in told
    assert run("train", "two_link", *SMALL, "-q").out.count("\n") == 1
    text = run("info", "two_link.calib", "--degrees").out
    assert "0 to 90 deg" in text
    assert "500 simulated samples, seed 0, no noise" in text


def test_options_reach_the_training(run):
    done = run(
        "train", "two_link", "-n", "500", "--motor-size", "8x9", "--sensory-size", "7",
        "--map", "som", "--rule", "online", "--epochs", "2", "--sigma", "3:0.5",
        "--noise", "0.001", "--range", "elbow=1:2", "--change", "elbow.length=+10%",
    )  # fmt: skip
    assert done.code == 0, done.err
    about = calib.load("two_link.calib").about
    expected = {"map": "som", "rule": "online", "epochs": 2}
    assert {name: about.options[name] for name in expected} == expected
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


def test_the_view_is_what_was_asked_for_and_what_was_found(run, log):
    train = ("train", "--data", log, "--joints", "shoulder,elbow", "--size", "6", "--json")
    rigid = run(*train).document["view"]
    assert (rigid["kind"], rigid["mirror"]) == ("rigid", False)
    assert set(rigid) == {"kind", "mirror", "rotation", "shift_x", "shift_y"}
    for name in ("rotation", "shift_x", "shift_y"):  # the log is in the robot's own frame
        low, high = rigid[name]["interval"]
        assert low - 1e-3 <= 0.0 <= high + 1e-3
    assert (rigid["rotation"]["unit"], rigid["shift_x"]["unit"]) == ("rad", "m")
    assert "log_scale" in run(*train, "--view", "similarity").document["view"]
    base = run("train", "two_link", *train[1:3], "--size", "6", "--json", "--view", "base")
    assert base.document["view"] == {"kind": "base", "mirror": False}
    assert run(*train, "--body", "none").document["view"] == {"kind": None}


def test_babble_writes_what_it_says(run, tmp_path):
    arm = calib.load_arm("two_link")
    done = run("babble", "two_link", "-n", "20", "--seed", "3", "-o", "log.csv")
    assert (done.out, done.err) == ("log.csv: 20 rows of shoulder, elbow, x, y [rad, m]\n", "")
    read, drawn = calib.read_log("log.csv", arm), calib.babble(arm, 20, seed=3)
    assert (read.q == drawn.q).all()
    assert (read.x == drawn.x).all()
    streamed = run("babble", "two_link", "-n", "20", "--seed", "3", "-o", "-")
    assert streamed.out == (tmp_path / "log.csv").read_text()
    assert streamed.err.endswith("[rad, m]\n")
    assert run("babble", "two_link", "-n", "20", "-o", "log.parquet").code == 0
    assert len(calib.read_log("log.parquet", arm)) == 20
