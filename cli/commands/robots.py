"""List the bundled robots."""

from __future__ import annotations

from ..output import Outcome, TextTable, fields


def robots() -> Outcome:
    import calib

    entries = calib.list_robots()
    rows = [
        [entry.name, str(entry.dof), entry.description] for entry in entries
    ]
    table = TextTable(["robot", "joints", "description"], rows, left=3)
    document = [
        fields(entry, "name joints dof description") for entry in entries
    ]
    return Outcome(document, [table])
