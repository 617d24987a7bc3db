"""Write the reference of the Python interface from the docstrings.

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

Everything here is `calib.NAME`; `help(calib.NAME)` has examples and errors too.
Joint values are in rad or m, positions in m or, for a log, in
the log's unit, written `[unit]`; `n` rows are `(n, dof)` and `(n, 2)` arrays, and single vectors
`(dof,)` and `(2,)` work as well. Arrays of results are read-only where they are part of a model.
Equations are those of the [paper](paper.md#what-stands-where).
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
    "Sweeps": ("sweep", "Sweep", "Trial"),
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
    return _EQUATION.sub(r"[\1](paper.md#what-stands-where)", text)


def signature(name: str, function: Callable[..., Any]) -> str:
    """Return a call with its defaults; the types are told below it."""
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


def body(doc: str) -> Iterator[str]:
    """Yield a docstring's first paragraph and its lists as Markdown."""
    for name, lines in sections(doc).items():
        if name == "":
            for paragraph in "\n".join(lines).strip().split("\n\n")[:1]:
                if paragraph.strip():
                    yield inline(" ".join(paragraph.split()))
                    yield ""
        elif name not in ("Examples", "Notes", "Raises"):  # help() shows these
            yield f"**{name}**"
            yield ""
            yield from entries(name, lines)
            yield ""


def entries(section: str, lines: list[str]) -> Iterator[str]:
    """Yield one list item for each parameter, attribute, result or error."""
    for head, text in items(lines):
        names, _, kind = head.partition(" : ")
        if section in ("Returns", "Yields") and not kind:
            names, kind = "", names
        label = ", ".join(f"`{name.strip()}`" for name in names.split(",") if name.strip())
        parts = [part for part in (label, inline(kind)) if part]
        yield f"- {', '.join(parts)}{': ' if text else ''}{inline(text)}"


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


def chapter(name: str) -> Iterator[str]:
    """Yield the text about one public name."""
    thing = getattr(calib, name)
    doc = _doc(thing)
    yield f"### {name}"
    yield ""
    if inspect.isclass(thing) and issubclass(thing, Exception):
        yield from body(doc)
        return
    if not inspect.isclass(thing) or "Parameters" in sections(doc) or name in MADE_BY_USERS:
        yield "```text"
        yield signature(f"calib.{name}", thing)
        yield "```"
        yield ""
    if name in BRIEF:
        yield inline(" ".join(doc.split("\n\n", maxsplit=1)[0].split()))
        yield ""
        return
    yield from body(doc)
    if inspect.isclass(thing):
        for written, text in members(thing):
            if name in ASKED:
                yield f"#### `{written}`"
                yield ""
                yield from body(text)
            else:
                first = text.split("\n\n", maxsplit=1)[0]
                yield f"- `{written}`: {inline(' '.join(first.split()))}"
        yield ""


#: Classes that users make themselves; the others come out of functions.
MADE_BY_USERS = ("SOM", "Samples", "Simulation")


#: Classes that few users look into: `help()` has all of them.
BRIEF = ("Map", "Association", "Visit", "Trial", "Simulation", "Path")


#: Classes whose methods are told in full, those of the others in a line.
ASKED = ("Model",)


def page() -> str:
    """Return the whole page."""
    parts = [(title, names) for title, names in chapters(calib.__all__[1:]) if names]
    lines = []
    for title, names in parts:
        lines += [f"## {title}", ""]
        for name in names:
            lines += chapter(name)
    place = anchors(lines)
    overview = [
        f"- {title}: " + ", ".join(f"[`{name}`](#{place[f'### {name}']})" for name in names)
        for title, names in parts
    ]
    text = "\n".join([INTRODUCTION, *overview, "", *lines])
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def anchors(lines: Iterable[str]) -> dict[str, str]:
    """Return the anchor that GitHub gives each heading; a second one alike gets a number."""
    found: dict[str, str] = {}
    for line in lines:
        if line.startswith("#"):
            plain = re.sub(r"[^\w\- ]", "", line.lstrip("#").strip().lower()).replace(" ", "-")
            same = sum(
                re.fullmatch(rf"{plain}(-\d+)?", other) is not None for other in found.values()
            )
            found.setdefault(line, f"{plain}-{same}" if same else plain)
    return found


def _doc(thing: Any) -> str:
    text = inspect.getdoc(thing)
    if not text:
        raise SystemExit(f"{thing!r} has no docstring")
    return text


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
