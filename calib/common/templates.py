"""Templates: pages that are files of a package, with places such as `@title@` to be filled."""

from __future__ import annotations

import re
from importlib.resources import files

_PLACE = re.compile(r"@([a-z]+(?:\.[a-z]+)?)@")


def filled(package: str, name: str, **parts: str) -> str:
    """Return a file of a package whose places are filled.

    A place such as `@page.css@` takes the file of that name, any other one of the parts.
    """
    folder = files(package)

    def fill(found: re.Match[str]) -> str:
        place = found[1]
        return parts[place] if place in parts else (folder / place).read_text(encoding="utf-8")

    return _PLACE.sub(fill, (folder / name).read_text(encoding="utf-8"))
