"""Logs: damaged and odd tables, whose accepted rows have to be what a plain reader finds."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

import calib
from calib.common.checks import LARGEST
from calib.errors import CalibError
from calib.samples.tables import read_batch

from .guard import guarded, one_line
from .kinds import Kind
from .mutate import NAMES, NUMBERS, damaged

MISSING = {"", "na", "n/a", "nan", "null", "none", "-", "?"}


@dataclass(frozen=True)
class LogCase:
    """A file and how it is asked for."""

    name: str
    data: bytes
    with_arm: bool
    columns: dict[str, str]
    degrees: bool
    prismatic: tuple[str, ...]


class Logs(Kind):
    """CSV and Parquet files, whole, odd and damaged."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.arm = calib.load_arm("two_link")

    def make(self, rng: Random) -> LogCase:
        """Make a file."""
        parquet = rng.random() < 0.35
        header, rows, separator = self._table(rng)
        if parquet:
            data = _parquet(rng, header, rows)
        elif rng.random() < 0.12:
            data = _monster(rng, header, rows)
        else:
            data = _csv(rng, header, rows, separator)
        if rng.random() < 0.3:
            data = damaged(rng, data, 2)
        columns = {"x": "cam u"} if "cam u" in header else {}
        if rng.random() < 0.05:
            columns[rng.choice(("x", "elbow", "q"))] = rng.choice(NAMES)
        suffix = rng.choice((".csv", ".csv", ".txt", "")) if not parquet else ".parquet"
        if rng.random() < 0.05:
            suffix = rng.choice((".parquet", ".csv", ".pq"))
        return LogCase(f"log{suffix}", data, rng.random() < 0.7, columns, rng.random() < 0.15,
                       ("elbow",) if rng.random() < 0.1 else ())  # fmt: skip

    def judge(self, case: LogCase) -> str:
        """Read it as a log and as a table of queries."""
        path = self.folder / case.name
        path.write_bytes(case.data)
        try:
            with guarded(self.folder):
                log = calib.read_log(
                    path,
                    self.arm if case.with_arm else None,
                    joints=None if case.with_arm else ("shoulder", "elbow"),
                    columns=case.columns,
                    degrees=case.degrees,
                    prismatic=() if case.with_arm else case.prismatic,
                )
                for note in log.notes:
                    one_line(note)
        except CalibError as error:
            one_line(str(error))
            outcome = "refused"
        else:
            _check(log)
            if not case.data.startswith(b"PAR1"):
                self._compare(log, case)
            outcome = "read"
        with guarded(self.folder):
            try:
                batch = read_batch(path, ("x", "y"))
                values, invalid = batch.values, batch.invalid
            except CalibError as error:
                one_line(str(error))
                return outcome
        bad = ~np.isfinite(values).all(axis=1)
        assert (np.flatnonzero(bad) + 1).tolist() == list(invalid)
        return outcome

    def _compare(self, log: calib.Samples, case: LogCase) -> None:
        """Find every accepted row in the file, in order, as Python itself reads numbers."""
        names = ["shoulder", "elbow", "x", "y"]
        if log.plane is not None or log.x.shape[1] == 3:  # else a column z is not looked at
            names.append("z")
        rows = _plain_rows(case.data, [case.columns.get(name, name) for name in names])
        assert len(log) + log.dropped <= len(rows), "more rows than there are"
        good = rows[(np.abs(rows) < LARGEST).all(axis=1)]
        assert log.dropped == len(rows) - len(good), "not as many rows dropped as miss a value"
        place = 0
        if log.plane is not None:
            return
        turns = np.array(log.revolute)
        scale = np.where(turns & case.degrees, math.radians(1.0), 1.0)
        joints = good[:, :2] * scale
        for q, x in zip(log.q, log.x, strict=True):
            while place < len(good) and not (good[place, 2:] == x).all():
                place += 1
            assert place < len(good), f"a row {q}, {x} that the file does not have"
            gap = q - joints[place]
            gap = np.where(turns, gap - 2 * np.pi * np.round(gap / (2 * np.pi)), gap)
            assert np.abs(gap).max() <= 1e-9 * max(1.0, np.abs(joints[place]).max()), (q, place)
            place += 1

    def _table(self, rng: Random) -> tuple[list[str], list[list[str]], str]:
        """Header, cells and separator of a table that is mostly right."""
        n = rng.choice((0, 1, 2, 5, 20, 60, 60))
        draws = np.random.default_rng(rng.getrandbits(32)).random((n, 2))
        q = self.arm.lower + (self.arm.upper - self.arm.lower) * draws
        x = self.arm.forward(q) if n else np.zeros((0, 2))
        if rng.random() < 0.1:
            q = np.degrees(q)
        columns = {"shoulder": q[:, 0], "elbow": q[:, 1], "x": x[:, 0], "y": x[:, 1]}
        cells = {name: [repr(float(v)) for v in values] for name, values in columns.items()}
        if rng.random() < 0.1:
            cells["z"] = [rng.choice(("0", "0.1", "1e-3")) for _ in range(n)]
        if rng.random() < 0.3:
            cells["time"] = [rng.choice(("1", "a", "", "12:00")) for _ in range(n)]
        if rng.random() < 0.1:
            cells["cam u"] = cells.pop("x")
        for _ in range(rng.choice((0, 0, 1, 2))):
            if n:
                cells[rng.choice(list(cells))][rng.randrange(n)] = rng.choice(NUMBERS)
        header = list(cells)
        rng.shuffle(header)
        rows = [[cells[name][k] for name in header] for k in range(n)]
        if rng.random() < 0.1:
            header[rng.randrange(len(header))] = rng.choice(NAMES)
        if rng.random() < 0.05:
            header.append(rng.choice(header))
            rows = [[*row, row[0]] for row in rows]
        for _ in range(rng.choice((0, 0, 0, 1, 2))):
            if rows:
                rows.insert(rng.randrange(len(rows)), rng.choice(([], [""], rows[0][:-1],
                            [*rows[0], "1"], [*rows[0], ""], [" "] * len(header))))  # fmt: skip
        return header, rows, rng.choice((",", ",", ",", ";", "\t"))


def _csv(rng: Random, header: list[str], rows: list[list[str]], separator: str) -> bytes:
    out = io.StringIO()
    quoting = rng.choice((csv.QUOTE_MINIMAL, csv.QUOTE_MINIMAL, csv.QUOTE_ALL))
    end = rng.choice(("\n", "\n", "\r\n", "\r"))
    writer = csv.writer(out, delimiter=separator, quoting=quoting, lineterminator=end)
    try:
        writer.writerows([header, *rows])
    except csv.Error:
        return b""
    text = out.getvalue()
    if rng.random() < 0.1:
        text = text.replace(separator, f" {separator} ")
    if rng.random() < 0.1:
        text = end * rng.randint(1, 3) + text
    return text.encode(rng.choice(("utf-8", "utf-8", "utf-8-sig")), "replace")


def _monster(rng: Random, header: list[str], rows: list[list[str]]) -> bytes:
    """A file that is long in some direction."""
    good = "\n".join(",".join(row) for row in [header, *rows])
    choice = rng.randrange(7)
    if choice == 0:
        wide = [*header, *(f"c{k}" for k in range(10_000))]
        return "\n".join([",".join(wide), *(",".join([*row, *["1"] * 10_000])
                                            for row in rows[:5])]).encode()  # fmt: skip
    if choice == 1:
        return (good + "\n" + "9" * 3_000_000).encode()
    if choice == 2:
        return ("x" * 3_000_000 + "," + good).encode()
    if choice == 3:
        return good.encode() + b"\n" + bytes(3_000_000)
    if choice == 4:
        return (good + "\n" + '"' + "\n".join(",".join(row) for row in rows) * 2000).encode()
    if choice == 5:
        return (good + "\n" * 500_000).encode()
    return (",".join(header) + "\n" + ("," * (len(header) - 1) + "\n") * 50_000).encode()


def _parquet(rng: Random, header: list[str], rows: list[list[str]]) -> bytes:
    import polars as pl

    width = len(header)
    rows = [row for row in rows if len(row) == width]
    frame: dict[str, Any] = {}
    for k, name in enumerate(header):
        cells = [_cell(row[k]) for row in rows]
        odd = rng.random() < 0.12
        frame[name] = _odd(rng, cells) if odd else pl.Series(cells, dtype=pl.Float64, strict=False)
    out = io.BytesIO()
    compression = rng.choice(("zstd", "snappy", "uncompressed", "gzip", "lz4"))
    try:
        pl.DataFrame(frame).write_parquet(out, compression=compression)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError):
        return b"PAR1"
    return out.getvalue()


def _odd(rng: Random, cells: list[float]) -> Any:
    """A column of another type."""
    import polars as pl

    kind = rng.randrange(10)
    if kind == 0:
        return pl.Series([str(c) for c in cells], dtype=pl.String)
    if kind == 1:
        return pl.Series([c > 0 for c in cells], dtype=pl.Boolean)
    if kind == 2:
        return pl.Series([[c] for c in cells], dtype=pl.List(pl.Float64))
    if kind == 3:
        return pl.Series([{"a": c} for c in cells], dtype=pl.Struct({"a": pl.Float64}))
    if kind == 4:
        return pl.Series([None for _ in cells], dtype=pl.Null)
    if kind == 5:
        return pl.Series([2**64 - 1 - k for k in range(len(cells))], dtype=pl.UInt64)
    if kind == 6:
        return pl.Series(cells, dtype=pl.Float32, strict=False)
    if kind == 7:
        return pl.Series([b"\xff" for _ in cells], dtype=pl.Binary)
    if kind == 8:
        return pl.Series([1 for _ in cells], dtype=pl.Datetime)
    return pl.Series([f"{c}" for c in cells], dtype=pl.Categorical)


def _cell(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _check(log: calib.Samples) -> None:
    assert len(log.q) == len(log.x) >= 2
    assert np.isfinite(log.q).all()
    assert np.isfinite(log.x).all()
    assert (log.lower < log.upper).all()
    slack = 1e-9 * (log.upper - log.lower)
    assert (log.q >= log.lower - slack).all()
    assert (log.q <= log.upper + slack).all()


def _plain_rows(data: bytes, names: list[str]) -> np.ndarray:
    """Numbers of some columns of a CSV file, as the standard library reads it."""
    text = data.decode("utf-8-sig")
    line = data.split(b"\n", 1)[0]
    separator = max(",;\t", key=lambda mark: line.count(mark.encode()))
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    usual = csv.field_size_limit(len(text) + 1)  # a cell may be as long as a line
    try:
        rows = [row for row in reader if row and (len(row) > 1 or row[0].strip())]
    finally:
        csv.field_size_limit(usual)
    header = [name.strip() for name in rows[0]]
    has_z = "z" in header and "z" not in names
    index = [header.index(name) for name in (*names, *(["z"] if has_z else []))]
    return np.array([[_number(row[i]) if i < len(row) else math.nan for i in index]
                     for row in rows[1:]]).reshape(-1, len(index))  # fmt: skip


def _number(cell: str) -> float:
    text = cell.strip()
    if text.lower() in MISSING:
        return math.nan
    assert text.isascii(), f"{text!r} was taken for a number"
    assert "_" not in text, f"{text!r} was taken for a number"
    return float(text)
