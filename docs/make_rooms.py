"""Draw the rooms of the code and the imports between them, from the code's own imports.

    python docs/make_rooms.py          writes docs/rooms.svg
    python docs/make_rooms.py --list   prints every import that runs up, for types too

The order of the rooms is that of the data: from a URDF to a command.  A room imports from
rooms above it in this list; imports for type checkers alone are no arrows.
"""

from __future__ import annotations

import argparse
import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent

ROOMS = (
    ("common", "errors, files, scales, checks, threads, words"),
    ("arm", "from a URDF to kinematics"),
    ("samples", "what the arm did and the sensor saw"),
    ("body", "chain, view, curves; fit, gate, posterior"),
    ("maps", "lattices, gains, links, readouts, local models"),
    ("kernel", "a model as C: its source, compiled"),
    ("inverse", "from positions to joints: starts, Newton, branches"),
    ("model", "what was learned, and its answers"),
    ("model_file", "how a model is kept"),
    ("training", "from samples to a model, and its errors"),
    ("recording", "pictures and clocks to a log"),
    ("stream", "maps that follow a stream"),
    ("change", "judge a log: check, adapt"),
    ("use", "evaluate, monitor, recognise, correct, plan, URDF, C"),
    ("show", "figures, preview, report"),
    ("paper", "the paper's tables, figures, experiments"),
    ("cli", "the command line"),
)

DOORS = ("calib/model/model.py:", "calib/maps/map.py:", "calib/maps/association.py:")
"""Files whose `save` and the like call a room above when they are called."""

WIDTH, ROW, LEFT = 860, 34, 300


def room_of(module: str) -> str | None:
    """The room of a module of the package or of the command line."""
    parts = module.split(".")
    if parts[0] in ("cli", "calib_cli"):
        return "cli"
    if parts[0] != "calib" or len(parts) == 1:
        return None
    return "common" if parts[1] == "errors" else parts[1]


def imports(path: Path, *, types: bool = False) -> Iterator[tuple[str, int]]:
    """Modules that a file imports when it runs, or also for `types`, with their lines."""
    return ((name, line) for name, line, runs in all_imports(path) if runs or types)


@cache
def all_imports(path: Path) -> list[tuple[str, int, bool]]:
    """Modules that a file imports, their lines, and whether when it runs or for types alone."""
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    package = module.split(".")[:-1]
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    typing_only = set()
    found: list[tuple[str, int, bool]] = []
    for node in nodes:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            typing_only |= {id(inner) for inner in ast.walk(node)}
    for node in nodes:
        runs = id(node) not in typing_only
        if isinstance(node, ast.Import):
            found += ((alias.name, node.lineno, runs) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            name = ".".join([*base, *([node.module] if node.module else [])])
            if node.module is None or name in ("calib", "cli"):
                found += ((f"{name}.{alias.name}", node.lineno, runs) for alias in node.names)
            else:
                found.append((name, node.lineno, runs))
    return found


def arrows(*, types: bool = False) -> Iterator[tuple[str, str, str]]:
    """(importing room, imported room, where) of every import between rooms."""
    files = [*sorted((ROOT / "calib").rglob("*.py")), *sorted((ROOT / "cli").rglob("*.py"))]
    for path in files:
        here = room_of(".".join(path.relative_to(ROOT).with_suffix("").parts))
        if here is None or path == ROOT / "calib" / "__init__.py":
            continue
        for module, line in imports(path, types=types):
            there = room_of(module)
            if there is not None and there != here and there in {name for name, _ in ROOMS}:
                yield here, there, f"{path.relative_to(ROOT)}:{line} imports {module}"


def running_up() -> list[str]:
    """Imports of a room from one that comes later, those for types included."""
    place = {name: k for k, (name, _) in enumerate(ROOMS)}
    return [
        where
        for here, there, where in arrows(types=True)
        if place[there] > place[here] and not where.startswith(DOORS)
    ]


def picture() -> str:
    """The rooms from top to bottom, and an arc for each pair that imports."""
    place = {name: k for k, (name, _) in enumerate(ROOMS)}
    pairs = sorted({(here, there) for here, there, _ in arrows()})
    height = ROW * len(ROOMS) + 20
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        f'font-family="sans-serif" font-size="13">',
        "<style>rect{fill:#f1f3f5;stroke:#868e96}text{fill:#212529}.note{fill:#495057}"
        "path{fill:none;stroke:#1c7ed6;stroke-opacity:.45}</style>",
        f'<rect x="0" y="0" width="{WIDTH}" height="{height}" style="fill:#ffffff;stroke:none"/>',
    ]
    for here, there in pairs:
        a, b = (ROW * place[name] + ROW / 2 + 10 for name in (here, there))
        reach = LEFT - 150 - 10 * abs(place[here] - place[there])
        parts.append(
            f'<path d="M {LEFT - 110} {a:.0f} C {reach} {a:.0f} {reach} {b:.0f} {LEFT - 110} '
            f'{b:.0f}"><title>{here} imports {there}</title></path>'
        )
    for k, (name, job) in enumerate(ROOMS):
        y = ROW * k + 10
        parts.append(f'<rect x="{LEFT - 110}" y="{y + 3}" width="110" height="{ROW - 6}" rx="4"/>')
        parts.append(
            f'<text x="{LEFT - 55}" y="{y + ROW / 2 + 5}" text-anchor="middle">{name}</text>'
        )
        parts.append(f'<text class="note" x="{LEFT + 14}" y="{y + ROW / 2 + 5}">{job}</text>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def main() -> None:
    """Write the picture, or list what runs up."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--list", action="store_true")
    if parser.parse_args().list:
        sys.stdout.write("\n".join(running_up()) + "\n")
        return
    (ROOT / "docs" / "rooms.svg").write_text(picture(), encoding="utf-8")


if __name__ == "__main__":
    main()
