"""The application: every command, found by the name of its file in `commands`.

Exit codes: 0 done, 1 an error, 2 wrong usage, 3 a result that a script should act on, 130
interrupted.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache, wraps
from importlib import import_module
from pkgutil import ModuleInfo, iter_modules
from types import ModuleType
from typing import Annotated

import typer

from . import commands
from .errors import INTERRUPTED, TRACEBACK, report_error
from .output import Outcome, note, silence, start_speaking
from .parsing import BadOption

USAGE_ORDER = (
    *(
        "robots",
        "plan",
        "train",
        "query",
        "evaluate",
        "sweep",
        "check",
        "adapt",
        "recognise",
    ),
    *(
        "correct",
        "urdf",
        "export",
        "babble",
        "log",
        "noise",
        "handeye",
        "lerobot",
        "tag",
        "preview",
        "report",
    ),
    *("reproduce", "info"),
)
"""Commands in the order of their use, for `calib --help`; others follow."""


def run(arguments: Sequence[str]) -> int:
    """Run a command line and return its exit code; errors are one line on standard error."""
    first = next((word for word in arguments if not word.startswith("-")), None)
    try:
        code = application(first)(
            list(arguments), prog_name="calib", standalone_mode=False
        )
        sys.stdout.flush()
    except BrokenPipeError:  # a reader who has seen enough
        silence(sys.stdout)
        return 0
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        return report_error(error, as_json="--json" in arguments)
    if code == INTERRUPTED:
        note("error: interrupted")
    return code if isinstance(code, int) else 0


@cache
def application(name: str | None = None) -> typer.Typer:
    """Return the command line with one command, or with all where none has that name.

    One alone, since all take a tenth of a second to make.
    """
    app = new_group(start.__doc__)
    app.callback(invoke_without_command=True)(start)
    modules = sorted(iter_modules(commands.__path__), key=_place)
    named = [module for module in modules if module.name == name]
    add_commands(app, commands, named or modules)
    return app


def new_group(help_text: str | None) -> typer.Typer:
    """Return a group without commands; plain help, since Rich takes longer to import."""
    return typer.Typer(
        help=help_text,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        # help is wrapped at 80 columns otherwise, wherever it is printed
        context_settings={"max_content_width": 100},
    )


def add_commands(
    group: typer.Typer, package: ModuleType, entries: Iterable[ModuleInfo]
) -> None:
    """Add modules of a package, each as a command, and packages in it, each as a group."""
    for entry in entries:
        module = import_module(f"{package.__name__}.{entry.name}")
        inner = new_group(module.__doc__)
        if entry.ispkg:
            add_commands(inner, module, iter_modules(module.__path__))
            group.add_typer(inner, name=entry.name)
            continue
        command = getattr(module, entry.name)
        register = inner.command(
            entry.name,
            short_help=_first_paragraph(command),
            context_settings=getattr(module, "CONTEXT_SETTINGS", None),
        )
        register(printing(command))
        # each in a nameless group: Typer lists commands before groups otherwise
        group.add_typer(inner)


def _first_paragraph(command: Callable[..., Outcome]) -> str:
    return (command.__doc__ or "").split("\n\n")[0].strip()


def _place(module: ModuleInfo) -> tuple[int, str]:
    name = module.name
    return (USAGE_ORDER.index(name) if name in USAGE_ORDER else len(USAGE_ORDER), name)


def printing(command: Callable[..., Outcome]) -> Callable[..., None]:
    """Return a command that prints its outcome, as --json, --verbose and --quiet say."""

    @wraps(command)  # Typer reads the parameters of the command itself
    def run_and_print(**options: object) -> None:
        as_json = bool(options["as_json"])
        streamed = options.get("output") == "-"
        if as_json and streamed:
            raise BadOption(
                "--json and '-' both want standard output: expected one of them"
            )
        start_speaking(quiet=bool(options["quiet"]))
        outcome = command(**options)
        outcome.show(
            as_json=as_json, verbose=bool(options["verbose"]), streamed=streamed
        )
        raise typer.Exit(outcome.code)

    return run_and_print


def start(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.")
    ] = False,
) -> None:
    """Calibrate a robot arm from its own motions, with self-organizing maps.

    Start with: calib train two_link, then calib query inverse two_link.calib 0.1 0.4
    """
    if version:
        import calib

        print(f"calib {calib.__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())
