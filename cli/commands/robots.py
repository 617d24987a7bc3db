"""The command `calib robots`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import options as opt
from ..output import Outcome, TextTable, fields

if TYPE_CHECKING:
    pass


def robots(
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """List the bundled robots."""
    import calib

    entries = calib.list_robots()
    rows = [[entry.name, str(entry.dof), entry.description] for entry in entries]
    table = TextTable(["robot", "joints", "description"], rows, left=3)
    document = [fields(entry, "name joints dof description") for entry in entries]
    return Outcome(document, [table])
