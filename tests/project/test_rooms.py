"""The rooms of the code: imports run down, and the picture shows the imports that there are."""

import importlib.util
import re
from pathlib import Path

import numpy as np
from refusals import refused

import calib

ROOT = Path(__file__).parents[2]


def rooms():
    spec = importlib.util.spec_from_file_location("make_rooms", ROOT / "docs" / "make_rooms.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_no_import_runs_up():
    assert rooms().running_up() == []


def files():
    """Modules of the package and the command line, and what each imports, for types too."""
    paths = [*(ROOT / "calib").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): {
            module for module, _ in rooms().imports(path, types=True)
        }
        for path in paths
        if path.name != "__init__.py"
    }


def test_no_two_files_know_each_other():
    graph = files()
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
    named = {name for name, _ in rooms().ROOMS} - {"cli"}
    assert found == named


def test_a_model_answers_queries_and_names_the_functions_for_all_else():
    model = calib.train(calib.babble(calib.load_arm("two_link"), 200), size=5)
    for name in ("check", "adapt", "evaluate", "monitor", "correct"):
        refused(AttributeError, f"calib.{name}", getattr, model, name)


def test_the_picture_is_the_one_that_the_imports_draw():
    assert (ROOT / "docs" / "rooms.svg").read_text() == rooms().picture()


def test_contributing_names_files_that_there_are():
    named = re.findall(
        r"`((?:calib|cli|docs|robots|tests)/[^` ]*)", (ROOT / "CONTRIBUTING.md").read_text()
    )
    assert len(named) > 20
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_every_module_says_what_it_does_in_its_first_line():
    for path in [*(ROOT / "calib").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]:
        first = path.read_text(encoding="utf-8").split("\n", 1)[0]
        assert re.match(r'"""\S.*[.:]', first), path
