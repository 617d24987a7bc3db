"""Other versions of Python, NumPy and SciPy find the same errors."""

from __future__ import annotations

import copy
import json
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1]
sys.path.insert(0, str(HERE.parent / "benchmarks"))

import versions  # noqa: E402


@pytest.fixture(scope="module")
def kept():
    return json.loads((HERE / "data" / "errors.json").read_text(encoding="utf-8"))


def test_errors_agree_with_those_of_other_versions(kept):
    lines = versions.differences(versions.errors(), kept)
    assert lines == [], "was training changed on purpose? python benchmarks/versions.py --write"


@pytest.mark.parametrize(
    ("key", "factor", "refused"),
    [("mean", 1 + 5e-7, 0), ("mean", 1 + 5e-6, 1), ("max", 1.04, 0), ("max", 1.06, 1)],
)
def test_the_bounds_are_as_stated(kept, key, factor, refused):
    changed = copy.deepcopy(kept)
    changed["two_link, noise 0 m"]["winner"]["forward"]["x"][key] *= factor
    assert len(versions.differences(changed, kept)) == refused


def test_what_is_missing_is_no_agreement(kept):
    changed = copy.deepcopy(kept)
    del changed["two_link, noise 0 m"]["local"]
    assert versions.differences(changed, kept) != []
