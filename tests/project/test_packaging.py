"""What is packaged: versions that agree, types, robots, and nothing that is rude."""

import re
import shutil
import subprocess
import sys
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

import calib

ROOT = Path(__file__).parents[2]


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
