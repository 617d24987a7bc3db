"""The application: every command, found by the name of its file in `commands`.

Exit codes: 0 done, 1 an error, 2 wrong usage, 3 a result that a script should act on, 130
interrupted.
"""

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Annotated

import typer

from . import commands
from . import options as opt
from .errors import INTERRUPTED, TRACEBACK, report_error
from .output import EXIT_ACT, PRINT_MODE, Outcome, note, silence
from .parsing import BadOption

INPUTS = (
    *("robot", "data", "input_", "joints_file", "poses_file", "tags_at"),
    *("calibration", "lerobot", "bag", "lens"),
)
"""Parameters whose files no output may replace; a model may replace a model."""

OUTPUTS = ("output", "transform", "picture", "html", "ur", "mjcf")
"""Parameters whose files are written."""

ONCE = ("--data", "--input", "--joints-file", "--poses-file")
"""Files that a command reads one of; `calib train` takes the data of several sensors."""

FLAGS = ("--json", "--verbose", "-v", "--quiet", "-q")
"""Options of every command, anywhere in the line."""

ALL = "*"
"""In place of a command's name: all commands with their options."""

USAGE_ORDER = (
    "robots plan train query evaluate check adapt recognise correct urdf export babble log "
    "noise handeye lerobot tag preview report reproduce info"
)
"""Commands in the order of their use, for `calib --help`; others follow."""


def run(arguments: Sequence[str]) -> int:
    """Run a command line and return its exit code; errors are one line on standard error."""
    words = _flags_first(arguments)
    name = next((word for word in words if not word.startswith("-")), "")
    try:
        if name != "train":
            _refuse_repeats(words)
        code = application(name)(
            words, prog_name="calib", standalone_mode=False
        )
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit) as end:
        # a reader has seen enough: of its help Typer ends with 1, a signal with another code
        if getattr(end, "code", 1) != 1:
            raise
        silence(sys.stdout)
        return 0
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        return report_error(error, as_json="--json" in arguments)
    if code == INTERRUPTED:
        note("error: interrupted")
    return code if isinstance(code, int) else 0


def _flags_first(arguments: Sequence[str]) -> list[str]:
    """Return a command line with the flags of every command before the command's name."""
    words = list(arguments)
    end = words.index("--") if "--" in words else len(words)
    flags = [word for word in words[:end] if word in FLAGS]
    others = [word for word in words[:end] if word not in FLAGS]
    return [*flags, *others, *words[end:]]


def _refuse_repeats(words: Sequence[str]) -> None:
    """Refuse a second file where the last one alone would be read."""
    options = [word.partition("=")[0] for word in words]
    for option in ONCE:
        if options.count(option) > 1:
            raise BadOption(
                f"{option} is given {options.count(option)} times: expected one file; run the "
                "command once for each"
            )


@cache
def application(name: str = ALL) -> typer.Typer:
    """Return the command line, where the command `name` alone, or all, can be run.

    The others are listed: to read their options takes a tenth of a second.
    """
    app = _group(start.__doc__)
    app.callback(invoke_without_command=True)(start)
    names = _names_in(commands)
    in_use = [command for command in USAGE_ORDER.split() if command in names]
    for command in dict.fromkeys([*in_use, *names]):
        path = f"{commands.__name__}.{command}"
        if name in (ALL, command):
            _add(app, path)
        else:
            _list(app, path)
    return app


def _names_in(package: ModuleType) -> list[str]:
    """Return the names of a package's modules, by the alphabet."""
    entries = Path(package.__path__[0]).iterdir()
    return sorted(p.stem for p in entries if not p.name.startswith(("_", ".")))


def _group(help_text: str | None) -> typer.Typer:
    """Return a group without commands; plain help, since Rich takes longer to import."""
    return typer.Typer(
        help=help_text,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        # help is wrapped at 80 columns otherwise, wherever it is printed
        context_settings={"max_content_width": 100},
    )


def _list(app: typer.Typer, path: str) -> None:
    """Add a command that is listed alone, by the docstring of its module."""
    # read without the module's imports
    source = Path(str(getattr(find_spec(path), "origin", "")))
    help_text = source.read_text(encoding="utf-8").split('"""')[1]
    name = path.rpartition(".")[2]
    register = app.command(name, help=help_text, short_help=_summary(help_text))
    register(_not_loaded)


def _add(app: typer.Typer, path: str) -> None:
    """Add the command of a module, or the group of a package's commands."""
    name = path.rpartition(".")[2]
    module = import_module(path)
    group = _group(module.__doc__)
    if hasattr(module, "__path__"):
        for entry in _names_in(module):
            _add(group, f"{path}.{entry}")
        app.add_typer(group, name=name)
        return
    register = group.command(
        name,
        help=module.__doc__,
        short_help=_summary(module.__doc__ or ""),
        epilog="And --json, --verbose (-v), --quiet (-q), as every command.",
        # a negative number is a value, not an option
        context_settings={"ignore_unknown_options": hasattr(module, "NUMBERS")},
    )
    register(_printing(getattr(module, name)))
    # in a nameless group: Typer lists commands before groups otherwise
    app.add_typer(group)


def _summary(help_text: str) -> str:
    return help_text.split("\n\n")[0].strip()


def _not_loaded() -> None:
    """Represent a command that is only listed."""


def _printing(command: Callable[..., Outcome]) -> Callable[..., None]:
    """Return a command that prints its outcome."""

    @wraps(command)  # Typer reads the parameters of the command itself
    def run_and_print(**options: object) -> None:
        streamed = options.get("output") == "-"
        if PRINT_MODE.as_json and streamed:
            raise BadOption(
                "--json and '-' both want standard output: expected one of them"
            )
        _keep_inputs(options)
        outcome = command(**options)
        try:
            outcome.show(streamed=streamed)
            sys.stdout.flush()
        except BrokenPipeError:  # a reader who has seen enough
            silence(sys.stdout)
        raise typer.Exit(EXIT_ACT if outcome.warnings else outcome.code)

    return run_and_print


def _keep_inputs(options: Mapping[str, object]) -> None:
    """Refuse an output that is a file which the command reads, such as the user's log."""
    outputs = {
        Path(str(options[name])).resolve(): name
        for name in OUTPUTS
        if options.get(name) and Path(str(options[name])).exists()
    }
    for name in INPUTS if outputs else ():
        typed = options.get(name)
        for path in typed if isinstance(typed, list) else [typed]:
            # by another name, too: ./log.csv is log.csv
            option = outputs.get(Path(str(path)).resolve())
            if option is not None:
                raise BadOption(
                    f"--{option} {options[option]!r} would replace what is read: expected another "
                    "file"
                )


def start(
    context: typer.Context,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.")
    ] = False,
) -> None:
    """Calibrate a robot arm from its own motions, with self-organizing maps.

    Start with: calib train two_link, then calib query inverse two_link.calib 0.1 0.4
    """
    PRINT_MODE.start(as_json, verbose, quiet)
    if version:
        import calib

        print(f"calib {calib.__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())
