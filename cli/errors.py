"""Errors: the one place where what ended a command becomes a line, a document and an exit code."""

import sys

import typer

from calib.common.wording import one_line
from calib.errors import CalibError

from .output import EXIT_ACT, as_typed, note, option_of, print_json, silence
from .parsing import BadOption

FAILED = 1
USAGE = 2
INTERRUPTED = 130
TRACEBACK = "CALIB_TRACEBACK"
"""The environment variable that shows where an error was raised."""


def report_error(error: Exception, as_json: bool) -> int:
    """Print an error on standard error, and as a document if wanted; return the exit code."""
    code, report = describe_error(error)
    try:
        if as_json:
            print_json({"error": report})
        sys.stdout.flush()
    except OSError:  # a full disk, perhaps the error itself
        silence(sys.stdout)
    hint = report["hint"]
    note(f"error: {report['message']}{f'; {hint}' if hint else ''}")
    return code


def describe_error(error: Exception) -> tuple[int, dict[str, object]]:
    """Return the exit code of what ended a command, and its description as `--json` prints it."""
    code = FAILED
    kind = type(error).__name__
    text = str(error)
    hint: str | None = None
    parameter: str | None = None
    value: object = None
    if isinstance(error, CalibError):
        # clocks that no offset brings together are an answer about the recording
        code = EXIT_ACT if kind == "ClockError" else FAILED
        text = as_typed(error.message)
        hint = error.hint and as_typed(error.hint)
        parameter = error.parameter and option_of(error.parameter)
        value = error.value
    elif isinstance(error.__cause__, KeyboardInterrupt):
        code = INTERRUPTED  # while Python made a class
        text = "interrupted"
    elif isinstance(error, typer.TyperException):
        code = USAGE
        kind = "UsageError"
        text = error.format_message().rstrip(".").replace("Value error, ", "")
        context = getattr(error, "ctx", None)
        if context is not None:
            text += f" (see {context.command_path} --help)"
        if isinstance(error, BadOption):
            parameter = error.option
            value = error.value
    elif isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename else ""
        text = f"{place}{error.strerror or error}"
    elif isinstance(error, MemoryError):  # NumPy has one of its own
        text = "not enough memory; use a smaller --size or fewer --samples"
    else:
        text = f"internal error, {kind}: {error}; {TRACEBACK}=1 shows where, please report it"
    report: dict[str, object] = {
        "type": kind,
        "message": one_line(" ".join(text.split())),
        "hint": hint,
        "parameter": parameter,
        "value": value,
    }
    return code, report
