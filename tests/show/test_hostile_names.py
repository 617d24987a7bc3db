"""Names from a stranger's file reach neither the terminal raw nor a figure as a formula."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from matplotlib.figure import Figure
from models import log

import calib
from calib.show.report.drawing import plain_text

HOSTILE = "\x1b]0;owned\x07\x1b[2J\u202eel\nbow$\\foo$"
RAW = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


@pytest.fixture(scope="module")
def hostile():
    """A model whose joint, robot and tip have names that a terminal would obey."""
    model = calib.train(replace(log(300, 1e-4), arm=None), size=8)
    about = replace(
        model.about,
        joint_names=("shoulder", HOSTILE),
        robot=HOSTILE,
        tip=HOSTILE,
        notes=(f"{HOSTILE} was chosen",),
        errors={
            readout: {
                way: {HOSTILE if key == "elbow" else key: error for key, error in found.items()}
                for way, found in ways.items()
            }
            for readout, ways in model.about.errors.items()
        },
    )
    return replace(model, about=about)


def test_the_parameters_of_a_body_are_printed_without_control_characters(tmp_path, run):
    log = calib.babble(calib.load_arm("two_link"), 40, noise=1e-4)
    named = replace(log, joint_names=("shoulder", HOSTILE), arm=None, simulation=None)
    calib.train(named, size=4).save(tmp_path / "m.calib")
    done = run("info", tmp_path / "m.calib")
    assert done.code == 0
    assert "gain" in done.out
    assert not RAW.search(done.out)


def test_a_report_takes_a_name_for_what_it_is(hostile, tmp_path):
    calib.report(hostile, tmp_path / "m.html")
    assert "internal" not in (tmp_path / "m.html").read_text(encoding="utf-8")
    assert calib.figures(hostile)


@pytest.mark.parametrize("name", ["$\\foo$", "$", "$$", "a$b$c", "\\$x$", "$\\frac{1$"])
def test_dollar_signs_are_drawn_as_they_are(name):
    figure = Figure(figsize=(2, 2))
    drawn = figure.text(0.5, 0.5, plain_text(name))
    figure.canvas.draw()
    shown, is_math = drawn._preprocess_math(drawn.get_text())
    assert (shown, is_math) == (name, False)
