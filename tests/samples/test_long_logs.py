"""Logs of any length: few rows are held, the same ones each time."""

import numpy as np
import polars as pl
import pytest

import calib
from calib import read_log

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
