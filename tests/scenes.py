"""Scenes of a preview, read back by the tests."""

from __future__ import annotations

import math

import numpy as np
import umsgpack


def packed(scene) -> list[dict]:
    return [umsgpack.unpackb(command) for command in scene.canvas.packed()]


def paths(scene) -> set[str]:
    return {c["path"] for c in packed(scene) if c["type"] == "set_object"}


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
