"""The rooms of the code: imports run down, the style in figures; and what is packaged."""

import ast
import graphlib
import io
import re
import shutil
import subprocess
import sys
import tokenize
import zipfile
from importlib.metadata import version
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


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_versions_agree():
    stated = re.search(r'^version = "(.+)"$', text_of("pyproject.toml"), re.MULTILINE)
    cited = re.search(r"^version: (.+)$", text_of("CITATION.cff"), re.MULTILINE)
    assert calib.__version__ == stated[1] == cited[1] == version("calib-arm")
    assert f"## [{calib.__version__}]" in text_of("CHANGELOG.md")


def test_every_package_is_named_and_every_dependency_has_a_lower_bound():
    """Setuptools packs what is listed: a forgotten folder would be missing in the wheel.

    A bound is what `.ci/legs lowest` installs; without one it would try the newest.
    """
    listed = re.search(r"^packages = \[(.*)\]$", text_of("pyproject.toml"), re.MULTILINE)
    package = Path(calib.__file__).parent
    folders = (path.parent.relative_to(package.parent) for path in package.rglob("__init__.py"))
    packages = {".".join(folder.parts) for folder in folders}
    elsewhere = {"calib._robots", "calib_cli", "calib_cli.commands", "calib_cli.commands.query"}
    assert set(re.findall(r'"(.+?)"', listed[1])) == packages | elsewhere
    table = re.search(r"^dependencies = \[\n(.*?)^\]", text_of("pyproject.toml"), re.M | re.S)
    wanted = re.findall(r'^  "(.+?)",$', table[1], re.M)
    assert len(wanted) == 10
    assert [w for w in wanted if not re.match(r"[\w-]+>=\d+(\.\d+)+(; |$)", w)] == []


def test_wheel_holds_all_that_is_needed(tmp_path):
    pytest.importorskip("build", reason="the package `build` is not installed: pip install build")
    if not (ROOT / "calib").is_dir():
        pytest.skip("the tests of an installed package: its source is elsewhere")
    if int(version("setuptools").partition(".")[0]) < 77:
        pytest.skip("setuptools is too old to build the wheel: pip install -U setuptools")
    source = tmp_path / "source"
    source.mkdir()
    for name in ("calib", "cli", "robots"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    words = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "-o", tmp_path, source]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = tmp_path.glob("calib_arm-*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    files = {path.relative_to(ROOT).as_posix() for path in (ROOT / "calib").rglob("*.*")}
    tools = re.compile(r"\.pyc$|ruff")  # what Python and the linter keep there
    modules = {file for file in files if not tools.search(file)}  # styles, scripts, C, too
    assert {"calib/kernel/c/head.h", "calib/show/report/page.css"} <= modules
    commands = {f"calib_cli/{path.name}" for path in (ROOT / "cli").glob("*.py")}
    robots = {f"calib/_robots/{path.name}" for path in (ROOT / "robots").glob("*.urdf")}
    assert robots
    assert modules | commands | robots | {"calib/py.typed", "calib_cli/py.typed"} <= names
    tops = {name.split("/")[0] for name in names}
    assert tops == {"calib", "calib_cli", f"calib_arm-{calib.__version__}.dist-info"}
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_nothing_large_and_nothing_that_runs_code_is_tracked():
    if not (ROOT / ".git").exists():
        pytest.skip("not a checkout")
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    names = listed.stdout.split()
    assert len(names) > 300
    assert [name for name in names if name.endswith((".pkl", ".pickle", ".pyc"))] == []
    assert [name for name in names if (ROOT / name).stat().st_size > 300_000] == []
