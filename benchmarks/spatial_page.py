"""The section on arms in space of docs/accuracy.md, from the lines of `benchmarks/spatial.py`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

Row = dict[str, Any]

WORDS = """\
## A real arm in space

UR10, six joints, position by a laser tracker (the same measurements, all columns). Written from
`docs/spatial.json`: `python benchmarks/spatial.py --data FOLDER --json docs/spatial.json`, then
`python benchmarks/accuracy.py --page`. Ten contiguous blocks, five held out in turn; errors in mm;
"covered" is the share of held-out rows within the 95 % bound. "Geometry alone" is the same fit
without elasticity and joint curves; "nominal" is the URDF with base and tool fitted."""

PEERS = """\
**Beside other tools** on the same {rows} rows, evenly spaced, each from the nominal arm in its
best frame (`benchmarks/spatial_peer.py` says how they are installed). robotkinecal 0.1.0 moves the
joints' screws, FIGAROH 1.0.2 six numbers at each joint origin of which it keeps those that can be
told, both without a prior, elasticity or curves; both converged."""

MOUNT = """\
**After a new mounting** `calib adapt` takes the old posterior as the prior of the arm and finds
the sensor anew."""

UNKNOWN = """\
**Without a URDF** the chain is found from random starts; three draws, the first of C being the
block in which it warmed up."""

URDF = """\
**The URDF that `calib urdf` writes** after {rows:,} rows, without elasticity and curves, for which
a URDF has no words: mean error on the held-out block, base and tool fitted to the same rows."""

SAFE = """\
**Never worse than the nominal arm** with frames fitted by the same estimator to the same rows:
the largest ratio of held-out errors in {draws} draws."""

STRAIGHT = """\
**A simulated UR10 without joint curves**, against geometry alone: ratio of errors, mean of
draws."""

CAMERA = """\
**A simulated SO-101** (five joints) in 60 pictures at 0.3 px; camera, focal length, centre and k1
unknown, joint offsets up to 5 deg. "Up to" is up to a similarity, which one camera cannot tell;
"base" is the 95 % bound in the base frame, then without the arm's size, each with its coverage."""

TIME = """\
**Time of a fit**, processor time on two busy cores (bars: 2 s and 6 s):
{said}.

**Poses** of the bundled six-axis arm: {branches} branches of {targets} poses by its closed form,
{missed} missed, {invented} invented, {ms_per_target} ms each."""


def section(lines: Iterable[Row]) -> list[str]:
    """Lines of Markdown."""
    parts: dict[str, list[Row]] = {}
    for line in lines:
        parts.setdefault(line["part"], []).append(line)
    out = [WORDS, ""]
    for part, made in _PARTS.items():
        if part in parts and "skipped" not in parts[part][0]:
            out += [*made(parts[part]), ""]
    if {"time", "poses"} <= set(parts):
        said = "; ".join(
            f"{r['series'].upper()}, {r['rows']:,} rows, {r['seconds']} s" for r in parts["time"]
        )
        out += [TIME.format(said=said, **parts["poses"][0]), ""]
    return out


def _table(head: str, rows: Iterable[Sequence[Any]]) -> list[str]:
    cells = [f"| {' | '.join(str(cell) for cell in row)} |" for row in rows]
    return [f"| {head} |", "|---|" + "---:|" * head.count("|"), *cells]


def _count(rows: int) -> str:
    return f"{rows:,}" if rows else "all"


def _rows(lines: list[Row]) -> list[str]:
    return _table(
        "series, rows | nominal | geometry alone | calib | 95 % | max | covered | to geometry",
        (
            (
                f"{r['series'].upper()}, {_count(r['rows'])}", r["nominal"], r["geometry"],
                f"**{r['mean']}**", r["p95"], r["max"], f"{r['covered']} %",
                f"{r['mean'] / r['geometry']:.2f}",
            )
            for r in lines
        ),
    )  # fmt: skip


def _peers(lines: list[Row]) -> list[str]:
    tools = [name for name in lines[0]["ratio"] if name != "calib"]
    head = " | ".join(["series | calib", *tools, *(f"ratio to {tool}" for tool in tools)])
    rows = (
        (r["series"].upper(), r["calib"], *(r[t] for t in tools), *(r["ratio"][t] for t in tools))
        for r in lines
    )
    counts = " and ".join(f"{r['rows']:,}" for r in lines)
    return [PEERS.format(rows=counts), "", *_table(head, rows)]


def _mount(lines: list[Row]) -> list[str]:
    rows = (
        (f"{r['from']} to {r['to']}".upper().replace("TO", "to"), r["rows"], r["mean"], r["p95"],
         f"{r['covered']} %", f"{r['answered']} %")
        for r in lines
    )  # fmt: skip
    return [MOUNT, "", *_table("series | rows | mean | 95 % | covered | answered", rows)]


def _urdf(lines: list[Row]) -> list[str]:
    rows = ((r["series"].upper(), r["nominal"], r["mean"]) for r in lines)
    head = "series | nominal URDF | written URDF"
    return [URDF.format(rows=lines[0]["rows"]), "", *_table(head, rows)]


def _unknown(lines: list[Row]) -> list[str]:
    rows = (
        (r["series"].upper(), r["rows"], r["mean"], r["p95"], r["max"], f"{r['covered']} %")
        for r in lines
    )
    return [UNKNOWN, "", *_table("series | rows | mean | 95 % | max | covered", rows)]


def _safe(lines: list[Row]) -> list[str]:
    counts = list(lines[0]["worst"])
    rows = ((r["series"].upper(), *r["worst"].values()) for r in lines)
    head = " | ".join(["series", *(f"{n} rows" for n in counts)])
    return [SAFE.format(draws=lines[0]["draws"]), "", *_table(head, rows)]


def _straight(lines: list[Row]) -> list[str]:
    rows = ((f"{r['noise_mm']:g}", r["rows"], r["ratio"], r["worst"]) for r in lines)
    return [STRAIGHT, "", *_table("noise [mm] | rows | ratio | worst", rows)]


def _camera(lines: list[Row]) -> list[str]:
    rows = (
        (
            r["placements"], r["pixels"], r["tip_mm"], r["tip_up_to_similarity_mm"],
            f"{r['camera_mm']} mm, {r['camera_deg']} deg",
            f"{r['base_mm']} mm, {r['base_covered']} %",
            f"{r['shape_mm']} mm, {r['shape_covered']} %",
        )
        for r in lines
    )  # fmt: skip
    head = "joint origins | pixels | tip [mm] | up to [mm] | camera | base | without size"
    return [CAMERA, "", *_table(head, rows)]


_PARTS: dict[str, Callable[[list[Row]], list[str]]] = {
    "rows": _rows,
    "peer": _peers,
    "mount": _mount,
    "urdf": _urdf,
    "unknown": _unknown,
    "safe": _safe,
    "straight": _straight,
    "camera": _camera,
}
