"""Parsing: how typed texts that Typer has no type for become values, and wrong usage is told."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

import typer
import typer.core

from calib.common.wording import quoted, suggestion
from calib.errors import OptionError

_T = TypeVar("_T")
Reader = Callable[[str], _T]

TABLES = (".csv", ".txt", ".parquet", ".pq")
"""Endings of tables; all but Parquet's are written as CSV."""


class BadOption(typer.BadParameter):
    """Wrong usage, told by its message alone."""

    def __init__(self, message: str, option: str | None = None, value: str | None = None) -> None:
        super().__init__(message)
        self.option, self.value = option, value

    def format_message(self) -> str:
        """Return the message without a preface, which would name the option a second time."""
        return self.message


def bad_option(option: str, text: str, expected: str) -> BadOption:
    """Return the error for a value that an option cannot have."""
    return BadOption(f"{option} {quoted(text)}: expected {expected}", option, text)


def reader(
    expected: str, read: Reader[_T], good: Callable[[_T], bool] = lambda _: True
) -> Reader[_T]:
    """Return a reader that says what it expects where `read` fails, or its value is not `good`."""

    def told(text: str) -> _T:
        try:
            if good(value := read(text)):
                return value
        except (ValueError, OverflowError):  # of a whole number that no float holds
            pass
        raise ValueError(expected)

    return told


class _Value:
    """Values from what was typed; Typer's own adapter imports Pydantic, a tenth of a second."""

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
        except ValueError as error:
            raise bad_option(option, text, str(error)) from None
        except OptionError as error:  # of the library, which reads columns itself
            raise BadOption(f"--{error}", option, text) from None

    def _plain(self, text: str) -> Any:
        if get_origin(self._kind) is Literal:
            return one_of(get_args(self._kind))(text)
        if self._kind not in (int, float):
            return text
        least, most, whole = self._info.min, self._info.max, self._kind is int
        told = "a whole number" if whole else "a number"
        told += "" if least is None else f", {least or 'zero'} or more"
        told += "" if most is None else f", at most {most}"
        low, high = -math.inf if least is None else least, math.inf if most is None else most
        read = whole_number if whole else finite_number
        return reader(told, read, lambda value: low <= value <= high)(text)


# Typer has no public way; of 0.26, which reads plainly itself, it is no name
typer.core.build_runtime_param = _Value  # type: ignore[attr-defined, assignment]


def finite_number(text: str, kind: type[float] = float) -> float:
    """Return a finite number as a plain user would write it, else raise ValueError."""
    # Python also takes 1_0 and other digits
    if not text.isascii() or "_" in text or not math.isfinite(number := kind(text)):
        raise ValueError(text)
    return number


def whole_number(text: str) -> int:
    """Return a whole number as a plain user would write it, else raise ValueError."""
    return int(finite_number(text, int))


def one_of(choices: Sequence[str]) -> Reader[str]:
    """Return a reader of a word out of several."""

    def read(text: str) -> str:
        if text not in choices:
            raise ValueError(f"a name that there is: {suggestion(text, choices)}")
        return text

    return read


def several(read: Reader[_T]) -> Reader[tuple[_T, ...]]:
    """Return a reader of values with commas between them, each once."""

    def read_all(text: str) -> tuple[_T, ...]:
        values = tuple(read(part.strip()) for part in text.split(","))
        if len(set(values)) < len(values):
            raise ValueError("each value once")
        return values

    return read_all


def _sides(text: str) -> int | tuple[int, ...]:
    sides = tuple(map(whole_number, text.strip().lower().split("x")))
    if min(sides) < 2:
        raise ValueError(text)
    return sides[0] if len(sides) == 1 else sides


def typed_columns(text: str) -> dict[str, str]:
    """Read `x=cam_u,y=cam_v`."""
    from calib.samples.roles import parse_columns

    return parse_columns(text)


def _named(text: str, *, between: str = "\0") -> tuple[Any, ...]:
    # from the right: names in URDFs hold what they like, a number no equals sign
    name, _, numbers = text.rpartition("=")
    if not name.strip():
        raise ValueError(text)
    return name.strip(), *map(finite_number, numbers.split(between))


above_zero = reader("a number above zero", finite_number, lambda value: value > 0.0)
not_negative = reader("a number, zero or more", finite_number, lambda value: value >= 0.0)
count = reader("a whole number, 1 or more", whole_number, lambda value: value >= 1)
reals = reader(
    "numbers with commas between them such as 0.5,-1",
    lambda text: tuple(map(finite_number, text.split(","))),
)
sigma = reader(
    "START:END above zero such as 5:0.5 [nodes]",
    lambda text: tuple(map(above_zero, text.split(":", 1))),
    lambda ends: len(ends) == 2,
)
names = several(reader("names with commas between them such as a,b", str, bool))
size = reader("whole numbers of 2 or more such as 70 or 70x70", _sides)
# numbers of joints in rad, m, or deg as typed
joint_value = reader("JOINT=VALUE such as wrist=0.5", _named)
joint_range = reader(
    "JOINT=LOW:HIGH with LOW below HIGH such as elbow=0.5:1.5",
    lambda text: _named(text, between=":"),
    lambda found: len(found) == 3 and found[1] < found[2],
)
height = reader(
    "a height of the base frame in m such as z=0.02", _named, lambda found: found[0] == "z"
)
seconds = reader(
    "a number of seconds, or auto",
    lambda text: None if text.strip() == "auto" else finite_number(text),
)


def check_file(
    path: str | None, endings: tuple[str, ...], *, option: str = "--output", stream: bool = False
) -> None:
    """Refuse an output that cannot be written, or whose ending is not what will be written."""
    from calib.common.atomic import check_writable

    if path is None or (stream and path == "-"):
        return
    if path == "-":
        raise bad_option(option, path, "a file name")
    if endings and Path(path).suffix and not path.lower().endswith(endings):
        raise bad_option(option, path, f"a name that ends in {' or '.join(endings)}")
    check_writable(path)
