"""Places: a column of a log, or one element of a column of lists."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..common.wording import quoted
from ..errors import OptionError

_ELEMENT = re.compile(r"(.+)\[(.*)\]", re.DOTALL)
_INDEX = re.compile(r"0|[1-9][0-9]{0,8}")


@dataclass(frozen=True)
class Place:
    """Where the numbers of one name stand."""

    name: str  # as asked for: `time`, or `observation.state[0]`
    column: str  # a column of the file
    # which element of the column's lists, counted from 0; None for a column of numbers
    element: int | None = None


def find_place(header: Sequence[str], name: str) -> Place | None:
    """Find a name in a header; one that is there as written is a column, whatever it looks like.

    Raises OptionError if what stands in the brackets is no place in a list.

    Examples
    --------
    >>> find_place(["state"], "state[2]")
    Place(name='state[2]', column='state', element=2)
    >>> find_place(["state", "state[2]"], "state[2]")
    Place(name='state[2]', column='state[2]', element=None)
    >>> find_place(["state"], "speed") is None
    True
    """
    if name in header:
        return Place(name, name)
    match = _ELEMENT.fullmatch(name)
    if match is None or match[1] not in header:
        return None
    if not _INDEX.fullmatch(match[2]):
        raise OptionError(
            f"{quoted(name)}: {quoted(match[2])} is no place in a list, expected a whole number "
            "counted from 0"
        )
    return Place(name, match[1], int(match[2]))
