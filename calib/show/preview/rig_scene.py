"""Rig scene: a flange that goes through its poses, with cameras and board around it."""

import numpy as np

from ...recording.rig import HandEye
from ..error_scale import ErrorScale
from ..setup import things_of_rig
from .camera import OBLIQUE, camera_onto
from .canvas import Canvas
from .scene import ARM, draw_points, draw_things, standing


def data_of_rig(rig: HandEye) -> dict[str, object]:
    """Plain data for the page of a preview."""
    places = rig.flange[:, :3, 3]
    things = things_of_rig(rig)
    around = np.vstack([np.zeros(3), places, *standing(things)])
    canvas = Canvas(float(np.ptp(around, axis=0).max()))
    base, flange = rig.frames
    canvas.layer(ARM, "", "the flange, from its base")
    canvas.add(f"{ARM}/{base}/ball", "sphere", "#e0853c", size=[0.02])
    canvas.add(f"{ARM}/{flange}/ball", "sphere", "#59636e", size=[0.015])
    canvas.place(f"{ARM}/{flange}", rig.flange)
    canvas.label(ARM, base, np.zeros(3))
    draw_things(canvas, things, flange)
    scale = ErrorScale.of(rig.misses, "px", extent=1.0)
    draw_points(canvas, "Poses", places, rig.misses, scale)
    return canvas.data(
        scale,
        camera_onto(around, OBLIQUE),
        title=f"Hand-eye: {rig.hand_item} in the hand",
        bound="corners off, rms of pictures that the fit did not see",
        links=None,
        notes=[],
    )
