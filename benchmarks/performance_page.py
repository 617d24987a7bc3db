"""The page docs/performance.md, written from docs/performance.json."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from measure import ROOT

Rows = list[dict[str, Any]]

_BY_PART = ("growth", "fits")


def read(folder: Path) -> dict[str, Any]:
    """Figures measured so far."""
    path = folder / "performance.json"
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def finish(folder: Path | None, new: dict[str, Any], quick: bool) -> None:
    """Merge new figures into the page, or print it where a quick run names no folder."""
    figures = {} if quick else read(folder or ROOT / "docs")
    if quick and folder is not None:
        figures = read(folder)
    for key in _BY_PART:
        if key in new:
            new[key] = figures.get(key, {}) | new[key]
    figures |= new
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
    for name, section in (("maps", _maps), ("queries", _queries), ("processes", _processes)):
        if figures.get(name):
            lines += section(figures[name])
    if figures.get("growth"):
        lines += _growth(figures["growth"], figures["fits"])
    if figures.get("limits"):
        lines += _limits(figures["limits"])
    return "\n".join(lines).rstrip() + "\n"


def _number(value: float) -> str:
    if value < 1e-6:
        return "< 1e-6"
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _range(s: dict[str, Any]) -> str:
    """Median, and the least and most where there were several runs."""
    if s["runs"] == 1:
        return f"{_number(s['median'])} (1 run)"
    return f"{_number(s['median'])} ({_number(s['least'])}–{_number(s['most'])})"


def _maps(maps: dict[str, Any]) -> list[str]:
    value, deviation = maps["area_by_chance_m2"]
    lines = [
        "## Training a map",
        "",
        "One plain self-organizing map of the positions of `two_link` (uniform joints), scaled to "
        "the unit box; the same array for all.  A map of N nodes on an area A can at best have "
        "the mean distance 0.377 sqrt(A / N) from a uniform sample to its winner (a hexagonal "
        "lattice).  The table gives the time to a quality: the least time of a whole training, "
        "from the array to the nodes, whose mean distance on 20,000 fresh samples is within the "
        "stated ratio of that bound.  Each library has its best amount of training on a grid "
        "(steps per node 5 to 110 for those that show one sample at a time; 7 to 40 passes over "
        "5, 10 or 20 samples per node for batch maps; 1.5 to 20 samples per node with the "
        "default schedule for calib), the least that is 0.003 better than asked for in a search "
        "before, repeated here in fresh processes and with other seeds, all in turn; libraries "
        "may use both cores.  Imports and just-in-time compilation are "
        "excluded and told apart (first call).",
        "",
        f"The workspace's area is l1 l2 range(q1) (cos q2min - cos q2max) = {maps['area_m2']:.5f} "
        f"m²; a million random points give {value:.5f} ± {deviation:.5f} m².  The samples are "
        "not uniform on it, so a ratio somewhat below 1 would be no contradiction.",
        "",
    ]
    race: Rows = maps["race"]
    for side in sorted({r["side"] for r in race}):
        for goal in sorted({r["goal"] for r in race if r["side"] == side}, reverse=True):
            rows = [r for r in race if (r["side"], r["goal"]) == (side, goal)]
            lines += _race_table(side, goal, rows)
            lines += _not_reached(maps["search"], side, goal, rows)
    lines += [
        "“Fresh maximum” is the largest distance of a fresh sample over the bound's mean; the "
        "topographic error is the share of fresh samples whose two nearest nodes are no lattice "
        "neighbours (diagonals count as neighbours).  Memory is the whole process at its peak, in "
        "brackets before the training began, so that a library's own imports can be told apart.  "
        "Slow trainings are repeated less often.",
        "",
        "| library | version | called as |",
        "|---|---|---|",
    ]
    for peer in maps["peers"]:
        lines.append(f"| {peer['name']} | {peer['version'] or 'not installed'} | {peer['note']} |")
    return [*lines, ""]


def _race_table(side: int, goal: str, rows: Rows) -> list[str]:
    ours = next((r["seconds"]["median"] for r in rows if r["peer"] == "calib"), None)
    rows = sorted(rows, key=lambda r: r["seconds"]["median"])
    lines = [
        f"### {side}x{side} nodes, to {goal} of the bound",
        "",
        "| library | training | time [s] | times calib's | samples/s | ratio to the bound | "
        "fresh maximum | topographic error | memory [MB] | first call [s] |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for r in rows:
        times = f"{r['seconds']['median'] / ours:.1f}" if ours else ""
        missed = r["seconds"]["runs"] - r["reached"]
        note = f", {missed} of {r['seconds']['runs']} missed" if missed else ""
        lines.append(
            f"| {r['peer']} | {r['setting']} | {_range(r['seconds'])} | {times} | "
            f"{_number(r['per_second'])} | {r['ratio']['median']:.3f}{note} | "
            f"{r['worst']['median']:.1f} | {100 * r['topographic']['median']:.2f} % | "
            f"{r['peak_mb']['most']:.0f} ({r['before_mb']:.0f}) | {r['first_s']:.2g} |"
        )
    return [*lines, ""]


def _not_reached(search: Rows, side: int, goal: str, rows: Rows) -> list[str]:
    """What is known of those that did not get there: how close, or how long it would take."""
    lines = []
    ours = next((r["seconds"]["median"] for r in rows if r["peer"] == "calib"), None)
    for s in search:
        if s["side"] != side or s["best"].get(goal) is not None:
            continue
        close = s["closest"]
        found = f"came to {close['ratio']:.3f}" if close else "was not run at this size"
        text = f"{s['peer']} did not reach {goal} within 60 s of processor time: it {found}"
        needed = _needed(search, s, side)
        if needed and s["cpu_per_sample"]:
            seconds = needed * s["cpu_per_sample"]
            times = f", {seconds / ours:,.0f} times calib's time" if ours else ""
            text += (
                f"; with as many samples per node as it took to 1.10 on 70x70 and "
                f"{1e6 * s['cpu_per_sample']:.0f} us of processor time each (measured on this "
                f"lattice), {seconds:,.0f} s are to be expected{times}"
            )
        lines.append(f"- {text}.")
    return [*lines, ""] if lines else []


def _needed(search: Rows, row: dict[str, Any], side: int) -> float | None:
    """Samples to be shown at this size, from those that 70x70 took."""
    for s in search:
        if (s["side"], s["peer"]) == (70, row["peer"]) and side > 70 and s["best"].get("1.10"):
            best = s["best"]["1.10"]
            online = best["rounds"] > 1000
            shown = best["rounds"] if online else best["rows"] * max(1, best["rounds"])
            return float(shown * (side / 70) ** 2)
    return None


def _queries(found: dict[str, Any]) -> list[str]:
    by_name = {r["name"]: r for r in found["rows"]}
    lines = [
        "## Queries",
        "",
        f"A {found['size']}x{found['size']} model of `two_link` from {found['samples']:,} exact "
        "samples, in a process that is bound to one core with one thread.  Nearest neighbours are "
        "scikit-learn's (k = 5, distance weights) on all training samples, once from joints to "
        "positions and once back.  Errors are distances to the true kinematics.  Solvers know the "
        "robot's kinematics; calib's model has learned it.  ikpy and pink are timed on "
        "40 targets, their setting up included.",
        "",
        "| query | time [us] | spread | per second | mean error [mm] | max [mm] |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for r in found["rows"]:
        errors = " | ".join(_number(r[k]) if k in r else "" for k in ("mean_mm", "max_mm"))
        lines.append(
            f"| {r['name']} | {_number(r['us'])} | {_number(r['least_us'])}–"
            f"{_number(r['most_us'])} | {_number(1e6 / r['us'])} | {errors} |"
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
    ratio, cpu = found["query_over_yardstick"], found["query_over_yardstick_cpu"]
    lines = [
        "## Whole commands",
        "",
        "From the start of a process to its end, imports included, with the default options; "
        "“before” is the code as it was before it was made faster, run in turn with the present "
        "one.",
        "",
        "| process | wall time [s] | processor time [s] | peak memory [MB] |",
        "|---|---:|---:|---:|",
    ]
    for r in found["rows"]:
        lines.append(f"| `{r['name']}` | {_range(r['seconds'])} | {_range(r['cpu'])} | "
                     f"{r['peak_mb']:.0f} |")  # fmt: skip
    rate = found["minisom_updates_per_second"]
    yardstick = f"  MiniSom made {rate:,.0f} updates per second (70x70) meanwhile." if rate else ""
    lines += [
        "",
        f'`calib query inverse` takes {ratio["median"]:.2f} times as long as `python -c "import '
        f'numpy, scipy.spatial"` run beside it ({ratio["least"]:.2f}–{ratio["most"]:.2f}; in '
        f"processor time {cpu['median']:.2f}).{yardstick}",
        "",
        "### Where the time goes",
        "",
    ]
    trees = list(found["stages"])
    lines += [f"| `calib train two_link`, stage | {' [s] | '.join(trees)} [s] |",
              "|---|" + "---:|" * len(trees)]  # fmt: skip
    told = {t: found["imports"][t]["train two_link"]["total"] for t in trees}
    lines.append("| imports, all together | " + " | ".join(f"{told[t]:.3f}" for t in trees) + " |")
    for stage in dict.fromkeys(s for t in trees for s in found["stages"][t]):
        cells = [found["stages"][t].get(stage) for t in trees]
        lines.append(f"| {stage} | " + " | ".join("" if c is None else f"{c:.3f}" for c in cells)
                     + " |")  # fmt: skip
    lines += ["", f"| `calib query inverse`, step | {' [s] | '.join(trees)} [s] |",
              "|---|" + "---:|" * len(trees)]  # fmt: skip
    told = {t: found["imports"][t]["query inverse"]["total"] for t in trees}
    lines.append("| imports, all together | " + " | ".join(f"{told[t]:.3f}" for t in trees) + " |")
    for step in found["steps"][trees[0]]:
        cells = [found["steps"][t][step] for t in trees]
        lines.append(f"| {step} | " + " | ".join(f"{c:.4f}" for c in cells) + " |")
    lines += [
        "",
        "Imports are the sum that `python -X importtime` tells, which itself slows them a little; "
        "the steps of a query and the stages of a training (its “total” is without the "
        "interpreter, the robot, the samples and the file) hold what they import at their first "
        "use.  Packages that take most of the imports, now:",
        "",
    ]
    for command, said in found["imports"]["now"].items():
        most = ", ".join(f"{name} {s:.3f} s" for name, s in said["packages"].items())
        lines.append(f"- `calib {command}`: {most}")
    return [*lines, ""]


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
    for part, rows in growth.items():
        for r in rows:
            name = part if part != "joints" else f"calib.train, {r['joints']} joints"
            nodes = f"{r['side']}x{r['side']}" if part != "joints" else r["motor"]
            lines.append(f"| {name} | {nodes} | {r['rows']:,} | {_number(r['cpu'])} | "
                         f"{_number(r['seconds'])} | {_number(max(r['mb'], 0.0))} |")  # fmt: skip
    return [*lines, ""]


def _limits(found: dict[str, Any]) -> list[str]:
    cpu, tree = found["cpu"], found["tree_query_us"]
    asked = {name: 1e6 * cpu[name] / tree for name in ("plain map", "map of varying density")}
    moved = 1e6 * 32 / (1e9 * found["copy_gb_s"])  # two doubles in, two out
    side, rows, batch = found["side"], found["rows"], found["batch"]
    lines = [
        "## The limit",
        "",
        f"On one core of this machine, one search of the k-d tree of {side}x{side} nodes for one "
        f"winner takes {tree:.2f} us, building that tree {found['tree_build_ms']:.2f} ms, and "
        f"copying reads and writes {found['copy_gb_s']:.1f} GB/s.",
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
