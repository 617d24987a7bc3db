"""Parquet files: their rows in batches, or one line that says what is wrong."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import LogError

if TYPE_CHECKING:
    import polars as pl

KEY = "calib"
"""Names the entry of the metadata that says what holds for all rows."""

BATCH = 1 << 18
"""Rows of a Parquet file that are held at once."""

ELEMENTS = 1 << 24
"""Elements of a column of lists that are held at once."""


@dataclass(frozen=True)
class ParquetFile:
    """A Parquet file, of which the header is read; errors call it `label`."""

    label: str
    path: Path
    header: tuple[str, ...]
    keep: object = None  # whatever has to live as long as the file is needed

    def frames(self, names: Sequence[str], lenient: bool | None = None) -> Iterator[pl.DataFrame]:
        """Yield columns of some rows at a time, of whatever type.

        Arrays are lists, but not where `lenient` is None, which takes columns as they are.
        """
        import polars as pl

        with _parquet_errors(self.label):
            table = pl.scan_parquet(self.path, glob=False).select(names)
            schema = table.collect_schema()
        counted = [] if lenient is None else names
        lists = [name for name in counted if isinstance(schema[name], (pl.List, pl.Array))]
        arrays = [name for name in lists if isinstance(schema[name], pl.Array)]
        table = table.with_columns(pl.col(arrays).arr.to_list()) if arrays else table
        # the first row alone tells how long the lists are, and so how many rows fit
        first, size = 0, 1 if lists else BATCH
        while True:
            with _parquet_errors(self.label):
                frame = table.slice(first, size).collect()
            yield frame
            if frame.height < size:
                return
            first += size
            counts = [frame[name].list.len().fill_null(0).to_numpy() for name in lists]
            longest = max((int(count.max(initial=1)) for count in counts), default=1)
            size = min(BATCH, max(1, ELEMENTS // longest))

    def about(self) -> str:
        """Return what the file says of all its rows, as JSON."""
        import polars as pl

        read = getattr(pl, "read_parquet_metadata", None)  # of newer versions
        return str(read(self.path).get(KEY, "{}")) if read else "{}"


def open_parquet(label: str, path: Path) -> ParquetFile:
    """Read the names of a Parquet file's columns."""
    import polars as pl

    with _parquet_errors(label):
        return ParquetFile(label, path, tuple(pl.read_parquet_schema(path)))


@contextmanager
def _parquet_errors(label: str) -> Iterator[None]:
    """Tell a failure of Polars in one line, without what its threads print on a panic."""
    import polars as pl

    # the whole process's, other threads' words too: a panic of Polars' Rust threads writes to
    # descriptor 2 by itself, before Python sees an exception, and nothing else stops it
    stderr = null = None
    with suppress(AttributeError, ValueError, OSError):  # there may be none
        sys.stderr.flush()
        stderr, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 2)
    try:
        yield
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError) as error:
        reason = (str(error).strip().splitlines() or ["unreadable"])[0][:100]
        raise LogError(f"{label} is a damaged Parquet file: {reason}") from None
    finally:
        if stderr is not None and null is not None:
            os.dup2(stderr, 2)
            os.close(stderr)
            os.close(null)
