"""Sensors: logs of several that measured one arm, a file each or by a column `sensor`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from .tables import Source, open_source

COLUMN = "sensor"
"""Column that says which sensor measured a row."""


def sources_by_sensor(
    paths: Sequence[str | os.PathLike[str] | Source],
) -> dict[str, Source]:
    """Return a table for each sensor, by its name.

    A sensor is named by the column `sensor`; where there is none, by its file's name, or not at all
    if it is the only one.
    """
    sources = [open_source(path) for path in paths]
    by_name: dict[str, Source] = {}
    for source in sources:
        names = names_of_sensors(source)
        if not names:
            names = ("",) if len(sources) == 1 else (Path(source.label).stem,)
            by_name[_free_name(names[0], by_name)] = source
            continue
        for name in names:
            by_name[_free_name(name, by_name)] = rows_of_sensor(source, name)
    return by_name


def names_of_sensors(source: Source) -> tuple[str, ...]:
    """Names in a table's column `sensor`, in their order; none where it has no such column."""
    if COLUMN not in source.header:
        return ()
    names = source.read([COLUMN])[COLUMN].cast(str).fill_null("").str.strip_chars()
    return tuple(name for name in names.unique(maintain_order=True).to_list() if name)


def rows_of_sensor(source: Source, name: str) -> Source:
    """Return the rows of a table that one sensor measured; they keep their numbers."""
    import polars as pl

    measured = pl.col(COLUMN).cast(pl.String).str.strip_chars() == name
    return replace(source, rows=source.rows.filter(measured))


def _free_name(name: str, taken: dict[str, Source]) -> str:
    """Return a name that no other sensor has."""
    number = 2
    free = name
    while free in taken:
        free = f"{name}-{number}"
        number += 1
    return free
