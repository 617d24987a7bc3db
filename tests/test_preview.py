"""Preview: poses, shapes, meshes, placement, border, camera, scene, page and server."""

from __future__ import annotations

import base64
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import umsgpack
from models import measured, trained

import calib
from calib.show.colours import UNKNOWN, colours, rgb, stops
from calib.show.error_scale import ErrorScale, length_in_words
from calib.show.preview.body import Body
from calib.show.preview.camera import Camera
from calib.show.preview.canvas import quaternions
from calib.show.preview.lattices import strongest_partners
from calib.show.preview.live import Live
from calib.show.preview.meshes import read_mesh, resolve_mesh
from calib.show.preview.motion import drive
from calib.show.preview.page import html
from calib.show.preview.placement import place, similarity
from calib.show.preview.scene import draw
from calib.show.preview.server import ADDRESS, PreviewServer
from calib.show.preview.visuals import visuals
from calib.show.workspace import border, level_lines, sensory_errors

ROBOTS = ("two_link", "two_link_full", "three_link", "tilted", "scara", "polar")


def packed(scene) -> list[dict]:
    return [umsgpack.unpackb(command) for command in scene.canvas.packed()]


def paths(scene) -> set[str]:
    return {c["path"] for c in packed(scene) if c["type"] == "set_object"}


def data_of(page: str) -> dict:
    found = re.search(r'id="calib-data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found.group(1))


# --------------------------------------------------------------------------- body
@pytest.mark.parametrize("robot", ROBOTS)
def test_the_drawn_tip_is_pinocchios(robot: str):
    arm = calib.load_arm(robot)
    body = Body.of(trained(robot, n=400, size=8).about)
    assert body is not None
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (20, arm.dof))
    np.testing.assert_allclose(body.tips(q), arm.points(q)[:, -1], atol=1e-12)


def test_shapes_of_a_urdf_with_gaps():
    text = """<robot name="r"><material name="red"><color rgba="1 0 0 0.5"/></material>
    <link name="a">
      <visual><geometry><box size="1 2 3"/></geometry><material name="red"/></visual>
      <visual><origin xyz="1 0 0"/><geometry><sphere radius="0.1"/></geometry></visual>
      <visual><geometry><cylinder radius="nan" length="1"/></geometry></visual>
      <visual><geometry><box size="1 2"/></geometry></visual>
      <visual><geometry><torus/></geometry></visual>
      <visual/>
      <visual><geometry><mesh filename="m.stl" scale="2 2 2"/></geometry></visual>
    </link></robot>"""
    box, ball, mesh = visuals(text)
    assert (box.kind, box.size, box.colour, box.opacity) == ("box", (1, 2, 3), "#ff0000", 0.5)
    assert ball.origin[0, 3] == 1.0
    assert mesh.mesh == "m.stl"
    assert mesh.scale.tolist() == [2, 2, 2]


# --------------------------------------------------------------------------- meshes
CUBE = "solid s\nfacet normal 0 0 1\nouter loop\n" + (
    "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid s\n"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    inner = tmp_path / "robot"
    (inner / "pkg" / "meshes").mkdir(parents=True)
    (inner / "pkg" / "meshes" / "a.stl").write_text(CUBE)
    (inner / "meshes").mkdir()
    (inner / "meshes" / "b c.stl").write_text(CUBE)
    (tmp_path / "secret.stl").write_text(CUBE)
    (inner / "link.stl").symlink_to(tmp_path / "secret.stl")
    return inner


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("package://pkg/meshes/a.stl", "pkg/meshes/a.stl"),
        ("package://other/meshes/b%20c.stl", "meshes/b c.stl"),
        ("meshes/../meshes/b c.stl", "meshes/b c.stl"),
    ],
)
def test_meshes_inside_of_the_folder(folder: Path, name: str, found: str):
    assert resolve_mesh(name, folder) == (folder / found).resolve()


@pytest.mark.parametrize(
    "name",
    [
        "../secret.stl",
        "package://pkg/../../secret.stl",
        "package://..//secret.stl",
        "link.stl",
        "file:///etc/passwd",
        "/etc/passwd",
        "http://127.0.0.1/a.stl",
        "https://example.org/a.stl",
        "ftp://example.org/a.stl",
        "",
        "a\0.stl",
        "missing.stl",
    ],
)
def test_meshes_elsewhere_are_refused(folder: Path, name: str):
    with pytest.raises(calib.RobotError, match="mesh"):
        resolve_mesh(name, folder)


def test_mesh_files(folder: Path):
    mesh = read_mesh(folder / "pkg" / "meshes" / "a.stl")
    assert mesh.vertices[mesh.faces].shape == (1, 3, 3)
    (folder / "bad.stl").write_bytes(b"solid")
    (folder / "bad.dae").write_text('<!DOCTYPE x [<!ENTITY a "b">]><COLLADA/>')
    (folder / "bad.exe").write_text("")
    for name in ("bad.stl", "bad.dae", "bad.exe"):
        with pytest.raises(calib.RobotError, match=name):
            read_mesh(folder / name)


def test_meshes_are_drawn_or_a_skeleton_in_their_place(tmp_path: Path):
    (tmp_path / "m.stl").write_text(CUBE)
    model = trained("two_link", n=400, size=8)
    text = re.sub(
        r"<geometry>.*?</geometry>",
        '<geometry><mesh filename="m.stl"/></geometry>',
        model.about.urdf,
    )
    meshed = replace(model, about=replace(model.about, urdf=text))
    bare = draw(meshed)
    assert any("`meshes`" in note for note in bare.notes)
    assert any(path.endswith("/bone") for path in paths(bare))
    full = draw(meshed, meshes=tmp_path)
    assert full.notes == ()
    assert not any(path.endswith("/bone") for path in paths(full))
    missing = draw(meshed, meshes=tmp_path / "..")
    assert any("no such file" in note for note in missing.notes)


# --------------------------------------------------------------------------- placement
def test_a_similarity_is_found_mirrored_or_not():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(50, 2))
    for mirror in (1.0, -1.0):
        turn = 2.5 * np.array([[0.6, 0.8 * mirror], [-0.8, 0.6 * mirror]])
        linear, shift = similarity(x, x @ turn + [3.0, -1.0])
        np.testing.assert_allclose(linear, turn, atol=1e-12)
        np.testing.assert_allclose(shift, [3.0, -1.0], atol=1e-12)


@pytest.mark.parametrize("robot", ["two_link", "tilted", "scara"])
def test_positions_are_drawn_at_their_true_place(robot: str):
    model, arm = trained(robot, n=400, size=8), calib.load_arm(robot)
    placement = place(model, Body.of(model.about))
    x = np.array([[0.1, 0.2], [0.3, -0.1]])
    np.testing.assert_allclose(placement.lift(x), arm.plane.lift(x), atol=1e-9)
    assert placement.note == ""


def test_a_camera_that_counts_pixels_is_brought_to_the_robot():
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, 500, seed=0)
    seen = replace(
        log, x=log.x @ np.array([[0.0, 900.0], [900.0, 0.0]]) + 400.0, unit="px", simulation=None
    )
    model = calib.train(seen, size=8)
    placement = place(model, Body.of(model.about))
    assert "least-squares" in placement.note
    drawn = placement.lift(seen.x)
    assert np.linalg.norm(drawn - arm.plane.lift(log.x), axis=1).max() < 5e-3


def test_without_a_urdf_the_map_is_drawn_at_a_size_that_can_be_seen():
    model = measured()
    scene = draw(replace(model, about=replace(model.about, urdf="", plane=None)))
    assert any("no URDF" in note for note in scene.notes)
    assert "Sensory map/lattice" in paths(scene)
    assert not any(path.startswith("Arm") for path in paths(scene))


# --------------------------------------------------------------------------- border
def test_level_lines_of_a_circle():
    x = np.linspace(-2, 2, 81)
    r = np.hypot(*np.meshgrid(x, x, indexing="ij"))
    lines = level_lines(x, x, r, 1.0)
    np.testing.assert_allclose(np.linalg.norm(lines, axis=2), 1.0, atol=2e-3)
    length = np.linalg.norm(lines[:, 0] - lines[:, 1], axis=1).sum()
    assert abs(length - 2 * np.pi) < 0.01


def test_border_of_two_link_lies_on_its_limits():
    model = trained("two_link", n=3000, size=20)
    lines = border(model)
    length = np.linalg.norm(lines[:, 0] - lines[:, 1], axis=1).sum()
    inner = np.sqrt(0.3**2 + 0.25**2 + 2 * 0.3 * 0.25 * np.cos(np.radians(150)))
    outer = np.sqrt(0.3**2 + 0.25**2 + 2 * 0.3 * 0.25 * np.cos(np.radians(15)))
    turn = np.radians(90) * (inner + outer) + 2 * np.radians(135) * 0.25
    assert abs(length / turn - 1) < 0.05
    radius = np.linalg.norm(lines, axis=2)
    assert inner - 0.01 < radius.min()
    assert radius.max() < outer + 1e-6


# --------------------------------------------------------------------------- camera, motion
def test_the_camera_shows_everything_in_any_window():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (200, 3)) * [0.5, 0.3, 0.1]
    for frame in (np.eye(3), np.eye(3)[[0, 2, 1]] * [[1], [1], [-1]], np.eye(3)[[1, 2, 0]]):
        camera = Camera.onto(points, frame)
        for width, height, panel in ((900, 700, 280), (1440, 900, 280), (500, 900, 0)):
            pixels = camera.project(points, width, height, panel)
            assert (pixels[:, 0] > panel).all()
            assert (pixels[:, 0] < width).all()
            assert (pixels[:, 1] > 0).all()
            assert (pixels[:, 1] < height).all()


def test_x_leads_right_and_y_up():
    camera = Camera.onto(np.eye(3), np.eye(3))
    pixels = camera.project([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], 800, 600)
    assert pixels[1, 0] > pixels[0, 0] + 5
    assert abs(pixels[1, 1] - pixels[0, 1]) < 1
    assert pixels[2, 1] < pixels[0, 1] - 5


@pytest.mark.parametrize("robot", ["two_link_full", "three_link", "polar"])
def test_the_path_is_followed_without_jumps(robot: str):
    model = trained(robot, n=3000, size=20)
    motion = drive(model)
    assert motion.true
    step = np.abs(np.diff(motion.q, axis=0)) / model.motor.scale.span
    assert step.max() < 0.08
    np.testing.assert_allclose(motion.q[0], motion.q[-1], atol=1e-6)
    arm = calib.load_arm(robot)
    np.testing.assert_allclose(motion.reached, arm.forward(motion.q), atol=1e-12)
    assert motion.deviation.max() < 1e-3


def test_deviations_are_enlarged_only_where_they_are_no_rounding():
    motion = drive(trained("two_link", n=400, size=8))
    size = 0.5
    for deviation, factor in ((1e-12, 1), (1e-6, 5000), (1e-4, 50), (0.1, 1)):
        moved = replace(motion, reached=motion.target + np.array([deviation, 0.0]))
        shown, found = moved.magnified(size)
        assert found == factor
        off = np.linalg.norm(shown - motion.target, axis=1)
        np.testing.assert_allclose(off, deviation * factor, rtol=1e-3)


def test_quaternions_stay_on_one_side():
    angles = np.linspace(0, 4 * np.pi, 100)
    turns = np.tile(np.eye(3), (100, 1, 1))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0], turns[:, 0, 1] = np.sin(angles), -np.sin(angles)
    q = quaternions(turns)
    assert np.sum(q[1:] * q[:-1], axis=1).min() > 0.9


# --------------------------------------------------------------------------- scales
def test_lengths_in_words():
    words = [length_in_words(v, "m") for v in (2.0, 0.5, 1e-3, 2.34e-5, 5e-9, 1e-12, 0.0)]
    assert words == ["2 m", "500 mm", "1 mm", "23.4 µm", "5 nm", "below 1 nm", "0"]
    assert length_in_words(0.99999e-3, "m") == "1 mm"
    assert length_in_words(float("nan"), "m") == "unknown"


def test_error_scales():
    rounding = ErrorScale.of(np.array([1e-13, 3e-12]), "m", 0.5)
    assert rounding.rounding
    assert rounding.words() == "below 1 nm everywhere"
    assert rounding.share(np.array([1e-13, np.nan])).tolist()[0] == 0.0
    narrow = ErrorScale.of(np.linspace(0.9, 1.0, 100) * 1e-3, "m", 0.5)
    assert not narrow.log
    assert narrow.low > 0.8e-3
    wide = ErrorScale.of(np.geomspace(1e-6, 1e-3, 100), "m", 0.5)
    assert wide.log
    for scale in (narrow, wide):
        shares = np.linspace(0, 1, 7)
        values = np.array([scale.value(s) for s in shares])
        np.testing.assert_allclose(scale.share(values), shares, atol=1e-9)
    pixels = ErrorScale.of(np.array([1e-8]), "px", 600.0)
    assert pixels.rounding
    assert "px" in pixels.words()


def test_colours_rise_evenly_in_lightness_and_have_no_ends_that_vanish():
    tint = colours(np.linspace(0, 1, 50)).astype(float) / 255
    linear = np.where(tint <= 0.04045, tint / 12.92, ((tint + 0.055) / 1.055) ** 2.4)
    light = linear @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(light) > 0).all()
    assert light[0] > 0.02
    assert light[-1] < 0.6
    assert colours(np.array([np.nan]))[0].tolist() == list(rgb(UNKNOWN))
    assert colours(np.array([0.0]))[0].tolist() == list(rgb(stops()[0]))


# --------------------------------------------------------------------------- scene and page
@pytest.mark.parametrize("robot", ROBOTS)
def test_layers_have_plain_names(robot: str):
    scene = draw(trained(robot, n=400, size=8))
    layers = {path.split("/")[0] for path in paths(scene)}
    assert layers == {
        "Arm",
        "Sensory map",
        "Motor map",
        "Hebbian links",
        "Workspace border",
        "Training samples",
        "Target path",
        "Reached path",
    }
    assert scene.page["layers"][0]["name"] == "Arm"


def test_three_joints_give_a_lattice_in_space():
    scene = draw(trained("three_link", n=400, size=8))
    edges = np.array(scene.page["panel"]["edges"])
    assert edges.shape == (3, 3)
    assert abs(np.linalg.det(edges)) > 1e-3


def test_the_arm_moves_with_its_joints():
    model = trained("two_link", n=400, size=8)
    scene = draw(model)
    found = next(c for c in packed(scene) if c["type"] == "set_animation")
    clips = {c["path"]: c["clip"]["tracks"][0]["keys"] for c in found["animations"]}
    tip = np.array([key["value"] for key in clips["Arm/tip"]])
    np.testing.assert_allclose(tip[:, :2], model.forward(scene.motion.q), atol=1e-6)
    assert len(clips["Target path/target"]) == len(tip)


def test_sensory_errors_are_means_of_their_partners():
    model = trained("two_link", n=3000, size=20, noise=1e-3)
    errors = sensory_errors(model)
    links = model.links.toarray()
    for node in (0, 57, 211):
        partners = links[:, node] * model.visited
        if partners.sum():
            expected = (partners * model.bounds).sum() / partners.sum()
            np.testing.assert_allclose(errors[node], expected)
        else:
            assert np.isnan(errors[node])


def test_the_strongest_partners_come_first():
    model = trained("two_link", n=3000, size=20)
    partners, strength = strongest_partners(model)
    links = model.links.toarray()
    for node in (5, 100, 399):
        known = partners[node][partners[node] >= 0]
        best = np.sort(links[:, node])[::-1][: len(known)]
        np.testing.assert_allclose(links[known, node], best)
        assert (np.diff(strength[node].astype(int)) <= 0).all()


def test_the_page_is_the_same_every_time_and_needs_no_network():
    model = trained("two_link", n=400, size=8)
    first, second = (html(draw(model), model) for _ in range(2))
    assert first == second
    assert "default-src 'none'" in first
    head = first.split("<script>")[0]
    assert not re.search(r"""(src|href)=["']?http""", head)
    assert len(first.encode()) < 3_000_000


def test_names_from_a_urdf_are_text_in_the_page():
    model = trained("two_link", n=400, size=8)
    name = "</script><script>alert(1)</script>@SCRIPT@<!--"
    evil = replace(model, about=replace(model.about, robot=name))
    page = html(draw(evil), evil)
    assert "<script>alert" not in page
    assert data_of(page)["title"] == name


def test_the_page_holds_the_links():
    model = trained("two_link", n=400, size=8)
    data = data_of(html(draw(model), model))
    partners = np.frombuffer(base64.b64decode(data["links"]["partners"]), dtype="<u2")
    expected = strongest_partners(model)[0]
    assert (partners.reshape(expected.shape) == expected.astype("<u2")).all()


# --------------------------------------------------------------------------- server
@pytest.fixture
def server():
    model = trained("two_link_full", n=3000, size=20)
    with PreviewServer("<p>page</p>", 0, Live(model).answer) as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def ask(url: str, data: bytes | None = None, **headers: str) -> tuple[int, bytes]:
    request = urllib.request.Request(url, data, headers)
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(request, timeout=20) as reply:
            return reply.status, reply.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def test_the_server_listens_on_loopback_alone(server: PreviewServer):
    assert server.server_address[0] == ADDRESS == "127.0.0.1"
    assert ask(server.url) == (200, b"<p>page</p>")
    other = f"http://{ADDRESS}:{server.server_address[1]}/"
    assert ask(other)[0] == 404
    assert ask(server.url, Host="example.org")[0] == 404
    with pytest.raises(calib.OptionError, match=str(server.server_address[1])):
        PreviewServer("", server.server_address[1])


def test_live_answers_hold_every_branch(server: PreviewServer):
    model = trained("two_link_full", n=3000, size=20)
    target = model.forward([0.6, 0.7])
    status, reply = ask(server.url + "ask", json.dumps({"at": [*target, 0.3]}).encode())
    assert status == 200
    answer = json.loads(reply)
    assert answer["reachable"]
    units = np.array([branch["joints"] for branch in answer["branches"]])
    q = model.motor.scale.from_unit(units)
    np.testing.assert_allclose(q, model.inverse_all(target[None])[0], atol=1e-12)
    assert len(q) == 2
    for branch in answer["branches"]:
        tip = np.array(branch["links"]["tip"]).reshape(4, 4).T[:2, 3]
        np.testing.assert_allclose(tip, target, atol=1e-3)
    far = json.loads(ask(server.url + "ask", b'{"at": [5, 5, 0]}')[1])
    assert not far["reachable"]
    for bad in (b"", b"nonsense", b"[1]", b'{"at": [1]}', b'{"at": [NaN, 0, 0]}'):
        assert ask(server.url + "ask", bad)[0] in (400, 404)


# --------------------------------------------------------------------------- command
def test_command_writes_a_page(run, model: Path, tmp_path: Path):
    page = tmp_path / "page.html"
    done = run("preview", model, "--html", page)
    assert done.code == 0
    assert "MB" in done.out
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--html", "no/such/folder.html"], 1),
        (["--port", "70000"], 2),
        (["--port", "-1"], 2),
        (["--meshes", "nowhere"], 2),
        (["--columns", "x=u,y=v"], 2),
        (["--live", "--html", "x.html"], 2),
    ],
)
def test_wrong_usage_is_told_in_one_line(run, model: Path, arguments: list[str], code: int):
    done = run("preview", model, "--no-open", *arguments)
    assert done.code == code
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1


def test_command_shows_samples_of_a_log(run, model: Path, log: Path, tmp_path: Path):
    page = tmp_path / "page.html"
    assert run("preview", model, "--data", log, "--html", page).code == 0
    layers = {e["name"]: e for e in data_of(page.read_text(encoding="utf-8"))["layers"]}
    assert layers["Training samples"]["text"] == "rows of the log"


def test_command_serves_and_ends_with_ctrl_c(model: Path):
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
            assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]+/", url)
            assert b"MeshCat" in ask(url)[1]
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 0
        finally:
            process.kill()
    port = int(url.split(":")[2].split("/")[0])
    with socket.socket() as probe:
        assert probe.connect_ex((ADDRESS, port)) != 0
