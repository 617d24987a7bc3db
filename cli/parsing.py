"""Parsing: texts that Typer has no type for become values, and wrong usage becomes one line."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import typer

from calib.common.wording import quoted, suggestion
from calib.errors import OptionError

_T = TypeVar("_T")
Parser = Callable[[str], _T]
Numbers = Sequence[float]

TABLES = (".csv", ".txt", ".parquet", ".pq")
"""Endings of tables; all but Parquet's are written as CSV."""


class OfJoint(NamedTuple):
    """What is typed for a joint, a value `wrist=0.5` or a range `elbow=0.5:1.5`."""

    joint: str
    low: float  # [rad or m], or [deg] with --degrees
    high: float  # equals `low` where a single value is typed


class BadOption(typer.BadParameter):
    """Wrong usage, as one line; `value` is what was typed, if an option has a wrong one."""

    def __init__(
        self, message: str, option: str | None = None, value: str | None = None
    ) -> None:
        super().__init__(message)
        self._option = option
        self.value = value

    @property
    def option(self) -> str | None:
        """The option of a value, as Typer knows it where a parser refused the value."""
        if self.param is None:
            return self._option
        longest = max(self.param.opts, key=len)
        is_option = longest.startswith("-")
        return longest if is_option else str(self.param.metavar or longest)

    def format_message(self) -> str:
        """Return the option, the value and what was expected."""
        if self.value is None:
            return self.message
        return f"{self.option or 'value'} {quoted(self.value)}: {self.message}"


def bad_value(text: str, expected: str, option: str | None = None) -> BadOption:
    """Return the error for a value that an option cannot have."""
    return BadOption(f"expected {expected}", option, text)


def parser(
    expected: str,
    read: Parser[_T],
    accepts: Callable[[_T], bool] = lambda _: True,
) -> Parser[_T]:
    """Return a parser that states what is expected where `read` fails or `accepts` is false."""

    def parse(text: str) -> _T:
        if not isinstance(text, str):
            return text  # Typer also parses defaults, which are values already
        try:
            value = read(text)
        except (OverflowError, ValueError):  # no float holds some whole numbers
            raise bad_value(text, expected) from None
        if not accepts(value):
            raise bad_value(text, expected)
        return value

    return parse


def finite_number(text: str) -> float:
    """Return a finite number as a plain user writes it, else raise ValueError."""
    # Python also takes 1_0 and digits of other scripts
    if not text.isascii() or "_" in text or not math.isfinite(float(text)):
        raise ValueError(text)
    return float(text)


def whole_number(text: str) -> int:
    """Return a whole number as a plain user writes it, else raise ValueError."""
    finite_number(text)
    return int(text)


def numbers(text: str) -> Numbers:
    """Return numbers with commas between them."""
    return tuple(finite_number(part) for part in text.split(","))


def whole(least: int, most: float = math.inf) -> Parser[int]:
    """Return a parser of whole numbers from `least` to `most`."""
    expected = f"a whole number, {least or 'zero'} or more"
    if most < math.inf:
        expected += f", at most {most}"
    return parser(
        expected, whole_number, lambda number: least <= number <= most
    )


def one_of(choices: Sequence[str]) -> Parser[str]:
    """Return a parser of one word out of several."""

    def parse(text: str) -> str:
        if text not in choices:
            raise bad_value(
                text, f"a name that there is: {suggestion(text, choices)}"
            )
        return text

    return parse


def column_names(text: str) -> Mapping[str, str]:
    """Return the columns of a log by role, from `x=cam_u,y=cam_v`."""
    from calib.samples.roles import parse_columns

    try:
        return parse_columns(text)
    except OptionError as error:
        raise BadOption(f"--{error}", "--columns") from None


def _of_joint(text: str) -> OfJoint:
    # from the right: names in URDFs hold what they like, a number no equals sign
    name, _, values = text.rpartition("=")
    if not name.strip():
        raise ValueError(text)
    low, _, high = values.partition(":")
    return OfJoint(name.strip(), finite_number(low), finite_number(high or low))


def _lattice_size(text: str) -> str:
    """Return the size of a lattice as typed, such as 70 or 70x70, where it is one."""
    sides = map(whole_number, text.strip().lower().split("x"))
    return text if min(sides) > 1 else ""


number = parser("a number", finite_number)
above_zero = parser(
    "a number above zero", finite_number, lambda value: value > 0.0
)
not_negative = parser(
    "a number, zero or more", finite_number, lambda value: value >= 0.0
)
length = parser(
    "a length above zero, or inf",
    lambda text: math.inf if text.strip() == "inf" else finite_number(text),
    lambda value: value > 0.0,
)
count = whole(1)
reals = parser("numbers with commas between them such as 0.5,-1", numbers)
direction = parser(
    "three numbers, not all zero, such as 0,0,-1",
    numbers,
    lambda axis: len(axis) == 3 and any(axis),
)
point = parser(
    "three numbers, a point of the base frame in m",
    numbers,
    lambda place: len(place) == 3,
)
angles = parser(
    "3 numbers: roll, pitch and yaw", numbers, lambda values: len(values) == 3
)
quaternion = parser(
    "4 numbers of length 1, qx,qy,qz,qw",
    numbers,
    # typed numbers are rounded
    lambda values: len(values) == 4 and abs(math.hypot(*values) - 1.0) <= 0.01,
)
sigma = parser(
    "START:END above zero such as 5:0.5 [nodes]",
    lambda text: tuple(map(finite_number, text.split(":"))),
    lambda radii: len(radii) == 2 and min(radii) > 0.0,
)
names = parser(
    "names with commas between them such as a,b, each once",
    lambda text: tuple(name.strip() for name in text.split(",")),
    lambda names: all(names) and len(set(names)) == len(names),
)
frames = parser(
    "two frames SENSOR,TIP",
    names,
    lambda pair: len(pair) == 2,
)
lattice_size = parser(
    "whole numbers of 2 or more such as 70 or 70x70", _lattice_size, bool
)
joint_value = parser(
    "JOINT=VALUE such as wrist=0.5",
    _of_joint,
    lambda part: part.low == part.high,
)
joint_range = parser(
    "JOINT=LOW:HIGH with LOW below HIGH such as elbow=0.5:1.5",
    _of_joint,
    lambda part: part.low < part.high,
)
height = parser(
    "a height of the base frame in m such as z=0.02",
    _of_joint,
    lambda part: part.joint == "z" and part.low == part.high,
)
seconds = parser(
    "a number of seconds, or auto",
    lambda text: None if text.strip() == "auto" else finite_number(text),
)


def refuse(typed: Mapping[str, object], why: str) -> None:
    """Refuse the first of some options that was typed; None is not."""
    for name, value in typed.items():
        if value is not None:
            raise BadOption(f"--{name.replace('_', '-')} {why}")


def check_file(
    path: str | None,
    endings: tuple[str, ...],
    *,
    option: str = "--output",
    stream: bool = False,
) -> None:
    """Refuse an output that cannot be written, or whose ending is not what will be written."""
    from calib.common.atomic import check_writable

    if path is None:
        return
    if path == "-":
        if not stream:
            raise bad_value(path, "a file name", option)
        return
    if Path(path).suffix and not path.lower().endswith(endings):
        raise bad_value(
            path, f"a name that ends in {' or '.join(endings)}", option
        )
    check_writable(path)
