"""The benchmarks: their closed forms, and that the commands run without any peer."""

import json
import re
from pathlib import Path

import versions

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"


def test_every_script_that_a_page_names_is_there_and_every_script_is_named():
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    named = set(re.findall(r"benchmarks/(\w+)\.py", text))
    there = {path.stem for path in FOLDER.glob("*.py")}
    assert named <= there
    scripts = [*FOLDER.glob("*.py"), *Path(__file__).parent.glob("*.py")]
    text = "\n".join(path.read_text(encoding="utf-8") for path in scripts)
    used = set(re.findall(r"^ *(?:from|import) (\w+)", text, re.MULTILINE))
    assert {name for name in there - named - used if not name.startswith("peer_")} == set()


def test_errors_agree_with_those_of_other_versions():
    """Other versions of Python, NumPy and SciPy found the same."""
    kept = json.loads((ROOT / "tests/data/errors.json").read_text(encoding="utf-8"))
    lines = versions.differences(versions.errors(), kept)
    assert lines == [], "was training changed on purpose? python benchmarks/versions.py --write"
