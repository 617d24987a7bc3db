"""Measuring: fresh processes, peak memory, medians, the machine."""

import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
ONE_CORE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def peak_mb() -> float:
    """Most memory that this process has held so far [MB]."""
    status = Path("/proc/self/status")
    if status.exists():
        # unlike ru_maxrss it knows nothing of the parent that started this process
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 1024)


def child(script: Path, task: dict[str, Any], timeout: float = 600.0) -> dict[str, Any] | None:
    """What `script --child TASK` prints as its last line, None where it fails or takes too long."""
    command = [sys.executable, str(script), "--child", json.dumps(task)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=True)
    except subprocess.TimeoutExpired:
        print(f"  longer than {timeout:g} s, stopped: {task}", file=sys.stderr)
        return None
    except subprocess.CalledProcessError as error:
        last = error.stderr.strip().splitlines()[-1:] or ["no message"]
        print(f"  failed: {task}: {last[0]}", file=sys.stderr)
        return None
    return dict(json.loads(done.stdout.splitlines()[-1]))


def timed(run: Callable[[], Any]) -> tuple[float, float, Any]:
    """Wall seconds, processor seconds and result of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = run()
    return time.perf_counter() - wall, time.process_time() - cpu, result


@dataclass(frozen=True)
class Done:
    """A process that has ended: wall and processor seconds, and its peak memory."""

    wall: float
    cpu: float
    peak_mb: float


_PROBE = """
import json, resource, subprocess, sys, time
start = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
wall = time.perf_counter() - start
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([wall, used.ru_utime + used.ru_stime, used.ru_maxrss]))
"""


def as_installed(folder: Path) -> dict[str, str]:
    """Environment of a process of this checkout, with bytecode in `folder` as an installer has it.

    Compiling the sources anew took a quarter of a command.
    """
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPATH": str(ROOT), "PYTHONPYCACHEPREFIX": str(folder / "bytecode")}


def process(command: Sequence[str], folder: Path) -> Done:
    """Run a whole process of this checkout in `folder`; the first also compiles the sources."""
    # a small process starts it: memory is told as that of the larger of the two
    done = subprocess.run(
        [sys.executable, "-S", "-c", _PROBE, *command], cwd=folder, check=True,
        capture_output=True, text=True, env=as_installed(folder),
    )  # fmt: skip
    wall, cpu, memory = json.loads(done.stdout)
    return Done(wall, cpu, memory / (2**20 if sys.platform == "darwin" else 1024))


def spread(values: Sequence[float]) -> dict[str, float | int]:
    """Median, least, most and number of some values."""
    return {
        "median": statistics.median(values),
        "least": min(values),
        "most": max(values),
        "runs": len(values),
    }


def number(value: float) -> str:
    """Three digits, for a table."""
    if value < 1e-6:
        return "< 1e-6"
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def interval(s: dict[str, Any]) -> str:
    """Median, and the least and most where there were several runs."""
    if s["runs"] == 1:
        return f"{number(s['median'])} (1 run)"
    return f"{number(s['median'])} ({number(s['least'])}–{number(s['most'])})"


def machine() -> dict[str, Any]:
    """What this is measured on."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        models = [s for s in info.read_text().splitlines() if s.startswith("model name")]
        name = models[0].split(":")[1].strip() if models else name
    return {
        "processor": name,
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
        "versions": {p: metadata.version(p) for p in ("calib-arm", "numpy", "scipy")},
    }


def minisom_rate() -> float:
    """Updates per second of MiniSom on a 70x70 lattice: a yardstick; 0 without it."""
    try:
        from minisom import MiniSom
    except ImportError:
        return 0.0
    import numpy as np

    x = np.random.default_rng(0).random((1500, 2))
    som = MiniSom(70, 70, 2, sigma=35, learning_rate=0.5, random_seed=0)
    start = time.perf_counter()
    som.train_random(x, len(x))
    return len(x) / (time.perf_counter() - start)
