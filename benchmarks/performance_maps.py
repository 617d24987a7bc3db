"""The section of docs/performance.md on the training of maps."""

from __future__ import annotations

from typing import Any

from map_race import CAP
from measure import interval, number

Rows = list[dict[str, Any]]


def maps_section(maps: dict[str, Any]) -> list[str]:
    """Lines of the section on training, with a table for each lattice and quality."""
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
        "5, 10 or 20 samples per node for batch maps; 2 to 20 samples per node with the "
        "default schedule for calib), the least that got there in a search before (the median of "
        "three seeds where it was close; of calib every one of five), repeated here in fresh "
        "processes, all in turn; libraries may use both cores.  Imports and just-in-time "
        "compilation are excluded and told apart (first call).",
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
    ours = next((r for r in rows if r["peer"] == "calib"), None)
    rows = sorted(rows, key=lambda r: r["cpu"]["median"])
    lines = [
        f"### {side}x{side} nodes, to {goal} of the bound",
        "",
        "| library | training | time [s] | times calib's | processor time [s] | times calib's | "
        "samples/s | "
        "ratio to the bound | fresh maximum | topographic error | memory [MB] | first call [s] |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for r in rows:
        wall, cpu = (f"{r[k]['median'] / ours[k]['median']:.1f}" if ours else ""
                     for k in ("seconds", "cpu"))  # fmt: skip
        missed = r["seconds"]["runs"] - r["reached"]
        note = f", {missed} of {r['seconds']['runs']} missed" if missed else ""
        lines.append(
            f"| {r['peer']} | {r['setting']} | {interval(r['seconds'])} | {wall} | "
            f"{interval(r['cpu'])} | {cpu} | "
            f"{number(r['per_second'])} | {r['ratio']['median']:.3f}{note} | "
            f"{r['worst']['median']:.1f} | {100 * r['topographic']['median']:.2f} % | "
            f"{r['peak_mb']['most']:.0f} ({r['before_mb']:.0f}) | {r['first_s']:.2g} |"
        )
    return [*lines, ""]


def _not_reached(search: Rows, side: int, goal: str, rows: Rows) -> list[str]:
    """What is known of those that did not get there: how close, or how long it would take."""
    lines = []
    ours = next((r["cpu"]["median"] for r in rows if r["peer"] == "calib"), None)
    for s in search:
        if s["side"] != side or s["best"].get(goal) is not None:
            continue
        close = s["closest"]
        found = f"came to {close['ratio']:.3f}" if close else "was not run at this size"
        text = f"{s['peer']} did not reach {goal} within {CAP:.0f} s of processor time: it {found}"
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
