"""Names from a stranger's file reach neither the terminal raw nor a figure as a formula."""

from dataclasses import replace

import pytest
from matplotlib.figure import Figure
from models import log

import calib
from calib.show.report.drawing import plain_text

HOSTILE = "\x1b]0;owned\x07\x1b[2J\u202eel\nbow$\\foo$"


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
