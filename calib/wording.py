"""Wording: names and choices in messages that stay one short line."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def quoted(name: str) -> str:
    """Return a name from a file or a user, safe to print in one line."""
    return repr(name if len(name) <= 60 else name[:57] + "...")


def listed(names: Iterable[str], most: int = 12) -> str:
    """Names in one line, cut after `most` of them."""
    items = list(names)
    if not items:
        return "(none)"
    more = f", ... ({len(items)} in all)" if len(items) > most else ""
    return ", ".join(items[:most]) + more


def suggestion(name: str, names: Iterable[str]) -> str:
    """Say what may have been meant by a name, and which names there are."""
    items = list(names)
    close = get_close_matches(name, items, n=1)
    meant = f"did you mean {close[0]}? " if close else ""
    return f"{meant}choose from {listed(items)}"
