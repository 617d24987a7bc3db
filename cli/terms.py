"""Terms: what the words of the method mean, in a line below each table that prints them."""

from __future__ import annotations

import re
from dataclasses import replace

from calib.common.choices import READOUTS

from .output import TextTable

_MEANINGS = (
    (
        set(READOUTS),
        "local: body and local models; body: the body alone; linear, activity, winner: the maps "
        "and their Hebbian links alone",
    ),
    (
        {"threshold"},
        "found: test statistic of a change of these parameters, above its threshold it fired; "
        "smallest: the smallest change that these rows could have shown",
    ),
    ({"zeta"}, "zeta: mean squared distance of rows to winning nodes, in the unit box (eq. 9)"),
    ({"som"}, "SOM: self-organizing map of even density"),
    (
        {"vdsom"},
        "VDSOM: the same with varying density; behind a colon, the gain of each sample (eq. 8)",
    ),
    ({"dsom"}, "DSOM: steps grow with the distance to the winner"),
    ({"gng"}, "GNG: growing neural gas, a map without a lattice"),
    ({"gas"}, "gas: neural gas, nodes without a lattice that follow samples by rank"),
    ({"sigma"}, "sigma: radius of the neighbourhood [nodes]"),
    ({"links"}, "links: Hebbian links between nodes of the two maps (eq. 5)"),
    ({"+-"}, "+-: standard deviation over the seeds"),
)


def explained(table: TextTable) -> TextTable:
    """Return the table with what its terms mean below it; each row's first cells count too."""
    # only words that stand in this table: a list of all terms would be longer than most tables
    cells = [cell for row in table.rows for cell in row[: table.left]]
    text = " ".join([table.title, *table.header, *cells]).lower()
    words = set(re.findall(r"[a-z]+|\+-", text))
    return replace(table, foot="; ".join(told for terms, told in _MEANINGS if words & terms))
