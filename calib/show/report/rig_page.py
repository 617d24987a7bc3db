"""Rig page: a report that answers where cameras and board are, how surely, and what limits it."""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING

import numpy as np

from ...recording.rig import HandEye
from ..error_scale import number
from . import rig_figures
from .drawing import settings
from .html import figure_of, write_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CAPTIONS = {
    "setup": "Base, flange, cameras and board, to scale.",
    "misses": "Each picture is predicted by a fit that did not see it.",
    "corners": "Corners over a picture that the fit did not see.",
}


def figures_of_rig(rig: HandEye) -> dict[str, Figure]:
    """Return the figures of a rig by name."""
    drawn = {
        "setup": rig_figures.rig_setup(rig),
        "misses": rig_figures.misses(rig),
    }
    corners = rig_figures.corners(rig)
    return drawn if corners is None else {**drawn, "corners": corners}


def pictures_of_rig(rig: HandEye) -> dict[str, str]:
    """Return the figures of a rig as HTML, by name."""
    return {
        name: figure_of(figure, name, _CAPTIONS[name])
        for name, figure in figures_of_rig(rig).items()
    }


def report_rig(rig: HandEye, path: str | os.PathLike[str]) -> str:
    """Write a report of a rig, and return its verdict in words."""
    with settings():
        pictures = pictures_of_rig(rig)
    verdict = verdict_of_rig(rig)
    square = rig.square
    low, high = (number(1e3 * end, 4) for end in square["interval"])
    turn = np.degrees(rig.repeatability["rotation"])
    answers = {
        "Limited by": rig.limited_by,
        "Held out": f"{number(rig.held_out['rms'])} px rms, "
        f"{number(rig.held_out['median'])} px median, of pictures that the fit did not see",
        "The arm": f"its poses scatter by {number(1e3 * rig.repeatability['position'])} mm "
        f"and {number(turn)} deg (sd)",
        "A square": f"{number(1e3 * square['measured'], 4)} mm ({low} to {high}), "
        f"{number(1e3 * square['said'], 4)} mm as stated",
    }
    write_page(
        path,
        title=f"Hand-eye calibration: {rig.carried} in the hand",
        verdict=verdict,
        answers=answers,
        first=pictures.pop("setup") + pictures.pop("misses"),
        sections={"A picture": "".join(pictures.values())},
        facts={
            "pictures": f"{rig.used} of {rig.pictures}",
            "left out": ", ".join(rig.left_out) or "none",
            "board": str(rig.board["text"]),
            **{
                camera.name: _lens(camera.lens["focal"])
                for camera in rig.cameras
            },
        },
        notes=rig.notes,
    )
    return verdict


def verdict_of_rig(rig: HandEye) -> str:
    """Where what is carried and what stands still are, with intervals, in a sentence each."""
    sentences = []
    for line in rig.lines()[:2]:
        words = re.sub(r", quaternion \(.*\) ±", ", turned ±", line.strip())
        sentences.append(f"{words[0].upper()}{words[1:]}.")
    return " ".join(sentences)


def _lens(focal: float) -> str:
    return f"focal length {number(focal, 5)} px"
