"""Logs of any length: few rows are held, the same ones each time."""

import numpy as np
import polars as pl
import pytest

import calib
from calib import read_log
from calib.samples.tables import open_source

N = 3000
JOINTS = ["shoulder", "elbow"]


@pytest.fixture(scope="module")
def rows(arm):
    """A log of N rows, of which every hundredth misses a value."""
    log = calib.babble(arm, N, seed=3, noise=1e-3)
    values = np.hstack([log.q, log.x])
    values[::100, 3] = np.nan
    return values


@pytest.fixture
def files(tmp_path, rows):
    frame = pl.DataFrame(dict(zip([*JOINTS, "x", "y"], rows.T, strict=True))).fill_nan(None)
    frame.write_csv(tmp_path / "log.csv")
    frame.write_parquet(tmp_path / "log.parquet", row_group_size=700)
    return [tmp_path / "log.csv", tmp_path / "log.parquet"]


@pytest.mark.parametrize(
    ("text", "values"),
    [
        (
            "a,b,t\n1,2,x\n\n3,NA,y\n\n5,6,z\n\n",
            [[1, 2], [np.nan] * 2, [3, np.nan], [np.nan] * 2, [5, 6]],
        ),
        ('a,b,t\n1,2,x\n3,4,"line\nend"\n5,6,"z"\n7,8,\n', [[1, 2], [3, 4], [5, 6], [7, 8]]),
        ("a,b,t\r\n1,2,x\r\n3,4,y\r\n5,6,z\r\n", [[1, 2], [3, 4], [5, 6]]),
        ('\ufeff\na,"b",t\n1,2,é\n3,4,肘\n', [[1, 2], [3, 4]]),
        ('\ufeff# calib {"unit": "mm"}\na,b\n1,2\n3\n', [[1, 2], [3, np.nan]]),
    ],
)
def test_text_that_programs_write(tmp_path, text, values):
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode())
    np.testing.assert_array_equal(open_source(path).numbers(["a", "b"])[0], values)


def test_the_rows_drawn_depend_on_the_seed_alone(files, arm, rows):
    drawn = [read_log(path, arm, most=200, seed=1) for path in files]
    complete = rows[np.isfinite(rows).all(axis=1)]
    for log in drawn:
        assert (log.q == drawn[0].q).all()
        assert (log.x == drawn[0].x).all()
        assert 190 <= len(log) <= 200
        place = [np.flatnonzero((complete[:, :2] == q).all(axis=1))[0] for q in log.q]
        assert (np.diff(place) > 0).all()
        assert (complete[place, 2:] == log.x).all()
        assert log.dropped == 200 - len(log)
        assert "3,000 rows: 200 of them, drawn evenly" in log.notes[0]
    other = read_log(files[0], arm, most=200, seed=2)
    assert len({*map(tuple, other.q)} & {*map(tuple, drawn[0].q)}) < 60
