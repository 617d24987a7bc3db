"""Logs: damaged and odd tables, whose accepted rows have to be what a plain reader finds."""

import csv
import io
import math
from random import Random

import numpy as np

import calib
from hostile.damage import NAMES, NUMBERS, damaged
from hostile.guard import each_seed, guarded, one_line

ARM = calib.load_arm("two_link")
LARGEST = 1e15


def table(rng: Random):
    """Header, cells and separator of a table that is mostly right."""
    n = rng.choice((0, 1, 2, 5, 20, 60, 60))
    draws = np.random.default_rng(rng.getrandbits(32)).random((n, 2))
    q = ARM.lower + (ARM.upper - ARM.lower) * draws
    x = ARM.forward(q) if n else np.zeros((0, 2))
    if rng.random() < 0.1:
        q = np.degrees(q)
    columns = {"shoulder": q[:, 0], "elbow": q[:, 1], "x": x[:, 0], "y": x[:, 1]}
    cells = {name: [repr(float(v)) for v in values] for name, values in columns.items()}
    if rng.random() < 0.1:
        cells["z"] = [rng.choice(("0", "0.1", "1e-3")) for _ in range(n)]
    if rng.random() < 0.2:
        cells["note"] = [rng.choice(("1", "a", "", "12:00")) for _ in range(n)]
    if rng.random() < 0.1:
        cells["cam u"] = cells.pop("x")
    for _ in range(rng.choice((0, 0, 1, 2)) if n else 0):
        cells[rng.choice(list(cells))][rng.randrange(n)] = rng.choice(NUMBERS)
    header = list(cells)
    rng.shuffle(header)
    rows = [[cells[name][k] for name in header] for k in range(n)]
    if rng.random() < 0.1:
        header[rng.randrange(len(header))] = rng.choice(NAMES)
    for _ in range(rng.choice((0, 0, 0, 1, 2)) if rows else 0):
        odd = ([], [""], rows[0][:-1], [*rows[0], "1"], [*rows[0], ""], [" "] * len(header))
        rows.insert(rng.randrange(len(rows)), rng.choice(odd))
    return header, rows, rng.choice((",", ",", ",", ";", "\t"))


def as_csv(rng, header, rows, separator):
    out, end = io.StringIO(), rng.choice(("\n", "\n", "\r\n", "\r"))
    quoting = rng.choice((csv.QUOTE_MINIMAL, csv.QUOTE_MINIMAL, csv.QUOTE_ALL))
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


def number(cell):
    try:
        return float(cell)
    except ValueError:
        return math.nan


def plain_rows(data, names):
    """Numbers of some columns of a CSV file, as the standard library reads it."""
    text = data.decode("utf-8-sig")
    line = text.lstrip().split("\n", 1)[0]
    separator = max(",;\t", key=line.count)
    usual = csv.field_size_limit(len(text) + 1)  # a cell may be as long as a line
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=separator))
    finally:
        csv.field_size_limit(usual)
    while rows and not any(cell.strip() for cell in rows[0]):
        rows.pop(0)
    while rows and not any(rows[-1]):
        rows.pop()
    header = [name.strip() for name in rows[0]]
    index = [header.index(name) for name in (*names, *(["z"] if "z" in header else []))]
    found = np.full((len(rows) - 1, len(index)), math.nan)
    for k, row in enumerate(rows[1:]):
        for j, i in enumerate(index):
            cell = row[i].strip() if i < len(row) else ""
            if cell.isascii() and "_" not in cell:  # as in Python, which takes other digits too
                found[k, j] = number(cell)
    return found


def stands_in_the_file(log, data, columns, degrees):
    """Find every accepted row in the file, in order, as Python itself reads numbers."""
    rows = plain_rows(data, [columns.get(name, name) for name in ("shoulder", "elbow", "x", "y")])
    good = rows[(np.abs(rows) < LARGEST).all(axis=1)]
    assert log.dropped == len(rows) - len(good), "not as many rows dropped as miss a value"
    turns, place = np.array(log.revolute), 0
    joints = good[:, :2] * np.where(turns & degrees, math.radians(1.0), 1.0)
    for q, x in zip(log.q, log.x, strict=True):
        while place < len(good) and not (good[place, 2 : 2 + len(x)] == x).all():
            place += 1
        assert place < len(good), f"a row {q}, {x} that the file does not have"
        gap = q - joints[place]
        gap = np.where(turns, gap - 2 * np.pi * np.round(gap / (2 * np.pi)), gap)
        assert np.abs(gap).max() <= 1e-9 * max(1.0, np.abs(joints[place]).max())
        place += 1


def test_damaged_and_odd_tables_are_read_as_they_are_or_refused(tmp_path):
    def judge(rng):
        header, rows, separator = table(rng)
        data = as_csv(rng, header, rows, separator)
        if rng.random() < 0.3:
            data = damaged(rng, data, 2)
        columns = {"x": "cam u"} if "cam u" in header else {}
        if rng.random() < 0.05:
            columns[rng.choice(("x", "elbow", "q"))] = rng.choice(NAMES)
        path = tmp_path / f"log{rng.choice(('.csv', '.csv', '.txt', ''))}"
        path.write_bytes(data)
        degrees, options = rng.random() < 0.15, {"arm": ARM}
        if rng.random() < 0.3:
            options = {"joints": ("shoulder", "elbow"), "prismatic": rng.choice(((), ("elbow",)))}
        try:
            with guarded(tmp_path):
                log = calib.read_log(path, columns=columns, degrees=degrees, **options)
        except calib.CalibError as error:
            one_line(str(error))
            return "refused"
        for note in log.notes:
            one_line(note)
        assert len(log.q) == len(log.x) >= 2
        assert np.isfinite(log.q).all()
        assert np.isfinite(log.x).all()
        slack = 1e-9 * (log.upper - log.lower)
        assert (log.lower < log.upper).all()
        assert ((log.q >= log.lower - slack) & (log.q <= log.upper + slack)).all()
        # of a plane in space the positions are coordinates that no cell holds
        if log.plane is None:
            stands_in_the_file(log, data, columns, degrees)
        return "read"

    found = each_seed(120, judge)
    assert min(found["read"], found["refused"]) > 10
