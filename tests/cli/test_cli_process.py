"""The command as a process: help, imports, streams and signals."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from calib_cli.app import COMMANDS

from calib.common import choices

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

HELP = {
    "train": [
        "ROBOT", "--data", "-o", "--joints", "--tip", "--lock", "--range", "--map", "--size",
        "--motor-size", "--sensory-size", "--rule", "--epochs", "--sigma", "--samples", "--noise",
        "--seed", "--change", "--columns", "--unit", "--degrees", "--json",
    ],
    "query forward": ["MODEL", "--readout", "--input", "--output", "--degrees", "--json"],
    "query inverse": [
        "MODEL", "--near", "--all", "--readout", "--input", "--output", "--degrees", "--json",
    ],
    "evaluate": ["MODEL", "--data", "--columns", "--degrees", "--json"],
    "babble": [
        "ROBOT", "-n", "-o", "--joints", "--tip", "--lock", "--range", "--noise", "--seed",
        "--change", "--degrees", "--json",
    ],
    "robots": ["--json"],
    "info": ["MODEL", "--json"],
}  # fmt: skip


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
    lean = (*kinematics, "scipy", "pydantic")  # either takes longer to import than the answer
    for way in ("inverse", "forward"):
        assert imported(["query", way, str(model), "0.1", "0.4"], lean) == []


def test_help_lists_the_commands_in_the_order_of_their_use(run):
    done = run("--help")
    assert done.code == 0
    commands = done.out.partition("Commands:")[2].splitlines()
    names = [line.split()[0] for line in commands if line.strip()]
    assert names == list(COMMANDS)
    assert {"robots", "train", "query", "evaluate", "preview", "report", "info"} <= set(names)
    assert run().out == done.out  # without a command: the same


@pytest.mark.parametrize("command", HELP)
def test_help_names_every_option(run, command):
    done = run(*command.split(), "--help")
    assert done.code == 0
    for name in HELP[command]:
        assert name in done.out
    assert max(map(len, done.out.splitlines())) <= 100


def test_choices_agree_with_the_library():
    from calib.body.views import PLANAR
    from calib.maps.density import GAINS
    from calib.samples.babbling import SAMPLERS

    assert set(choices.MAPS) <= set(GAINS)
    assert set(choices.MOTIONS) == set(SAMPLERS)
    assert set(choices.VIEWS) >= {"auto", *PLANAR}


def test_version(run):
    import calib

    assert run("--version").out == f"calib {calib.__version__}\n"


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


def test_output_that_is_not_ascii_prints_anyway(run_real, tmp_path):
    env = {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    done = run_real("train", "näm\u2192e.urdf", env=env)
    assert (done.code, done.out, done.err.count("\n")) == (1, "", 1)


@pytest.mark.skipif(os.name == "nt", reason="signals and pipes of POSIX")
def test_a_reader_who_leaves_ends_it_quietly():
    command = [sys.executable, "-m", "calib_cli", "babble", "two_link", "-n", "50000", "-o", "-"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.readline()
        process.stdout.close()
        error = process.stderr.read().decode()
        assert process.wait(60) == 0
    assert "Error" not in error
    assert "Traceback" not in error


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")  # noqa: PTH110
def test_a_full_disk_is_an_error():
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = subprocess.run(
            [sys.executable, "-m", "calib_cli", "robots"],
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
            timeout=60,
        )
    assert done.returncode == 1
    assert done.stderr.decode().count("\n") == 1


@pytest.mark.skipif(os.name == "nt", reason="signals and pipes of POSIX")
def test_ctrl_c_is_130_and_leaves_nothing(tmp_path):
    command = [sys.executable, "-m", "calib_cli", "train", "two_link", "-n", "2000000"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=tmp_path
    ) as process:
        time.sleep(1.5)
        process.send_signal(signal.SIGINT)
        out, error = process.communicate(timeout=60)
    # a shell sees 130 for both: the exit code, and an end by the signal itself
    assert process.returncode in (130, -signal.SIGINT)
    assert (out, error) == (b"", b"error: interrupted\n")
    assert list(tmp_path.iterdir()) == []
