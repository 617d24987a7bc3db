"""Thinning: evenly spread rows of a long table, where all of them would tell no more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def thinned(count: int, most: int) -> NDArray[np.intp]:
    """Return at most `most` row numbers of `count`, evenly spread, in order.

    Examples
    --------
    >>> thinned(10, 4).tolist(), thinned(3, 4).tolist()
    ([0, 3, 6, 9], [0, 1, 2])
    """
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.intp))
