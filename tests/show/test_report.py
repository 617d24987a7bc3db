"""Report: what it holds, what it measures, and that it is one file."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from models import in_pixels, in_space, log, measured, trained
from touching import World

import calib
from calib.common.scale import Scale
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.samples.sockets import Touches
from calib.show.report.figures import u_matrix

LABELS = ("as learned", "as drawn")
FLAT = ["forward", "inverse", "lattices", "nodes"]


class Reader:
    """Headings, table cells, names of elements and addresses of a page."""

    def __init__(self, text: str) -> None:
        self.headings = re.findall(r"<h[12][^>]*>([^<]*)", text)
        self.cells = re.findall(r"<t[dh][^>]*>([^<]*)", text)
        self.names = re.findall(r'\sid="([^"]*)"', text)
        self.addresses = re.findall(r'\s(?:xlink:href|href|src)="([^"]*)"', text)


def report(model, given=None) -> str:
    path = Path("report.html")
    calib.report(model, path, given)
    return path.read_text(encoding="utf-8")


@pytest.fixture
def unrendered(monkeypatch):
    """Leave out the rendering, which takes most of a report's time: for tests of its words."""
    monkeypatch.setattr("calib.show.report.page.to_svg", lambda *_: "<svg></svg>")


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def noisy():
    return trained("two_link", n=3000, size=20, noise=1e-3)


def test_one_small_file_without_addresses_in_the_page_own_ink():
    page = report(noisy())
    read = Reader(page)
    assert read.headings[0] == "two_link"
    assert [name for name in read.names if name in FLAT] == FLAT
    assert len(page.encode()) < 3_000_000
    assert all(a.startswith(("#", "data:image/png")) for a in read.addresses)
    assert len(set(read.names)) == len(read.names)
    assert {a[1:] for a in read.addresses if a.startswith("#")} <= set(read.names)
    words = ("default-src 'none'", "currentColor", "prefers-color-scheme: dark", "@media print")
    for text in words:
        assert text in page
    assert not re.search("#010203|#020304", page)
    errors = calib.evaluate(noisy()).errors["local"]["forward"]["distance"]
    assert f"{1e3 * errors['mean']:.3g} ({1e3 * errors['max']:.3g})" in read.cells
    assert report(noisy()) == page


@pytest.mark.usefixtures("unrendered")
def test_words_of_other_models():
    assert "below 1 nm" in report(trained("two_link", n=3000, size=20))
    assert "held out in contiguous blocks" in report(measured())
    assert "rows of the log" in report(measured(), log(300, 1e-3))
    assert "U-matrix" in report(trained("two_link", n=400, size=4, map="gng"))
    assert Reader(report(trained("three_link", n=400, size=8))).headings
    evil = replace(noisy(), about=replace(noisy().about, robot="<script>alert(1)</script>"))
    assert "<script>" not in report(evil)


def test_figures_on_paper():
    drawn = calib.figures(noisy())
    assert list(drawn) == FLAT
    calib.figures(noisy(), names=["forward"])["forward"].savefig("forward.png")
    assert Path("forward.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(calib.OptionError, match="latices"):
        calib.figures(noisy(), names=["latices"])


def test_figures_of_an_arm_in_space():
    assert list(calib.figures(in_space())) == FLAT
    assert list(calib.figures(in_pixels(), names=["nodes", "photo"])) == ["nodes"]


@pytest.mark.usefixtures("unrendered")
def test_a_row_that_contradicts_the_others_is_left_out_of_the_headline():
    """One zero row of a thousand made the headline 2.9 mm."""
    given = log(300, 1e-4)
    x = given.x.copy()
    x[17] = 0.0
    page = report(measured(), replace(given, x=x))
    assert "299 measured rows of the log; 1 are left out" in page


def test_touches_are_drawn_by_socket_as_drawn_and_as_learned():
    world = World(2, each=15)
    touch = Touches(world.number, tuple(("", name) for name in "ABCD"))
    arm, nothing = world.arm, np.zeros((len(world.q), 3))
    ranges = arm.joint_names, arm.lower, arm.upper, arm.revolute
    touches = calib.Samples(world.q, nothing, *ranges, arm=arm, touch=touch)
    (ax,) = calib.figures(calib.train(touches, size=4), touches, ["sockets"])["sockets"].axes
    learned, drawn = ({line.get_label(): line.get_xdata() for line in ax.lines}[w] for w in LABELS)
    assert np.nanmean(learned) < 0.5 * np.nanmean(drawn)


def test_results_tell_themselves_in_a_line():
    model = trained("two_link", n=400, size=8)
    evaluation = calib.evaluate(model)
    log = calib.babble(calib.load_arm("two_link"), 200)
    sweep = calib.sweep(log, {"size": [4, 5]}, jobs=1)
    for shown in (evaluation, sweep, calib.load_arm("two_link"), calib.load_arm("six_axis")):
        assert len(repr(shown)) < 200, repr(shown)
    assert "local" in repr(evaluation)
    assert repr(sweep).startswith("Sweep of 2 trainings")


def test_u_matrix_of_a_map_made_by_hand():
    units = np.array([[0.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.5, 1.0]])
    box = Scale(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))
    part = Map(units, Lattice((2, 2)), box, np.empty((0, 4)))
    np.testing.assert_allclose(u_matrix(part), 0.75)


def test_command(run, models: Path, model: Path, log: Path, tmp_path: Path):
    target = tmp_path / "report.html"
    done = run("report", model, "-o", target, "--png", tmp_path / "figures")
    assert done.code == 0, done.err
    assert target.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert {p.suffix for p in (tmp_path / "figures").iterdir()} == {".png"}
    for wrong, code in (
        ([model], 2),
        ([model, "-o", tmp_path / "no" / "x.html"], 1),
        ([models / "polar.calib", "--data", log, "-o", tmp_path / "x.html"], 1),
    ):
        done = run("report", *wrong)
        assert (done.code, done.err.count("\n")) == (code, 1)
        assert done.err.startswith("error: ")
    assert not (tmp_path / "x.html").exists()
