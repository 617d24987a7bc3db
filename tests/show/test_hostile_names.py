"""Names from a stranger's file reach neither the terminal raw nor a figure as a formula."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from matplotlib.figure import Figure
from models import log

import calib
from calib.samples.tables import write_table
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


def test_no_command_prints_a_control_character(hostile, tmp_path, run):
    path = tmp_path / "m\x1b[2J.calib"
    hostile.save(path)
    table = tmp_path / "q.csv"
    write_table(table, {"shoulder": [0.4], HOSTILE: [1.0], "\x1b[2J": [1.0]})
    lines = [
        ["info", path],
        ["query", "forward", path, "0.4", "1.0"],
        ["query", "forward", path, "0.4", "9"],
        ["query", "inverse", path, "0.2", "0.4"],
        ["evaluate", path],
        ["evaluate", path, "--data", tmp_path / "none\x07.csv"],
        ["query", "forward", path, "--input", table, "--output", tmp_path / "o.csv"],
        ["info", path, "--json"],
        ["train", "two_link", "--joints", HOSTILE],
    ]
    for line in lines:
        done = run(*line)
        assert done.code in (0, 1, 3), (line, done.err)
        assert not RAW.search(done.out), line
        assert not RAW.search(done.err), line
        assert "internal" not in done.err, done.err


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
