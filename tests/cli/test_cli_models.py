"""`train`, `info`, `query`: options, answers, what is remembered; noise, ISO 9283, plans."""

import io
import math
import re

import numpy as np
import pytest
from models import babbled, lengths, two_link
from reference import read, table
from scipy.special import chdtri

import calib

SENSOR, RETURN, OFFSET = 1e-5, 4e-5, 0.004  # [m], [m], [rad] of the elbow


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_options_reach_the_training(run):
    words = "-n 500 --motor-size 8x9 --sensory-size 7 --map som --rule online --epochs 2"
    words += " --sigma 3:0.5 --noise 0.001 --range elbow=1:2 --change elbow.length=+10%"
    document = run.done(f"train two_link {words} --json").document
    assert document["size"] == {"motor": [8, 9], "sensory": [7, 7]}
    about = calib.load("two_link.calib").about
    assert [about.options[name] for name in ("map", "rule", "epochs")] == ["som", "online", 2]
    assert list(about.options["sigma"]) == [3.0, 0.5]
    assert about.simulation == {"noise": 0.001, "changes": ["elbow.length=+10%"]}
    assert (about.lower[1], about.upper[1]) == (1.0, 2.0)


def test_tables_of_joints_are_read_in_degrees(run, model):
    """One of the two ways to a target is asked for; no test saw joints of tables in degrees."""
    q = np.array([[0.4, 1.0], [1.2, 0.8]])
    x = calib.load(model).forward(q)
    degrees = np.degrees(q)
    table("q.csv", ["shoulder", "elbow"], degrees)
    answered = read(run.done(f"query forward {model} --degrees --input q.csv").out)
    np.testing.assert_allclose(np.transpose([answered["x"], answered["y"]]), x, atol=1e-6)
    table("x.csv", ["x", "y", "near_shoulder", "near_elbow"], np.hstack([x, degrees]))
    answered = read(run.done(f"query inverse {model} --degrees --input x.csv").out)
    joints = np.transpose([answered["shoulder"], answered["elbow"]])
    np.testing.assert_allclose(joints, degrees, atol=0.1)


def test_degrees_apply_to_ranges_locks_and_changes(run):
    words = "--range shoulder=10:40 --range slide=0.05:0.2"
    words += " --change shoulder.offset=3 --change slide.offset=0.01"
    run.done(f"train polar --size 10 -n 500 --degrees {words}")
    about = calib.load("polar.calib").about
    assert about.lower == pytest.approx([math.radians(10), 0.05])
    assert about.upper == pytest.approx([math.radians(40), 0.2])
    offset, slide = about.simulation["changes"]
    assert float(offset.rpartition("=")[2]) == pytest.approx(math.radians(3))
    assert slide == "slide.offset=0.01"
    words = "--joints shoulder,elbow --tip tip --degrees --lock wrist=30"
    run.done(f"train three_link --size 10 -n 500 {words}")
    assert calib.load("three_link.calib").about.locked["wrist"] == pytest.approx(math.radians(30))


def test_the_view_is_what_was_asked_for_and_what_was_found(run):
    run.done("babble two_link -n 400 -o log.csv")
    data = "--data log.csv --size 6 --json"
    train = f"train --joints shoulder,elbow {data}"
    rigid = run(train).document["view"]
    assert (rigid["kind"], rigid["mirror"]) == ("rigid", False)
    assert set(rigid) == {"kind", "mirror", "rotation", "shift_x", "shift_y"}
    for name in ("rotation", "shift_x", "shift_y"):  # the log is in the robot's own frame
        low, high = rigid[name]["interval"]
        assert low - 1e-3 <= 0.0 <= high + 1e-3
    assert (rigid["rotation"]["unit"], rigid["shift_x"]["unit"]) == ("rad", "m")
    assert "log_scale" in run(f"{train} --view similarity").document["view"]
    base = run(f"train two_link {data} --view base").document["view"]
    assert base == {"kind": "base", "mirror": False}
    assert run(f"{train} --body none").document["view"] == {"kind": None}


def test_later_commands_need_no_option(run):
    """Of a log in degrees whose columns have other names."""
    s = babbled(n=200, seed=3, noise=1e-4)
    table("camera.csv", ["j1", "j2", "cam_u", "cam_v"], np.column_stack([np.degrees(s.q), s.x]))
    columns = "shoulder=j1,elbow=j2,x=cam_u,y=cam_v"
    line = ["train", "--data", "camera.csv", "--joints", "shoulder,elbow", "--columns", columns]
    run.done(*line, "--degrees", "--size", "6")
    model = calib.load("camera.calib")
    assert model.about.degrees
    assert model.about.columns["x"] == "cam_u"
    for line in (
        "check camera.calib --data camera.csv",
        "evaluate camera.calib --data camera.csv",
        "report camera.calib --data camera.csv -o r.html",
        "preview camera.calib --data camera.csv --html p.html",
        "plan camera.calib -n 3 -o poses.csv",
    ):
        run.done(line)
    assert run("evaluate camera.calib --data camera.csv --radians").code == 1
    for words in ("forward camera.calib 30 60", "inverse camera.calib 0.3 0.3 --near 30,60"):
        assert "is outside of the learned range" in run(f"query {words}").err
        run.done(f"query {words} --degrees")
    # other names, and rad: what the log has goes first
    calib.write_log(babbled(n=60, seed=4, noise=1e-4), "plain.csv")
    run.done("evaluate camera.calib --data plain.csv --radians")


def test_a_file_is_named_after_its_robot_and_another_robots_name_needs_force(run, tmp_path):
    small = "-n 300 --size 5"
    (tmp_path / "my arm.urdf").write_text(calib.load_arm("two_link").urdf)  # it says two_link
    done = run("train", "my arm.urdf", *small.split(), "--json")
    assert done.document["model"] == "my_arm.calib"
    run.done("train", "my arm.urdf", *small.split(), "--seed", "1")
    run(f"train polar {small} -o two_link.calib")
    before = (tmp_path / "two_link.calib").read_bytes()
    done = run(f"train two_link {small} --json")
    assert done.code == 1
    assert done.document["error"]["parameter"] == "--force"
    assert (tmp_path / "two_link.calib").read_bytes() == before
    run.done(f"train two_link {small} --force")
    run.done(f"train two_link {small}")
    (tmp_path / "polar.calib").write_text("notes of mine")
    assert run(f"train polar {small}").code == 1
    run.done(f"train polar {small} -o polar.calib")


@pytest.fixture(scope="module")
def lab(tmp_path_factory, run):
    """A folder with a log of five poses and thirty cycles, a log to learn from, and a model."""
    folder, arm = tmp_path_factory.mktemp("lab"), calib.load_arm("two_link")
    rng = np.random.default_rng(0)
    poses = np.array([[0.4, 0.8], [0.8, 1.2], [1.2, 1.6], [0.5, 2.0], [1.0, 0.7]])
    q = np.repeat(np.tile(poses, (30, 1)), 2, axis=0)
    attained = np.repeat(rng.normal(0.0, RETURN, (150, 2)), 2, axis=0)
    x = arm.forward(q + np.array([0.0, OFFSET])) + attained + rng.normal(0.0, SENSOR, (300, 2))
    q = q + rng.normal(0.0, 1e-5, q.shape)  # encoders read one pose a little otherwise
    calib.write_log(calib.Samples(q, x, arm.joint_names), folder / "cycles.csv")
    learned = calib.babble(arm, 120, noise=2e-5, changes=[f"elbow.offset={OFFSET}"], seed=1)
    calib.write_log(learned, folder / "log.csv")
    data = f"--data {folder}/log.csv --view base"
    run.done(f"train two_link {data} --size 4 -o {folder}/m.calib")
    return folder


def test_noise_tells_sensor_and_return_apart(lab, run, tmp_path):
    document = run.done("noise", lab / "cycles.csv", "--json").document
    assert document["sensor"] == pytest.approx(SENSOR, rel=0.15)
    assert document["return"] == pytest.approx(RETURN, rel=0.15)
    assert (document["poses"], document["repeats"]) == (5, 295)
    for name in ("sensor", "return"):
        low, high = document["intervals"][name]
        assert low < document[name] < high
    freedom = 2 * 150  # axes, and readings beyond the first of each visit
    scale = np.sqrt(freedom / chdtri(freedom, [0.025, 0.975]))
    assert document["intervals"]["sensor"] == pytest.approx(document["sensor"] * scale)
    assert "expected" not in run("noise", lab / "cycles.csv").out
    run.refused(1, "none of the log's", "noise", lab / "log.csv")
    # with one reading for each visit it was taken for the arm's alone
    log = calib.read_log(lab / "cycles.csv", joints=["shoulder", "elbow"])
    calib.write_log(log.take(np.arange(0, 300, 2)), tmp_path / "once.csv")
    document = run.done("noise", tmp_path / "once.csv", "--json").document
    assert document["sensor"] is document["return"] is None
    assert document["together"] == pytest.approx(np.hypot(SENSOR, RETURN), rel=0.15)
    (low, high), *apart = (document["intervals"][key] for key in ("together", "sensor", "return"))
    assert low < document["together"] < high
    assert apart == [[0.0, high], [0.0, high]]
    assert "no pose twice in a row: each is between 0" in run("noise", tmp_path / "once.csv").out
    # a wrong reading is no noise
    text = (lab / "cycles.csv").read_text()
    header, *_, last = text.splitlines()
    wrong = last.split(",")
    wrong[header.split(",").index("x")] = "0.9"
    (tmp_path / "log.csv").write_text(text + ",".join(wrong))
    document = run.done("noise", tmp_path / "log.csv", "--json").document
    assert document["sensor"] == pytest.approx(SENSOR, rel=0.15)
    assert document["left_out"] == 1


def test_iso_9283_is_as_delivered_and_as_corrected(lab, run):
    done = run(f"evaluate {lab}/m.calib --data {lab}/cycles.csv --iso9283 --json")
    assert done.code == 3, done.err  # the bound does not hold for these readings
    standard = done.document["iso9283"]
    assert (standard["poses"], standard["cycles"]) == (5, 30)
    # the elbow turns the forearm, 0.25 m to the tip
    assert standard["as_delivered"]["AP"] == pytest.approx(0.25 * OFFSET, rel=0.1)
    assert standard["as_corrected"]["AP"] < 5e-5
    x = calib.read_log(lab / "cycles.csv", calib.load_arm("two_link")).x
    x = x.reshape(150, 2, 2).mean(axis=1)  # of two readings each
    away = [lengths(x[k::5] - x[k::5].mean(axis=0)) for k in range(5)]
    repeatability = max(row.mean() + 3.0 * row.std(ddof=1) for row in away)
    assert standard["RP"] == pytest.approx(repeatability, rel=1e-6)


def test_zeros_alone_are_told_to_a_fraction_of_all(lab, run):
    urdf = f"urdf {lab}/m.calib -o {lab}/new.urdf --json"
    everything = run(urdf).document["offsets"]["elbow"]
    alone = run(f"{urdf} --free offsets").document["offsets"]["elbow"]
    assert alone["value"] == pytest.approx(OFFSET, abs=2e-4)
    assert alone["interval"] < 0.5 * everything["interval"]


def test_a_plan_stays_above_a_table(run):
    done = run.done("plan six_axis -n 6 --above 0.1 -o poses.csv --json")
    assert min(done.document["poses"]["expected_z"]) > 0.1
    done = run("plan two_link --above 0.1 -o poses.csv --json")
    assert done.document["error"]["parameter"] == "--above"


def test_what_has_no_answer_is_exit_code_3_with_one_line_and_in_its_place_in_a_batch(run, model):
    done = run("query", "inverse", model, "2", "2", "--json")
    assert (done.code, done.document["reachable"]) == (3, False)
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
    # of a batch, each row has its place
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


def test_batch_forward_and_back_returns_the_positions(run, model, tmp_path):
    q = np.random.default_rng(0).uniform([0.2, 0.5], [1.3, 2.3], (50, 2))
    typed = "shoulder,elbow\n" + "\n".join(f"{a!r},{b!r}" for a, b in q.tolist()) + "\n"
    forward = run.done("query", "forward", model, "--input", "-", stdin=typed)
    answered, bounds = read(forward.out), ["expected_error", "model_error"]
    assert list(answered) == ["shoulder", "elbow", "x", "y", *bounds]
    assert (answered["shoulder"] == q[:, 0]).all()
    positions = np.c_[answered["x"], answered["y"]]
    assert (positions == calib.load(model).forward(q)).all()  # in full: not a bit is lost
    targets = tmp_path / "targets.csv"
    targets.write_text(forward.out)
    found = read(run.done("query", "inverse", model, "--input", targets).out)
    assert list(found) == ["x", "y", "shoulder", "elbow", "distance", *bounds, "reachable"]
    assert np.abs(two_link(np.c_[found["shoulder"], found["elbow"]]) - positions).max() < 1e-3
    empty = run("query", "forward", model, "--input", "-", stdin="shoulder,elbow\n")
    assert empty.err == "standard input has no rows below its header\n"


@pytest.mark.parametrize("readout", ["linear", "activity", "winner"])
def test_the_bound_of_another_readout_covers_its_distance_from_the_truth(run, model, readout):
    rows, tables = "shoulder,elbow\n0.3,0.6\n0.4,0.9\n0.9,1.4\n", []
    for options in ([], ["--readout", readout]):
        done = run.done("query", "forward", model, "--input", "-", *options, stdin=rows)
        tables.append(np.loadtxt(io.StringIO(done.out), delimiter=",", skiprows=1))
    body, other = tables
    off = lengths(other[:, 2:4] - body[:, 2:4])
    assert (off > 1e-5).any()
    assert (other[:, 4] >= off).all()
    done = run("query", "forward", model, "0.3", "0.6", "--readout", readout, "--json")
    assert done.document["expected_error"] == pytest.approx(other[0, 4], rel=1e-6)
