"""Errors: the one place where what ended a command becomes a line, a document and an exit code."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass

import typer

from calib.common.wording import one_line
from calib.errors import CalibError

from .output import NO, as_typed, note, option_of, print_json, silence
from .parsing import BadOption

FAILED = 1
USAGE = 2
INTERRUPTED = 130
TRACEBACK = "CALIB_TRACEBACK"
"""The environment variable that shows where an error was raised."""


@dataclass(frozen=True)
class ErrorReport:
    """An error in words; `--json` prints these fields."""

    type: str  # class of the error
    message: str  # what is wrong, one line
    hint: str | None = None  # what to do
    parameter: str | None = None  # the option concerned
    value: object = None  # what it was

    @property
    def line(self) -> str:
        """The message and the hint as people read them."""
        return (
            self.message
            if self.hint is None
            else f"{self.message}; {self.hint}"
        )


def report_error(error: Exception, as_json: bool) -> int:
    """Print an error on standard error, and as a document if wanted; return the exit code."""
    code, report = describe_error(error)
    try:
        if as_json:
            print_json({"error": asdict(report)})
        sys.stdout.flush()
    except OSError:  # a full disk, perhaps the error itself
        silence(sys.stdout)
    note(f"error: {report.line}")
    return code


def describe_error(error: Exception) -> tuple[int, ErrorReport]:
    """Return the exit code of what ended a command, and its description."""
    kind = type(error).__name__
    if isinstance(error, CalibError):
        return _library_error(error)
    if isinstance(
        error.__cause__, KeyboardInterrupt
    ):  # while Python made a class
        return INTERRUPTED, ErrorReport(kind, "interrupted")
    if isinstance(error, typer.TyperException):
        return USAGE, _usage_error(error)
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename else ""
        text = f"{place}{error.strerror or error}"
    elif isinstance(error, MemoryError):  # NumPy has one of its own
        text = "not enough memory; use a smaller --size or fewer --samples"
    else:
        text = f"internal error, {kind}: {error}; {TRACEBACK}=1 shows where, please report it"
    return FAILED, ErrorReport(kind, _in_one_line(text))


def _library_error(error: CalibError) -> tuple[int, ErrorReport]:
    kind = type(error).__name__
    # clocks that no offset brings together are an answer about the recording
    code = NO if kind == "ClockError" else FAILED
    report = ErrorReport(
        kind,
        _in_one_line(as_typed(error.message)),
        hint=None if error.hint is None else as_typed(error.hint),
        parameter=None
        if error.parameter is None
        else option_of(error.parameter),
        value=error.value,
    )
    return code, report


def _usage_error(error: typer.TyperException) -> ErrorReport:
    message = error.format_message().rstrip(".")
    context = getattr(error, "ctx", None)
    if context is not None:
        message += f" (see {context.command_path} --help)"
    report = ErrorReport("UsageError", _in_one_line(message))
    if isinstance(error, BadOption):
        return ErrorReport(
            report.type,
            report.message,
            parameter=error.option,
            value=error.value,
        )
    return report


def _in_one_line(text: str) -> str:
    return one_line(" ".join(text.split()))
