"""What a model remembers of its log, how its file is named, and how it is shown."""

import numpy as np
from models import babbled
from reference import table

import calib


def test_later_commands_need_no_option(tmp_path, monkeypatch, run):
    """Of a log in degrees whose columns have other names."""
    monkeypatch.chdir(tmp_path)
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


def test_a_file_is_named_after_its_robot_and_another_robots_name_needs_force(
    tmp_path, monkeypatch, run
):
    monkeypatch.chdir(tmp_path)
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
