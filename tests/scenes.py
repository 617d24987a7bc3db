"""Scenes of a preview, read back by the tests."""

from __future__ import annotations

import base64
import math

import numpy as np


def objects(scene) -> dict[str, dict]:
    """What is drawn, by path, with the points and colours of each as arrays."""
    found = {}
    for drawn in scene.canvas.to_json()["objects"]:
        each = dict(drawn)
        for name, kind in (("points", "<f4"), ("tints", "u1"), ("index", "<u4")):
            if name in each:
                each[name] = np.frombuffer(base64.b64decode(each[name]), kind)
        for name in {"points", "tints"} & set(each):
            each[name] = each[name].reshape(-1, 3)
        found[each["path"]] = each
    return found


def tracks(scene) -> dict[str, np.ndarray]:
    """Transforms (frames, 4, 4) of the animation, by path."""
    texts = scene.canvas.to_json()["tracks"]
    found = {p: np.frombuffer(base64.b64decode(text), "<f4") for p, text in texts.items()}
    return {path: values.reshape(-1, 4, 4).swapaxes(1, 2) for path, values in found.items()}


def paths(scene) -> set[str]:
    return set(objects(scene))


def project(camera, points, width, height, panel=0):
    """Pixels (n, 2) of points (n, 3), as the page's script places its camera.

    `panel` pixels at the left are covered by the legend; the picture is centred in the rest.
    """
    right = np.cross([0.0, 0.0, 1.0], camera.direction)
    right = right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(camera.direction, right), camera.direction])
    facts = camera.to_json()
    slope = math.tan(math.radians(facts["fov"]) / 2)
    # the nearest of the box, half a depth in front of its middle, must fit as well
    half, aspect = facts["half"], (width - panel) / height
    distance = facts["margin"] * max(half[1], half[0] / aspect) / slope + half[2]
    away = (np.atleast_2d(np.asarray(points, dtype=float)) - camera.target) @ axes.T
    pixels = away[:, :2] / ((distance - away[:, 2]) * slope)[:, None] * (height / 2)
    return np.stack([(width + panel) / 2 + pixels[:, 0], height / 2 - pixels[:, 1]], axis=1)
