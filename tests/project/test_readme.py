"""The README's commands and code run; its links are tested with those of the manual."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from pages import SHARED

import calib

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = [
    part.split("#")[0].strip()
    for line in TEXT.splitlines()
    if line.startswith("    ")
    for part in line.split("&&")
    if part.strip().startswith(("calib ", "printf "))
]
# what the README's files stand for
NEEDS = "ur10.urdf"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An empty folder: the README's own lines write the files that its commands need."""
    return tmp_path_factory.mktemp("readme")


def real_urdf():
    pinocchio = pytest.importorskip("pinocchio")
    robots = Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots"
    return next(robots.rglob("ur10_robot.urdf"), None) if robots.is_dir() else None


def test_the_commands_run_in_order(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert len(COMMANDS) > 12
    for command in COMMANDS:
        if command.startswith("printf "):
            (folder / command.split()[-1]).write_text(shlex.split(command)[1].replace("\\n", "\n"))
            continue
        words = shlex.split(command)[1:]
        if words[0] == "preview":
            words += ["--html", "page.html"]  # no server, no browser
        if NEEDS in words:
            urdf = real_urdf()
            if urdf is None:
                continue  # without the package of real robots
            (folder / NEEDS).write_text(urdf.read_text())
        done = SHARED.run(words, folder)
        expected = 3 if words[0] == "check" else 0  # the README says so: it has drifted
        assert done.code == expected, (command, done.err)
    assert {"two_link.calib", "arm.calib", "two_link.adapted.calib", "joints.csv", "q2.csv"} <= {
        p.name for p in folder.iterdir()
    }


def test_the_python_code_does_what_its_comments_say(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(code, "README.md", "exec"), names)
    assert np.shape(names["x"]) == np.shape(names["q"]) == (2,)
    assert calib.load("two_link.calib").about.samples == 20_000


def test_the_two_commands_are_what_is_checked_on_every_change():
    script = (ROOT / ".ci/run").read_text()
    starts = re.findall(r"command_of '(.*?)'", script)
    assert len(starts) == 2
    for start in starts:
        found = re.findall(rf"^    {start}.*$", TEXT, re.MULTILINE)
        assert len(found) == 1, (start, found)
    assert "export" not in script  # no variable is set for them
