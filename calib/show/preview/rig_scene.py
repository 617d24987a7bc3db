"""Rig scene: a flange that goes through its poses, with cameras and board around it."""

from __future__ import annotations

import numpy as np

from ...recording.rig import HandEye
from ..error_scale import STOPS, ErrorScale, colours
from ..setup import things_of_rig
from .camera import camera_onto, space_frame
from .canvas import Canvas
from .scene import ARM, draw_things


def data_of_rig(rig: HandEye) -> dict[str, object]:
    """Plain data for the page of a preview."""
    places = rig.flange[:, :3, 3]
    things = things_of_rig(rig)
    still = [thing.placed(np.eye(4)) for thing in things if not thing.carried]
    around = np.vstack([np.zeros(3), places, *still])
    size = float(np.ptp(around, axis=0).max())
    scale = ErrorScale.of(rig.misses, "px", extent=1.0)
    canvas = Canvas()
    base, flange = rig.frames
    canvas.layer(ARM, "", "the flange, from its base")
    path = f"{ARM}/{flange}"
    canvas.place(path, rig.flange)
    canvas.add(f"{path}/ball", "sphere", "#59636e", size=[0.015 * size])
    canvas.add(f"{ARM}/{base}/ball", "sphere", "#e0853c", size=[0.02 * size])
    canvas.label(ARM, base, np.zeros(3))
    draw_things(canvas, things, flange)
    canvas.layer(
        "Poses", "scale", "of the flange, in the colour of their pictures"
    )
    tints = colours(scale.share(rig.misses))
    canvas.add("Poses/positions", "points", tints, places, size=0.014 * size)
    canvas.place("Axes", np.diag([*[0.2 * size] * 3, 1.0]))
    frame = space_frame()
    return {
        **vars(canvas),
        "title": f"Hand-eye: {rig.carried} in the hand",
        "bound": "corners off, rms of pictures that the fit did not see",
        "ticks": scale.ticks(),
        "stops": STOPS,
        "camera": camera_onto(around, frame),
        "links": None,
        "step": 15,
        "size": size,
        "notes": [],
    }
