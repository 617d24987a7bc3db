"""The command `calib robots`: list the bundled robots."""

from __future__ import annotations

from ..output import Outcome, TextTable, fields


def robots() -> Outcome:
    """List the bundled robots."""
    import calib

    entries = calib.list_robots()
    # of more than two joints their number, so that a robot stays one line
    joints = [", ".join(e.joints) if e.dof == 2 else f"{e.dof} joints" for e in entries]
    rows = [[e.name, told, e.description] for e, told in zip(entries, joints, strict=True)]
    table = TextTable(["robot", "joints, base to tip", "description"], rows, left=3)
    document = [fields(entry, "name joints dof description") for entry in entries]
    return Outcome(document, [table])
