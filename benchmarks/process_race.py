"""Whole processes: how long commands take, what of it is imports, and where the rest goes.

Every command is run in turn with a yardstick, so that a drifting machine hits all alike.
"""

from __future__ import annotations

import json
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from measure import as_installed, minisom_rate, process, spread

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


def processes(quick: bool) -> dict[str, Any]:
    """Times of whole processes [s], and of each over the yardstick beside it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = str(folder / "two_link.calib")
        train = [*TRAIN, model, *(["--size", "20", "--samples", "2000"] if quick else [])]
        query = [part.format(model=model) for part in QUERY]
        process([*CLI, *train], folder)  # a model to ask, and bytecode
        commands = {
            "calib train two_link": [*CLI, *train],
            "calib query inverse": [*CLI, *query],
            "calib --help": [*CLI, "--help"],
            "import numpy, scipy.spatial": YARDSTICK,
        }
        for command in commands.values():
            process(command, folder)
        runs = {name: [] for name in commands}
        rates = []
        for _ in range(2 if quick else 7):
            for name, command in commands.items():
                runs[name].append(process(command, folder))
            if len(rates) < 5:
                rates.append(minisom_rate())
        beside = runs["import numpy, scipy.spatial"]
        repeats = 1 if quick else 3
        return {
            "rows": [
                {
                    "name": name,
                    "seconds": spread([d.wall for d in done]),
                    "cpu": spread([d.cpu for d in done]),
                    "peak_mb": max(d.peak_mb for d in done),
                    # pair by pair: the machine drifts
                    "over": spread([d.wall / b.wall for d, b in zip(done, beside, strict=True)]),
                    "over_cpu": spread([d.cpu / b.cpu for d, b in zip(done, beside, strict=True)]),
                }
                for name, done in runs.items()
            ],
            "minisom_updates_per_second": statistics.median(rates),
            "steps": _steps(folder, model, repeats),
            "imports": {
                "train two_link": imports(train, folder, repeats),
                "query inverse": imports(query, folder, repeats),
            },
            "stages": _stages(train, folder, repeats),
        }


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True,
                          env=as_installed(folder))  # fmt: skip


def _steps(folder: Path, model: str, runs: int) -> dict[str, float]:
    """Median times [s] of the steps of a query."""
    found = [json.loads(_run([sys.executable, "-c", _STEPS, model], folder).stdout)
             for _ in range(runs)]  # fmt: skip
    return {name: statistics.median(f[name] for f in found) for name in found[0]}


def imports(command: list[str], folder: Path, runs: int) -> dict[str, Any]:
    """Median seconds of all imports of a command, and the packages that take most."""
    totals, packages = [], []
    for _ in range(runs):
        said = _run([sys.executable, "-X", "importtime", "-m", "cli", *command], folder)
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


def _stages(command: list[str], folder: Path, runs: int) -> dict[str, float]:
    """Median seconds of the stages of a training, as it tells them itself."""
    found = [json.loads(_run([*CLI, *command, "--json"], folder).stdout)["seconds"]
             for _ in range(runs)]  # fmt: skip
    return {name: statistics.median(f[name] for f in found) for name in found[0]}
