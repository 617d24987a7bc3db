"""Pages in a real browser: what is drawn, where, and that nothing else is asked for."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from browser import Sight, document, look
from scenes import project

import calib
from calib.model.model import Model
from calib.show.error_scale import STOPS, colours, rgb
from calib.show.preview.motion import REACHED
from calib.show.preview.page import html
from calib.show.preview.scene import Scene, draw
from calib.show.preview.server import Live, PreviewServer
from calib.show.report.page import report
from calib.show.workspace import motor_errors, sensory_errors

SIZE = (900, 700)
PANEL = 280  # pixels that the page's panel covers


@pytest.fixture(scope="module")
def model() -> Model:
    arm = calib.load_arm("two_link_full")
    return calib.train(calib.babble(arm, 3000, seed=0, noise=1e-3), size=24)


@pytest.fixture(scope="module")
def scene(model: Model) -> Scene:
    return draw(model)


@pytest.fixture(scope="module")
def seen(model: Model, scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Sight:
    folder = tmp_path_factory.mktemp("browser")
    page = folder / "page.html"
    page.write_text(html(scene, model), encoding="utf-8")
    return look(page, folder, size=SIZE)


def near(sight: Sight, pixels: np.ndarray, wanted: np.ndarray, reach: int = 2) -> np.ndarray:
    """Smallest colour distance (n,) to `wanted` (n, 3) within some pixels of places (n, 2)."""
    height, width = sight.pixels.shape[:2]
    best = np.full(len(pixels), np.inf)
    for dx in range(-reach, reach + 1):
        for dy in range(-reach, reach + 1):
            x = np.clip(np.round(pixels[:, 0]).astype(int) + dx, 0, width - 1)
            y = np.clip(np.round(pixels[:, 1]).astype(int) + dy, 0, height - 1)
            away = np.linalg.norm(sight.pixels[y, x] - wanted, axis=1)
            best = np.minimum(best, away)
    return best


def test_console_is_silent(seen: Sight):
    assert seen.console == []


@pytest.mark.parametrize("name", ["sensory", "motor"])
def test_nodes_have_their_colours_where_they_are(
    model: Model, scene: Scene, seen: Sight, name: str
):
    if name == "sensory":
        points, errors = scene.placement.lift(model.sensory.weights), sensory_errors(model)
    else:
        panel = scene.page["panel"]
        points = np.array(panel["corner"]) + model.motor.units @ np.array(panel["edges"])
        errors = motor_errors(model)
    wanted = colours(scene.scale.share(errors)).astype(int)
    pixels = project(scene.camera, points, *SIZE, PANEL)
    hit = near(seen, pixels, wanted) < 40
    # the arm, links and paths hide some of them
    assert hit.mean() > 0.75
    shuffled = wanted[np.random.default_rng(0).permutation(len(wanted))]
    assert hit.mean() > (near(seen, pixels, shuffled) < 40).mean() + 0.1


def test_the_tip_is_where_forward_puts_it(model: Model, scene: Scene, seen: Sight):
    tip = model.forward(scene.motion.q[0])
    expected = project(scene.camera, scene.placement.lift(tip[None]), *SIZE, PANEL)[0]
    orange = np.linalg.norm(seen.pixels - np.array(rgb(REACHED)), axis=2) < 30
    rows, columns = np.nonzero(orange)
    close = np.hypot(columns - expected[0], rows - expected[1]) < 12
    assert close.sum() > 15
    middle = columns[close].mean(), rows[close].mean()
    assert np.hypot(*(np.array(middle) - expected)) < 3


def test_outside_of_everything_is_background(scene: Scene, seen: Sight):
    corner = seen.pixels[-8:, -8:].reshape(-1, 3)
    assert np.ptp(corner, axis=0).max() < 6
    assert corner.min() > 200  # light


def test_legend_runs_through_all_colours(seen: Sight):
    panel = seen.pixels[:200, :PANEL]
    first, last = (np.array(rgb(c)) for c in (STOPS[0], STOPS[-1]))
    starts = np.linalg.norm(panel - first, axis=2) < 25
    ends = np.linalg.norm(panel - last, axis=2) < 25
    rows = np.flatnonzero(starts.any(axis=1) & ends.any(axis=1))
    assert len(rows) >= 8
    row = rows[len(rows) // 2]
    assert np.flatnonzero(ends[row]).max() - np.flatnonzero(starts[row]).min() > 200


def test_layers_can_be_switched_and_are_named(model: Model, scene: Scene, tmp_path: Path):
    page = tmp_path / "page.html"
    page.write_text(html(scene, model), encoding="utf-8")
    text = document(page, tmp_path)
    for name in ("Arm", "Sensory map", "Motor map", "Hebbian links", "Workspace border"):
        assert text.count(f">{name}<") >= 2  # in the panel and in meshcat's own controls
    assert "Training samples" in text


@pytest.mark.parametrize("robot", ["three_link", "tilted"])
def test_other_arms_in_the_dark(robot: str, tmp_path: Path):
    arm = calib.load_arm(robot)
    model = calib.train(calib.babble(arm, 1500, seed=0), size=12)
    page = tmp_path / "page.html"
    scene = draw(model)
    page.write_text(html(scene, model), encoding="utf-8")
    sight = look(page, tmp_path, dark=True, size=(1440, 900))
    assert sight.console == []
    assert sight.pixels[-8:, -8:].max() < 60
    nodes = project(scene.camera, scene.placement.lift(model.sensory.weights), 1440, 900, PANEL)
    tint = colours(scene.scale.share(sensory_errors(model))).astype(int)
    assert (near(sight, nodes, tint) < 45).mean() > 0.6


def test_a_live_page_draws_every_branch(model: Model, tmp_path: Path):
    scene = draw(model)
    target = model.forward([0.6, 0.7])
    at = scene.placement.lift(target[None])[0].tolist()
    page = html(scene, model, live=True)
    page = page.replace("</body>", f"<script>calib.ask({at})</script></body>")
    with PreviewServer(page, 0, Live(model).answer) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        try:
            sight = look(server.url, tmp_path, size=SIZE)
        finally:
            server.shutdown()
            thread.join()
    assert sight.console == []
    panel = scene.page["panel"]
    branches = model.inverse_all(target[None])[0]
    assert len(branches) == 2
    u = model.motor.scale.to_unit(branches)
    dots = np.array(panel["corner"]) + u @ np.array(panel["edges"])
    pixels = project(scene.camera, dots, *SIZE, PANEL)
    wanted = np.array([rgb("#1c7ed6"), rgb("#e8590c")])
    assert (near(sight, pixels, wanted, 1) < 40).all()


@pytest.fixture(scope="module")
def reported(model: Model) -> str:
    return report(model)


@pytest.mark.parametrize("dark", [False, True])
def test_report_in_light_and_dark(reported: str, tmp_path: Path, dark: bool):
    page = tmp_path / "report.html"
    page.write_text(reported, encoding="utf-8")
    sight = look(page, tmp_path, dark=dark, size=(900, 2600))
    assert sight.console == []
    ground = sight.pixels[:, :10].reshape(-1, 3)
    assert ground.max() < 60 if dark else ground.min() > 240
    # ink stands out from the ground, and the heat maps are there, from end to end
    ink = sight.pixels.reshape(-1, 3)
    assert ink.max() > 200 if dark else ink.min() < 60
    for colour in (STOPS[1], STOPS[-1]):
        assert (np.linalg.norm(ink - np.array(rgb(colour)), axis=1) < 20).sum() > 50
