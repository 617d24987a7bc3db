"""Usage: how a command declares what it takes, and how wrong usage is told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import typer

from calib.errors import OptionError

from .parsing import Reader, ReadingError, finite_number, one_of

_T = TypeVar("_T")


class BadOption(typer.BadParameter):
    """Wrong usage, told by its message alone.

    message : what was typed and what was expected
    option, value : the option that is wrong, and what was typed
    """

    def __init__(self, message: str, option: str | None = None, value: str | None = None) -> None:
        super().__init__(message)
        self.option, self.value = option, value

    def format_message(self) -> str:
        """Return the message without a preface."""
        # Click's own preface would name the option a second time
        return self.message


def option(usage: str, help: str, read: Reader[Any] | None = None) -> Any:  # noqa: A002
    """Declare an option of a value as a usage line has it, such as "--output -o FILE"."""
    # flags, then what stands for the value, as a manual page writes them
    *flags, metavar = usage.split()
    return typer.Option(*flags, metavar=metavar, parser=read and _parser(flags[0], read), help=help)


def choice(flags: str, choices: Sequence[str], help: str) -> Any:  # noqa: A002
    """Declare an option that is one of several words."""
    return option(f"{flags} {'|'.join(choices)}", help, one_of(choices))


def flag(flags: str, help: str) -> Any:  # noqa: A002
    """Declare an option without a value."""
    return typer.Option(flags, help=help)


def argument(metavar: str, help: str, read: Reader[Any] | None = None) -> Any:  # noqa: A002
    """Declare an argument."""
    return typer.Argument(metavar=metavar, parser=read and _parser(metavar, read), help=help)


def bad_option(option: str, text: str, expected: str) -> BadOption:
    """Return the error for a value that an option cannot have."""
    shown = text if len(text) <= 60 else text[:57] + "..."
    return BadOption(f"{option} {shown!r}: expected {expected}", option, text)


def typed_numbers(values: Sequence[str] | None) -> list[float]:
    """Parse arguments; among them are options that do not exist."""
    result = []
    for text in values or ():
        try:
            result.append(finite_number(text))
        except ValueError:
            if text.startswith("-") and not text[1:2].isdigit():
                raise BadOption(f"no such option or number: {text!r}") from None
            raise bad_option("value", text, "a finite number") from None
    return result


def check_count(typed: Sequence[float], names: Sequence[str], what: str) -> None:
    """Refuse more or fewer numbers than there are names."""
    if len(typed) != len(names):
        raise BadOption(
            f"{len(typed)} {what}s: expected {len(names)}, one each for {', '.join(names)}"
        )


def check_streams(
    typed: Sequence[float], input_: str | None, output: str | None, as_json: bool
) -> None:
    """Refuse both one query and a table of them, and a table of answers without one."""
    if input_ is not None and typed:
        raise BadOption(f"--input {input_!r} and {len(typed)} values: expected one of them")
    if output is not None and input_ is None:
        raise BadOption(f"--output {output!r} is for many queries: expected --input FILE too")
    one_document(output, as_json)


def refuse(typed: Mapping[str, object], why: str) -> None:
    """Refuse the first of some options that was given; None is not given."""
    for name, value in typed.items():
        if value is not None:
            raise BadOption(f"--{name.replace('_', '-')} {why}")


def one_document(output: str | None, as_json: bool) -> None:
    """Refuse a table and a JSON document that would both go to standard output."""
    if as_json and output == "-":
        raise BadOption("--json and --output '-' both want standard output: expected one of them")


def check_file(path: str) -> None:
    """Refuse an output that cannot be written before the work starts."""
    from calib.common.atomic import check_writable

    if path == "-":
        raise BadOption("--output '-': expected a file name, a model cannot be printed as text")
    check_writable(path)


def _parser(option: str, read: Reader[_T]) -> Callable[[object], _T]:
    def parse(typed: object) -> _T:  # a default that is no text comes here too
        try:
            return read(str(typed))
        except ReadingError as error:
            raise bad_option(option, error.text, error.expected) from None
        except OptionError as error:  # of the library, which reads columns itself
            raise BadOption(f"--{error}") from None

    return parse
