"""Measure how honest the bounds, alarms and adaptations are: one row per bar.

    python benchmarks/honesty.py --data FOLDER [--only PART,PART] [--quick]

FOLDER holds the laser-tracker logs series_a.csv, series_c.csv, full_a.csv and full_c.csv of a UR10
(docs/accuracy.md names their source); without it the parts on real rows are left out, aloud.
PART is one of coverage, gaps, adapt, adapt-space, check, rows, few, urdf, sessions, real-streams
(real rows) and paths, places, power, change, clocks, noisier, encoders, encoders-space,
repeats, few-rows, approach, streams (own generators, see honest_worlds.py).
``--quick`` takes fewer splits and seeds: each part then ends within about a minute.
"""

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import honest_change
import honest_check
import honest_real
import honest_verdicts
from tables import typed

Row = dict[str, Any]

REAL: dict[str, Callable[[Path, bool], Iterator[Row]]] = {
    "coverage": honest_real.coverage,
    "gaps": honest_real.gaps,
    "adapt": honest_change.adaptations,
    "adapt-space": honest_change.space_adaptations,
    "check": honest_check.checks,
    "rows": honest_real.rows,
    "few": honest_real.few,
    "urdf": honest_real.urdf,
    "sessions": honest_verdicts.sessions,
    "real-streams": honest_verdicts.real_streams,
}
OWN: dict[str, Callable[[bool], Iterator[Row]]] = {
    "paths": honest_check.paths,
    "places": honest_change.places,
    "power": honest_check.power,
    "change": honest_change.changed,
    "clocks": honest_check.clocks,
    "noisier": honest_check.noisier,
    "encoders": honest_check.encoders,
    "encoders-space": honest_check.space_encoders,
    "repeats": honest_verdicts.repeats,
    "few-rows": honest_verdicts.few_rows,
    "approach": honest_verdicts.approach,
    "streams": honest_verdicts.streams,
}


def judged(row: Row) -> Row:
    """Add whether a measured figure keeps its bar."""
    value, low, high = row["measured"], row.get("least"), row.get("most")
    kept = value == value and (low is None or value >= low) and (high is None or value <= high)
    return {**row, "kept": bool(kept) if (low, high) != (None, None) else None}


def shown(row: Row) -> str:
    """One line of the table."""
    bar = " to ".join(
        f"{word} {row[key]:g}"
        for key, word in (("least", "at least"), ("most", "at most"))
        if row.get(key) is not None
    )
    verdict = {True: "kept", False: "MISSED", None: ""}[row["kept"]]
    more = f"  ({row['more']})" if row.get("more") else ""
    return f"{row['what']:<58} {row['measured']:>9.4g} {row['unit']:<4} {bar:<28} {verdict}{more}"


def main() -> None:
    """Run the parts and print their rows."""
    options = typed(__doc__, data=Path, only="", quick=False)
    wanted = [name for name in options.only.split(",") if name]
    unknown = set(wanted) - {*REAL, *OWN}
    if unknown:
        sys.exit(f"unknown: {', '.join(sorted(unknown))}; choose from {', '.join(REAL | OWN)}")
    warnings.simplefilter("ignore")
    found: list[Row] = []
    for name in REAL | OWN:
        if wanted and name not in wanted:
            continue
        if name in REAL and options.data is None:
            print(f"{name}: no --data, left out", file=sys.stderr)
            continue
        started = time.perf_counter()
        parts = (
            REAL[name](options.data, options.quick) if name in REAL else OWN[name](options.quick)
        )
        for row in parts:
            found.append(judged(row))
            print(shown(found[-1]), flush=True)
        print(f"{name}: {time.perf_counter() - started:.0f} s", file=sys.stderr)
    missed = [row for row in found if row["kept"] is False]
    print(f"{len(found)} rows, {len(missed)} missed")


if __name__ == "__main__":
    main()
