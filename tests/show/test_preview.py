"""Preview: scene, page, server and command."""

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
from models import trained
from scenes import paths, tracks

import calib
from calib.show.preview.lattices import strongest_partners
from calib.show.preview.page import html
from calib.show.preview.scene import draw
from calib.show.preview.server import ADDRESS, Live, PreviewServer
from calib.show.workspace import sensory_errors

ROBOTS = ("two_link", "two_link_full", "three_link", "tilted", "scara", "polar")


def data_of(page: str) -> dict:
    found = re.search(r'id="calib-data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found.group(1))


@pytest.mark.parametrize("robot", ROBOTS)
def test_layers_have_plain_names(robot: str):
    scene = draw(trained(robot, n=400, size=8))
    layers = {layer["name"] for layer in scene.canvas.layers}
    assert {path.split("/")[0] for path in paths(scene)} == layers - {"Hebbian links"}
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
    assert scene.canvas.layers[0]["name"] == "Arm"


def test_three_joints_give_a_lattice_in_space():
    scene = draw(trained("three_link", n=400, size=8))
    edges = np.array(scene.page["panel"]["edges"])
    assert edges.shape == (3, 3)
    assert abs(np.linalg.det(edges)) > 1e-3


def test_the_arm_moves_with_its_joints():
    model = trained("two_link", n=400, size=8)
    scene = draw(model)
    moved = tracks(scene)
    tip = moved["Arm/tip"][:, :3, 3]
    np.testing.assert_allclose(tip[:, :2], model.forward(scene.motion.q), atol=1e-6)
    assert len(moved["Target path/target"]) == len(tip)


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
