"""Scenes of a preview, read back by the tests."""

from __future__ import annotations

import umsgpack


def packed(scene) -> list[dict]:
    return [umsgpack.unpackb(command) for command in scene.canvas.packed()]


def paths(scene) -> set[str]:
    return {c["path"] for c in packed(scene) if c["type"] == "set_object"}
