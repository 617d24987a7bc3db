"""Page: a scene's plain data in one file of HTML, with meshcat's viewer."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template


def page_of(data: Mapping[str, object], *, live: bool = False) -> str:
    """Return the page of a scene; `live` where a server answers inverse queries."""
    package = find_spec(
        "meshcat"
    )  # not imported, which takes a quarter of a second
    assert package is not None  # noqa: S101 - it is required
    viewer = (
        Path(str(package.origin)).parent / "viewer" / "dist" / "main.min.js"
    )
    text = json.dumps(
        {**data, "live": live}, separators=(",", ":"), allow_nan=False
    )
    folder = files(__package__)
    page = Template((folder / "page.html").read_text(encoding="utf-8"))
    return page.substitute(
        style=(folder / "page.css").read_text(encoding="utf-8"),
        script=(folder / "page.js").read_text(encoding="utf-8"),
        viewer=viewer.read_text(encoding="utf-8"),
        # a name that holds a closing tag must not end the script
        data=text.replace("<", "\\u003c"),
    )
