"""The application: its commands, and the one place where errors become lines.

Exit codes: 0 done, 1 an error, 2 wrong usage, 3 a result that a script should act on (each
command says which), 130 interrupted.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import shorten
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from calib.common.wording import one_line
from calib.errors import CalibError

from .on_demand import COMMANDS, load_command
from .output import NO, note, show_json, silence, tell
from .process import received
from .translation import as_typed, option_of

USAGE, INTERRUPTED = 2, 130
_SIGNAL = 128  # a larger code names the signal that ended it
_TRACEBACK = "CALIB_TRACEBACK"


class CalibGroup(TyperGroup):
    """Commands whose errors are one line on standard error and an exit code."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        names: Any = dict.fromkeys(COMMANDS)  # alone, see `get_command`
        self.commands = names

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Run a command line; see `typer.core.TyperGroup.main` for the parameters."""
        try:
            # not standalone: Click would print its own errors in several lines and exit
            code = super().main(args, prog_name, complete_var, False, windows_expand_args, **extra)
            sys.stdout.flush()
        except BrokenPipeError:
            code = _reader_left()
        except Exception as error:
            if os.environ.get(_TRACEBACK):
                raise
            told = describe_error(error)
            code = told.code
            # a process that a signal ended says nothing more: its reader may be gone
            if code < _SIGNAL:
                try:
                    if "--json" in (sys.argv[1:] if args is None else args):
                        show_json({"error": told.to_json()})
                    sys.stdout.flush()
                except OSError:  # a full disk, perhaps the error itself
                    _reader_left()
                note(told.line)
        code = code if isinstance(code, int) else 0
        if standalone_mode:
            sys.exit(code)
        return code

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        """Import a command when it is asked for."""
        return load_command(cmd_name) if cmd_name in COMMANDS else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write what each command does, without importing any."""
        room = formatter.width - 6 - max(map(len, COMMANDS))
        with formatter.section("Commands"):
            formatter.write_dl(
                [(name, shorten(text, room, placeholder="...")) for name, text in COMMANDS.items()]
            )

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was chosen; a reader who has seen enough ends it quietly."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            raise typer.Exit(_reader_left()) from None


@dataclass(frozen=True)
class ErrorReport:
    """An error as the command line tells it."""

    kind: str  # its type, such as "LogError"; "UsageError" for what was typed wrongly
    message: str  # what was given and what was expected, in one line
    code: int  # exit code: 130 for an interruption, 2 for wrong usage, else 1
    # what to do, and the option that is concerned
    hint: str | None = None
    option: str | None = None
    value: Any = None  # the value that is wrong, None if there is none

    @property
    def line(self) -> str:
        """All of it in one line, whatever the error's own text looks like."""
        text = self.message if self.hint is None else f"{self.message}; {self.hint}"
        return "error: " + one_line(" ".join(text.split()))

    def to_json(self) -> dict[str, Any]:
        """Plain data: what a command with `--json` prints in place of its result."""
        plain = self.value is None or isinstance(self.value, (bool, int, float, str, list, tuple))
        return {
            "type": self.kind,
            "message": one_line(" ".join(self.message.split())),
            "hint": self.hint,
            "parameter": self.option,
            "value": self.value if plain else str(self.value),
        }


def describe_error(error: Exception) -> ErrorReport:
    """Return how an error is told, whatever ended a command."""
    kind, code = type(error).__name__, 1
    # Ctrl-C may be behind an error, as when it comes while Python makes a class
    behind: BaseException | None = error
    while behind is not None and not isinstance(behind, KeyboardInterrupt):
        behind = behind.__cause__
    if isinstance(error, CalibError):
        hint = None if error.hint is None else as_typed(error.hint)
        # clocks that no offset brings together are an answer about the recording
        code = NO if kind == "ClockError" else 1
        option = option_of(error.parameter)
        return ErrorReport(kind, as_typed(error.message), code, hint, option, error.value)
    if isinstance(error, typer.Abort) or behind is not None or received() is not None:
        text, code = "interrupted", received() or INTERRUPTED
    elif hasattr(error, "format_message"):  # an error of usage, told by Typer
        context = getattr(error, "ctx", None)
        help_line = f" (see {context.command_path} --help)" if context else ""
        text = error.format_message().rstrip(".") + help_line
        code = int(getattr(error, "exit_code", USAGE))
        kind = "UsageError" if code == USAGE else kind
    elif isinstance(error, OSError):
        text = f"{f'{error.filename}: ' if error.filename else ''}{error.strerror or error}"
    elif isinstance(error, ImportError):
        text = f"{error}; install calib-arm again, with all that it requires"
    else:
        told = f"internal error, {kind}: {error}; {_TRACEBACK}=1 shows where, please report it"
        # NumPy has a MemoryError of its own
        text = next((known for kinds, known in _LIMITS if isinstance(error, kinds)), told)
    option, value = getattr(error, "option", None), getattr(error, "value", None)
    return ErrorReport(kind, text, code, option=option, value=value)


_LIMITS = (
    (MemoryError, "not enough memory; use a smaller --size or fewer --samples"),
    (RecursionError, "the input is nested too deeply; simplify it"),
)


def _reader_left() -> int:
    silence(sys.stdout)
    return 0


def _print_version(wanted: bool) -> None:
    if wanted:
        import calib

        tell(f"calib {calib.__version__}")
        raise typer.Exit


app = typer.Typer(
    cls=CalibGroup,
    add_completion=False,
    # Click wraps help at 80 columns otherwise, wherever it is printed
    context_settings={"max_content_width": 100},
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # Rich takes longer to import than most commands run
)


@app.callback()
def start(
    context: typer.Context,
    _version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Calibrate a robot arm from its own motions, with self-organizing maps.

    Start with: calib train two_link, then calib query inverse two_link.calib 0.1 0.4
    """
    if context.invoked_subcommand is None:
        print(context.get_help())
