"""Numbers from users and files: rows of them, checked; named columns are taken by name.

Use it wherever a function takes joint values or positions: a table whose columns are named in
another order would otherwise be read in the wrong order without a word.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import CalibError, OptionError, QueryError
from .arrays import Array
from .wording import listing, quoted, suggestion

LARGEST = 1e15
"""No measure of an arm is so large, and its powers are numbers still."""


def number_rows(
    values: Any,
    names: Sequence[str],
    what: str,
    error: type[CalibError] = QueryError,
) -> tuple[Array, bool]:
    """Return rows of numbers, and whether it was a single vector.

    values : (n, len(names)) or (len(names),) array-like, or named columns: Polars and pandas
        tables, mappings and structured arrays are read by name, their other columns ignored
    names : what each column is
    Returns rows : (n, len(names)) array, a copy. It may hold NaN: whether that is wrong is the
        caller's to say.
    Returns single : whether it was one vector
    Raises CalibError if a column is missing, or the values are masked, dates or no numbers.
    """
    columns = column_names(values)
    # they may come in any order: NumPy would keep it
    if columns:
        for name in names:
            if name not in columns:
                raise error(
                    f"{what}: no column {quoted(name)} among {listing(map(repr, columns))}",
                    hint=suggestion(name, [str(name) for name in columns]),
                    value=name,
                )
        parts = [
            _numbers(values[name], f"{what}, column {quoted(name)}", error)
            for name in names
        ]
        if len({part.shape for part in parts}) > 1 or parts[0].ndim > 1:
            raise error(f"{what}: expected columns of numbers of one length")
        rows = np.stack(parts, axis=-1)
    else:
        rows = _numbers(values, what, error)
    single = rows.ndim == 1
    if rows.ndim not in (1, 2) or rows.shape[-1] != len(names):
        raise error(
            f"{what} of shape {rows.shape}: expected ({len(names)},) or (n, {len(names)}), "
            f"one column each for {listing(names)}"
        )
    return np.atleast_2d(rows), single


def query_rows(
    values: object, names: Sequence[str], what: str
) -> tuple[Array, bool]:
    """Return rows as `number_rows` does, all of them finite, or raise QueryError."""
    rows, single = number_rows(values, names, what)
    if not np.isfinite(rows).all():
        row = int(np.argmin(np.isfinite(rows).all(axis=1)))
        where = "" if single else f" in row {row}"
        raise QueryError(
            f"{what}{where}: {rows[row].tolist()} is not finite, expected numbers"
        )
    return rows, single


def joint_numbers(
    name: str, value: object, joints: Sequence[str], *, zero: bool = True
) -> Array:
    """Return an option's numbers (dof,), one for each joint, from one for all or one each.

    zero : whether a number may be zero; else it has to be positive
    """
    try:
        numbers = np.broadcast_to(
            np.asarray(value, dtype=float), (len(joints),)
        ).copy()
    except (TypeError, ValueError):
        numbers = np.full(len(joints), np.nan)
    # NaN is neither
    is_allowed = numbers >= 0.0 if zero else numbers > 0.0
    if not is_allowed.all():
        raise OptionError(
            f"{name} {value!r}: expected a number {'of zero or more' if zero else 'above zero'}, "
            f"or one for each of {', '.join(joints)} [rad or m]",
            parameter=name,
            value=value,
        )
    return numbers


def column_names(values: object) -> list[object]:
    """Return the names of the columns, none for an array without."""
    if isinstance(values, np.ndarray):
        return list(values.dtype.names or ())
    if isinstance(values, Mapping):
        return list(values)
    columns = getattr(values, "columns", None)
    names = [] if columns is None or callable(columns) else list(columns)
    # pandas numbers the columns of a table that was made without names
    return [] if names == list(range(len(names))) else names


def _numbers(values: object, what: str, error: type[CalibError]) -> Array:
    """Return a float64 copy of what is an array of plain numbers."""
    if (
        isinstance(values, np.ma.MaskedArray)
        and np.ma.getmaskarray(values).any()
    ):
        raise error(
            f"{what}: a masked array; leave out its masked entries, no measurements"
        )
    try:
        array = np.asarray(values)
        # dates, times, complex numbers, true and false
        if array.dtype.kind in "mMcb":
            raise error(
                f"{what}: values of type {array.dtype}, expected real numbers"
            )
        return np.array(array, dtype=np.float64, order="C")
    except (TypeError, ValueError) as problem:
        raise error(
            f"{what}: expected numbers, got {values!r:.60}"
        ) from problem


def numbers(name: str, values: object, count: int) -> list[float]:
    """Return a list of `count` finite numbers, or raise ValueError; true and false are none."""
    items = values if isinstance(values, list) else []
    sound = all(
        isinstance(item, int | float)
        and not isinstance(item, bool)
        and math.isfinite(item)
        for item in items
    )
    if not sound or len(items) != count:
        raise ValueError(
            f"{name}: {values!r:.40} are not {count} finite numbers"
        )
    return [float(item) for item in items]


def whole(name: str, value: object, least: int, most: int) -> int:
    """Return a whole number within bounds, NumPy's too; True and 3.0 are none."""
    good = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (good and least <= value <= most):  # type: ignore[operator]
        raise OptionError(
            f"{name} is {value!r}, expected a whole number, {least} to {most:,}"
        )
    return int(value)  # type: ignore[call-overload, no-any-return]
