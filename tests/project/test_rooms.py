"""The rooms of the code: imports run down, and the picture shows the imports that there are."""

import re
from pathlib import Path

import make_rooms
import numpy as np
from refusals import refused

import calib

ROOT = Path(__file__).parents[2]
FILES = [*(ROOT / "calib").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]


def test_no_import_runs_up():
    assert make_rooms.running_up() == []


def test_no_two_files_know_each_other():
    graph = {  # modules of the package and the command line, and what each imports, for types too
        ".".join(path.relative_to(ROOT).with_suffix("").parts): {
            module for module, _ in make_rooms.imports(path, types=True)
        }
        for path in FILES
        if path.name != "__init__.py"
    }
    names = sorted(graph)
    assert len(names) > 150
    reach = np.array([[other in graph[name] for other in names] for name in names])
    assert reach.sum() > 500
    for _ in range(9):  # paths of up to 2^9 imports
        reach |= (reach.astype(np.float32) @ reach.astype(np.float32)) > 0
    assert {names[k] for k in np.flatnonzero(np.diag(reach))} == set()


def test_every_room_is_named_and_none_is_missing():
    found = {path.parent.name for path in (ROOT / "calib").glob("*/__init__.py")}
    found |= {path.stem for path in (ROOT / "calib").glob("*.py")} - {"__init__", "errors"}
    named = {name for name, _ in make_rooms.ROOMS} - {"cli"}
    assert found == named


def test_a_model_answers_queries_and_names_the_functions_for_all_else():
    model = calib.train(calib.babble(calib.load_arm("two_link"), 200), size=5)
    for name in ("check", "adapt", "evaluate", "monitor", "correct"):
        refused(AttributeError, f"calib.{name}", getattr, model, name)


def test_the_picture_is_the_one_that_the_imports_draw():
    assert (ROOT / "docs" / "rooms.svg").read_text() == make_rooms.picture()


def test_contributing_names_files_that_there_are():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    named = re.findall(r"`((?:calib|cli|docs|robots|tests)/[^` ]*)", text)
    assert len(named) > 20
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_every_module_says_what_it_does_in_its_first_line():
    for path in FILES:
        first = path.read_text(encoding="utf-8").split("\n", 1)[0]
        assert re.match(r'"""\S.*[.:]', first), path
