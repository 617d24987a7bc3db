"""The examples in the docstrings are true."""

import doctest
import importlib
import pkgutil

import pytest

import calib

MODULES = sorted(
    ["calib"]
    + [
        m.name
        for m in pkgutil.walk_packages(calib.__path__, "calib.")
        if not m.name.endswith("__main__") and "._robots" not in m.name
    ]
)
FINDER = doctest.DocTestFinder(exclude_empty=True)


def examples(name):
    module = importlib.import_module(name)
    return [t for t in FINDER.find(module, name) if t.examples]


@pytest.mark.parametrize("name", MODULES)
def test_examples_of(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    said = []
    for test in examples(name):
        runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)


def test_there_are_examples_of_the_main_functions():
    named = {t.name for name in MODULES for t in examples(name)}
    assert {"calib", "calib.training.train.train", "calib.model.model.Model.forward"} <= named
