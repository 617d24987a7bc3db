"""Other versions of Python, NumPy and SciPy find the same errors."""

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
