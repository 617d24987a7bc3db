"""The examples in the docstrings are true, and the names in them exist."""

import doctest
import importlib
import inspect
import pkgutil
import pydoc
import re
from pathlib import Path

import pytest

import calib

MODULES = ["calib"] + [
    m.name
    for m in pkgutil.walk_packages(calib.__path__, "calib.")
    if not m.name.endswith("__main__") and "._robots" not in m.name
]
FINDER = doctest.DocTestFinder(exclude_empty=True)
SOURCE = "".join(p.read_text(encoding="utf-8") for p in Path(calib.__path__[0]).rglob("*.py"))
_ITEM = re.compile(r"^(\w+(?:, \w+)*) : (.*(?:\n(?:    .*|$))*)", re.MULTILINE)
_QUOTED = re.compile(r'"([a-z][\w:-]*)"')
_ROLE = re.compile(r":(?:func|class|meth|mod|data):`~?([\w.]+)`")


@pytest.mark.parametrize("name", MODULES)
def test_examples_are_true_and_references_lead_somewhere(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    for reference in set(_ROLE.findall(inspect.getsource(module))):
        if reference.startswith("calib"):
            assert pydoc.locate(reference) is not None, reference
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    said = []
    for test in FINDER.find(module, name):
        runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)
    assert runner.tries or name not in ("calib", "calib.training.train", "calib.model.model")


def public():
    """Public functions and classes with the public methods of the classes, by name."""
    for name in calib.__all__:
        thing = getattr(calib, name)
        if callable(thing):
            yield name, thing
        if inspect.isclass(thing):
            for method, function in inspect.getmembers(thing, inspect.isfunction):
                if not method.startswith("_") and function.__module__.startswith("calib"):
                    yield f"{name}.{method}", function


PUBLIC = dict(public())


@pytest.mark.parametrize("name", PUBLIC)
def test_docstrings_name_parameters_and_choices_that_exist(name):
    doc = inspect.getdoc(PUBLIC[name])
    assert doc, f"{name} has no docstring"
    _, _, told = doc.partition("Parameters\n----------\n")
    told = re.split(r"\n\w+\n-+\n", told)[0]
    known = set(inspect.signature(PUBLIC[name]).parameters)
    for parameters, text in _ITEM.findall(told):
        assert set(parameters.split(", ")) <= known
        for choice in _QUOTED.findall(text):
            kinds = [f'"{part}"' in SOURCE for part in choice.split(":")]
            assert all(kinds), (parameters, choice)
