"""The command as a process: help, imports, streams and signals."""

import json
import subprocess
import sys

import pytest

HEAVY = ("numpy", "scipy", "pinocchio", "polars", "rich", "safetensors", "yourdfpy", "meshcat")

IMPORTS = """
import json, sys
sys.argv[1:] = json.loads(sys.argv[1])
from calib_cli import main
try:
    main()
except SystemExit:
    pass
print(json.dumps([name for name in json.loads(sys.argv[-1]) if name in sys.modules]))
"""


def imported(args: list[str], modules: tuple[str, ...]) -> list[str]:
    """Which of the modules a command line imports, in a fresh process."""
    script = IMPORTS.replace("json.loads(sys.argv[-1])", repr(list(modules)))
    done = subprocess.run(
        [sys.executable, "-c", script, json.dumps(args)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("command", ["", "train", "query inverse", "babble"])
def test_help_imports_nothing_heavy(command):
    assert imported([*command.split(), "--help"], HEAVY) == []


def test_light_commands_stay_light(model):
    assert imported(["robots"], HEAVY) == []
    kinematics = ("pinocchio", "yourdfpy", "meshcat", "polars", "rich")
    assert imported(["info", str(model)], kinematics) == []
    lean = (*kinematics, "scipy")
    for way in ("inverse", "forward"):
        assert imported(["query", way, str(model), "0.1", "0.4"], lean) == []


def test_a_real_process_from_training_to_a_query(run_real, tmp_path):
    path = tmp_path / "m.calib"
    trained = run_real("train", "two_link", "--size", "10", "-n", "500", "-o", path, "--json")
    assert (trained.code, trained.err) == (0, "")
    assert trained.document["model"] == str(path)
    answer = run_real("query", "inverse", path, "-0.1", "0.3", "--json")
    assert (answer.code, answer.err) == (0, "")
    assert answer.document["reachable"] is True
    batch = run_real("query", "inverse", path, "--input", "-", stdin="x,y\n-0.1,0.3\n3,3\n")
    assert batch.code == 3
    assert batch.out.splitlines()[1].endswith(",1")
    assert batch.err == "row 2 of 2: out of reach\n"
    bad = run_real("query", "inverse", path, "-0.1", "--degrees", "up")
    assert (bad.code, bad.out, bad.err.count("\n")) == (2, "", 1)


def test_the_main_job_needs_no_pinocchio(run, tmp_path, monkeypatch):
    """It has no wheel for Windows: all but collisions works without."""
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    for robot, target in (("two_link", "0.3 0.3"), ("six_axis", "0.4 0.1 0.5")):
        path = tmp_path / f"{robot}.calib"
        assert run("train", robot, "--size", "8", "-n", "400", "-o", path).code == 0
        assert run("query", "inverse", path, *target.split(), "--json").document["reachable"]
    planned = run("plan", "six_axis", "-n", "5", "-o", tmp_path / "poses.csv")
    assert planned.code == 0
    assert "collision are not checked" in planned.err
