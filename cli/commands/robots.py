"""List the bundled robots."""

import calib

from ..output import Outcome, TextTable, fields


def robots() -> Outcome:
    document = [
        fields(entry, "name", "joints", "dof", "description")
        for entry in calib.list_robots()
    ]
    rows = [
        [str(entry[key]) for key in ("name", "dof", "description")]
        for entry in document
    ]
    table = TextTable(["robot", "joints", "description"], rows, left=3)
    return Outcome(document, [table])
