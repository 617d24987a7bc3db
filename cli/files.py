"""Files that a command writes: refused before the work whose result goes there."""

from __future__ import annotations

from pathlib import Path

from .parsing import BadOption

TABLES = (".csv", ".txt", ".parquet", ".pq")
"""Endings of tables; all but Parquet's are written as CSV."""


def check_file(
    path: str | None, endings: tuple[str, ...], *, option: str = "--output", stream: bool = False
) -> None:
    """Refuse an output that cannot be written, or whose ending is not what will be written.

    endings : those that fit; a name without any fits always
    stream : whether `-`, standard output, is one
    """
    from calib.common.atomic import check_writable

    if path is None or (stream and path == "-"):
        return
    if path == "-":
        raise BadOption(f"{option} '-': expected a file name", option, path)
    ending = Path(path).suffix.lower()
    if endings and ending and ending not in endings:
        expected = f"{option} {path!r}: expected a name that ends in {' or '.join(endings)}"
        raise BadOption(f"{expected}, which is what is written", option, path)
    check_writable(path)
