"""Write the index of the Python interface from the docstrings.

python docs/make_api.py                 # writes docs/api.md
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import calib

PAGE = Path(__file__).parent / "api.md"
INTRODUCTION = """\
# Python interface

Written by `python docs/make_api.py` from the docstrings; edit those, not this page.

An index of `calib.NAME`. `help(calib.NAME)` has parameters, attributes, examples and errors.
Joint values are in rad or m, positions in m or, for a log, in its unit, written `[unit]`. Rows are
`(n, dof)` and `(n, 2)` arrays; single vectors `(dof,)` and `(2,)` work as well. Arrays of a model
are read-only. Equations are those of the [paper](paper.md#where-each-equation-is).
"""
#: Chapters in the order of use; what is not named here comes last.
CHAPTERS = {
    "Arms": ("load_arm", "list_robots", "PlanarArm"),
    "Samples": ("babble", "read_log", "write_log", "Samples", "Simulation", "plan", "Plan"),
    "Models": (
        "train",
        "TrainingOptions",
        "load",
        "Model",
        "Answer",
        "Path",
        "evaluate",
        "Evaluation",
    ),
    "Pages": ("report", "preview", "figures", "Preview"),
    "Drift and re-calibration": ("check", "Verdict", "Monitor", "adapt", "Adaptation"),
    "Maps": ("SOM", "Map", "Association", "Visit"),
    "Errors": ("CalibError", "RobotError", "LogError", "OptionError", "ModelError", "QueryError"),
}
_UNDERLINE = re.compile(r"^-{3,}$")
_ROLE = re.compile(r":\w+:`~?([^`]+)`")
_LITERAL = re.compile(r"``([^`]+)``")
_EQUATION = re.compile(r"\b(eq\. \d+(?:(?: to |, | and )\d+)*)")


def chapters(names: Iterable[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield the chapters with those of their names that exist, and then all other names."""
    left = list(names)
    for title, wanted in CHAPTERS.items():
        found = [name for name in wanted if name in left]
        left = [name for name in left if name not in found]
        yield title, found
    if left:
        yield "More", left


def sections(doc: str) -> dict[str, list[str]]:
    """Split a docstring into its underlined sections; the text before them has no name."""
    parts: dict[str, list[str]] = {"": []}
    lines, name = doc.splitlines(), ""
    for here, below in zip(lines, [*lines[1:], ""], strict=True):
        if _UNDERLINE.match(below.strip()) and here.strip():
            name = here.strip()
            parts[name] = []
        elif not _UNDERLINE.match(here.strip()):
            parts[name].append(here)
    return parts


def items(lines: list[str]) -> Iterator[tuple[str, str]]:
    """Yield what stands at the margin, with the indented text below it in one line."""
    head, text = "", [""]
    for line in [*lines, "end"]:
        if line and not line.startswith(" "):
            if head:
                yield head, " ".join(" ".join(text).split())
            head, text = line.strip(), []
        else:
            text.append(line)


def inline(text: str) -> str:
    """Turn reStructuredText within a line into Markdown, and link the equations."""
    text = _ROLE.sub(lambda found: f"`{found[1].rsplit('.', 1)[-1]}`", text)
    text = _LITERAL.sub(r"`\1`", text)
    return _EQUATION.sub(r"[\1](paper.md#where-each-equation-is)", text)


def signature(name: str, function: Callable[..., Any]) -> str:
    """Return a call with its defaults; `help()` has the types."""
    shown, starred = [], False
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name == "self":
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not starred:
            shown.append("*")
            starred = True
        default = parameter.default
        factory = default is not parameter.empty and repr(default) == "<factory>"
        written = "" if default is parameter.empty else f"={'...' if factory else repr(default)}"
        shown.append(parameter.name + written)
    return f"{name}({', '.join(shown)})"


def first_sentence(doc: str) -> str:
    """Return the first sentence of a docstring as Markdown."""
    paragraph = " ".join(doc.split("\n\n", maxsplit=1)[0].split())
    return inline(sentence(paragraph))


def sentence(text: str) -> str:
    """Return the text up to its first full stop before a capital letter."""
    return re.split(r"(?<=[a-z\])`]\.) (?=[A-Z`])", text, maxsplit=1)[0]


def parameters(doc: str) -> Iterator[str]:
    """Yield one list item for each parameter that a docstring describes."""
    for head, text in items(sections(doc).get("Parameters", [])):
        names, _, kind = head.partition(" : ")
        label = ", ".join(f"`{name.strip()}`" for name in names.split(","))
        kind = kind.replace(", optional", "")
        yield f"  - {label} ({inline(kind)}){': ' if text else ''}{inline(sentence(text))}"


def members(kind: type) -> Iterator[tuple[str, str]]:
    """Yield how each public method and property of a class is written, and its docstring.

    Those that it inherits from a class of calib without a chapter of its own are its too.
    """
    parts = [c for c in kind.__mro__ if c.__module__.split(".")[0] == "calib"]
    own = [c for c in parts if c is kind or c.__name__ not in calib.__all__]
    found: dict[str, Any] = {}
    for part in own:
        found = {**found, **{n: v for n, v in vars(part).items() if n not in found}}
    for name, value in found.items():
        if name.startswith("_"):
            continue
        if isinstance(value, (classmethod, staticmethod)):
            yield signature(f"{kind.__name__}.{name}", getattr(kind, name)), _doc(value.__func__)
        elif inspect.isfunction(value):
            yield signature(f".{name}", value), _doc(value)
        elif isinstance(value, (property, cached_property)):
            yield f".{name}", _doc(value)


def entry(name: str) -> Iterator[str]:
    """Yield the list items about one public name."""
    thing = getattr(calib, name)
    doc = _doc(thing)
    if inspect.isclass(thing) and name not in MADE_BY_USERS:
        written = name
    else:
        written = signature(name, thing)
    yield f"- `{written}`: {first_sentence(doc)}"
    if name in EXPLAINED:
        yield from parameters(doc)
    if inspect.isclass(thing) and name in WITH_METHODS:
        properties = []
        for method, text in members(thing):
            if "(" in method:
                yield f"  - `{method}`: {first_sentence(text)}"
            else:
                properties.append(f"`{method}`")
        if properties:
            yield f"  - properties {', '.join(properties)}"


#: Classes that users make themselves; the others come out of functions.
MADE_BY_USERS = ("SOM", "Samples", "Simulation", "TrainingOptions")


#: Names whose parameters the page lists: the functions of the main job.
EXPLAINED = ("load_arm", "plan", "train", "adapt", "correct")


#: Classes whose methods the page lists.
WITH_METHODS = ("PlanarArm", "Model", "Monitor", "SOM")


def page() -> str:
    """Return the whole page."""
    lines = []
    for title, names in chapters(calib.__all__[1:]):
        if names:
            lines += [f"## {title}", ""]
            for name in names:
                lines += entry(name)
            lines.append("")
    return "\n".join([INTRODUCTION, *lines]).rstrip() + "\n"


def _doc(thing: Any) -> str:
    text = inspect.getdoc(thing)
    if not text:
        raise SystemExit(f"{thing!r} has no docstring")
    return text


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
