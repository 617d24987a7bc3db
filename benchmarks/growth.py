"""Growth of time and memory with nodes, samples and joints: tables of docs/performance.md.

    python benchmarks/growth.py [--quick] [--only PART ...]

Every case runs in a process of its own.  Exponents are least squares on logarithms of
processor time, with 95 % intervals.  PART: som, vdsom, links, train, joints, large (maps of up to
a million nodes from a Parquet file that is read in parts).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from measure import ROOT, child, machine, peak_mb, timed
from tables import table

SIDES = (30, 50, 70, 100, 150, 200, 300)
ROWS = (20_000, 50_000, 100_000, 200_000, 500_000, 1_000_000, 2_000_000)
FIXED_ROWS = 200_000  # while nodes grow
FIXED_SIDE = 70  # while samples grow
LARGE = ((100, 100_000), (300, 1_000_000), (1000, 10_000_000))  # nodes along a side, samples
TIMEOUT = 1200.0  # [s] of one case


def cases(quick: bool) -> dict[str, list[dict[str, Any]]]:
    """Tasks of each part."""
    sides, rows = (SIDES, ROWS) if not quick else ((10, 20, 30), (2000, 4000, 8000))
    fixed = {"rows": FIXED_ROWS, "side": FIXED_SIDE} if not quick else {"rows": 4000, "side": 15}
    parts: dict[str, list[dict[str, Any]]] = {}
    for part in ("som", "vdsom", "links", "train"):
        # a whole training of a lattice of every other size is enough
        some = slice(None, None, 1 if part in ("som", "links") else 2)
        parts[part] = [
            *({"part": part, "varied": "nodes", "side": s, "rows": fixed["rows"]}
              for s in sides[some]),
            *({"part": part, "varied": "samples", "side": fixed["side"], "rows": n}
              for n in rows[some]),
        ]  # fmt: skip
    parts["joints"] = [
        {"part": "joints", "varied": "joints", "joints": k, "rows": min(20_000, fixed["rows"]),
         "side": fixed["side"]} for k in range(2, 4 if quick else 8)
    ]  # fmt: skip
    parts["large"] = [
        {"part": "large", "varied": "both", "side": side, "rows": rows}
        for side, rows in (LARGE if not quick else ((10, 1000), (20, 4000)))
    ]
    return parts


def _large(side: int, rows: int) -> dict[str, Any]:
    """A plain map of the positions in a Parquet file: reading, training and the peak of both."""
    import calib

    # another process writes it, so that this one's peak is that of reading and training
    write = "import calib, sys; calib.write_log(calib.babble(calib.load_arm('two_link'), " \
            "int(sys.argv[1]), seed=0), sys.argv[2])"  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "log.parquet")
        subprocess.run([sys.executable, "-c", write, str(rows), path], check=True)
        megabytes = Path(path).stat().st_size / 1e6
        before = peak_mb()
        reading, _, log = timed(lambda: calib.read_log(path, calib.load_arm("two_link"), most=rows))
    x = log.x
    del log
    calib.SOM((5, 5), map="som").fit(x[:300].copy())
    wall, cpu, found = timed(lambda: calib.SOM((side, side), map="som").fit(x))
    return {"seconds": wall, "cpu": cpu, "read_s": reading, "file_mb": megabytes, "read": len(x),
            "mb": peak_mb() - before, "error": float(found.history[-1, 2])}  # fmt: skip


def one(task: dict[str, Any]) -> dict[str, Any]:
    """Time and memory of one case, in this process."""
    import calib

    if task["part"] == "large":
        return task | _large(task["side"], task["rows"])
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, task["rows"], seed=0)
    side = (task["side"],) * 2
    if task["part"] in ("som", "vdsom"):
        few, net = log.x[:300].copy(), task["part"]
        calib.SOM((5, 5), map=net).fit(few)
        run = lambda: calib.SOM(side, map=net).fit(log.x)  # noqa: E731
    elif task["part"] == "links":
        run = _linking(arm, log, task["side"])
    else:
        if task["part"] == "joints":
            arm, log = _chain(task["joints"], task["rows"])
        calib.train(calib.babble(arm, 300, seed=1), size=5)
        run = lambda: calib.train(log, size=task["side"])  # noqa: E731
    before = peak_mb()
    wall, cpu, result = timed(run)
    row = task | {"seconds": wall, "cpu": cpu, "mb": peak_mb() - before, "peak_mb": peak_mb()}
    if task["part"] in ("train", "joints"):
        row["stages"] = result.seconds
        row["motor"] = "x".join(map(str, result.motor.lattice.shape))
    if task["part"] == "joints":
        row["queries_us"] = _queries(result, arm, min(200, task["rows"] // 20))
    return row


def _queries(model: Any, arm: Any, n: int) -> dict[str, float]:
    """Median processor time of each query [us], near the middle of the joints' range."""
    import calib

    rng = np.random.default_rng(1)
    q = arm.lower + (0.3 + 0.4 * rng.random((n, arm.dof))) * (arm.upper - arm.lower)
    x, near, monitor = arm.forward(q), q + 5e-3, calib.monitor(model)
    model.warm_up()
    calls = {
        "forward": lambda k: model.forward(q[k]),
        "expected error": lambda k: model.expected_error(q[k]),
        "inverse near": lambda k: model.inverse(x[k], near=near[k]),
        "correct": lambda k: calib.correct(model, q[k]),
        "monitor": lambda k: monitor.update(q[k], x[k]),
    }
    found = {name: [timed(lambda call=call, k=k: call(k))[1] for k in range(n)]
             for name, call in calls.items()}  # fmt: skip
    model.inverse(x, near=near)  # so that later ones find its starts
    found["forward, a row of a batch"] = [timed(lambda: model.forward(q))[1] / n]
    found["inverse, a row of a batch"] = [timed(lambda: model.inverse(x, near=near))[1] / n]
    return {name: 1e6 * float(np.median(taken)) for name, taken in found.items()}


def _linking(arm: Any, log: Any, side: int) -> Any:
    """Linking of two ordered maps that need no training."""
    from calib.common.scale import Scale
    from calib.maps.lattice import Lattice
    from calib.maps.links import WIRINGS
    from calib.maps.map import Map

    lattice, none = Lattice((side, side)), np.zeros((0, 4))
    units = (lattice.positions() + 0.5) / side
    joints = Scale.of_range(log.lower, log.upper, log.revolute)
    seen = Scale.of_data(log.x)
    motor = Map(units, lattice, joints, none)
    sensory = Map(seen.to_unit(arm.forward(joints.from_unit(units))), lattice, seen, none)
    u, v = joints.to_unit(log.q), seen.to_unit(log.x)
    wiring = WIRINGS["reciprocal"]

    def learn(rows: int) -> Any:
        parts = wiring.parts(motor, u[:rows], sensory, v[:rows])
        return wiring.linked((a, b) for _, a, b in parts)

    learn(100)
    return lambda: learn(len(u))


def _chain(joints: int, rows: int) -> tuple[Any, Any]:
    """A chain of equal links with so many joints, and its samples."""
    import calib

    sys.path.insert(0, str(ROOT / "tests"))
    from planar import chain_urdf

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.urdf"
        path.write_text(chain_urdf(joints))
        # without names no more than three would be found
        arm = calib.load_arm(path, joints=[f"joint_{k + 1}" for k in range(joints)])
        return arm, calib.babble(arm, rows, seed=0)


def exponent(x: Any, y: Any) -> dict[str, float]:
    """Slope of log y over log x, and half of its 95 % interval."""
    from scipy.stats import linregress, t

    fit = linregress(np.log(x), np.log(y))
    half = float(t.ppf(0.975, len(x) - 2) * fit.stderr) if len(x) > 2 else float("nan")
    return {"exponent": float(fit.slope), "interval": half}


def fits(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Exponents against nodes and samples, of all cases and of the larger half."""
    found = []
    for varied in ("nodes", "samples"):
        some = [r for r in rows if r["varied"] == varied]
        if len(some) < 3:
            continue
        x = np.array([float(r["side"] ** 2 if varied == "nodes" else r["rows"]) for r in some])
        y, mb = (np.array([max(r[key], 0.0) for r in some]) for key in ("cpu", "mb"))
        larger = slice(-(len(x) // 2 + 1), None)
        every, half = exponent(x, y), exponent(x[larger], y[larger])
        flat = exponent(x[larger], y[larger] / np.log(x[larger]))
        found.append(
            {"against": varied}
            | {
                name: f"{fit['exponent']:.2f} +- {fit['interval']:.2f}"
                for name, fit in (("all", every), ("larger half", half), ("over n log n", flat))
            }
            | {"bytes each": float(2**20 * np.polyfit(x, mb, 1)[0])}
        )
    return found


def main() -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="tiny sizes: does it all run?")
    parser.add_argument("--only", nargs="+", choices=list(cases(True)), default=list(cases(True)))
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        print(json.dumps(one(json.loads(options.child))))
        return
    print(machine())
    everything = cases(options.quick)
    for part in options.only:
        rows = [row for task in everything[part] if (row := child(Path(__file__), task, TIMEOUT))]
        for row in rows:
            row.update({"us": 1e6 * row["cpu"] / row.get("rows", row.get("read", 1))})
            row.pop("stages", None)
            queries = row.pop("queries_us", {})
            row.update({f"{name} [us]": taken for name, taken in queries.items()})
        table(f"{part}: processor time (cpu) and wall time [s], memory [MB]", rows)
        table(f"{part}: exponents of processor time", fits(rows))


if __name__ == "__main__":
    main()
