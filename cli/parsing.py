"""Parsing: readers, which take a text and return a value, or say what they expected."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from functools import wraps
from typing import TypeVar

_T = TypeVar("_T")
Reader = Callable[[str], _T]


class ReadingError(ValueError):
    """A text that is not what a reader expected."""

    def __init__(self, text: str, expected: str) -> None:
        super().__init__(text)
        self.text, self.expected = text, expected


Names = tuple[str, ...]  # as in `shoulder,elbow`
Columns = dict[str, str]  # of a log, by the names they stand for, as in `x=cam_u,y=cam_v`
JointValue = tuple[str, float]  # a joint and a value of it [rad, m, or deg as typed]
JointRange = tuple[str, float, float]  # a joint and the ends of a part of its range


def expects(expected: str) -> Callable[[Reader[_T]], Reader[_T]]:
    """Say what a reader expects: its plain ValueErrors become an `ReadingError` that tells it."""

    def decorated(read: Reader[_T]) -> Reader[_T]:
        @wraps(read)
        def told(text: str) -> _T:
            try:
                return read(text)
            except ReadingError:
                raise
            except ValueError:
                raise ReadingError(text, expected) from None

        return told

    return decorated


def require(good: bool) -> None:
    """Raise a ValueError where a condition fails; `expects` says what it was."""
    if not good:
        raise ValueError


def finite_number(text: str) -> float:
    """Return a finite number as a plain user would write it, else raise ValueError."""
    require(text.isascii() and "_" not in text)  # float() also takes 1_0 and other digits
    value = float(text)
    require(math.isfinite(value))
    return value


def integer(least: int, most: int = 2**63 - 1) -> Reader[int]:
    """Return a reader of whole numbers within bounds."""
    limits = f"{least} or more" + (f", at most {most}" if most < 2**63 - 1 else "")

    @expects(f"a whole number, {limits}")
    def read(text: str) -> int:
        # int() also takes 1_0 and the digits of other scripts
        require(text.isascii() and "_" not in text)
        value = int(text)
        require(least <= value <= most)
        return value

    return read


def number_where(expected: str, good: Callable[[float], bool] = math.isfinite) -> Reader[float]:
    """Return a reader of finite numbers that a condition holds for."""

    @expects(expected)
    def read(text: str) -> float:
        value = finite_number(text)
        require(good(value))
        return value

    return read


def at_least_zero(unit: str) -> Reader[float]:
    """Return a reader of numbers that are not negative."""
    return number_where(f"a number, zero or more [{unit}]", lambda value: value >= 0.0)


def above_zero(unit: str) -> Reader[float]:
    """Return a reader of numbers above zero."""
    return number_where(f"a number above zero [{unit}]", lambda value: value > 0.0)


def one_of(choices: Sequence[str]) -> Reader[str]:
    """Return a reader of a word out of several."""

    def read(text: str) -> str:
        if text in choices:
            return text
        near = get_close_matches(text, choices, n=1)
        meant = f"; did you mean {near[0]}?" if near else ""
        raise ReadingError(text, f"one of {', '.join(choices)}{meant}")

    return read


def several(read: Reader[_T]) -> Reader[tuple[_T, ...]]:
    """Return a reader of values with commas between them."""

    def read_all(text: str) -> tuple[_T, ...]:
        values = tuple(read(part.strip()) for part in text.split(","))
        if any(value in values[:k] for k, value in enumerate(values)):
            raise ReadingError(text, "each value once")
        return values

    return read_all


@expects("whole numbers of 2 or more such as 70 or 70x70")
def size(text: str) -> int | tuple[int, ...]:
    """Read `70`, `70x70` and `17x17x17` as `calib.train` takes it."""
    sides = text.strip().lower().split("x")
    require(all(side.isascii() and side.isdigit() and int(side) >= 2 for side in sides))
    return int(text) if len(sides) == 1 else tuple(map(int, sides))


@expects("START:END above zero such as 5:0.5 [nodes]")
def sigma(text: str) -> tuple[float, float]:
    """Read `START:END`, both above zero."""
    start, end = map(finite_number, text.split(":"))
    require(start > 0.0 and end > 0.0)
    return start, end


@expects("names with commas between them such as a,b")
def names(text: str) -> Names:
    """Read names with commas between them."""
    parts = [part.strip() for part in text.split(",")]
    require(all(parts))
    if len(set(parts)) < len(parts):
        raise ReadingError(text, "each name once")
    return tuple(parts)


@expects("numbers with commas between them such as 0.5,-1")
def reals(text: str) -> tuple[float, ...]:
    """Read numbers with commas between them."""
    return tuple(map(finite_number, text.split(",")))


@expects("a height of the base frame in m such as z=0.02")
def height(text: str) -> float:
    """Read `z=0.02`, a plane of the base frame [m]."""
    axis, _, value = text.partition("=")
    require(axis.strip() == "z")
    return finite_number(value)


def typed_columns(text: str) -> Columns:
    """Read `x=cam_u,y=cam_v`."""
    from calib.samples.roles import parse_columns

    return parse_columns(text)


@expects("JOINT=VALUE such as wrist=0.5")
def joint_value(text: str) -> JointValue:
    """Read `joint=value`; the name may hold an equals sign itself."""
    # from the right: names in URDFs hold what they like, a number no equals sign
    joint, _, value = text.rpartition("=")
    require(bool(joint.strip()))
    return joint.strip(), finite_number(value)


@expects("JOINT=LOW:HIGH with LOW below HIGH such as elbow=0.5:1.5")
def joint_range(text: str) -> JointRange:
    """Read `joint=lo:hi`."""
    joint, _, limits = text.rpartition("=")
    low, high = map(finite_number, limits.split(":"))
    require(bool(joint.strip()) and low < high)
    return joint.strip(), low, high
