"""Pages of a preview, read back by the tests."""

import base64
import json
import math
import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import calib


def page_of(model, **options) -> str:
    """The page of a model's preview."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        calib.preview(model, path, **options)
        return path.read_text(encoding="utf-8")


def data_of(page: str) -> dict[str, Any]:
    """What a page draws: its plain data."""
    found = re.search(r'id="calib-data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found[1])


def unpacked(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def objects(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """What is drawn, by path, with the points and colours of each as arrays (n, 3)."""
    found = {}
    for drawn in data["objects"]:
        each = dict(drawn)
        for name, kind in (("points", "<f4"), ("tints", "u1")):
            if name in each:
                each[name] = unpacked(each[name], kind).reshape(-1, 3)
        found[each["path"]] = each
    return found


def tracks(data: dict[str, Any]) -> dict[str, np.ndarray]:
    """Transforms (frames, 4, 4) of the animation, by path."""
    found = {path: unpacked(text, "<f4") for path, text in data["tracks"].items()}
    return {path: values.reshape(-1, 4, 4).swapaxes(1, 2) for path, values in found.items()}


def project(camera, points, width, height, panel=0):
    """Pixels (n, 2) of points (n, 3), as the page's script places its camera.

    `panel` pixels at the left are covered by the legend; the picture is centred in the rest.
    """
    direction, half = np.array(camera["direction"]), camera["half"]
    right = np.cross([0.0, 0.0, 1.0], direction)
    right = right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(direction, right), direction])
    slope = math.tan(math.radians(camera["fov"]) / 2)
    # the nearest of the box, half a depth in front of its middle, must fit as well
    aspect = (width - panel) / height
    distance = camera["margin"] * max(half[1], half[0] / aspect) / slope + half[2]
    away = (np.atleast_2d(np.asarray(points, dtype=float)) - camera["target"]) @ axes.T
    pixels = away[:, :2] / ((distance - away[:, 2]) * slope)[:, None] * (height / 2)
    return np.stack([(width + panel) / 2 + pixels[:, 0], height / 2 - pixels[:, 1]], axis=1)
