"""Interpretations: the joints of a log in another unit, another order, or with another sign."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from ..common.arrays import Array
from ..common.wording import listing
from .findings import Finding

Interpretation = tuple[Array, Finding]
"""Other joint values (n, dof), and what they would mean."""

ONLY_IF = "the log fits the robot only if "
"""Begins the words of each."""


def interpretations(
    q: Array, names: Sequence[str], revolute: Sequence[bool], *, any_order: bool
) -> tuple[Iterator[Interpretation], ...]:
    """Interpretations of joint values (n, dof): their unit, their order, one sign, two signs.

    any_order : whether columns are tried in all orders, not only with two exchanged
    """
    return (
        units(q, revolute),
        _orders(q, names, any_order),
        _signs(q, names, 1),
        _signs(q, names, 2),
    )


def units(q: Array, revolute: Sequence[bool]) -> Iterator[Interpretation]:
    """The angles of joint values (n, dof) in degrees, then in radians."""
    for unit, convert, hint in (
        ("degrees", np.deg2rad, "give `degrees=True`"),
        ("radians", np.rad2deg, "leave out `degrees`"),
    ):
        words = f"{ONLY_IF}the joint values are {unit}"
        finding = Finding("degrees", words, hint, "degrees", unit == "radians")
        yield np.where(revolute, convert(q), q), finding


def _orders(
    q: Array, names: Sequence[str], any_order: bool
) -> Iterator[Interpretation]:
    """Columns of joint values (n, dof) exchanged, two of them or in any order."""
    for order in itertools.permutations(range(len(names))):
        column_of = {names[k]: names[j] for k, j in enumerate(order) if k != j}
        if len(column_of) == 2 or (column_of and any_order):
            holds = listing(
                f"{column} holds {name}" for name, column in column_of.items()
            )
            words = f"{ONLY_IF}columns are exchanged ({holds})"
            hint = f"give `columns={column_of}`, or correct the header"
            value = list(column_of)
            finding = Finding("exchanged", words, hint, "columns", value)
            yield q[:, list(order)], finding


def _signs(
    q: Array, names: Sequence[str], count: int
) -> Iterator[Interpretation]:
    """The signs of `count` columns of joint values (n, dof) changed."""
    if count >= len(names):  # all of them changed are a mirror
        return
    hint = "its encoder or servo is reversed: change the sign of its column"
    for joints in itertools.combinations(range(len(names)), count):
        changed = q.copy()
        changed[:, joints] *= -1.0
        reversed_names = [names[k] for k in joints]
        joined = " and ".join(reversed_names)
        words = f"{ONLY_IF}{joined} counts the other way"
        yield (
            changed,
            Finding("reversed", words, hint, "joints", reversed_names),
        )
