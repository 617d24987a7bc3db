"""Whole processes: how long commands take, beside an import of NumPy and SciPy.

Every command is run in turn with that yardstick, so that a drifting machine hits all alike.
"""

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from measure import Done, as_installed, interval, process, spread

CLI = [sys.executable, "-m", "calib_cli"]
YARDSTICK = "import numpy, scipy.spatial"


def processes(quick: bool) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """Rows of whole processes, and the seconds of a training's stages."""
    with tempfile.TemporaryDirectory() as name:
        folder, model = Path(name), str(Path(name) / "two_link.calib")
        train = [*CLI, "train", "two_link", "-o", model]
        train += ["--size", "20", "--samples", "2000"] if quick else []
        commands = {
            "calib train two_link": train,
            "calib query inverse": [*CLI, "query", "inverse", model, "0.3", "0.3"],
            "calib --help": [*CLI, "--help"],
            YARDSTICK: [sys.executable, "-c", YARDSTICK],
        }
        for command in commands.values():  # a model to ask, and bytecode
            process(command, folder)
        runs: dict[str, list[Done]] = {name: [] for name in commands}
        for _ in range(2 if quick else 7):
            for name, command in commands.items():
                runs[name].append(process(command, folder))
        rows = [
            {
                "process": name,
                "wall time [s]": interval(spread([d.wall for d in done])),
                "processor time [s]": interval(spread([d.cpu for d in done])),
                # pair by pair: the machine drifts
                "times the import": statistics.median(
                    d.cpu / b.cpu for d, b in zip(done, runs[YARDSTICK], strict=True)
                ),
                "peak memory [MB]": max(d.peak_mb for d in done),
            }
            for name, done in runs.items()
        ]
        said = subprocess.run([*train, "--json"], cwd=folder, check=True, capture_output=True,
                              text=True, env=as_installed(folder)).stdout  # fmt: skip
        return rows, json.loads(said)["seconds"]
