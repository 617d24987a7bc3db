"""What training and queries cannot do without, measured on one core, beside what they take.

No winner is found without asking the k-d tree, and no query is answered without reading
its argument and writing its answer.
"""

from __future__ import annotations

import cProfile
import json
import os
import pstats
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from measure import child, timed

SIDE = 70
COPIED = 8_000_000  # doubles


def limits(quick: bool) -> dict[str, Any]:
    """Measure in a fresh process that is bound to one core."""
    return child(Path(__file__), {"quick": quick}) or {}


def _cpu(run: Callable[[], Any], repeats: int = 5) -> float:
    """Median processor seconds."""
    return statistics.median(timed(run)[1] for _ in range(repeats))


def _shares(run: Callable[[], Any]) -> dict[str, float]:
    """Share of the processor time that each function itself takes, the six that take most."""
    profile = cProfile.Profile(time.process_time)
    profile.runcall(run)
    own: dict[str, float] = {}
    for (file, _, name), (_, _, seconds, _, _) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        where = name.strip("<>{}") if file == "~" else f"{Path(file).stem}.{name.strip('<>')}"
        # while it waits, the threads of a k-d tree work
        where = "k-d tree in threads" if "'acquire'" in where else where
        own[where] = own.get(where, 0.0) + seconds
    total = sum(own.values())
    most = sorted(own.items(), key=lambda item: -item[1])[:6]
    return {where: seconds / total for where, seconds in most}


def _measure(quick: bool) -> dict[str, Any]:
    import calib
    from calib.maps.map import search_tree

    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    side, rows, batch = (15, 2000, 2000) if quick else (SIDE, 20_000, 100_000)
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, rows, seed=0)
    model = calib.train(log, size=side)
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (batch, 2))
    x = arm.forward(q)
    u = model.motor.scale.to_unit(q)
    tree = search_tree(model.motor.units, model.motor.scale)
    cell = np.floor(u * 64).astype(int)
    sorted_u = u[np.lexsort(cell.T)]
    big = np.ones(COPIED)
    other = np.empty_like(big)
    runs: dict[str, Callable[[], Any]] = {
        "plain map": lambda: calib.SOM((side, side), map="som").fit(log.x),
        "map of varying density": lambda: calib.SOM((side, side)).fit(log.x),
        "forward, batch": lambda: model.forward(q),
        "inverse, batch": lambda: model.inverse(x, near=q),
    }
    return {
        "side": side,
        "rows": rows,
        "batch": batch,
        "tree_query_us": 1e6 * _cpu(lambda: tree.query(u)) / batch,
        "tree_query_sorted_us": 1e6 * _cpu(lambda: tree.query(sorted_u)) / batch,
        "tree_build_ms": 1e3 * _cpu(lambda: search_tree(model.motor.units, model.motor.scale)),
        "copy_gb_s": 16e-9 * COPIED / _cpu(lambda: np.copyto(other, big)),
        "cpu": {name: _cpu(run) for name, run in runs.items()},
        "shares": {name: _shares(run) for name, run in runs.items()},
    }


if __name__ == "__main__":
    print(json.dumps(_measure(json.loads(sys.argv[sys.argv.index("--child") + 1])["quick"])))
