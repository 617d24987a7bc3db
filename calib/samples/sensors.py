"""Sensors: logs of several that measured one arm, a file each or by a column `sensor`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import count
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
    by_name: dict[str, Source] = {}
    for path in paths:
        source = open_source(path)
        for name, rows in _by_column(source):
            if not name and len(paths) > 1:
                name = Path(source.label).stem
            numbered = (f"{name}-{number}" for number in count(2))
            while name in by_name:
                name = next(numbered)
            by_name[name] = rows
    return by_name


def _by_column(source: Source) -> Iterator[tuple[str, Source]]:
    """Name the sensors of a table, with the rows of each, which keep their numbers."""
    import polars as pl

    names = names_of_sensors(source)
    if not names:
        yield "", source
    for name in names:
        measured = pl.col(COLUMN).cast(pl.String).str.strip_chars() == name
        yield name, replace(source, rows=source.rows.filter(measured))


def names_of_sensors(source: Source) -> tuple[str, ...]:
    """Names in a table's column `sensor`, in their order; none where it has no such column."""
    if COLUMN not in source.header:
        return ()
    names = (
        source.read([COLUMN])[COLUMN].cast(str).fill_null("").str.strip_chars()
    )
    return tuple(
        name for name in names.unique(maintain_order=True).to_list() if name
    )
