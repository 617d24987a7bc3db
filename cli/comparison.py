"""Comparison: what a sweep found, as tables for people and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from calib.common.choices import READOUTS
from calib.common.wording import for_people

from .output import TextTable, fields, fixed, number
from .terms import explained

if TYPE_CHECKING:
    from calib import Sweep, Trial

DIRECTIONS = ("forward", "inverse")


def failures(found: Sweep) -> list[str]:
    """Return a line for each error of a source, however many of its trainings it ended."""
    ended: dict[tuple[str, str], list[Trial]] = {}
    for row in found.failed:
        ended.setdefault((row.source, row.error), []).append(row)
    return [f"error: {source}, {_which(rows)}: {error}" for (source, error), rows in ended.items()]


def sweep_tables(found: Sweep, readouts: Sequence[str]) -> list[TextTable]:
    """Return a table for each readout, with a row for each combination that was trained."""
    from calib.sweeps.trials import written

    parts = [done for part in found.combinations() if (done := _trained(part))]
    if not parts:
        return []
    varied = _varied(found)
    seeds = len({row.seed for row in found.rows})
    keys = ("mean", "spread", "max") if seeds > 1 else ("mean", "max")
    units = list(dict.fromkeys(part[0].unit for part in parts))
    header = ["source", *varied]
    header += [{"mean": way, "spread": "sd"}.get(key, key) for way in DIRECTIONS for key in keys]
    lines = []
    for readout in readouts:
        rows = []
        for part in parts:
            factor, _ = for_people(part[0].unit)
            cells = [part[0].source, *(written(part[0].options.get(name)) for name in varied)]
            for way in DIRECTIONS:
                result = together(part, readout, way)
                cells += [number(result[key] * factor) for key in keys]
            rows.append([*cells, fixed(_mean([row.seconds for row in part]), 2)])
        unit = ", ".join(for_people(unit)[1] for unit in units)
        title = f"{readout} readout: mean and largest error of the tip [{unit}]"
        if seeds > 1:
            title += f", mean of {seeds} seeds and its standard deviation"
        lines.append(TextTable([*header, "seconds"], rows, title, left=1 + len(varied)))
    return [*lines[:-1], *map(explained, lines[-1:])]  # the terms once, below the last


def count_line(found: Sweep, output: str | None) -> str:
    """Return a line that says how many trainings there were, and where."""
    where = "one after the other"
    if found.backend:
        many = f"{found.jobs} at a time" if found.jobs > 0 else "on all workers"
        where = f"{many} ({found.backend})"
    noun = "training" if len(found) == 1 else "trainings"
    failed = f", {len(found.failed)} failed" if found.failed else ""
    return f"{f'{output}: ' if output else ''}{len(found)} {noun}{failed}, {where}"


def document(found: Sweep, output: str | None) -> dict[str, Any]:
    """Return what the command prints as JSON."""
    return {
        "output": output,
        "backend": found.backend or None,
        "jobs": found.jobs,
        "trainings": len(found),
        "failed": len(found.failed),
        "units": {"errors": "unit of the row", "seconds": "s"},
        "combinations": [_combination(part) for part in found.combinations()],
        "rows": [
            fields(row, "source options seed seconds")
            # what a training that failed does not have, and the error of one that did not
            | {key: getattr(row, key) or None for key in ("unit", "errors", "error")}
            for row in found.rows
        ],
    }


def together(part: Sequence[Trial], readout: str, direction: str) -> dict[str, float]:
    """Return what trainings gave that differ in their seed alone, errors of the tip [unit].

    "mean" of the mean errors, their standard deviation "spread" (NaN for one seed), and the
    largest error "max" of all.
    """
    # not NumPy's: what one command alone needs must not slow the others' start
    from statistics import stdev

    means = [row.distance(readout, direction, "mean") for row in part]
    known = len(means) > 1 and all(map(math.isfinite, means))  # a training may lack a readout
    return {
        "mean": _mean(means),
        "spread": stdev(means) if known else math.nan,
        "max": max(row.distance(readout, direction, "max") for row in part),
    }


def _combination(part: Sequence[Trial]) -> dict[str, Any]:
    done = _trained(part)
    errors = {r: {way: together(done, r, way) for way in DIRECTIONS} for r in READOUTS if done}
    return {
        "source": part[0].source,
        "options": part[0].options,
        "seeds": [row.seed for row in part],
        "failed": len(part) - len(done),
        "unit": done[0].unit if done else None,
        "seconds": _mean([row.seconds for row in done]) if done else None,
        "errors": errors or None,
    }


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def _trained(part: Sequence[Trial]) -> list[Trial]:
    return [row for row in part if not row.error]


def _varied(found: Sweep) -> list[str]:
    """Return the options of which more than one value was tried."""
    names = dict.fromkeys(name for row in found.rows for name in row.options)
    return [n for n in names if len({repr(row.options.get(n)) for row in found.rows}) > 1]


def _which(rows: Sequence[Trial]) -> str:
    from calib.sweeps.trials import written

    if len(rows) > 1:
        return f"{len(rows)} trainings"
    options = [f"{name} {written(value)}" for name, value in rows[0].options.items()]
    return ", ".join([*options, f"seed {rows[0].seed}"])
