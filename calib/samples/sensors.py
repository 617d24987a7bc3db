"""Sensors: logs of several that measured one arm, a file each or by a column `sensor`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

from .tables import Source, open_source

COLUMN = "sensor"
"""Column that says which sensor measured a row."""


def sources_by_sensor(
    paths: Sequence[str | os.PathLike[str] | Source],
) -> dict[str, Source]:
    """Return a table for each sensor, by its name; rows keep their numbers.

    A sensor is named by the column `sensor`; where there is none, by its file's name, or not at all
    if it is the only one.
    """
    import polars as pl

    by_name: dict[str, Source] = {}
    for path in paths:
        source = open_source(path)
        names = names_of_sensors(source)
        measured = pl.col(COLUMN).cast(pl.String).str.strip_chars()
        tables = {
            name: replace(source, rows=source.rows.filter(measured == name))
            for name in names
        }
        if not names:
            label = Path(source.label).stem if len(paths) > 1 else ""
            tables = {label: source}
        for name, table in tables.items():
            numbered = (f"{name}-{number}" for number in count(2))
            while name in by_name:
                name = next(numbered)
            by_name[name] = table
    return by_name


def names_of_sensors(source: Source) -> tuple[str, ...]:
    """Names in a table's column `sensor`, in their order; none where it has no such column."""
    if COLUMN not in source.header:
        return ()
    cells = source.read([COLUMN])[COLUMN].cast(str)
    names = cells.fill_null("").str.strip_chars().unique(maintain_order=True)
    return tuple(name for name in names.to_list() if name)
