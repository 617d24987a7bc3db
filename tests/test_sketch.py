"""Sketch: the picture of the error in characters, and where it is shown."""

from __future__ import annotations

import io
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from calib_cli.sketch import PLAIN, SHADES, show_sketch, sketch
from models import trained

from calib.show.workspace import sensory_errors


class Terminal(io.StringIO):
    """Standard output that says that it is a terminal."""

    def __init__(self, encoding: str) -> None:
        super().__init__()
        self._encoding = encoding

    @property
    def encoding(self) -> str:
        return self._encoding

    def isatty(self) -> bool:
        return True


@pytest.fixture(scope="module")
def noisy():
    return trained("two_link", n=3000, size=20, noise=1e-3)


def test_it_has_the_workspaces_shape(noisy):
    *picture, legend = sketch(noisy, width=22)
    letters = np.array([list(line.ljust(30)) for line in picture])
    # two_link reaches above and to the right of its base: nothing at the lower left
    assert set(np.unique(letters)) <= {*SHADES, " "}
    assert (letters != " ").sum() > 0.4 * letters.size * 22 / 30
    assert legend.startswith("expected error")
    x = noisy.sensory.weights
    low, span = x.min(axis=0), np.ptp(x, axis=0)
    for node in range(0, len(x), 7):
        column = int((x[node, 0] - low[0]) / span[0] * 21)
        row = int((1 - (x[node, 1] - low[1]) / span[1]) * (len(picture) - 1))
        around = letters[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
        assert (around != " ").any()


def test_larger_errors_are_darker(noisy):
    errors = sensory_errors(noisy)
    x = noisy.motor.units[:, 0]
    graded = replace(noisy, bounds=1e-4 + 1e-3 * np.clip(x, 0, 1))
    assert np.nanmax(sensory_errors(graded)) > np.nanmax(errors)
    text = "".join(sketch(graded)[:-1])
    assert SHADES[0] in text
    assert SHADES[-1] in text


def test_rounding_is_drawn_in_one_shade():
    *picture, legend = sketch(trained("two_link", n=3000, size=20))
    assert {*"".join(picture)} <= {SHADES[0], " "}
    assert legend == "expected error (95 %): below 1 nm everywhere"


@pytest.mark.parametrize(("encoding", "shades"), [("utf-8", SHADES), ("ascii", PLAIN)])
def test_a_terminal_shows_what_it_can(noisy, monkeypatch, encoding: str, shades: str):
    screen = Terminal(encoding)
    monkeypatch.setattr(sys, "stdout", screen)
    show_sketch(noisy)
    text = screen.getvalue()
    assert any(letter in text for letter in shades)
    text.replace("µ", "u").encode(encoding)


def test_nothing_is_drawn_where_there_is_no_terminal(run, model: Path):
    done = run("evaluate", model)
    assert done.code == 0
    assert not any(letter in done.out for letter in SHADES)


@pytest.mark.parametrize("robot", ["three_link", "polar", "scara"])
def test_every_arm_fits_into_a_terminal(robot: str):
    lines = sketch(trained(robot, n=400, size=8))
    assert max(map(len, lines)) <= 79
    assert len(lines) <= 24
