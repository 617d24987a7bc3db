"""Logs: damaged and odd tables, whose accepted rows have to be what a plain reader finds."""

import csv
import io
import math
from collections import Counter
from contextlib import suppress
from functools import partial

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import calib
from hostile.guard import NAMES, NUMBERS, answer, damaged, inputs, one_line

ARM = calib.load_arm("two_link")
LARGEST = 1e15
OPTIONS = st.sampled_from((
    {"arm": ARM},
    {"arm": ARM, "degrees": True},
    {"joints": ("shoulder", "elbow")},
    {"joints": ("shoulder", "elbow"), "prismatic": ("elbow",)},
))  # fmt: skip


@st.composite
def tables(draw) -> bytes:
    """A table of joints and positions that is mostly right, in one of many forms of CSV."""
    n = draw(st.sampled_from((0, 1, 2, 5, 20, 60)))
    q = np.random.default_rng(n).uniform(ARM.lower, ARM.upper, (n, 2))
    x = ARM.forward(q).reshape(n, 2)
    if draw(st.integers(0, 9)) == 9:
        q = np.degrees(q)
    columns = {"shoulder": q[:, 0], "elbow": q[:, 1], "x": x[:, 0], "y": x[:, 1]}
    cells = {name: [repr(float(v)) for v in values] for name, values in columns.items()}
    more = draw(st.sampled_from(("", "", "", "z", "note")))
    if more:
        cells[more] = draw(st.lists(st.sampled_from(("0", "0.1", "a", "")), min_size=n, max_size=n))
    if draw(st.integers(0, 9)) == 9:
        cells["cam u"] = cells.pop("x")
    for value in draw(st.lists(NUMBERS, max_size=2)) if n else ():
        cells[draw(st.sampled_from(sorted(cells)))][draw(st.integers(0, n - 1))] = value
    header = draw(st.permutations(list(cells)))
    rows = [[cells[name][k] for name in header] for k in range(n)]
    if draw(st.integers(0, 9)) == 9:
        header[0] = draw(NAMES)
    if rows and draw(st.integers(0, 4)) == 4:
        odd = ([], [""], rows[0][:-1], [*rows[0], "1"], [*rows[0], ""], [" "] * len(header))
        rows.insert(draw(st.integers(0, n - 1)), draw(st.sampled_from(odd)))
    text, end = io.StringIO(), draw(st.sampled_from(("\n", "\n", "\r\n", "\r")))
    separator = draw(st.sampled_from((",", ",", ";", "\t")))
    quoting = draw(st.sampled_from((csv.QUOTE_MINIMAL, csv.QUOTE_ALL)))
    writer = csv.writer(text, delimiter=separator, quoting=quoting, lineterminator=end)
    writer.writerows([header, *rows])
    before = draw(st.sampled_from(("", "", "", end * 2)))
    encoding = draw(st.sampled_from(("utf-8", "utf-8", "utf-8-sig")))
    return (before + text.getvalue()).encode(encoding, "replace")


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
                with suppress(ValueError):
                    found[k, j] = float(cell)
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
    found = Counter()

    @inputs(150)
    @given(tables(), st.data(), OPTIONS, st.sampled_from((".csv", ".txt", "")))
    def judge(data, drawn, options, suffix):
        if drawn.draw(st.integers(0, 2)) == 0:
            data = drawn.draw(damaged(data, 2))
        columns = {"x": "cam u"} if b"cam u" in data else {}
        if drawn.draw(st.integers(0, 19)) == 19:
            columns[drawn.draw(st.sampled_from(("x", "elbow", "q")))] = drawn.draw(NAMES)
        read = partial(calib.read_log, columns=columns, **options)
        log = answer(tmp_path / f"log{suffix}", data, read)
        if isinstance(log, str):
            found["refused"] += 1
            return
        for note in log.notes:
            one_line(note)
        assert len(log.q) == len(log.x) >= 2
        assert np.isfinite(np.hstack([log.q, log.x])).all()
        slack = 1e-9 * (log.upper - log.lower)
        assert (log.lower < log.upper).all()
        assert ((log.q >= log.lower - slack) & (log.q <= log.upper + slack)).all()
        # of a plane in space the positions are coordinates that no cell holds
        if log.plane is None:
            stands_in_the_file(log, data, columns, options.get("degrees", False))
        found["read"] += 1

    judge()
    assert min(found["read"], found["refused"]) > 10
