"""Logs of any length: few rows are held, the same ones whatever the batches, all count."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import calib
from calib.errors import LogError, OptionError
from calib.samples import csv_rows, parquet
from calib.samples.columns import open_source, read_batches, read_columns
from calib.samples.locked import locked_from_log
from calib.samples.logs import read_log
from calib.samples.measured_rows import Reservoir

N = 3000
JOINTS = ["shoulder", "elbow"]


@pytest.fixture(scope="module")
def arm():
    return calib.load_arm("two_link")


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


@pytest.fixture(params=[(1 << 23, 1 << 18), (1 << 14, 700), (5001, 411)])
def batches(request, monkeypatch):
    """Different lengths of what is read at once."""
    monkeypatch.setattr(csv_rows, "CSV_BLOCK", request.param[0])
    monkeypatch.setattr(parquet, "BATCH", request.param[1])
    return request.param


# Batches


def test_batches_are_the_rows_and_short(files, rows, batches):
    for path in files:
        parts = list(read_batches(open_source(path), [*JOINTS, "y"]))
        np.testing.assert_array_equal(np.concatenate(parts), rows[:, [0, 1, 3]])
        shortest = len("0,0,0,0\n")
        most = 2 * batches[0] // shortest if path.suffix == ".csv" else batches[1]
        assert max(map(len, parts)) <= most


@pytest.mark.parametrize("block", [16, 40, 1 << 20])
@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a,b,t\n1,2,x\n3,4,y\n5,6,z", [[1, 2], [3, 4], [5, 6]]),
        ("a,b,t\n1,2,x\n\n3,NA,y\n\n5,6,z\n\n", [[1, 2], [3, np.nan], [5, 6]]),
        ('a,b,t\n1,2,x\n3,4,"line\nend"\n5,6,"z"\n7,8,\n', [[1, 2], [3, 4], [5, 6], [7, 8]]),
        ("a,b,t\r\n1,2,x\r\n3,4,y\r\n5,6,z\r\n", [[1, 2], [3, 4], [5, 6]]),
        ("a,b,t\r1,2,x\n3,4,y\n", [[1, 2], [3, 4]]),
        ('\ufeff\na,"b",t\n1,2,é\n3,4,肘\n', [[1, 2], [3, 4]]),
    ],
)
def test_a_block_may_end_anywhere(tmp_path, monkeypatch, text, values, block):
    monkeypatch.setattr(csv_rows, "CSV_BLOCK", block)
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode())
    np.testing.assert_array_equal(read_columns(open_source(path), ["a", "b"]), values)


@pytest.mark.parametrize("block", [16, 40, 1 << 20])
def test_a_bad_cell_is_told_by_its_row_in_the_file(tmp_path, monkeypatch, block):
    monkeypatch.setattr(csv_rows, "CSV_BLOCK", block)
    path = tmp_path / "log.csv"
    path.write_text("a,b\n1,2\n\n3,4\n5,6\n7,8\n9,zehn\n")
    with pytest.raises(LogError, match="row 5, column 'b': 'zehn' is not a number"):
        read_columns(open_source(path), ["a", "b"])


def test_a_file_without_line_ends_does_not_fill_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_rows, "CSV_BLOCK", 1 << 10)
    path = tmp_path / "log.csv"
    path.write_text("a,b\n1,2\n" + "5" * 5000)
    with pytest.raises(LogError, match="has a line of more than"):
        read_columns(open_source(path), ["a", "b"])


# The reservoir


@given(st.lists(st.integers(0, 40), min_size=1, max_size=30), st.integers(2, 20), st.integers(0, 5))
@settings(max_examples=60)
def test_a_reservoir_holds_few_rows_and_the_same_for_any_batches(lengths, most, seed):
    total = sum(lengths)
    values = np.random.default_rng(1).standard_normal((total, 2))
    reservoir, whole, first = Reservoir(most, 2, seed), Reservoir(most, 2, seed), 0
    for length in lengths:
        reservoir.add(values[first : first + length], np.arange(first, first + length))
        first += length
        assert reservoir.held <= 2 * most + 4  # the extreme rows of both columns besides
    whole.add(values, np.arange(total))
    kept, numbers = reservoir.rows()
    assert (numbers == whole.rows()[1]).all()
    assert (kept == values[numbers].reshape(kept.shape)).all()
    assert (np.diff(numbers) > 0).all()
    if total:
        assert min(total, most) <= len(numbers) <= min(total, most + 4)
        assert (kept.min(axis=0) == values.min(axis=0)).all()
        assert (kept.max(axis=0) == values.max(axis=0)).all()


def test_every_row_is_as_likely_as_any_other():
    count = np.zeros(50)
    draws = 2000
    for seed in range(draws):
        reservoir = Reservoir(10, seed=seed)
        for first in range(0, 50, 5):
            reservoir.add(np.zeros((5, 1)), np.arange(first, first + 5))
        count[reservoir.rows()[1]] += 1
    # binomial: 400 of 2,000 with a standard deviation of 17.9
    assert np.abs(count - draws / 5).max() < 4.5 * np.sqrt(draws * 0.2 * 0.8)


# Long logs


def test_the_rows_drawn_depend_on_the_seed_alone(files, arm, rows, batches):
    drawn = [read_log(path, arm, most=200, seed=1) for path in files]
    complete = rows[np.isfinite(rows).all(axis=1)]
    for log in drawn:
        assert (log.q == drawn[0].q).all()
        assert (log.x == drawn[0].x).all()
        assert 200 <= len(log) <= 204
        place = [np.flatnonzero((complete[:, :2] == q).all(axis=1))[0] for q in log.q]
        assert (np.diff(place) > 0).all()
        assert (complete[place, 2:] == log.x).all()
        assert log.dropped == N // 100
        assert any("2,970 rows: 20" in note for note in log.notes)
        assert (log.q.min(axis=0) == complete[:, :2].min(axis=0)).all()
        assert (log.q.max(axis=0) == complete[:, :2].max(axis=0)).all()
    other = read_log(files[0], arm, most=200, seed=2)
    assert len({*map(tuple, other.q)} & {*map(tuple, drawn[0].q)}) < 60


def test_a_log_that_fits_is_held_whole(files, arm, rows):
    complete = rows[np.isfinite(rows).all(axis=1)]
    log = read_log(files[0], arm, most=len(complete))
    assert (log.q == complete[:, :2]).all()
    for bad in (1, 2.5, True):
        with pytest.raises(OptionError, match="most"):
            read_log(files[0], arm, most=bad)


def test_degrees_turns_ranges_and_planes_hold_for_the_rows_drawn(tmp_path):
    rng = np.random.default_rng(0)
    a, b = rng.uniform(170, 200, 1000), 0.5 + rng.integers(0, 90, 1000)
    a[a > 180] -= 360  # across the seam
    flat = rng.standard_normal((1000, 2))
    points = np.column_stack([flat[:, 0], np.full(1000, 0.5), flat[:, 1]])
    frame = pl.DataFrame({"a": a, "b": b, **dict(zip("xyz", points.T, strict=True))})
    frame.write_csv(tmp_path / "log.csv")
    log = read_log(
        tmp_path / "log.csv",
        joints=["a", "b"],
        degrees=True,
        ranges={"b": (0.0, np.pi / 4)},
        most=200,
    )
    few = b <= 45
    assert any(f"{np.count_nonzero(few)} rows: {len(log)} of them, drawn" in n for n in log.notes)
    assert any(f"{np.count_nonzero(~few)} rows dropped: b outside" in n for n in log.notes)
    place = np.linalg.norm(log.x[:, None] - flat, axis=2).argmin(axis=1)
    assert few[place].all()
    np.testing.assert_allclose(log.x, flat[place], atol=1e-9)
    turned = np.exp(1j * np.deg2rad([a, b]).T[place])
    np.testing.assert_allclose(np.exp(1j * log.q), turned, atol=1e-9)
    assert np.ptp(log.q[:, 0]) < np.deg2rad(31)


def test_locked_joints_of_a_long_log(tmp_path, monkeypatch):
    from calib.samples import locked

    monkeypatch.setattr(locked, "HELD_ROWS", 50)
    pan = np.full(1001, 0.25)
    pan[7] = 0.5
    pl.DataFrame({"pan": pan, "x": pan}).write_csv(tmp_path / "log.csv")
    values, notes = locked_from_log(tmp_path / "log.csv", ["pan"])
    assert values == {"pan": 0.25}
    assert "moved by up to 14.3 deg" in notes[0]


# Training


def test_a_model_of_a_long_log_rests_on_the_rows_drawn_and_is_as_good(tmp_path, arm):
    """A body has few parameters: 1,000 rows of noise say what 20,000 do to a part of the noise."""
    log = calib.babble(arm, 20_000, seed=5, noise=5e-3)
    calib.samples.logs.write_log(log, tmp_path / "log.parquet")
    q = calib.babble(arm, 2000, seed=6).q
    drawn = read_log(tmp_path / "log.parquet", arm, most=1000)
    model = calib.train(drawn, size=6)
    assert model.about.samples == len(drawn) == len(model.rows)
    assert any("20,000 rows: 1,00" in note for note in drawn.notes)
    error = np.linalg.norm(model.forward(q) - arm.forward(q), axis=1)
    # seven parameters and their view: sigma sqrt(7 / 2,000) along each axis
    assert error.mean() < 2.5 * 5e-3 * np.sqrt(7 / 2000)
    assert np.mean(error <= model.model_error(q)) >= 0.95
