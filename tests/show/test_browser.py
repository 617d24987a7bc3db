"""Pages in a real browser: what is drawn, where, and that nothing else is asked for."""

import re
from pathlib import Path

import numpy as np
import pytest
from browser import Sight, look, measured_page
from models import in_space
from scenes import data_of, objects, page_of, project, tracks, unpacked

import calib
from calib.show.error_scale import STOPS

SIZE = (900, 700)
PANEL = 280  # pixels that the page's panel covers


@pytest.fixture(scope="module")
def model() -> calib.Model:
    arm = calib.load_arm("two_link_full")
    return calib.train(calib.babble(arm, 3000, seed=0, noise=1e-3), size=24)


@pytest.fixture(scope="module")
def page(model: calib.Model) -> str:
    return page_of(model)


@pytest.fixture(scope="module")
def seen(page: str, tmp_path_factory: pytest.TempPathFactory) -> Sight:
    folder = tmp_path_factory.mktemp("browser")
    (folder / "page.html").write_text(page, encoding="utf-8")
    return look(folder / "page.html", folder, size=SIZE)


def rgb(colour: str) -> np.ndarray:
    return np.array(list(bytes.fromhex(colour[1:])))


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


@pytest.mark.parametrize("name", ["Sensory map", "Motor map"])
def test_nodes_have_their_colours_where_they_are(page: str, seen: Sight, name: str):
    data = data_of(page)
    nodes = objects(data)[f"{name}/nodes"]
    wanted = nodes["tints"].astype(int)
    pixels = project(data["camera"], nodes["points"], *SIZE, PANEL)
    hit = near(seen, pixels, wanted) < 40
    # the arm, links and paths hide some of them
    assert hit.mean() > 0.75
    shuffled = wanted[np.random.default_rng(0).permutation(len(wanted))]
    assert hit.mean() > (near(seen, pixels, shuffled) < 40).mean() + 0.1


def test_the_tip_is_on_its_ball(page: str, seen: Sight):
    data = data_of(page)
    tip = tracks(data)["Arm/tip"][0, :3, 3]
    expected = project(data["camera"], tip, *SIZE, PANEL)[0]
    ball = next(o for o in data["objects"] if o["path"] == "Reached path/ball")
    orange = np.linalg.norm(seen.pixels - rgb(ball["colour"]), axis=2) < 30
    rows, columns = np.nonzero(orange)
    close = np.hypot(columns - expected[0], rows - expected[1]) < 12
    assert close.sum() > 15
    assert np.hypot(columns[close].mean() - expected[0], rows[close].mean() - expected[1]) < 3


def test_partners_of_the_linked_node_are_dots(page: str, seen: Sight):
    data = data_of(page)
    partners = unpacked(data["links"]["partners"], "<u4").reshape(-1, data["links"]["each"])
    nodes = objects(data)["Motor map/nodes"]["points"]
    strongest = nodes[partners[data["links"]["node"]][:3]]
    pixels = project(data["camera"], strongest, *SIZE, PANEL)
    assert (near(seen, pixels, np.tile(rgb(data["links"]["link"]), (3, 1)), 1) < 40).all()


def test_another_arm_in_the_dark(tmp_path: Path):
    arm = calib.load_arm("tilted")
    model = calib.train(calib.babble(arm, 1500, seed=0), size=12)
    path = tmp_path / "page.html"
    calib.preview(model, path)
    sight = look(path, tmp_path, dark=True, size=(1440, 900))
    assert sight.console == []
    assert sight.pixels[-8:, -8:].max() < 60
    data = data_of(path.read_text(encoding="utf-8"))
    nodes = objects(data)["Sensory map/nodes"]
    pixels = project(data["camera"], nodes["points"], 1440, 900, PANEL)
    assert (near(sight, pixels, nodes["tints"].astype(int)) < 45).mean() > 0.6


def test_a_live_page_draws_every_branch(model: calib.Model, tmp_path: Path, monkeypatch):
    target = model.forward([0.6, 0.7])
    asked = f"<script>calib.ask({[*target.tolist(), 0.0]})</script></body>"
    from calib.show.preview.scene import Scene

    plain = Scene.html
    monkeypatch.setattr(
        Scene, "html", lambda self, **live: plain(self, **live).replace("</body>", asked)
    )
    with calib.preview(model, live=True, browse=False) as shown:
        sight = look(shown.url, tmp_path, size=SIZE)
    assert sight.console == []
    data = data_of(page_of(model))
    branches = model.inverse_all(target[None])[0]
    assert len(branches) == 2
    u = model.motor.scale.to_unit(branches)
    dots = np.array(data["panel"]["corner"]) + u @ np.array(data["panel"]["edges"])
    pixels = project(data["camera"], dots, *SIZE, PANEL)
    wanted = np.array([rgb("#1c7ed6"), rgb("#e8590c")])
    assert (near(sight, pixels, wanted, 1) < 40).all()


@pytest.mark.parametrize("dark", [False, True])
def test_report_in_light_and_dark(model: calib.Model, tmp_path: Path, dark: bool):
    page = tmp_path / "report.html"
    calib.report(model, page)
    sight = look(page, tmp_path, dark=dark, size=(900, 2600))
    assert sight.console == []
    ground = sight.pixels[:, :10].reshape(-1, 3)
    assert ground.max() < 60 if dark else ground.min() > 240
    # ink stands out from the ground, and the heat maps are there, from end to end
    ink = sight.pixels.reshape(-1, 3)
    assert ink.max() > 200 if dark else ink.min() < 60
    for colour in (STOPS[1], STOPS[-1]):
        assert (np.linalg.norm(ink - rgb(colour), axis=1) < 20).sum() > 50


@pytest.mark.parametrize("size", [(390, 844), (900, 700)])
def test_a_report_answers_on_its_first_screen_without_overlaps(tmp_path: Path, size):
    page = tmp_path / "report.html"
    calib.report(in_space(), page)
    seen = measured_page(page, tmp_path, size)
    assert seen["texts"] > 50
    assert seen["overlaps"] == []
    assert seen["sideways"] <= 0
    # verdict, answers, bars, and the first causes
    assert max(seen["bottoms"][:3]) < size[1]
    assert seen["bottoms"][3] < size[1] + 150


COUNT = """<script>setTimeout(() => {
  document.querySelectorAll("#calib-layers input").forEach((box) => box.checked || box.click());
  setTimeout(() => {
    const boxes = [...document.querySelectorAll("#calib-labels span")]
      .map((node) => node.getBoundingClientRect()).filter((box) => box.width);
    const over = boxes.filter((a, i) => boxes.slice(i + 1).some((b) => a.left < b.right
      && b.left < a.right && a.top < b.bottom && b.top < a.bottom));
    console.log(`labels ${boxes.length} overlaps ${over.length}`);
  }, 800);
}, 1500);</script></body>"""


@pytest.mark.parametrize("size", [(390, 844), (900, 700)])
def test_labels_of_a_preview_do_not_collide_with_all_layers_on(tmp_path: Path, size):
    page = tmp_path / "page.html"
    page.write_text(page_of(in_space()).replace("</body>", COUNT), encoding="utf-8")
    (line,) = look(page, tmp_path, size=size).console
    labels, overlaps = (int(word) for word in re.findall(r"\d+", line)[:2])
    assert labels > 0
    assert overlaps == 0
