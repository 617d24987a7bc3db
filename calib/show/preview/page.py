"""Page: meshcat's viewer, a scene and its legend in one file that needs no network."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ...common.templates import filled
from ...errors import CalibError
from ...model.model import Model
from .canvas import packed
from .lattices import strongest_partners
from .scene import Scene


def html(scene: Scene, model: Model, *, live: bool = False) -> str:
    """Return the page of a model's scene; `live` where a server answers inverse queries."""
    partners, strength = strongest_partners(model)
    # -1, which stands for none, is the largest number here
    short = np.uint16 if model.motor.size < 1 << 16 else np.uint32
    data = {
        **scene.page,
        "notes": list(scene.notes),
        "live": live,
        "links": {
            "each": partners.shape[1],
            "short": short is np.uint16,
            "partners": packed(partners.astype(short), short),
            "strength": packed(strength, np.uint8),
        },
        **scene.canvas.to_json(),
    }
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    # a name that holds a closing tag must not end the script; the page's policy lets a browser
    # load nothing that is not in it, except from its own server
    data_text = text.replace("<", "\\u003c")
    return filled(__package__, "page.html", viewer=_viewer_script(), data=data_text)


def _viewer_script() -> str:
    """Source of meshcat's viewer, as its package brings it."""
    found = find_spec("meshcat")
    if found is None or found.origin is None:
        raise CalibError("the preview needs meshcat, which is not installed: pip install meshcat")
    path = Path(found.origin).parent / "viewer" / "dist" / "main.min.js"
    return path.read_text(encoding="utf-8")
