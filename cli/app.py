"""The application: its commands, and the one place where errors become lines.

A command line imports the module of the command that it runs, no other. Exit codes: 0 done, 1 an
error, 2 wrong usage, 3 a result that a script should act on, 130 interrupted.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from calib.common.wording import one_line
from calib.errors import CalibError

from .output import NO, as_typed, note, option_of, print_json, rendered, silence

COMMANDS = {
    "robots": "List the bundled robots.",
    "plan": "Plan poses to measure: well spread, within the limits.",
    "train": "Learn a model from simulated babbling or from a measured log.",
    "query": "Ask a model for positions or for joint values.",
    "evaluate": "Print the errors of a model, on fresh samples or on a log.",
    "sweep": "Train with every combination of options, on all cores.",
    "check": "Compare a model with new samples: is it still calibrated?",
    "adapt": "Re-calibrate a model from a few new samples.",
    "recognise": "Tell which of some models the arm is in.",
    "correct": "Correct joint values so that the real arm goes where they lead.",
    "urdf": "Write a copy of the URDF with what the model has learned.",
    "export": "Write a model as one C99 header for controllers without Python.",
    "babble": "Write a log of simulated babbling [rad, m].",
    "log": "Turn a ROS bag, pictures or a video into a log.",
    "handeye": "Find the camera in the hand, or before it, from pictures of a board.",
    "tag": "Write a tag for the arm's tip, or a board for the desk.",
    "preview": "Show the arm and its learned maps in a browser.",
    "report": "Write figures and tables that explain a calibration.",
    "reproduce": "Repeat the paper's tables, figures and adaptation.",
    "info": "Show what a model is and how it was made.",
}
"""What the command line can do, in the order of its use, and what `calib --help` says of it."""

QUERIES = ("forward", "inverse", "path")
_TOGETHER = {
    "info": "robots evaluate",
    "query": "forward path correct",
    "many": "sweep reproduce",
    "files": "urdf export preview report",
    "train": "plan babble",
    "drift": "check adapt recognise",
    "recording": "log handeye tag",
}
"""Commands of one module, where it does not have the command's name."""
_MODULE = {name: module for module, names in _TOGETHER.items() for name in names.split()}

USAGE, INTERRUPTED = 2, 130
_TRACEBACK = "CALIB_TRACEBACK"
# Rich takes longer to import than most commands run
_PLAIN: dict[str, Any] = {"add_completion": False, "rich_markup_mode": None}


@cache
def load_command(name: str) -> Any:
    """Import the module of a command, and return its command."""
    made = typer.Typer(**_PLAIN, help=COMMANDS[name])
    for part in QUERIES if name == "query" else (name,):
        command = getattr(import_module(f".commands.{_MODULE.get(part, part)}", __package__), part)
        # -0.1 is a number, not an option
        numbers = {"ignore_unknown_options": True} if part in ("forward", "inverse") else {}
        made.command(part, context_settings=numbers)(rendered(command))
    return get_command(made)


class CalibGroup(TyperGroup):
    """Commands whose errors are one line on standard error and an exit code."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        names: Any = dict.fromkeys(COMMANDS)  # alone, see `get_command`
        self.commands = names

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        """Import a command when it is asked for."""
        return load_command(cmd_name) if cmd_name in COMMANDS else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write what each command does, without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def main(  # type: ignore[override]
        self, args: Any = None, *, standalone_mode: bool = True, **more: Any
    ) -> Any:
        """Run a command line; see `typer.core.TyperGroup.main` for the parameters."""
        try:
            # not standalone: Typer would print its own errors in several lines and exit
            code = super().main(args, standalone_mode=False, **more)
            sys.stdout.flush()
            if code == INTERRUPTED:
                note("error: interrupted")
        except BrokenPipeError:  # a reader who has seen enough
            silence(sys.stdout)
            code = 0
        except Exception as error:
            if os.environ.get(_TRACEBACK):
                raise
            code, told = describe_error(error)
            try:
                if "--json" in (sys.argv[1:] if args is None else args):
                    print_json({"error": told})
                sys.stdout.flush()
            except OSError:  # a full disk, perhaps the error itself
                silence(sys.stdout)
            note("error: " + "; ".join(filter(None, (told["message"], told["hint"]))))
        code = code if isinstance(code, int) else 0
        if standalone_mode:
            sys.exit(code)
        return code


def describe_error(error: BaseException) -> tuple[int, dict[str, Any]]:
    """Return the exit code of what ended a command, and what is told of it as plain data."""
    kind, code, hint, option, value = type(error).__name__, 1, None, None, None
    if isinstance(error, CalibError):
        text, value = as_typed(error.message), error.value
        hint = None if error.hint is None else as_typed(error.hint)
        option = None if error.parameter is None else option_of(error.parameter)
        # clocks that no offset brings together are an answer about the recording
        code = NO if kind == "ClockError" else 1
    elif isinstance(error, KeyboardInterrupt) or isinstance(error.__cause__, KeyboardInterrupt):
        text, code = "interrupted", INTERRUPTED  # the latter while Python made a class
    elif hasattr(error, "format_message"):  # an error of usage, told by Typer
        context = getattr(error, "ctx", None)
        see = f" (see {context.command_path} --help)" if context else ""
        text = error.format_message().rstrip(".") + see
        code, kind = USAGE, "UsageError"
        option, value = getattr(error, "option", None), getattr(error, "value", None)
    elif isinstance(error, OSError):
        text = f"{f'{error.filename}: ' if error.filename else ''}{error.strerror or error}"
    elif isinstance(error, MemoryError):  # NumPy has one of its own
        text = "not enough memory; use a smaller --size or fewer --samples"
    else:
        text = f"internal error, {kind}: {error}; {_TRACEBACK}=1 shows where, please report it"
    text = one_line(" ".join(text.split()))
    told = {"type": kind, "message": text, "hint": hint, "parameter": option, "value": value}
    return code, told


app = typer.Typer(
    cls=CalibGroup,
    # Click wraps help at 80 columns otherwise, wherever it is printed
    context_settings={"max_content_width": 100},
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    **_PLAIN,
)


@app.callback()
def start(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Calibrate a robot arm from its own motions, with self-organizing maps.

    Start with: calib train two_link, then calib query inverse two_link.calib 0.1 0.4
    """
    if version:
        import calib

        print(f"calib {calib.__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())
