"""The command `calib robots`: list the bundled robots."""

from __future__ import annotations

from ..output import Outcome, TextTable, fields


def robots() -> Outcome:
    """List the bundled robots."""
    import calib

    entries = calib.list_robots()
    rows = [[entry.name, ", ".join(entry.joints), entry.description] for entry in entries]
    table = TextTable(["robot", "joints, base to tip", "description"], rows, left=3)
    document = [fields(entry, "name joints dof description") for entry in entries]
    return Outcome(document, [table])
