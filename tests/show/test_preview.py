"""Preview: what its page draws, its server, its command."""

import re
import urllib.error
import urllib.request
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from boards import World
from conftest import refused
from models import in_space, lengths, trained
from scenes import data_of, objects, page_of, tracks

import calib

MAPS = ["Sensory map", "Motor map", "Hebbian links"]
LAYERS = ["Arm", *MAPS, "Reach", "Rows", "Measured tip", "Predicted tip"]
small = partial(trained, n=400, size=8)


@pytest.mark.parametrize("robot", ["three_link", "tilted", "polar"])
def test_an_arm_moves_along_its_path_at_its_true_place(robot: str):
    model, arm = small(robot), calib.load_arm(robot)
    data = data_of(page_of(model))
    assert [layer["name"] for layer in data["layers"]] == LAYERS
    assert data["notes"] == []
    moved = tracks(data)
    tip = moved[f"Arm/{arm.tip}"][:, :3, 3]
    np.testing.assert_allclose(moved["Predicted tip/ball"][:, :3, 3], tip, atol=2e-3)
    nodes = objects(data)["Sensory map/nodes"]["points"]
    drawn = arm.plane.origin + model.sensory.weights @ arm.plane.basis[:2]
    np.testing.assert_allclose(nodes, drawn, atol=1e-6)


def test_an_arm_in_space_has_its_reach_its_rows_and_no_maps_until_they_are_asked_for():
    model = in_space()
    data = data_of(page_of(model))
    found = objects(data)
    assert {"Reach/points", "Sensory map/nodes", "Rows/positions"} <= set(found)
    off = {layer["name"] for layer in data["layers"] if not layer["shown"]}
    assert off == {*MAPS, "Reach"}
    # positions are drawn where the tool is in the robot's frame
    places = {path: transforms[:, :3, 3] for path, transforms in tracks(data).items()}
    held = np.linalg.norm(model.body.beta[model.body.structure.groups["tool"]])
    away = places["Predicted tip/ball"] - places[f"Arm/{calib.load_arm('spatial_three').tip}"]
    assert lengths(away) == pytest.approx(held, abs=5e-3)
    # Play goes through the rows in their order
    moved = places["Measured tip/ball"]
    rows = found["Rows/positions"]["points"]
    steps = [lengths(rows - place).argmin() for place in moved]
    assert steps == sorted(steps)
    assert len(set(steps)) == len(moved) == 60
    assert data["step"] > 1


def test_colours_end_where_nearly_all_errors_are():
    model = small(body="none")
    _, (_, middle), (_, top) = data_of(page_of(model))["ticks"]
    middle, top = (float(words.removesuffix(" mm")) for words in (middle, top))
    assert middle == pytest.approx(top / 2, abs=0.1)
    errors = 1e3 * model.expected_error(model.motor.weights)
    assert 0.9 < np.mean(errors <= top) < 1.0


@pytest.mark.parametrize("in_hand", [True, False])
def test_a_rig_is_drawn_where_it_is_and_reported_with_its_pictures(in_hand, tmp_path, run):
    world = World(1, in_hand)
    rig = world.solve()
    assert set(calib.figures(rig)) >= {"setup", "misses"}
    path, page = tmp_path / "rig.calib", tmp_path / "page.html"
    rig.save(path)
    done = run.done("report", path, "-o", page)
    assert done.out.startswith(f"{'Camera' if in_hand else 'Board'} in the frame of flange: (")
    text = page.read_text(encoding="utf-8")
    assert {"setup", "misses"} <= set(re.findall(r'figure id="(\w+)"', text))
    run.done("preview", path, "--html", page)
    data = data_of(page.read_text(encoding="utf-8"))
    hand, setup = ("Arm/flange", "Setup") if in_hand else ("Setup", "Arm/flange")
    for name, frame in ((f"{hand}/camera", world.camera), (f"{setup}/board", world.placed)):
        place = np.reshape(data["places"][name], (4, 4)).T
        np.testing.assert_allclose(place, frame, atol=5e-3)
    np.testing.assert_allclose(tracks(data)["Arm/flange"], rig.flange, atol=1e-6)
    assert run("report", path, "-o", page, "--data", "x.csv").code == 2


def test_a_page_is_the_same_every_time_needs_no_network_and_takes_names_for_text():
    name = "</script><script>alert(1)</script>@data@<!--"
    model = replace(small(), about=replace(small().about, robot=name))
    page = page_of(model)
    assert page == page_of(model)
    assert data_of(page)["title"] == name
    assert "<script>alert" not in page
    assert "default-src 'none'" in page
    assert not re.search(r"""(src|href)=["']?http""", page.split("<script>")[0])
    assert len(page.encode()) < 3_000_000


def ask(url: str, data: bytes | None = None, **headers: str) -> tuple[int, bytes]:
    request = urllib.request.Request(url, data, headers)
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(request, timeout=20) as reply:
            return reply.status, reply.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def test_a_page_is_served_on_loopback_to_who_knows_its_address():
    model = small()
    with calib.preview(model, browse=False) as shown:
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]+/", shown.url)
        assert b"MeshCat" in ask(shown.url)[1]
        port = int(shown.url.split(":")[2].split("/")[0])
        assert ask(f"http://127.0.0.1:{port}/")[0] == 404
        assert ask(shown.url, b"{}")[0] == 501
        refused(calib.OptionError, str(port), calib.preview, model, port=port, browse=False)
