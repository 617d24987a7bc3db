"""The rooms of the code: imports run down, the picture shows them, and the style in figures."""

import ast
import graphlib
import io
import re
import tokenize
from pathlib import Path

import make_rooms
import pytest
from conftest import refused

import calib

ROOT = Path(__file__).parents[2]
FILES = [*(ROOT / "calib").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]
PARTICIPLES = {
    *("found", "told", "own", "known", "each", "asked", "given"),
    *("kept", "taken", "said", "seen", "left", "held"),
}
LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
MOST = {  # of a room; docstrings and comments do not count
    "tokens a line of code": 8.8,
    "assignments of several values at once, per 1,000 lines of code": 5,
    "uses of Any, per 1,000 lines of code": 4,
    "numbers as constants of a module, per 1,000 lines of code": 8,
    "participles, per 1,000 names": 4,
    "places that are not formatted": 0,
}


def test_no_import_runs_up_and_the_picture_is_the_one_that_imports_draw():
    assert make_rooms.running_up() == []
    assert (ROOT / "docs" / "rooms.svg").read_text() == make_rooms.picture()
    # every room is named, and none is missing
    found = {path.parent.name for path in (ROOT / "calib").glob("*/__init__.py")}
    found |= {path.stem for path in (ROOT / "calib").glob("*.py")} - {"__init__", "errors"}
    assert found == {name for name, _ in make_rooms.ROOMS} - {"cli"}


def test_no_two_files_know_each_other():
    graph = {  # modules of the package and the command line, and what each imports, for types too
        ".".join(path.relative_to(ROOT).with_suffix("").parts): {
            module for module, _ in make_rooms.imports(path, types=True)
        }
        for path in FILES
        if path.name != "__init__.py"
    }
    assert len(graph) > 150
    assert sum(map(len, graph.values())) > 500
    graphlib.TopologicalSorter(graph).prepare()  # or it tells the cycle


def test_a_model_answers_queries_and_names_the_functions_for_all_else():
    model = calib.train(calib.babble(calib.load_arm("two_link"), 200), size=5)
    for name in ("check", "adapt", "evaluate", "monitor", "correct"):
        refused(AttributeError, f"calib.{name}", getattr, model, name)


def test_contributing_names_files_that_there_are():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    named = re.findall(r"`((?:calib|cli|docs|robots|tests)/[^` ]*)", text)
    assert len(named) > 20
    assert [name for name in named if not (ROOT / name).exists()] == []


def is_docstring(token: tokenize.TokenInfo) -> bool:
    return token.type == tokenize.STRING and token.string.lstrip("rbfu").startswith('"""')


def holds_number(node: ast.stmt) -> bool:
    """Whether a statement of a module names a number, or several in a tuple."""
    value = getattr(node, "value", None)
    if not isinstance(node, ast.Assign | ast.AnnAssign) or isinstance(value, ast.Dict | ast.Call):
        return False
    constants = [part for part in ast.walk(node) if isinstance(part, ast.Constant)]
    return any(type(constant.value) in (int, float) for constant in constants)


def is_packed(node: ast.AST) -> bool:
    """Whether a statement assigns several values to several names: `a, b = x, y`."""
    if not isinstance(node, ast.Assign):
        return False
    return isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)


def style_of(files: list[Path]) -> dict[str, float]:
    tokens, names, nodes, constants, skips, lines = [], [], [], 0, 0, 0
    for path in files:
        text = path.read_text(encoding="utf-8")
        code = [
            token
            for token in tokenize.generate_tokens(io.StringIO(text).readline)
            if token.type not in LAYOUT and not is_docstring(token) and token.string
        ]
        tokens += code
        names += [token.string for token in code if token.type == tokenize.NAME]
        lines += len({row for t in code for row in range(t.start[0], t.end[0] + 1)})
        tree = ast.parse(text)
        nodes += ast.walk(tree)
        constants += sum(map(holds_number, tree.body))
        skips += len(re.findall(r"fmt: (?:skip|off)", text))
    anys = sum(isinstance(node, ast.Name) and node.id == "Any" for node in nodes)
    figures = (
        len(tokens) / lines,
        1e3 * sum(map(is_packed, nodes)) / lines,
        1e3 * anys / lines,
        1e3 * constants / lines,
        1e3 * sum(name in PARTICIPLES for name in names) / len(names),
        skips,
    )
    return dict(zip(MOST, figures, strict=True))


def rooms() -> dict[str, list[Path]]:
    """The files of each room: a folder of `calib`, its modules that stand alone, and `cli`."""
    folders = [path.parent for path in sorted(ROOT.glob("calib/*/__init__.py"))]
    modules = {"calib": sorted(ROOT.glob("calib/*.py")), "cli": sorted(ROOT.glob("cli/**/*.py"))}
    return modules | {folder.name: sorted(folder.rglob("*.py")) for folder in folders}


@pytest.mark.parametrize("room", rooms())
def test_a_room_keeps_to_its_limits(room):
    figures = style_of(rooms()[room])
    assert {name: figures[name] for name in MOST if figures[name] > MOST[name] + 0.05} == {}
