"""Preview: what its page draws, its server, its command."""

import io
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from boards import Rig
from flange_worlds import World
from models import in_pixels, in_space, log, trained
from PIL import Image
from scenes import data_of, objects, page_of, seen_by_two, tracks

import calib
from calib.arm.loading import arm_from_urdf
from calib.body.sensor_pose import SensorPose
from calib.recording.board import Board
from calib.recording.board_pictures import BoardPictures
from calib.recording.lens import Lens
from calib.recording.rig import Photo as Shown
from calib.show.placement import place_model, seen_by_sensor
from calib.show.robot import Robot
from calib.show.setup import things_of, things_of_rig

MAPS = ["Sensory map", "Motor map", "Hebbian links"]
LAYERS = ["Arm", *MAPS, "Reach", "Target path", "Reached path"]


def small(robot: str = "two_link", **options) -> calib.Model:
    return trained(robot, n=400, size=8, **options)


def layers(data: dict) -> list[str]:
    return [layer["name"] for layer in data["layers"]]


@pytest.mark.parametrize("robot", ["three_link", "tilted", "polar"])
def test_an_arm_moves_along_its_path_at_its_true_place(robot: str):
    model, arm = small(robot), calib.load_arm(robot)
    data = data_of(page_of(model))
    assert layers(data) == LAYERS
    assert data["notes"] == []
    moved = tracks(data)
    path = objects(data)["Reached path/line"]["points"]
    tip = moved[f"Arm/{arm.tip}"][:, :3, 3]
    np.testing.assert_allclose(moved["Reached path/ball"][:, :3, 3], tip, atol=2e-3)
    # lines are drawn a little in front of what they lie on
    assert np.ptp(path - tip, axis=0).max() < 2e-3
    nodes = objects(data)["Sensory map/nodes"]["points"]
    np.testing.assert_allclose(
        nodes, arm.plane.origin + model.sensory.weights @ arm.plane.basis[:2], atol=1e-6
    )
    assert np.linalg.matrix_rank(data["panel"]["edges"]) == arm.dof


def test_an_arm_in_space_has_its_reach_its_rows_and_no_maps_until_they_are_asked_for():
    model = in_space()
    data = data_of(page_of(model))
    found = objects(data)
    assert {"Reach/points", "Sensory map/nodes", "Rows/positions"} <= set(found)
    off = {layer["name"] for layer in data["layers"] if not layer["shown"]}
    assert off == {*MAPS, "Reach"}
    # positions are drawn where the tool is in the robot's frame
    arm = arm_from_urdf(model.about.urdf)
    held = np.linalg.norm(model.body.beta[model.body.structure.groups["tool"]])
    ball = tracks(data)["Predicted tip/ball"][:, :3, 3]
    away = np.linalg.norm(ball - tracks(data)[f"Arm/{arm.tip}"][:, :3, 3], axis=1)
    assert away == pytest.approx(held, abs=5e-3)
    # Play goes through the rows in their order
    moved = tracks(data)["Measured tip/ball"][:, :3, 3]
    rows = found["Rows/positions"]["points"]
    steps = [np.linalg.norm(rows - place, axis=1).argmin() for place in moved]
    assert steps == sorted(steps)
    assert len(set(steps)) == len(moved) == 60
    assert data["step"] > 1


def test_camera_and_board_stand_where_pictures_say():
    rig = Rig(True, seed=1, pictures=12)
    corners = tuple(dict(enumerate(rig.seen[rig.rows == k])) for k in range(12))
    names = tuple(f"{k:02d}.png" for k in range(12))
    board = Board.parse("7x5:24mm:18mm:5x5_100")
    shots = BoardPictures(board, rig.arm.joint_names, names, rig.q, corners, (1280, 720), 12, ())
    lens = Lens((1280, 720), np.full(2, rig.lens[0]), np.array(rig.lens[1:3]), np.eye(5)[0] * -0.08)
    log = shots.log(lens, True)
    model = calib.train(replace(log, arm=rig.arm, lower=rig.arm.lower, upper=rig.arm.upper), size=4)
    things = {thing.name: thing for thing in things_of(model)}
    standing = things["board"]
    carried = things["camera"]
    assert carried.carried
    assert not standing.carried
    position, turn = rig.hand(rig.beta)
    np.testing.assert_allclose(carried.frame[:3, 3], position, atol=3e-3)
    np.testing.assert_allclose(carried.frame[:3, :3], turn, atol=0.02)
    np.testing.assert_allclose(standing.frame[:3, 3], rig.base[0], atol=6e-3)
    drawn = objects(data_of(page_of(model)))
    assert f"Arm/tip/{carried.name}/lines" in drawn
    assert f"Setup/{standing.name}/faces" in drawn


def test_each_of_several_sensors_has_its_frame_and_its_rows():
    model = seen_by_two()
    found = objects(data_of(page_of(model)))
    for name in ("tracker", "left"):
        rows = model.by(name).rows
        drawn = found[f"Rows {name}/positions"]["points"]
        at = SensorPose.of(model.by(name).body)
        apart = rows.x @ at.rotation.T + at.position - drawn
        assert np.ptp(apart, axis=0).max() < 1e-4
        (frame,) = things_of(model.by(name))
        assert f"Setup/{frame.name}/lines" in found
    arms = np.abs(found["Rows tracker/positions"]["points"]).max(axis=0)
    others = np.abs(found["Rows left/positions"]["points"]).max(axis=0)
    np.testing.assert_allclose(arms, others, rtol=0.2)


@pytest.mark.parametrize("planar", [True, False])
def test_a_sensor_sees_the_tip_where_it_is_predicted_through_the_lens(planar):
    if planar:
        rows = log(200, 1e-4)
        plane = np.c_[rows.x, np.ones(len(rows.x))] @ [
            [900, 40, 0.3],
            [-60, -800, 0.2],
            [640, 420, 1],
        ]
        model = calib.train(replace(rows, x=plane[:, :2] / plane[:, 2:], unit="px"), size=8)
    else:
        model = in_pixels()
    q = model.rows.q[:30]
    tips = Robot.of(model.about).tips(q)
    off = np.linalg.norm(seen_by_sensor(model, tips) - model.forward(q), axis=1)
    # the drawn arm differs from the fitted one
    assert off.max() < (2.0 if planar else 40.0)
    if planar:
        placed = place_model(model, Robot.of(model.about))
        np.testing.assert_allclose(placed.drop(tips), seen_by_sensor(model, tips), atol=1e-6)
        np.testing.assert_allclose(placed.lift(placed.drop(tips)), tips, atol=1e-9)


@pytest.mark.parametrize("in_hand", [True, False])
def test_a_rig_is_drawn_where_it_is_and_reported_with_its_pictures(in_hand, tmp_path, run):
    world = World(1, in_hand)
    rig = world.solve()
    things = {thing.name: thing for thing in things_of_rig(rig)}
    camera, board = things["camera"], things["board"]
    assert (camera.carried, board.carried) == (in_hand, not in_hand)
    np.testing.assert_allclose(camera.frame, world.camera, atol=5e-3)
    np.testing.assert_allclose(board.frame, world.placed, atol=5e-3)
    jpeg = io.BytesIO()
    Image.new("L", (640, 360)).save(jpeg, "jpeg")
    corners = np.array([[100.0, 100.0], [500.0, 400.0]])
    shown = Shown("a.png", 0, jpeg.getvalue(), corners, corners + 0.5)
    rig = replace(rig, photo=shown)
    assert set(calib.figures(rig)) == {"setup", "misses", "corners"}
    path, page = tmp_path / "rig.calib", tmp_path / "page.html"
    rig.save(path)
    done = run("report", path, "-o", page)
    assert done.code == 0, done.err
    assert done.out.startswith(f"{'Camera' if in_hand else 'Board'} in the frame of flange: (")
    text = page.read_text(encoding="utf-8")
    assert {"setup", "misses", "corners"} <= set(re.findall(r'figure id="(\w+)"', text))
    assert run("preview", path, "--html", page).code == 0
    data = data_of(page.read_text(encoding="utf-8"))
    np.testing.assert_allclose(tracks(data)["Arm/flange"], rig.flange, atol=1e-6)
    assert run("report", path, "-o", page, "--data", "x.csv").code == 2


def test_a_page_is_the_same_every_time_needs_no_network_and_takes_names_for_text():
    model = small()
    name = "</script><script>alert(1)</script>@data@<!--"
    model = replace(model, about=replace(model.about, robot=name))
    page = page_of(model)
    assert page == page_of(model)
    assert data_of(page)["title"] == name
    assert "<script>alert" not in page
    assert "default-src 'none'" in page
    assert not re.search(r"""(src|href)=["']?http""", page.split("<script>")[0])
    assert len(page.encode()) < 3_000_000


@pytest.fixture(scope="module")
def full() -> calib.Model:
    return trained("two_link_full", n=3000, size=20)


@pytest.fixture(scope="module")
def live(full: calib.Model):
    with calib.preview(full, live=True, browse=False) as running:
        yield running


def ask(url: str, data: bytes | None = None, **headers: str) -> tuple[int, bytes]:
    request = urllib.request.Request(url, data, headers)
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(request, timeout=20) as reply:
            return reply.status, reply.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def test_a_page_is_served_on_loopback_to_who_knows_its_address(full, live):
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]+/", live.url)
    assert b"MeshCat" in ask(live.url)[1]
    port = int(live.url.split(":")[2].split("/")[0])
    assert ask(f"http://127.0.0.1:{port}/")[0] == 404
    assert ask(live.url, Host="example.org")[0] == 404
    with pytest.raises(calib.OptionError, match=str(port)):
        calib.preview(full, port=port, browse=False)
    with pytest.raises(calib.OptionError):
        calib.preview(full, "x.html", live=True, browse=False)


def test_live_answers_hold_every_branch(full, live):
    target = full.forward([0.6, 0.7])
    answer = json.loads(ask(live.url + "ask", json.dumps({"at": [*target, 0.3]}).encode())[1])
    assert answer["reachable"]
    q = full.motor.scale.from_unit(np.array([b["joints"] for b in answer["branches"]]))
    np.testing.assert_allclose(q, full.inverse_all(target[None])[0], atol=1e-12)
    assert len(q) == 2
    for branch in answer["branches"]:
        tip = np.array(branch["links"]["tip"]).reshape(4, 4).T[:2, 3]
        np.testing.assert_allclose(tip, target, atol=1e-3)
    assert not json.loads(ask(live.url + "ask", b'{"at": [5, 5, 0]}')[1])["reachable"]


@pytest.mark.parametrize("body", [b"[]", b"5", b"{}", b"[" * 5000, b'{"at": [NaN, 0, 0]}', b"x"])
def test_a_question_without_sense_is_answered(live, body, capfd):
    assert ask(live.url + "ask", body)[0] == 400
    assert "Traceback" not in capfd.readouterr().err


def raw(url: str, length: str, body: bytes, *, drop: bool = False) -> bytes:
    """What is answered to a body of another length than it says, or to one that is dropped."""
    _, _, place, path, _ = url.split("/")
    host, port = place.split(":")
    with socket.create_connection((host, int(port)), timeout=20) as connection:
        line = f"POST /{path}/ask HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {length}\r\n\r\n"
        connection.sendall(line.encode() + body)
        if drop:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            return b""
        answer = b""
        while part := connection.recv(4096):
            answer += part
    return answer


def test_connections_that_say_less_than_they_promise_hold_no_thread(live, capfd):
    before = threading.active_count()
    assert raw(live.url, "500", b"{") == b""
    raw(live.url, "500", b"{", drop=True)
    for _ in range(100):
        if threading.active_count() <= before:
            break
        threading.Event().wait(0.1)
    assert threading.active_count() <= before
    assert ask(live.url)[0] == 200
    assert "Traceback" not in capfd.readouterr().err


def test_command_writes_a_page_or_serves_it_until_ctrl_c(run, model: Path, log: Path, tmp_path):
    page = tmp_path / "page.html"
    assert run("preview", model, "--data", log, "--html", page).code == 0
    texts = {e["name"]: e["text"] for e in data_of(page.read_text(encoding="utf-8"))["layers"]}
    assert "in the colour of their errors" in texts["Rows"]
    with subprocess.Popen(
        [sys.executable, "-m", "calib_cli", "preview", str(model), "--no-open"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    ) as process:
        try:
            assert process.stdout is not None
            url = process.stdout.readline().strip()
            assert b"MeshCat" in ask(url)[1]
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 0
        finally:
            process.kill()
