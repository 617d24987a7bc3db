"""Write the reference of the command line from the program itself.

python docs/make_cli.py                 # writes docs/cli.md
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import typer
from calib_cli.app import application

PAGE = Path(__file__).parent / "cli.md"
SHOWN = ("help",)
INTRODUCTION = """\
# Command line

Written by `python docs/make_cli.py`; edit the program, not this page.

Results go to standard output; notes, warnings and progress to standard error. Files, JSON documents
and typed values are in rad, m and s; joint values are in degrees with `--degrees`. Logs are read
with the unit and columns of the model's log. Tables for people print mm and degrees and say so.
A negative number is an ordinary argument: `calib query inverse m.calib -0.1 0.3`.

Every command takes `--json` (one document in SI units), `--verbose` or `-v` and `--quiet` or `-q`.

## Exit codes

| exit code | meaning |
|---:|---|
| 0 | done |
| 1 | an error, printed in one line on standard error: the value, what was expected, what to do |
| 2 | the command was typed wrongly: an unknown option, a value that cannot be read |
| 3 | the command ran, and its result is one that a script should act on |
| 130 | interrupted with Ctrl-C; no incomplete file is left |

## Errors as JSON

With `--json` a failure prints one object on standard output too:

```text
{"error": {"type": "RobotError", "message": "...", "hint": "...", "parameter": "--joints",
           "value": "elbw"}}
```

`type` is the class of the error in Python, or `UsageError` for exit code 2; `hint` (what to
do), `parameter` (the option) and `value` may be `null`.
"""


def commands(command: Any, words: tuple[str, ...] = ("calib",)) -> Iterator[tuple[str, Any]]:
    """Yield every command that does something, with the words that call it."""
    if not hasattr(command, "commands"):
        yield " ".join(words), command
        return
    context = typer.Context(command)
    for name in command.list_commands(context):
        yield from commands(command.get_command(context, name), (*words, name))


def form(parameter: Any) -> str:
    """Return how a value is typed: its form, or the words that it may be."""
    return parameter.metavar or "|".join(get_args(parameter.type_descriptor.annotation))


def usage(name: str, command: Any) -> str:
    """Return one line: the command, what must be given, what may be."""
    words = [name]
    for parameter in command.params:
        if parameter.param_type_name == "argument":
            shown = form(parameter)
            words.append(shown if parameter.required else f"[{shown}]")
    words += [
        f"{parameter.opts[0]} {form(parameter)}"
        for parameter in command.params
        if parameter.param_type_name == "option" and parameter.required
    ]
    optional = any(p.param_type_name == "option" and not p.required for p in command.params)
    return " ".join([*words, "[OPTIONS]"] if optional else words)


def row(parameter: Any) -> str:
    """Return a line of a list: how it is typed, what it does, its default."""
    if parameter.param_type_name == "argument":
        typed = f"`{form(parameter)}`"
    else:
        names = sorted(parameter.opts, key=len, reverse=True)
        value = "" if parameter.is_flag else f" {form(parameter)}"
        typed = ", ".join([f"`{names[0]}{value}`", *(f"`{name}`" for name in names[1:])])
    text = parameter.help
    if (
        not parameter.required
        and "(default" not in text
        and not getattr(parameter, "is_flag", False)
        and parameter.default not in (None, (), [])
    ):
        text += f" Default `{parameter.default}`."
    if getattr(parameter, "multiple", False) and "repeatable" not in text:
        text += " Repeatable."
    return f"- {typed}: {text}"


def section(name: str, command: Any, shared: set[str]) -> str:
    """Return the chapter of one command; options that others share are named alone."""
    paragraphs = [" ".join(part.split()) for part in (command.help or "").split("\n\n")]
    lines = [f"## {name}", "", *_spaced(paragraphs), "```text", usage(name, command), "```", ""]
    own = [parameter for parameter in command.params if parameter.name not in SHOWN]
    rows = [row(parameter) for parameter in own if row(parameter) not in shared]
    if rows:
        lines += [*rows, ""]
    names = [
        row(parameter).split("`")[1].split()[0] for parameter in own if row(parameter) in shared
    ]
    if names:
        shown = ", ".join(f"`{name}`" for name in names)
        lines += [f"[Shared](#shared-options): {shown}.", ""]
    return "\n".join(lines)


def page() -> str:
    """Return the whole page."""
    program = typer.main.get_command(application())
    every = list(commands(program))
    every_row = Counter(
        row(parameter)
        for _, command in every
        for parameter in command.params
        if parameter.name not in SHOWN
    )
    named: dict[str, str] = {}
    for text, count in every_row.most_common():
        if count > 1:  # of an option with two meanings the rarer one stays with its commands
            named.setdefault(text.split()[1].strip("`:"), text)
    shared = set(named.values())
    parts = [
        INTRODUCTION,
        "`calib --version` prints the version; `--help` after any command prints its part of "
        "this page.\n",
        "## Shared options\n",
        "\n".join([*sorted(shared), ""]),
        *(section(name, command, shared) for name, command in every),
    ]
    return "\n".join(parts)


def _spaced(paragraphs: list[str]) -> list[str]:
    return [line for paragraph in paragraphs for line in (paragraph, "")]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
