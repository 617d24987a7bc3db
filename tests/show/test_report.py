"""Report: what it holds, what it measures, and that it is one file."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from models import log, measured, trained

import calib
from calib.common.scale import Scale
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.paper.published import TABLE1
from calib.show.report.curves import bound_pairs, coverage
from calib.show.report.evidence import gather
from calib.show.report.maps import hits, u_matrix
from calib.show.report.page import SECTIONS, pictures, report
from calib.show.report.tables import adaptation_table

PLANAR = {
    "forward", "inverse", "histogram", "calibration", "lattices", "nodes", "training",
}  # fmt: skip


class Reader(HTMLParser):
    """Headings, table cells, names of elements and addresses of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.headings: list[str] = []
        self.cells: list[str] = []
        self.names: list[str] = []
        self.addresses: list[str] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        for key, value in attrs:
            if key == "id":
                self.names.append(value)
            if key in ("href", "src", "xlink:href"):
                self.addresses.append(value)

    def handle_endtag(self, tag):
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data):
        if self.open and self.open[-1] in ("h1", "h2"):
            self.headings.append(data)
        if self.open and self.open[-1] in ("td", "th"):
            self.cells.append(data)


@pytest.fixture(scope="module")
def noisy():
    return trained("two_link", n=3000, size=20, noise=1e-3)


@pytest.fixture(scope="module")
def page(noisy) -> str:
    return report(noisy)


@pytest.fixture
def unrendered(monkeypatch):
    """Leave out the rendering, which takes most of a report's time: for tests of its words."""
    monkeypatch.setattr("calib.show.report.page.to_svg", lambda *_: "<svg></svg>")


def test_one_small_file_without_addresses(page: str):
    read = Reader(page)
    assert len(page.encode()) < 3_000_000
    assert all(a.startswith(("#", "data:image/png")) for a in read.addresses)
    assert len(set(read.names)) == len(read.names)
    local = {a[1:] for a in read.addresses if a.startswith("#")}
    assert local <= set(read.names)
    assert "default-src 'none'" in page


def test_everything_is_in_it(page: str):
    headings = Reader(page).headings
    assert headings[0] == "two_link"
    for section in SECTIONS:
        assert (section.title in headings) == (section.name in PLANAR)
    assert "sensor noise 1 mm" in page


def test_ink_follows_the_page(page: str):
    assert "currentColor" in page
    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page
    assert "#010203" not in page
    assert "#020304" not in page


def test_the_papers_numbers_stand_beside_those_of_its_arm(page: str, unrendered):
    cells = Reader(page).cells
    assert "paper" in cells
    for printed in TABLE1["vdsom"].values():
        assert f"{printed.mean:g} ({printed.max:g})" in cells
    assert "paper" not in Reader(report(trained("polar", n=400, size=8))).cells


def test_the_table_is_that_of_evaluate(noisy, page: str):
    errors = calib.evaluate(noisy).errors["local"]["forward"]["distance"]
    cells = Reader(page).cells
    assert f"{1e3 * errors['mean']:.3g} ({1e3 * errors['max']:.3g})" in cells


def test_the_same_model_gives_the_same_report(noisy, page: str):
    assert report(noisy) == page


def test_without_noise_nothing_is_made_of_rounding(unrendered):
    model = trained("two_link", n=3000, size=20)
    text = report(model)
    assert "below 1 nm" in text
    assert "Without noise the body of an ideal arm" in text


def test_a_log_is_judged_by_its_own_table_or_by_rows_that_are_given(unrendered):
    model = measured()
    alone = report(model)
    assert "held out in contiguous blocks" in alone
    assert "give the log" not in alone  # the model keeps rows for its figures
    assert "rows of the log that was given" in report(model, log(300, 1e-3))


def test_other_arms_and_maps_are_reported():
    assert Reader(report(trained("three_link", n=400, size=8))).headings
    gas = trained("two_link", n=400, size=4, map="gng")
    assert "U-matrix" in report(gas)


def test_earlier_states_are_told_whatever_they_hold(noisy, unrendered):
    history = (
        {"what": "trained", "errors": {"mean": 0.00123}, "rows": 100},
        {"what": "adapted", "causes": ["link", "sensor"], "improved": True},
    )
    text = report(replace(noisy, history=history))
    assert "Before and after" in Reader(text).headings
    assert adaptation_table(history, "m") == ""


def test_an_adapted_model_tells_before_and_after_and_a_log_its_distortion(unrendered):
    model = trained("two_link", n=3000, size=20)
    arm = calib.load_arm("two_link")
    bent = calib.babble(arm, 120, seed=1, changes=["elbow.length=+20%"])
    adapted = calib.adapt(model, bent).model
    cells = Reader(report(adapted, bent)).cells
    event = adapted.history[-1]
    assert f"{event['samples']}" in cells
    assert {"motor", "sensory", "links", "before: mean (largest)"} <= set(cells)
    assert "It has drifted." in report(model, bent)


def test_names_are_escaped(noisy, unrendered):
    evil = replace(noisy, about=replace(noisy.about, robot="<script>alert(1)</script>"))
    assert "<script>" not in report(evil)


def test_u_matrix_and_hits_of_a_map_made_by_hand():
    units = np.array([[0.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.5, 1.0]])
    box = Scale(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))
    part = Map(units, Lattice((2, 2)), box, np.empty((0, 4)))
    np.testing.assert_allclose(u_matrix(part), 0.75)
    u = np.array([[0.1, 0.1], [0.0, 0.0], [0.4, 0.9]])
    assert hits(part, u).tolist() == [2, 0, 0, 1]
    assert np.isnan(hits(part, np.empty((0, 2)))).all()


def test_expected_errors_are_kept_as_promised(noisy):
    pairs = bound_pairs(gather(noisy))
    assert pairs is not None
    assert 0.92 < coverage(*pairs) < 0.98


def test_pictures_are_on_white(noisy):
    from PIL import Image

    drawn = pictures(noisy)
    assert set(drawn) == PLANAR
    for data in drawn.values():
        picture = Image.open(io.BytesIO(data)).convert("RGB")
        assert picture.width > 800
        assert picture.getpixel((1, 1)) == (255, 255, 255)
        darkest = np.asarray(picture).reshape(-1, 3).max(axis=1).min()
        assert darkest < 90


def test_command(run, model: Path, tmp_path: Path):
    target = tmp_path / "report.html"
    done = run("report", model, "-o", target, "--png", tmp_path / "figures")
    assert done.code == 0, done.err
    assert target.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert {p.suffix for p in (tmp_path / "figures").iterdir()} == {".png"}
    for wrong, code in (([], 2), (["-o", tmp_path / "no" / "x.html"], 1)):
        done = run("report", model, *wrong)
        assert (done.code, done.err.count("\n")) == (code, 1)
        assert re.match("error: ", done.err)


def test_command_refuses_another_arms_log(run, models: Path, log: Path, tmp_path: Path):
    done = run("report", models / "polar.calib", "--data", log, "-o", tmp_path / "x.html")
    assert done.code == 1
    assert not (tmp_path / "x.html").exists()
