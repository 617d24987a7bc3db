"""Comparison: what a sweep found, as tables for people and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from calib.common.choices import READOUTS
from calib.common.wording import for_people

from .output import TextTable, fields, fixed, number

if TYPE_CHECKING:
    from calib import Sweep, Trial

_DIRECTIONS = ("forward", "inverse")


def failures(found: Sweep) -> list[str]:
    """Return a line for each error of a source, however many of its trainings it ended."""
    from calib.sweeps.trials import written

    ended: dict[tuple[str, str], list[str]] = {}
    for row in found.failed:
        options = [f"{name} {written(value)}" for name, value in row.options.items()]
        which = ", ".join([*options, f"seed {row.seed}"])
        ended.setdefault((row.source, row.error), []).append(which)
    return [
        f"error: {source}, {rows[0] if len(rows) == 1 else f'{len(rows)} trainings'}: {error}"
        for (source, error), rows in ended.items()
    ]


def sweep_tables(found: Sweep, readouts: Sequence[str]) -> list[TextTable]:
    """Return a table for each readout, with a row for each combination that was trained."""
    from calib.sweeps.trials import written

    parts = [told for part in found.combinations() if (told := _combination(part))["errors"]]
    if not parts:
        return []
    # options of which more than one value was tried
    names = dict.fromkeys(name for row in found.rows for name in row.options)
    varied = [n for n in names if len({repr(row.options.get(n)) for row in found.rows}) > 1]
    seeds = len({row.seed for row in found.rows})
    keys = {"mean": "", "spread": "sd", "max": "max"} if seeds > 1 else {"mean": "", "max": "max"}
    header = ["source", *varied]
    header += [shown or way for way in _DIRECTIONS for shown in keys.values()]
    unit = ", ".join(dict.fromkeys(for_people(part["unit"])[1] for part in parts))
    tables = []
    for readout in readouts:
        rows = []
        for part in parts:
            factor, _ = for_people(part["unit"])
            ways = [part["errors"][readout][way] for way in _DIRECTIONS]
            cells = [part["source"], *(written(part["options"].get(name)) for name in varied)]
            cells += [number(errors[key] * factor) for errors in ways for key in keys]
            rows.append([*cells, fixed(part["seconds"], 2)])
        title = f"{readout} readout: mean and largest error of the tip [{unit}]"
        title += f", mean of {seeds} seeds and its standard deviation" if seeds > 1 else ""
        tables.append(TextTable([*header, "seconds"], rows, title, left=1 + len(varied)))
    return tables


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


def _combination(part: Sequence[Trial]) -> dict[str, Any]:
    """Return what trainings gave that differ in their seed alone, those that failed left out."""
    # not NumPy's: what one command alone needs must not slow the others' start
    from statistics import fmean

    done = [row for row in part if not row.error]
    errors = {r: {way: together(done, r, way) for way in _DIRECTIONS} for r in READOUTS if done}
    return {
        "source": part[0].source,
        "options": part[0].options,
        "seeds": [row.seed for row in part],
        "failed": len(part) - len(done),
        "unit": done[0].unit if done else None,
        "seconds": fmean(row.seconds for row in done) if done else None,
        "errors": errors or None,
    }


def together(part: Sequence[Trial], readout: str, direction: str) -> dict[str, float]:
    """Return what some seeds gave for a readout, errors of the tip [unit].

    "mean" of the mean errors, their standard deviation "spread" (NaN for one seed), and the
    largest error "max" of all.
    """
    from statistics import fmean, stdev

    means = [row.distance(readout, direction, "mean") for row in part]
    known = len(means) > 1 and all(map(math.isfinite, means))  # a training may lack a readout
    return {
        "mean": fmean(means),
        "spread": stdev(means) if known else math.nan,
        "max": max(row.distance(readout, direction, "max") for row in part),
    }
