"""The command `calib robots`: list the bundled robots."""

from __future__ import annotations

from ..options import takes
from ..output import TextTable, fields, show, show_json


@takes()
def robots(as_json: bool = False) -> None:
    """List the bundled robots."""
    import calib

    entries = calib.list_robots()
    if as_json:
        show_json([fields(entry, "name joints dof description") for entry in entries])
        return
    rows = [[entry.name, ", ".join(entry.joints), entry.description] for entry in entries]
    show(TextTable(["robot", "joints, base to tip", "description"], rows, left=3))
