"""Sizes of the lattices: what the user gives, or what the samples can fill."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..errors import OptionError
from ..maps.lattice import Lattice
from ..samples.samples import Samples

Size = int | Sequence[int] | None

_SIDE = 70  # nodes along each axis of a plane lattice, as in the paper's best table
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
    given, motor, sensory = (
        _checked(value, name)
        for value, name in ((size, "size"), (motor_size, "motor_size"),
                            (sensory_size, "sensory_size"))
    )  # fmt: skip
    if given is None and motor is None and sensory is None and samples.simulation is None:
        rows, least = len(samples), _LEAST_SIDE[imagined]
        side = min(_SIDE, max(least, round(math.sqrt(rows / _ROWS_PER_NODE))))
        notes.append(f"lattices of {side}x{side} nodes for {rows:,} rows, `size` chooses others")
        given = (side, side)
    given = given or (_SIDE, _SIDE)
    if motor is None:  # as many nodes in a lattice of the joints' dimension
        cubic = len(given) == 2 and samples.dof in (1, 3)
        motor = _of_dimension(samples.dof, given) if cubic else given
    if sensory is None:  # as many nodes in a lattice of the space
        plane = given if len(given) == 2 else (_SIDE, _SIDE)
        sensory = _of_dimension(3, plane) if samples.x.shape[1] == 3 else plane
    axes = {"motor": (motor, samples.dof, "joint"),
            "sensory": (sensory, samples.x.shape[1], "coordinate")}  # fmt: skip
    for name, (shape, most, each) in axes.items():
        if len(shape) > most:
            given_size = "x".join(map(str, shape))
            raise OptionError(
                f"{name} size {given_size}: expected at most {most} numbers, one per {each}",
                hint=f"give `{name}_size`",
                parameter=f"{name}_size",
            )
    return motor, sensory, notes


def _of_dimension(dim: int, nodes: tuple[int, ...]) -> tuple[int, ...]:
    """A lattice of so many axes with as many nodes as another one."""
    return (max(2, round(math.prod(nodes) ** (1 / dim))),) * dim


def _checked(size: Size, name: str) -> tuple[int, ...] | None:
    """A size as a tuple; one number n stands for n x n."""
    if size is None:
        return None
    numbers = tuple(size) if isinstance(size, Sequence | np.ndarray) else (size, size)
    for n in numbers:
        if isinstance(n, bool) or not isinstance(n, int | np.integer):
            raise OptionError(f"{name} {size!r}: expected whole numbers of nodes, such as 70")
    return Lattice(tuple(int(n) for n in numbers)).shape
