"""The command `calib robots`: list the bundled robots."""

from __future__ import annotations

from ..output import Outcome, TextTable, fact_lines, fields


def robots() -> Outcome:
    """List the bundled robots."""
    import calib

    entries = calib.list_robots()
    rows = [[entry.name, str(entry.dof), entry.description] for entry in entries]
    table = TextTable(["robot", "joints", "description"], rows, left=3)
    names = fact_lines({entry.name: ", ".join(entry.joints) for entry in entries})
    document = [fields(entry, "name joints dof description") for entry in entries]
    return Outcome(document, [table], ["", "joints, base to tip", *names], result=[table])
