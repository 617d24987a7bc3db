"""Pages in a real browser: what is drawn, where, and that no words overlap, in one look each."""

import html
import io
import json
import os
import re
import shutil
import subprocess
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from boards import World
from models import in_space, log, measured, seen_by_two, trained
from scenes import data_of, objects, project

import calib

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
NOISE = ("GL Driver Message",)  # Chromium's remarks on its own software rendering
OPTIONS = """--headless --disable-gpu --disable-quic --no-first-run --disable-extensions
    --disable-background-networking --disable-component-update --disable-sync --hide-scrollbars
    --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --enable-logging=stderr
    --force-prefers-reduced-motion --force-device-scale-factor=1
    --proxy-server=http://127.0.0.1:9 --proxy-bypass-list=127.0.0.1"""
DATA = Path(__file__).parents[1] / "data"
MEASURE = (DATA / "measure.js").read_text()
"""What of a page's words overlaps, how far it scrolls sideways, where parts end [px]."""
START = (DATA / "start.html").read_text()
OUTER = (DATA / "outer.html").read_text()
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


def chromium() -> str:
    """Path of a Chromium, or skip the test, aloud."""
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no Chromium here: apt-get install chromium to run the browser tests")
    return found


def opened(page: Path, folder: Path, size: tuple[int, int], *words: str):
    """Open a page in a Chromium that reaches nothing but this computer; how that ended."""
    options = [
        "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
        f"--user-data-dir={folder / 'profile'}",
        f"--window-size={size[0]},{size[1]}",
    ]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        options.append("--no-sandbox")  # Chromium refuses to run as root with it
    words = (chromium(), *OPTIONS.split(), *options, *words, page.resolve().as_uri())
    return subprocess.run(words, capture_output=True, text=True, check=False, timeout=180)


def look(page: Path, folder: Path, size: tuple[int, int]) -> tuple[np.ndarray, list[str]]:
    """Open a page, wait until it has drawn; pixels (height, width, 3) and console."""
    from PIL import Image

    picture = folder / "seen.png"
    words = ("--virtual-time-budget=6000", f"--screenshot={picture}")
    done = opened(page, folder, size, *words)
    assert picture.exists(), done.stderr[-2000:]
    pixels = np.asarray(Image.open(io.BytesIO(picture.read_bytes())).convert("RGB"))
    lines = re.findall(r":CONSOLE(?::\d+|\(\d+\))?\]\s*(.*)", done.stderr)
    console = [line for line in lines if not any(word in line for word in NOISE)]
    return pixels.astype(int), console


def measured_pages(pages: dict[str, Path], folder: Path, sizes: list[tuple[int, int]]) -> dict:
    """Lay pages out at some sizes, and return what `MEASURE` says of each, by name and size.

    They stand in frames: a window of Chromium is never as narrow as a telephone.
    """
    frames = []
    for name, page in pages.items():
        text = page.read_text(encoding="utf-8")
        text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)
        inner = folder / f"inner-{page.name}"
        inner.write_text(text.replace("</body>", START % MEASURE), encoding="utf-8")
        for width, height in sizes:
            style = f"width:{width}px;height:{height}px"
            label = f"{name} {width} {height}"
            frames.append(f'<iframe name="{label}" src="{inner.name}" style="{style}"></iframe>')
    outer = folder / "outer.html"
    outer.write_text(OUTER % "".join(frames), encoding="utf-8")
    words = ("--virtual-time-budget=8000", "--dump-dom")
    done = opened(outer, folder, (1400, 1000), *words)
    measures = {}
    for line in re.findall(r"<pre>(\{.*?\})</pre>", done.stdout, re.DOTALL):
        measure = json.loads(html.unescape(line))
        name, width, height = measure["name"].rsplit(" ", 2)
        measures[name, (int(width), int(height))] = measure
    assert len(measures) == len(frames), done.stdout[-500:] + done.stderr[-500:]
    return measures


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, tuple[int, int]], dict]:
    """Reports, and a preview with all its layers, as they are laid out at two sizes."""
    chromium()  # or nothing of this is asked for
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
    pixels, console = look(page, tmp_path, size=SIZE)
    assert console == []
    data = data_of(page.read_text(encoding="utf-8"))
    for name in ("Sensory map", "Motor map"):
        nodes = objects(data)[f"{name}/nodes"]
        wanted = nodes["tints"].astype(int)
        places = project(data["camera"], nodes["points"], *SIZE, PANEL)
        hit = near(pixels, places, wanted).mean()
        # the arm, links and paths hide some of them
        assert hit > 0.75
        shuffled = np.random.default_rng(0).permutation(wanted)
        assert hit > near(pixels, places, shuffled).mean() + 0.1
