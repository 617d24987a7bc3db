"""Report and preview: what they answer and draw, each in one file, and the preview's server."""

import re
import urllib.error
import urllib.request
from dataclasses import replace
from functools import partial
from pathlib import Path

import models
import numpy as np
import pytest
from boards import World
from conftest import refused
from models import babbled, bare, in_pixels, in_space, lengths, log, measured, no_arm, trained
from scenes import data_of, objects, page_of, tracks
from scipy.special import stdtrit

import calib

WHY = ["where", "coverage", "joints", "arrows"]
simulated = partial(trained, "two_link")
CAUSES = [  # [mm or deg]
    ("two_link", "elbow.offset=0.02", "elbow: zero", np.degrees(0.02)),
    ("six_axis", "elbow.offset=0.01", "elbow: zero", np.degrees(0.01)),
    ("spatial_three", "shoulder_lift.length=+2%", "elbow: origin along x", 6.0),
]


def report(model, given=None) -> str:
    calib.report(model, "report.html", given)
    return Path("report.html").read_text(encoding="utf-8")


def words(model, given=None) -> str:
    """A report without the rendering of its figures, which takes most of its time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.show.report.html.to_svg", lambda *_: "<svg></svg>")
        return report(model, given)


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def changed_log():
    return replace(babbled("elbow.length=+5%", n=60, noise=1e-3), simulation=None)


def test_one_small_file_without_addresses_in_the_page_own_ink():
    model = simulated(noise=1e-3)
    page = report(model)
    names = re.findall(r'\sid="([^"]*)"', page)
    addresses = re.findall(r'\s(?:xlink:href|href|src)="([^"]*)"', page)
    assert re.findall(r"<h1[^>]*>([^<]*)", page) == ["two_link"]
    assert {"accuracy", *WHY} <= set(names)
    assert len(page.encode()) < 1_000_000
    assert all(a.startswith(("#", "data:image/png")) for a in addresses)
    assert len(set(names)) == len(names)
    assert {a[1:] for a in addresses if a.startswith("#")} <= set(names)
    for text in ("default-src 'none'", "currentColor", "scheme: dark", "@media print"):
        assert text in page
    assert not re.search("#010203|#020304", page)
    assert not re.search(r"\de[-+]\d", re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL))
    assert report(model) == page


def test_the_first_words_are_what_changed_and_what_to_do():
    changed = words(calib.adapt(simulated(noise=1e-3), changed_log()).model)
    assert "does not hold" not in changed  # a note on the model that it was
    (lead,) = re.findall(r'class="lead">([^<]*)', changed)
    assert re.search(r"elbow is .* longer.*predicted", lead, re.DOTALL)
    assert "is simulated" in words(simulated())


def test_a_log_is_told_by_the_verdict_of_check():
    still = words(measured(), log(300, 1e-3, seed=7))
    assert "Still calibrated" in still
    assert "of this log: it holds" in still
    changed = words(measured(), changed_log())
    cause = calib.judge(measured(), changed_log()).causes[0].words
    assert f"Drifted: {cause}" in changed
    assert "calib adapt" in changed
    # the page said beside it that nothing is off, and that the model is below 2.64 mm
    (off,) = re.findall(r"What is off</dt><dd>([^<]*)", changed)
    assert off.lower() == f"{cause}.".lower()
    assert "noisy readings" not in changed
    # rows that the model has learned say nothing of it
    for untold in (log(1200, 1e-3), log(5, 1e-3, seed=7)):
        page = words(measured(), untold)
        assert "rows held out" in page
        assert "fewer than 10 rows" in page


def test_words_of_other_models():
    as_drawn = words(measured())
    assert "rows held out" in as_drawn
    assert "As delivered" not in as_drawn
    # rounding alone: its arrows were drawn 60,000,000,000,000 times as long
    assert "below 0.000001 mm on average" in words(simulated())
    exact = calib.figures(simulated())
    assert list(exact) == ["accuracy", "where", "coverage", "lattices", "u_matrices"]
    assert exact["accuracy"].axes[0].get_xlim() == (0.0, 1.0)  # [nm]
    undrawn = calib.train(no_arm(300), size=4)
    assert any("`body='none'`" in note for note in undrawn.about.notes)
    assert "no planar arm explains the positions" in words(undrawn)
    few = words(trained("two_link", n=600, size=6, body="none"))
    assert 'id="u_matrices"' in few
    assert re.search(r"of the \d+ % that have an answer, on \d+ fresh exact samples", few)
    # the errors that a training printed
    model = trained("two_link", n=1500, size=10, body="none")
    mean = model.about.errors["linear"]["forward"]["distance"]["mean"]
    maps_alone = words(model)
    assert f"{1e3 * mean:.3g} mm on average" in maps_alone
    assert "noise included" not in maps_alone


@pytest.mark.parametrize(("robot", "change", "cause", "size"), CAUSES)
def test_the_largest_cause_is_the_change_within_its_interval(robot, change, cause, size):
    """Of a link 6 mm longer a report told an origin 46 m off along its own axis."""
    page = words(calib.train(bare(robot, 80, 0, change, noise=1e-4), size=4))
    told = re.search(rf"{cause} ([\d.]+) ± ([\d.]+) (?:mm|deg): it moves the tip", page)
    assert "As delivered it is off by" in page
    value, half = map(float, told.groups())
    assert abs(value - size) < half < 0.1 * size


def test_each_of_several_sensors_has_its_bars_and_its_rows():
    page = words(models.seen_by_two())
    assert "By left: the tip" in page
    assert "By right: the tip" in page
    names = set(re.findall(r'id="([^"]*)"', page))
    assert {"accuracy", "accuracy-2", "where-2", "order-2"} <= names
    assert page.count('id="causes"') == 1
    assert "where-2" in calib.figures(models.seen_by_two())


def test_a_value_stands_behind_a_long_name():
    name = 80 * "e"
    Path("long.urdf").write_text(calib.load_arm("two_link").urdf.replace("elbow", name))
    model = calib.train(bare("long.urdf", 60, 0, f"{name}.length=+5%"), size=4)
    cause = calib.figures(model)["causes"].axes[0].texts[0].get_text()
    assert re.fullmatch(r"e+ \.\.\. .*[\d.]+ ± [\d.]+ mm", cause)


def test_names_from_a_file_reach_a_page_as_text():
    name = "\x1b]0;owned\x07\u202eel\nbow$\\foo$<script>alert(1)</script>"
    model = calib.train(replace(log(300, 1e-4), arm=None), size=8)
    joints = ("shoulder", name)
    about = replace(model.about, joint_names=joints, robot=name, tip=name, notes=(name,))
    page = report(replace(model, about=about))
    assert "<script>" not in page
    assert "internal" not in page


def test_a_joint_that_does_not_move_the_tip_has_no_error():
    """Of wrist_3, whose axis the tip lies on, a figure showed 40,000 mrad."""
    rows = bare("six_axis", 80, 0, noise=1e-4)
    drawn = calib.figures(calib.train(rows, size=4))["joints"]
    assert [ax.get_title("left") for ax in drawn.axes] == list(rows.joint_names[:-1])


def test_bars_have_the_interval_of_ten_blocks_and_the_noise_of_readings():
    held_out, noisy = (
        calib.figures(model)["accuracy"].axes[0].texts[k].get_text()
        for model, k in ((measured(), -1), (simulated(noise=1e-3), 1))
    )
    distance = lengths(measured().rows.held_out)
    means = [block.mean() for block in np.array_split(distance, 10)]
    half = stdtrit(9, 0.975) * np.std(means, ddof=1) / np.sqrt(10)
    assert held_out == f"on rows held out: {1e3 * distance.mean():.3f} ± {1e3 * half:.3f} mm"
    mean = float(re.search(r"noise included: ([\d.]+) ±", noisy)[1])
    assert mean == pytest.approx(np.sqrt(np.pi / 2), rel=0.03)


def test_figures_on_paper_of_an_arm_in_space_and_in_pixels():
    refused(calib.OptionError, "tuple", calib.figures, (measured(), measured()))
    drawn = calib.figures(in_space())
    drawn["where"].savefig("where.png")
    assert Path("where.png").read_bytes().startswith(b"\x89PNG")
    assert set(drawn) == {"accuracy", "causes", *WHY, "order"}
    # three projections and their colours
    assert len(drawn["where"].axes) == 4
    assert "setup" in calib.figures(in_pixels())
    # the joint curve that was learned goes through what rows say
    for ax in drawn["joints"].axes:
        rows, curve = ax.lines
        there = np.interp(rows.get_xdata(), curve.get_xdata(), curve.get_ydata())
        assert np.std(rows.get_ydata() - there) < 0.8 * np.std(rows.get_ydata())


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
        np.testing.assert_allclose(np.reshape(data["places"][name], (4, 4)).T, frame, atol=5e-3)
    np.testing.assert_allclose(tracks(data)["Arm/flange"], rig.flange, atol=1e-6)
    assert run("report", path, "-o", page, "--data", "x.csv").code == 2
    # a page said 0.0000573 deg, the least that a fit looks for
    rig = replace(rig, repeatability={"position": 1e-4, "rotation": 1e-6})
    assert "scatter by 0.1 mm and less than 0.001 deg (sd)" in words(rig)


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
