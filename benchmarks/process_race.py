"""Whole processes: how long commands take, what of it is imports, and where the rest goes.

Every command is run in turn with a yardstick, so that a drifting machine hits all alike;
beside it the same command of an earlier commit, from a worktree that is made for the run.
"""

from __future__ import annotations

import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from measure import ROOT, minisom_rate, process, spread

BEFORE = "3ea9410"
CLI = [sys.executable, "-m", "cli"]
YARDSTICK = [sys.executable, "-c", "import numpy, scipy.spatial"]
TRAIN = ["train", "two_link", "-o"]
QUERY = ["query", "inverse", "{model}", "0.3", "0.3"]

# a model's life in one process, with the time of each step
_STEPS = """
import json, sys, time
clock = time.perf_counter
start = clock()
import cli.app
cli_s = clock() - start
import calib
steps = {}
def step(name, run):
    start = clock()
    result = run()
    steps[name] = clock() - start
    return result
model = step("load", lambda: calib.load(sys.argv[1]))
step("first inverse query", lambda: model.inverse([0.3, 0.3]))
step("second inverse query", lambda: model.inverse([0.31, 0.3]))
print(json.dumps({"import of the command line": cli_s} | steps))
"""


@contextmanager
def earlier(commit: str) -> Iterator[Path | None]:
    """A worktree of an earlier commit, None where there is no such commit or no git."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "before"
        git = ["git", "-C", str(ROOT), "worktree"]
        try:
            subprocess.run([*git, "add", "--detach", str(tree), commit],
                           check=True, capture_output=True)  # fmt: skip
        except (OSError, subprocess.CalledProcessError):
            print(f"commit {commit} is not there: no figures from before", file=sys.stderr)
            yield None
            return
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=False, capture_output=True)


def processes(quick: bool) -> dict[str, Any]:
    """Times of whole processes [s], now and before."""
    with tempfile.TemporaryDirectory() as folder, earlier(BEFORE) as before:
        return _processes(Path(folder), {"now": ROOT, "before": before}, quick)


def _processes(folder: Path, trees: dict[str, Path | None], quick: bool) -> dict[str, Any]:
    trees = {name: tree for name, tree in trees.items() if tree is not None}
    commands: dict[str, tuple[list[str], Path | None, int]] = {}
    extra = ["--size", "20", "--samples", "2000"] if quick else []
    for name, tree in trees.items():
        model = str(folder / f"{name}.calib")
        train = [*CLI, *TRAIN, model, *extra]
        process(train, folder, tree)
        query = [part.format(model=model) for part in QUERY]
        commands[f"train two_link, {name}"] = (train, tree, 1 if quick else 5)
        commands[f"query inverse, {name}"] = ([*CLI, *query], tree, 2 if quick else 11)
        commands[f"--help, {name}"] = ([*CLI, "--help"], tree, 1 if quick else 5)
    commands["import numpy, scipy.spatial"] = (YARDSTICK, ROOT, 2 if quick else 11)
    wall: dict[str, list[float]] = {name: [] for name in commands}
    cpu: dict[str, list[float]] = {name: [] for name in commands}
    memory: dict[str, list[float]] = {name: [] for name in commands}
    rates = []
    for run in range(max(most for _, _, most in commands.values())):
        for name, (command, tree, most) in commands.items():
            if run < most:
                done = process(command, folder, tree)
                wall[name].append(done.wall)
                cpu[name].append(done.cpu)
                memory[name].append(done.peak_mb)
        if run < 5:
            rates.append(minisom_rate())
    result: dict[str, Any] = {
        "rows": [
            {
                "name": name,
                "seconds": spread(wall[name]),
                "cpu": spread(cpu[name]),
                "peak_mb": max(memory[name]),
            }
            for name in commands
        ],
        "minisom_updates_per_second": statistics.median(rates),
        "steps": {},
        "imports": {},
        "stages": {},
    }
    # how much longer than the yardstick beside it, pair by pair
    pairs = zip(wall["query inverse, now"], wall["import numpy, scipy.spatial"], strict=True)
    result["query_over_yardstick"] = spread([a / b for a, b in pairs])
    pairs = zip(cpu["query inverse, now"], cpu["import numpy, scipy.spatial"], strict=True)
    result["query_over_yardstick_cpu"] = spread([a / b for a, b in pairs])
    for name, tree in trees.items():
        model = str(folder / f"{name}.calib")
        result["steps"][name] = _steps(folder, tree, model, 1 if quick else 5)
        query = [part.format(model=model) for part in QUERY]
        result["imports"][name] = {
            "train two_link": imports([*TRAIN, model, *extra], folder, tree, 1 if quick else 3),
            "query inverse": imports(query, folder, tree, 1 if quick else 3),
        }
        result["stages"][name] = _stages([*TRAIN, model, *extra], folder, tree, 1 if quick else 3)
    return result


def _run(command: list[str], folder: Path, tree: Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(tree)}
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True,
                          env=environment)  # fmt: skip


def _steps(folder: Path, tree: Path, model: str, runs: int) -> dict[str, float]:
    """Median times [s] of the steps of a query."""
    found = [json.loads(_run([sys.executable, "-c", _STEPS, model], folder, tree).stdout)
             for _ in range(runs)]  # fmt: skip
    return {name: statistics.median(f[name] for f in found) for name in found[0]}


def imports(command: list[str], folder: Path, tree: Path, runs: int) -> dict[str, Any]:
    """Median seconds of all imports of a command, and the packages that take most."""
    totals, packages = [], []
    for _ in range(runs):
        said = _run([sys.executable, "-X", "importtime", "-m", "cli", *command], folder, tree)
        own: dict[str, float] = {}
        for line in said.stderr.splitlines():
            found = re.match(r"import time:\s+(\d+) \|\s+\d+ \|\s+([\w.]+)", line)
            if found:
                package = found[2].split(".")[0]
                own[package] = own.get(package, 0.0) + 1e-6 * float(found[1])
        totals.append(sum(own.values()))
        packages.append(own)
    middle = packages[totals.index(sorted(totals)[len(totals) // 2])]
    most = dict(sorted(middle.items(), key=lambda item: -item[1])[:8])
    return {"total": statistics.median(totals), "packages": most}


def _stages(command: list[str], folder: Path, tree: Path, runs: int) -> dict[str, float]:
    """Median seconds of the stages of a training, as it tells them itself."""
    found = [json.loads(_run([*CLI, *command, "--json"], folder, tree).stdout)["seconds"]
             for _ in range(runs)]  # fmt: skip
    return {name: statistics.median(f[name] for f in found) for name in found[0]}
