"""Parsing: from what was typed to values, or one line that says what was expected."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple

import typer


class BadOption(typer.BadParameter):
    """Wrong usage, told by its message alone.

    Parameters
    ----------
    message : str
        What was typed and what was expected.
    option, value : str or None
        The option that is wrong, and what was typed.
    """

    def __init__(self, message: str, option: str | None = None, value: str | None = None) -> None:
        super().__init__(message)
        self.option, self.value = option, value

    def format_message(self) -> str:
        """Return the message without a preface."""
        return self.message


class Names(tuple[str, ...]):
    """Names, as in `shoulder,elbow`."""


class Numbers(tuple[float, ...]):
    """Numbers, as in `0.5,-1`."""


class Size(tuple[int, ...]):
    """Nodes of a lattice along each of its axes; one number for as many as there are."""

    def plain(self) -> int | tuple[int, ...]:
        """Return it as `calib.train` takes it."""
        return self[0] if len(self) == 1 else tuple(self)


class Values(tuple[Any, ...]):
    """Values of an option to try one after the other, as in `30,50,70`."""


class Columns(dict[str, str]):
    """Columns of a log by the names they stand for, as in `x=cam_u,y=cam_v`."""


class Sigma(NamedTuple):
    """Radius of the neighbourhood at the start and at the end [nodes]."""

    start: float
    end: float


class JointValue(NamedTuple):
    """A joint and a value of it [rad, m, or deg as typed]."""

    joint: str
    value: float


class JointRange(NamedTuple):
    """A joint and a part of its range [rad, m, or deg as typed]."""

    joint: str
    low: float
    high: float


class Margin(NamedTuple):
    """A distance from limits [rad, m, or deg as typed], or a share of each joint's range."""

    value: float
    share: bool


class Side(NamedTuple):
    """An axis of the plane and bounds along it."""

    axis: str
    low: float
    high: float


def bad_option(option: str, text: str, expected: str) -> BadOption:
    """Return the error for a value that an option cannot have."""
    shown = text if len(text) <= 60 else text[:57] + "..."
    return BadOption(f"{option} {shown!r}: expected {expected}", option, text)


def finite(text: str) -> float:
    """Return a finite number as a plain user would write it, else raise ValueError."""
    if not text.isascii() or "_" in text:  # float() also takes 1_0 and other digits
        raise ValueError(text)
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def whole(option: str, least: int, most: int = 2**63 - 1) -> Callable[[object], int]:
    """Return a parser of whole numbers within bounds."""

    def parse(typed: object) -> int:
        text = str(typed).strip()
        try:
            if not text.isascii() or "_" in text:
                raise ValueError(text)
            value = int(text)
        except ValueError:
            raise bad_option(option, text, "a whole number") from None
        if not least <= value <= most:
            limits = f"{least} or more" if value < least else f"at most {most}"
            raise bad_option(option, text, f"a whole number, {limits}")
        return value

    return parse


def at_least_zero(option: str, unit: str) -> Callable[[object], float]:
    """Return a parser of numbers that are not negative."""

    def parse(typed: object) -> float:
        text = str(typed).strip()
        try:
            value = finite(text)
        except ValueError:
            value = -1.0
        if value < 0.0:
            raise bad_option(option, text, f"a number, zero or more [{unit}]")
        return value

    return parse


def above_zero(option: str, unit: str) -> Callable[[object], float]:
    """Return a parser of numbers above zero."""

    def parse(typed: object) -> float:
        text = str(typed).strip()
        try:
            value = finite(text)
        except ValueError:
            value = 0.0
        if value <= 0.0:
            raise bad_option(option, text, f"a number above zero [{unit}]")
        return value

    return parse


def one_of(option: str, choices: Sequence[str]) -> Callable[[str], str]:
    """Return a parser of a word out of several."""

    def parse(text: str) -> str:
        if text in choices:
            return text
        near = get_close_matches(text, choices, n=1)
        meant = f"; did you mean {near[0]}?" if near else ""
        raise bad_option(option, text, f"one of {', '.join(choices)}{meant}")

    return parse


def kind_of_map(choices: Sequence[str]) -> Callable[[str], str]:
    """Return a parser of kinds of maps; a reading may follow, as in `vdsom:error`."""
    known = one_of("--map", choices)

    def parse(text: str) -> str:
        kind, colon, reading = text.partition(":")
        return known(kind if colon and reading else text) + colon + reading

    return parse


def size(option: str) -> Callable[[str], Size]:
    """Return a parser of `70`, `70x70` and `17x17x17`."""

    def parse(text: str) -> Size:
        sides = text.strip().lower().split("x")
        if not all(side.isascii() and side.isdigit() and int(side) >= 2 for side in sides):
            raise bad_option(option, text, "whole numbers of 2 or more such as 70 or 70x70")
        return Size(int(side) for side in sides)

    return parse


def sigma(text: str) -> Sigma:
    """Parse `START:END`, both above zero."""
    try:
        start, end = (finite(part) for part in text.split(":"))
    except ValueError:
        start = end = 0.0
    if not (start > 0.0 and end > 0.0):
        raise bad_option("--sigma", text, "START:END above zero such as 5:0.5 [nodes]")
    return Sigma(start, end)


def names(option: str) -> Callable[[str], Names]:
    """Return a parser of names with commas between them."""

    def parse(text: str) -> Names:
        parts = [part.strip() for part in text.split(",")]
        if not all(parts):
            raise bad_option(option, text, "names with commas between them such as a,b")
        if len(set(parts)) < len(parts):
            raise bad_option(option, text, "each name once")
        return Names(parts)

    return parse


def numbers(option: str) -> Callable[[str], Numbers]:
    """Return a parser of numbers with commas between them."""

    def parse(text: str) -> Numbers:
        try:
            return Numbers(finite(part.strip()) for part in text.split(","))
        except ValueError:
            expected = "numbers with commas between them such as 0.5,-1"
            raise bad_option(option, text, expected) from None

    return parse


def height(text: str) -> float:
    """Parse `z=0.02`, a plane of the base frame [m]."""
    axis, _, value = (part.strip() for part in text.partition("="))
    try:
        if axis != "z":
            raise ValueError(text)
        return finite(value)
    except ValueError:
        raise bad_option("--on", text, "a height of the base frame in m such as z=0.02") from None


def several(option: str, parse: Callable[[str], object]) -> Callable[[str], Values]:
    """Return a parser of values with commas between them, each read by `parse`."""

    def parse_all(text: str) -> Values:
        values = Values(parse(part.strip()) for part in text.split(","))
        if any(value in values[:k] for k, value in enumerate(values)):
            raise bad_option(option, text, "each value once")
        return values

    return parse_all


def columns(text: str) -> Columns:
    """Parse `x=cam_u,y=cam_v`."""
    from calib.errors import OptionError
    from calib.samples.roles import parse_columns

    try:
        return Columns(parse_columns(text))
    except OptionError as error:
        raise BadOption(f"--{error}") from None


def joint_value(text: str) -> JointValue:
    """Parse `joint=value`; the name may hold an equals sign itself."""
    joint, _, value = (piece.strip() for piece in text.rpartition("="))
    try:
        if not joint:
            raise ValueError(text)
        return JointValue(joint, finite(value))
    except ValueError:
        raise bad_option("--lock", text, "JOINT=VALUE such as wrist=0.5") from None


def joint_range(text: str) -> JointRange:
    """Parse `joint=lo:hi`."""
    joint, _, limits = (piece.strip() for piece in text.rpartition("="))
    try:
        low, high = (finite(part.strip()) for part in limits.split(":"))
        if not joint or not low < high:
            raise ValueError(text)
        return JointRange(joint, low, high)
    except ValueError:
        expected = "JOINT=LOW:HIGH with LOW below HIGH such as elbow=0.5:1.5"
        raise bad_option("--range", text, expected) from None


def margin(text: str) -> Margin:
    """Parse `0.02` or `2%`."""
    number, percent, rest = text.strip().partition("%")
    try:
        value = finite(number.strip())
    except ValueError:
        value = -1.0
    if value < 0.0 or rest or (percent and value >= 50.0):
        expected = "a number, zero or more, or a share below 50% such as 2%"
        raise bad_option("--margin", text, expected)
    return Margin(value / 100.0, True) if percent else Margin(value, False)


def percent(option: str) -> Callable[[object], float]:
    """Return a parser of shares such as `1%`, as a number from 0 to 1."""

    def parse(typed: object) -> float:
        text = str(typed).strip()
        try:
            value = finite(text.removesuffix("%").strip()) if text.endswith("%") else -1.0
        except ValueError:
            value = -1.0
        if not 0.0 < value <= 100.0:
            raise bad_option(option, text, "a share above zero such as 1%")
        return value / 100.0

    return parse


def side(text: str) -> Side:
    """Parse `x=lo:hi`."""
    axis, _, limits = (piece.strip() for piece in text.partition("="))
    try:
        low, high = (finite(part.strip()) for part in limits.split(":"))
        if axis not in ("x", "y") or not low < high:
            raise ValueError(text)
        return Side(axis, low, high)
    except ValueError:
        expected = "x=LOW:HIGH or y=LOW:HIGH with LOW below HIGH such as x=0.1:0.4"
        raise bad_option("--keep", text, expected) from None
