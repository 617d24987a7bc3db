"""Pages in a real browser: what is drawn, where, and that no words overlap, in one look each."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from browser import look, measured_pages
from flange_worlds import World
from models import in_space, log, measured, trained
from scenes import data_of, objects, project, seen_by_two

import calib

SIZE = (900, 700)
PANEL = 280  # pixels that the page's panel covers
NARROW = (390, 844)


full = partial(trained, "two_link_full", n=3000, size=24, noise=1e-3)

REPORTED = {
    "simulated": full,
    "in-space": in_space,
    "few-rows": lambda: measured(n=30),
    "two-sensors": seen_by_two,
    "rig": lambda: World(2).solve(),
    "maps-alone": lambda: trained("two_link", n=400, size=4, body="none"),
}


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, tuple[int, int]], dict]:
    """Reports, and a preview with all its layers, as they are laid out at two sizes."""
    folder = tmp_path_factory.mktemp("pages")
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


def near(pixels: np.ndarray, places: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Whether a colour like `wanted` (n, 3) is within two pixels of places (n, 2)."""
    steps = np.array([(dx, dy) for dx in range(-2, 3) for dy in range(-2, 3)])
    x, y = (np.round(places).astype(int)[:, None] + steps).clip(0, np.subtract(SIZE, 1)).T
    away = np.linalg.norm(pixels[y, x] - wanted, axis=2)
    return away.min(axis=0) < 40


def test_nodes_have_their_colours_where_they_are(tmp_path: Path):
    page = tmp_path / "page.html"
    calib.preview(full(), page)
    sight, data = look(page, tmp_path, size=SIZE), data_of(page.read_text(encoding="utf-8"))
    assert sight.console == []
    for name in ("Sensory map", "Motor map"):
        nodes = objects(data)[f"{name}/nodes"]
        wanted = nodes["tints"].astype(int)
        places = project(data["camera"], nodes["points"], *SIZE, PANEL)
        hit = near(sight.pixels, places, wanted).mean()
        # the arm, links and paths hide some of them
        assert hit > 0.75
        shuffled = np.random.default_rng(0).permutation(wanted)
        assert hit > near(sight.pixels, places, shuffled).mean() + 0.1
