"""Sizes of the lattices: what the user gives, or what the samples can fill."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..errors import OptionError
from ..maps.lattice import Lattice
from ..samples.samples import Samples

Size = int | Sequence[int] | None

SIDE = 70
"""Nodes along each axis of a plane lattice, as in the paper's best table."""

_ROWS_PER_NODE = 5
_LEAST_SIDE = {True: 20, False: 4}  # the links have to propose starts for every branch


def lattice_sizes(
    samples: Samples, size: Size, motor_size: Size, sensory_size: Size, *, imagined: bool = True
) -> tuple[tuple[int, ...], tuple[int, ...], list[str]]:
    """Choose the lattices.

    samples : what they are to be trained on
    size, motor_size, sensory_size : what the user gives; see :func:`calib.train`
    imagined : whether a body imagines samples where a log has no rows; without them few rows fill
        few nodes
    Returns motor, sensory : nodes along each axis
    Returns notes : what the user should be told
    Raises OptionError if a size is no lattice.
    """
    notes: list[str] = []
    dof, least = samples.dof, _LEAST_SIDE[imagined]
    given = _checked(size, "size")
    if given is None and motor_size is None and sensory_size is None:
        rows = len(samples)
        side = SIDE
        if samples.simulation is None:
            side = min(SIDE, max(least, round(math.sqrt(rows / _ROWS_PER_NODE))))
            notes.append(
                f"lattices of {side}x{side} nodes for {rows:,} rows, `size` chooses others"
            )
        given = (side, side)
    fallback = given or (SIDE, SIDE)
    motor = _checked(motor_size, "motor_size")
    sensory = _checked(sensory_size, "sensory_size")
    if motor is None:
        motor = fallback
        if len(motor) == 2 and dof in (1, 3):
            # the same number of nodes in a lattice of the joints' dimension
            motor = (max(2, round(math.prod(motor) ** (1 / dof))),) * dof
        elif len(motor) > dof:
            raise OptionError(
                f"size {'x'.join(map(str, motor))} has {len(motor)} axes for {dof} joints",
                hint="give `motor_size`",
                parameter="motor_size",
            )
    if sensory is None:
        sensory = fallback if len(fallback) == 2 else (SIDE, SIDE)
        if samples.x.shape[1] == 3:  # the same number of nodes in a lattice of the space
            sensory = (max(2, round(math.prod(sensory) ** (1 / 3))),) * 3
    if len(sensory) > samples.x.shape[1]:
        raise OptionError(
            f"sensory size {'x'.join(map(str, sensory))}: positions have {samples.x.shape[1]} "
            "coordinates, give as many numbers such as 70x70"
        )
    if len(motor) > dof:
        raise OptionError(
            f"motor size {'x'.join(map(str, motor))}: expected at most {dof} numbers, one per joint"
        )
    Lattice(motor)
    Lattice(sensory)
    return motor, sensory, notes


def _checked(size: Size, name: str) -> tuple[int, ...] | None:
    """A size as a tuple; one number n stands for n x n."""
    if size is None:
        return None
    numbers = tuple(size) if isinstance(size, Sequence | np.ndarray) else (size, size)
    for n in numbers:
        if isinstance(n, bool) or not isinstance(n, int | np.integer):
            raise OptionError(f"{name} {size!r}: expected whole numbers of nodes, such as 70")
    return Lattice(tuple(int(n) for n in numbers)).shape
