"""Parsing: how typed texts become values, and how wrong usage is told.

Types, ranges and choices are declared with Typer's own annotations; readers are for what Typer has
no type for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from functools import wraps
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

import typer
import typer.core

from calib.errors import OptionError

_T = TypeVar("_T")
Reader = Callable[[str], _T]


class BadOption(typer.BadParameter):
    """Wrong usage, told by its message alone.

    message : what was typed and what was expected
    option, value : the option that is wrong, and what was typed
    """

    def __init__(self, message: str, option: str | None = None, value: str | None = None) -> None:
        super().__init__(message)
        self.option, self.value = option, value

    def format_message(self) -> str:
        """Return the message without a preface, which would name the option a second time."""
        return self.message


def bad_option(option: str, text: str, expected: str) -> BadOption:
    """Return the error for a value that an option cannot have."""
    shown = text if len(text) <= 60 else text[:57] + "..."
    return BadOption(f"{option} {shown!r}: expected {expected}", option, text)


class _ExpectedError(ValueError):
    """What a reader expected."""


def expects(expected: str) -> Callable[[Reader[_T]], Reader[_T]]:
    """Say what a reader expects: it stands in the place of its plain ValueErrors."""

    def decorated(read: Reader[_T]) -> Reader[_T]:
        @wraps(read)
        def told(text: str) -> _T:
            try:
                return read(text)
            except _ExpectedError:
                raise
            except ValueError:
                raise _ExpectedError(expected) from None

        return told

    return decorated


def require(good: bool, expected: str | None = None) -> None:
    """Raise a ValueError where a condition fails; `expected` is told in the place of the usual."""
    if not good:
        raise ValueError if expected is None else _ExpectedError(expected)


class _Value:
    """Values from what was typed, in the place of Typer's adapter of Pydantic.

    That one is imported otherwise, which takes a tenth of a second of each command, and says what
    is wrong in several lines.
    """

    def __init__(self, descriptor: Any) -> None:
        self._info, self._kind = descriptor.parameter_info, descriptor.annotation
        if get_origin(self._kind) is list:
            (self._kind,) = get_args(self._kind)

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:  # noqa: ARG002
        """Read texts; a flag, and a default that is no text, are values already."""
        option = max(param.opts, key=len) if param.opts[0].startswith("-") else param.metavar
        if param.multiple or param.nargs == -1:
            return [self._read(text, option) for text in value or ()]
        return self._read(value, option) if isinstance(value, str) else value

    def _read(self, text: str, option: str) -> Any:
        try:
            return (self._info.parser or self._plain)(text)
        except _ExpectedError as error:
            raise bad_option(option, text, str(error)) from None
        except OptionError as error:  # of the library, which reads columns itself
            raise BadOption(f"--{error}", option, text) from None

    def _plain(self, text: str) -> Any:
        if get_origin(self._kind) is Literal:
            return one_of(get_args(self._kind))(text)
        if self._kind not in (int, float):
            return text
        least, most = self._info.min, self._info.max
        told = "a whole number" if self._kind is int else "a number"
        told += f", {'zero' if least == 0 else least} or more" if least is not None else ""
        told += f", at most {most}" if most is not None else ""
        try:
            value = finite_number(text) if self._kind is float else whole_number(text)
        except ValueError:
            raise _ExpectedError(told) from None
        require((least is None or value >= least) and (most is None or value <= most), told)
        return value


# Typer has no public way; of 0.26, which reads plainly itself, it is no name
typer.core.build_runtime_param = _Value  # type: ignore[attr-defined, assignment]


def finite_number(text: str) -> float:
    """Return a finite number as a plain user would write it, else raise ValueError."""
    require(text.isascii() and "_" not in text)  # float() also takes 1_0 and other digits
    value = float(text)
    require(math.isfinite(value))
    return value


def whole_number(text: str) -> int:
    """Return a whole number as a plain user would write it, else raise ValueError."""
    require(text.isascii() and "_" not in text)
    return int(text)


@expects("a number above zero")
def above_zero(text: str) -> float:
    """Read a finite number above zero."""
    value = finite_number(text)
    require(value > 0.0)
    return value


@expects("a number, zero or more")
def not_negative(text: str) -> float:
    """Read a finite number that is not below zero."""
    value = finite_number(text)
    require(value >= 0.0)
    return value


@expects("a whole number, 1 or more")
def count(text: str) -> int:
    """Read a whole number above zero."""
    value = whole_number(text)
    require(value >= 1)
    return value


@expects("a finite number")
def any_number(text: str) -> float:
    """Read a finite number; an option that does not exist is told as one."""
    if text.startswith("-") and not text[1:2].isdigit() and not text.startswith("-."):
        raise BadOption(f"no such option or number: {text!r}")
    return finite_number(text)


def one_of(choices: Sequence[str]) -> Reader[str]:
    """Return a reader of a word out of several."""

    def read(text: str) -> str:
        near = get_close_matches(text, choices, n=1)
        meant = f"; did you mean {near[0]}?" if near else ""
        require(text in choices, f"one of {', '.join(choices)}{meant}")
        return text

    return read


def several(read: Reader[_T]) -> Reader[tuple[_T, ...]]:
    """Return a reader of values with commas between them, each once."""

    def read_all(text: str) -> tuple[_T, ...]:
        values = tuple(read(part.strip()) for part in text.split(","))
        require(not any(value in values[:k] for k, value in enumerate(values)), "each value once")
        return values

    return read_all


@expects("whole numbers of 2 or more such as 70 or 70x70")
def size(text: str) -> int | tuple[int, ...]:
    """Read `70`, `70x70` and `17x17x17` as `calib.train` takes it."""
    sides = tuple(map(whole_number, text.strip().lower().split("x")))
    require(all(side >= 2 for side in sides))
    return sides[0] if len(sides) == 1 else sides


@expects("START:END above zero such as 5:0.5 [nodes]")
def sigma(text: str) -> tuple[float, ...]:
    """Read `START:END`, both above zero."""
    start, end = map(above_zero, text.split(":"))
    return start, end


@expects("names with commas between them such as a,b")
def names(text: str) -> tuple[str, ...]:
    """Read names with commas between them."""
    parts = tuple(part.strip() for part in text.split(","))
    require(all(parts))
    require(len(set(parts)) == len(parts), "each name once")
    return parts


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


def typed_columns(text: str) -> dict[str, str]:
    """Read `x=cam_u,y=cam_v`."""
    from calib.samples.roles import parse_columns

    return parse_columns(text)


@expects("JOINT=VALUE such as wrist=0.5")
def joint_value(text: str) -> tuple[str, float]:
    """Read `joint=value` [rad, m, or deg as typed]; the name may hold an equals sign itself."""
    # from the right: names in URDFs hold what they like, a number no equals sign
    joint, _, value = text.rpartition("=")
    require(bool(joint.strip()))
    return joint.strip(), finite_number(value)


@expects("JOINT=LOW:HIGH with LOW below HIGH such as elbow=0.5:1.5")
def joint_range(text: str) -> tuple[str, float, float]:
    """Read `joint=lo:hi` [rad, m, or deg as typed]."""
    joint, _, limits = text.rpartition("=")
    low, high = map(finite_number, limits.split(":"))
    require(bool(joint.strip()) and low < high)
    return joint.strip(), low, high


def check_count(typed: Sequence[float], names: Sequence[str], what: str) -> None:
    """Refuse more or fewer numbers than there are names."""
    if len(typed) != len(names):
        raise BadOption(
            f"{len(typed)} {what}s: expected {len(names)}, one each for {', '.join(names)}"
        )


def check_streams(
    typed: Sequence[float], input_: str | None, output: str | None, columns: object
) -> None:
    """Refuse both one query and a table of them, and what is for a table without one."""
    if input_ is not None and typed:
        raise BadOption(f"--input {input_!r} and {len(typed)} values: expected one of them")
    for option, value in (("--output", output), ("--columns", columns)):
        if value is not None and input_ is None:
            raise BadOption(f"{option} is for many queries: expected --input FILE too")


TABLES = (".csv", ".txt", ".parquet", ".pq")
"""Endings of tables; all but Parquet's are written as CSV."""


def check_file(
    path: str | None, endings: tuple[str, ...], *, option: str = "--output", stream: bool = False
) -> None:
    """Refuse an output that cannot be written, or whose ending is not what will be written.

    endings : those that fit; a name without any fits always
    stream : whether `-`, standard output, is one
    """
    from calib.common.atomic import check_writable

    if path is None or (stream and path == "-"):
        return
    if path == "-":
        raise BadOption(f"{option} '-': expected a file name", option, path)
    ending = Path(path).suffix.lower()
    if endings and ending and ending not in endings:
        expected = f"{option} {path!r}: expected a name that ends in {' or '.join(endings)}"
        raise BadOption(f"{expected}, which is what is written", option, path)
    check_writable(path)
