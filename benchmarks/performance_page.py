"""The page docs/performance.md, written from docs/performance.json."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

from measure import ROOT, interval, number
from performance_maps import maps_section

Rows = list[dict[str, Any]]

_BY_PART = ("growth", "fits")
_SECTIONS = ("maps", "queries", "processes", "limits")


def read(folder: Path) -> dict[str, Any]:
    """Figures measured so far."""
    path = folder / "performance.json"
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def finish(folder: Path | None, new: dict[str, Any], quick: bool) -> None:
    """Merge new figures into the page, or print it where a quick run names no folder."""
    figures = {} if quick else read(folder or ROOT / "docs")
    if quick and folder is not None:
        figures = read(folder)
    measured = [key for key in new if key in _SECTIONS] + list(new.get("growth", {}))
    dates = figures.get("dates", {}) | dict.fromkeys(measured, time.strftime("%Y-%m-%d"))
    for key in _BY_PART:
        if key in new:
            new[key] = figures.get(key, {}) | new[key]
    figures |= new | {"dates": dates}
    if quick and folder is None:
        print(page(figures))
        return
    folder = folder or ROOT / "docs"
    text = json.dumps(figures, indent=1)
    (folder / "performance.json").write_text(text + "\n", encoding="utf-8")
    (folder / "performance.md").write_text(page(figures), encoding="utf-8")
    print(folder / "performance.md", file=sys.stderr)


def page(figures: dict[str, Any]) -> str:
    """The whole page in Markdown; sections that were not measured are left out."""
    lines = [
        "# Performance",
        "",
        "Written by `python benchmarks/speed.py` and `python benchmarks/growth.py`; edit those, "
        "not this page.",
        "",
    ]
    if "machine" in figures:
        m = figures["machine"]
        versions = ", ".join(f"{k} {v}" for k, v in m["versions"].items())
        lines += [
            f"Machine: {m['processor']}, {m['cores']} cores, Python {m['python']}, {versions}; "
            f"load average {m['load']} when the measurement began.  Everything that is compared "
            "was run in turn in one sitting.  The speed of a shared machine drifts by factors: "
            "trust the ratios, not the seconds.",
            "",
        ]
    dates = figures.get("dates", {})
    parts = [*(k for k in _SECTIONS if k in figures), *figures.get("growth", {})]
    told = ", ".join(f"{part} {dates.get(part, 'before')}" for part in parts)
    lines += [f"Measured: {told} (before: on an earlier state of the code).", ""]
    for name, section in (("maps", maps_section), ("queries", _queries), ("processes", _processes)):
        if figures.get(name):
            lines += section(figures[name])
    if figures.get("growth"):
        lines += _growth(figures["growth"], figures["fits"])
    if figures.get("limits"):
        lines += _limits(figures["limits"])
    return "\n".join(lines).rstrip() + "\n"


def _queries(found: dict[str, Any]) -> list[str]:
    by_name = {r["name"]: r for r in found["rows"]}
    lines = [
        "## Queries",
        "",
        f"A {found['size']}x{found['size']} model of `two_link` from {found['samples']:,} exact "
        "samples, in a process that is bound to one core with one thread, in processor time: what "
        "a query takes on an idle machine.  Nearest neighbours are "
        "scikit-learn's (k = 5, distance weights) on all training samples, once from joints to "
        "positions and once back.  Errors are distances to the true kinematics.  Solvers know the "
        "robot's kinematics; calib's model has learned it.  Joints that are given, to calib and to "
        "solvers alike, are 10 mrad away from an answer, as in a control loop.  ikpy and pink are "
        "timed on 40 targets, their setting up included.",
        "",
        "| query | processor time [us] | spread | wall [us] | per second | mean error [mm] | "
        "max [mm] |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for r in found["rows"]:
        errors = " | ".join(number(r[k]) if k in r else "" for k in ("mean_mm", "max_mm"))
        lines.append(
            f"| {r['name']} | {number(r['us'])} | {number(r['least_us'])}–"
            f"{number(r['most_us'])} | {number(r['wall_us'])} | {number(1e6 / r['us'])} | "
            f"{errors} |"
        )
    lines.append("")
    for name in found["left_out"]:
        lines.append(f"Left out, not installed: {name}.")
    single = by_name["inverse, one, near given"]["us"]
    ratios = [
        f"{name.split(', ')[2]} {by_name[name]['us'] / single:.1f}"
        for name in by_name
        if name.startswith("inverse, one, ") and name != "inverse, one, near given"
    ]
    if ratios:
        lines.append(f"Times of one inverse query of calib: {'; '.join(ratios)}.")
    lines += [
        "",
        f"The model file has {found['file_mb']:.2f} MB and is loaded in {found['load_ms']:.1f} ms "
        "(imports apart).",
        "",
    ]
    return lines


def _processes(found: dict[str, Any]) -> list[str]:
    lines = [
        "## Whole commands",
        "",
        "From the start of a process to its end, imports included, with the default options.  "
        'Each was run in turn with `python -c "import numpy, scipy.spatial"`; the ratios are '
        "those of neighbours.  All have their bytecode, as an installed package has.",
        "",
        "| process | wall time [s] | processor time [s] | times the import | in processor time | "
        "peak memory [MB] |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for r in found["rows"]:
        cells = (interval(r[k]) for k in ("seconds", "cpu", "over", "over_cpu"))
        lines.append(f"| `{r['name']}` | {' | '.join(cells)} | {r['peak_mb']:.0f} |")
    if found["minisom_updates_per_second"]:
        rate = found["minisom_updates_per_second"]
        lines += ["", f"MiniSom made {rate:,.0f} updates per second (70x70) meanwhile."]
    for title, command, steps in (
        ("`calib train two_link`, stage", "train two_link", found["stages"]),
        ("`calib query inverse`, step", "query inverse", found["steps"]),
    ):
        said = found["imports"][command]
        lines += ["", f"| {title} | time [s] |", "|---|---:|",
                  f"| imports, all together | {said['total']:.3f} |"]  # fmt: skip
        lines += [f"| {name} | {seconds:.4f} |" for name, seconds in steps.items()]
        most = ", ".join(f"{name} {s:.3f} s" for name, s in said["packages"].items())
        lines += ["", f"Packages that take most of its imports: {most}."]
    lines += [
        "",
        "Imports are the sum that `python -X importtime` tells, which itself slows them a little; "
        "the steps of a query and the stages of a training (its “total” is without the "
        "interpreter, the robot, the samples and the file) hold what they import at their first "
        "use.",
    ]
    return [*lines, ""]


_MODEL = """\
### Cost model

With N nodes, n samples and k activities per sample (a fixed number):

- **Maps.** A training shows S samples in all: a fixed number on the 64 nodes on which a map
  unfolds, a few per node on the lattices between, and all of them in the epochs of the last
  one. Each asks the k-d tree for its winner, O(log N); each epoch builds the tree, O(N log N),
  and spreads the nodes' sums along the lattice's axes, O(N sigma). Together
  O((S + E N) log N) for E epochs, and memory for the samples and a few arrays of N.
- **Links.** Two searches for k nodes per sample and a product of two sparse matrices with k
  entries per sample, O(n log N + n k^2), part by part of the samples.
- **Local models, cross-validation, bounds.** Sums over the samples around each node,
  O(n + N), and one search per sample and fold.
- **Queries.** A search of the tree and the trend's few functions, O(log N); the inverse repeats
  them for each step from each start.

So nothing should grow faster than N log N in the nodes or faster than linearly in the samples,
and doubling the joints' number costs what the larger lattice and trend cost, as the lattice
keeps its number of nodes.

### Measured

"""


_PARTS = {
    "som": "a plain map (`calib.SOM`, map som)",
    "vdsom": "a map of varying density (the default)",
    "links": "links between two maps",
    "train": "`calib.train` as a whole",
}


def _growth(growth: dict[str, Rows], fits: dict[str, Rows]) -> list[str]:
    lines = [
        "## Growth",
        "",
        *_MODEL.splitlines(),
        "Each case is measured in a process of its own, in processor seconds of both cores "
        "together.  While nodes grow there are 200,000 samples, while samples grow 70x70 nodes.  "
        "The exponent is that of least squares on logarithms, with its 95 % interval; "
        "“larger half” leaves out the small cases, in which fixed costs hide the growth.  What "
        "grows as n log n has an exponent of 1 in the column “over n log n” when its time is "
        "divided by log n.  Bytes are the slope of the process's peak memory.",
        "",
        "| what | against | exponent of time | larger half | over n log n | bytes per node or "
        "sample |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for part, rows in fits.items():
        for f in (f for f in rows if f["of"] == "cpu"):
            cells = (f"{f[k]['exponent']:.2f} ± {f[k]['interval']:.2f}"
                     for k in ("all", "larger", "nlogn"))  # fmt: skip
            lines.append(f"| {_PARTS.get(part, part)} | {f['varied']} | {' | '.join(cells)} | "
                         f"{f['bytes_each']:,.0f} |")  # fmt: skip
    lines += ["", "| what | nodes | samples | processor time [s] | wall [s] | more memory [MB] |",
              "|---|---:|---:|---:|---:|---:|"]  # fmt: skip
    for part in (name for name in growth if name not in ("joints", "large")):
        for r in growth[part]:
            lines.append(f"| {part} | {r['side']}x{r['side']} | {r['rows']:,} | "
                         f"{number(r['cpu'])} | {number(r['seconds'])} | "
                         f"{number(max(r['mb'], 0.0))} |")  # fmt: skip
    lines.append("")
    return [*lines, *_large(growth.get("large", [])), *_joints(growth.get("joints", []))]


def _large(rows: Rows) -> list[str]:
    if not rows:
        return []
    lines = [
        "### Large maps",
        "",
        "Plain maps of the positions in a Parquet file, which is read in parts.  Memory is the "
        "peak of reading and training beyond the imports; reading is wall time.  The error is the "
        "mean distance to the winner in spacings of the lattice, so that maps of all sizes "
        "compare.",
        "",
        "| nodes | samples | file [MB] | read [s] | processor time [s] | wall [s] | "
        "us for a sample | more memory [MB] | error |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for r in rows:
        cells = (r["file_mb"], r["read_s"], r["cpu"], r["seconds"], 1e6 * r["cpu"] / r["rows"],
                 r["mb"], r["error"] * r["side"])  # fmt: skip
        lines.append(f"| {r['side']:,}x{r['side']:,} | {r['read']:,} | "
                     f"{' | '.join(map(number, cells))} |")  # fmt: skip
    return [*lines, ""]


def _joints(rows: Rows) -> list[str]:
    if not rows:
        return []
    names = list(rows[0]["queries_us"])
    lines = [
        "### With joints",
        "",
        f"Planar chains of equal links, {rows[0]['rows']:,} exact samples, default options; "
        "processor time, of queries the median of single calls and of a row of a batch [us].  "
        "Positions are answered in plain floats whatever their number.  Bounds of more than three "
        "joints come from the body's posterior.  The inverse and `correct` of more than two take "
        "Newton steps to the joints that are nearest of all that reach the target.",
        "",
        f"| joints | motor map | train [s] | more memory [MB] | {' | '.join(names)} |",
        "|---:|---|" + "---:|" * (2 + len(names)),
    ]
    for r in rows:
        cells = [number(r["queries_us"][name]) for name in names]
        lines.append(f"| {r['joints']} | {r['motor']} | {number(r['cpu'])} | "
                     f"{number(max(r['mb'], 0.0))} | {' | '.join(cells)} |")  # fmt: skip
    return [*lines, ""]


def _limits(found: dict[str, Any]) -> list[str]:
    cpu, tree = found["cpu"], found["tree_query_sorted_us"]
    asked = {name: 1e6 * cpu[name] / tree for name in ("plain map", "map of varying density")}
    moved = 1e6 * 32 / (1e9 * found["copy_gb_s"])  # two doubles in, two out
    side, rows, batch = found["side"], found["rows"], found["batch"]
    lines = [
        "## The limit",
        "",
        f"On one core of this machine, one search of the k-d tree of {side}x{side} nodes for one "
        f"winner takes {tree:.2f} us where samples come sorted by place "
        f"({found['tree_query_us']:.2f} us where they do not), building that tree "
        f"{found['tree_build_ms']:.2f} ms, and copying reads and writes "
        f"{found['copy_gb_s']:.1f} GB/s.",
        "",
        f"- A plain map from {rows:,} samples takes {cpu['plain map']:.3f} s of processor time, "
        f"as much as {asked['plain map']:,.0f} such searches, {asked['plain map'] / rows:.1f} per "
        f"sample; a map of varying density {cpu['map of varying density']:.3f} s, "
        f"{asked['map of varying density'] / rows:.1f} searches per sample.  A batch map needs one "
        "search per sample and epoch unless it can tell that a winner has not changed.",
        f"- A forward query in a batch takes {1e6 * cpu['forward, batch'] / batch:.2f} us, "
        f"{1e6 * cpu['forward, batch'] / batch / tree:.1f} searches of the tree; moving its 32 "
        f"bytes takes {1e3 * moved:.1f} ns, so bytes are not what limits it.",
        f"- An inverse query in a batch takes {1e6 * cpu['inverse, batch'] / batch:.2f} us, "
        f"{1e6 * cpu['inverse, batch'] / batch / tree:.1f} searches.",
        "",
        "Functions that take most of the time themselves (cProfile, which overstates small ones):",
        "",
        "| work | share of the time |",
        "|---|---|",
    ]
    for name, shares in found["shares"].items():
        told = ", ".join(f"{where} {100 * share:.0f} %" for where, share in shares.items())
        lines.append(f"| {name} | {told} |")
    return [*lines, ""]
