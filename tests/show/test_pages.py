"""Pages in a real browser: what is drawn, where, and that no words overlap, in one look each."""

from pathlib import Path

import numpy as np
import pytest
from browser import Sight, look, measured_pages
from flange_worlds import World
from models import in_space, log, measured, trained
from scenes import data_of, objects, page_of, project, seen_by_two

import calib

SIZE = (900, 700)
PANEL = 280  # pixels that the page's panel covers
NARROW = (390, 844)


def full() -> calib.Model:
    return trained("two_link_full", n=3000, size=24, noise=1e-3)


REPORTED = {
    "simulated": full,
    "in-space": in_space,
    "few-rows": lambda: measured(n=30),
    "two-sensors": seen_by_two,
    "rig": lambda: World(2).solve(),
    "maps-alone": lambda: trained("two_link", n=400, size=4, body="none"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def pages(folder: Path) -> dict[tuple[str, tuple[int, int]], dict]:
    """Reports, and a preview with all its layers, as they are laid out at two sizes."""
    paths = {"preview": folder / "preview.html"}  # first: what is out of the window is not drawn
    calib.preview(in_space(), paths["preview"])
    for name, model in REPORTED.items():
        paths[name] = folder / f"{name}.html"
        calib.report(model(), paths[name], log(60, 1e-3, seed=3) if name == "few-rows" else None)
    return measured_pages(paths, folder, [NARROW, SIZE])


@pytest.mark.parametrize("size", [NARROW, SIZE])
@pytest.mark.parametrize("name", REPORTED)
def test_a_report_answers_on_its_first_screen_without_overlaps(pages, name, size):
    seen = pages[name, size]
    assert seen["texts"] > 30
    assert seen["overlaps"] == []
    assert seen["exponents"] == []
    assert seen["sideways"] <= 0
    # verdict, answers, bars, and the first causes
    lead, answers, bars, causes = seen["bottoms"]
    assert max(lead, answers) < size[1]
    if name not in ("two-sensors", "rig"):
        assert bars < size[1]
        assert causes < size[1] + 150


@pytest.mark.parametrize("size", [NARROW, SIZE])
def test_labels_of_a_preview_do_not_collide_with_all_layers_on(pages, size):
    seen = pages["preview", size]
    assert seen["labels"] > 0
    assert seen["overlaps"] == []


@pytest.fixture(scope="module")
def page() -> str:
    return page_of(full())


@pytest.fixture(scope="module")
def seen(page: str, tmp_path_factory: pytest.TempPathFactory) -> Sight:
    folder = tmp_path_factory.mktemp("light")
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


@pytest.mark.parametrize("name", ["Sensory map", "Motor map"])
def test_nodes_have_their_colours_where_they_are(page, seen, name):
    sight, data = seen, data_of(page)
    assert sight.console == []
    nodes = objects(data)[f"{name}/nodes"]
    wanted = nodes["tints"].astype(int)
    pixels = project(data["camera"], nodes["points"], *SIZE, PANEL)
    hit = near(sight, pixels, wanted) < 40
    # the arm, links and paths hide some of them
    assert hit.mean() > 0.75
    shuffled = wanted[np.random.default_rng(0).permutation(len(wanted))]
    assert hit.mean() > (near(sight, pixels, shuffled) < 40).mean() + 0.1
