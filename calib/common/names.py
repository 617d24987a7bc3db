"""Names: values by what they are called, as documents and tables have them."""

from collections.abc import Iterable
from typing import TypeVar

_T = TypeVar("_T")


def by_name(names: Iterable[str], values: Iterable[_T]) -> dict[str, _T]:
    """Return values by their names, of which there are as many.

    >>> by_name(("shoulder", "elbow"), (0.1, 0.2))
    {'shoulder': 0.1, 'elbow': 0.2}
    """
    return dict(zip(names, values, strict=True))
