"""Logs come back to the last bit, or are refused in one line that says what to do."""

import math
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from log_files import GOOD, refused

from calib import CalibError, LogError, Samples, babble, read_log, train, write_log
from calib.samples.joint_values import locked_from_log
from calib.samples.tables import read_batch, write_table


@pytest.mark.parametrize("name", ["log.csv", "log.parquet", "log.pq"])
def test_a_simulated_log_comes_back_to_the_last_bit(arm, tmp_path, name):
    log = babble(arm, 500, noise=1e-3)
    write_log(log, tmp_path / name)
    again = read_log(tmp_path / name, arm)
    assert (again.q == log.q).all()
    assert (again.x == log.x).all()
    assert again.joint_names == log.joint_names
    assert (again.lower == arm.lower).all()
    assert (again.upper == arm.upper).all()
    assert (again.notes, again.dropped, again.simulation) == ((), 0, None)
    assert (tmp_path / name).read_bytes()[:4] == (b"shou" if name == "log.csv" else b"PAR1")


@given(
    st.lists(st.tuples(*[st.floats(-1e12, 1e12)] * 3), min_size=2, unique=True),
    st.sampled_from([".csv", ".parquet"]),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)
def test_any_finite_numbers_come_back(tmp_path, rows, suffix):
    values = np.array(rows)
    q, x = values[:, :1], values[:, 1:]
    if (np.ptp(values, axis=0) == 0).any():
        return
    name = 'slide, "the" é肘'
    log = Samples(q, x, (name,), q.min(axis=0), q.max(axis=0), (False,))
    write_log(log, tmp_path / f"log{suffix}")
    again = read_log(tmp_path / f"log{suffix}", joints=[name], prismatic=[name])
    assert (again.q == q).all()
    assert (again.x == x).all()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty"),
        ("a,b,x,y\n", "no row is left: 0 of 0"),
        ("a,b,x,y\n1,2,3,4\n", "one usable row"),
        ("a,b,x\n1,2,3\n", "no column 'y': columns: 'a', 'b', 'x'"),
        ("a,bb,x,y\n1,2,3,4\n", "did you mean 'bb'"),
        ("a,b,b,x,y\n1,2,2,3,4\n", "several columns 'b'"),
        ("a,b,x,y\n1,\u0661,3,4\n", "1 of 1 rows miss a finite number .* of b"),
        ("a;b;x;y\n1;0,5;3;4\n", r"1 of 1 rows miss a finite number \(2.5, not 2,5\) of b"),
        ("a,b,x,y\n1,2,3,4\n0,5,0,6,3,4\n", "more fields .*: write decimals"),
        ("a,b,x,y\n1,2,,4\n2,3,,5\n", "2 of 2 rows miss a finite number .* of x"),
        ("a,b,x,y\n1,,3,4\n,3,3,5\n", "2 of 2 rows miss a finite number .* of a, b"),
        ("a,b,x,y\n1,2,3,4\n1,3,4,5\n", "a is 1 in every row"),
        ("a,b,x,y\n1,1,3,4\n2,2,4,5\n", "'a' and 'b' have the same values"),
        ("a,b,x,y\n1,2,3,4\n2,3,3,5\n", "x is 3 in every row"),
        (b"a,b,x,y,c\n1,2,3,4,\xb0\n", "UTF-8"),
        (GOOD.encode("utf-16"), "UTF-8|no positions"),
        (b"PAR1 and nothing else", "cannot be read"),
        (b"a" * (1 << 20), "no positions"),
        ('a,b,x,y\n1,2,3,"4\n' + "5" * 200_000, "cannot be read"),
    ],
)
def test_bad_files_are_refused_in_one_line(file, content, message):
    refused(file(content), message)


def test_files_that_are_none(tmp_path, file):
    refused(tmp_path / "no.csv", "No such file")
    refused(tmp_path, "no table.*calib log")
    refused("a\0b", "cannot read")
    assert len(read_log(file(GOOD, "log.parquet"), joints=["a", "b"])) == 3  # by its content


def test_parquet_of_other_types(tmp_path):
    path = tmp_path / "log.parquet"
    frame = pl.DataFrame(
        {"a": [1, 2, None], "b": ["0.5", " 1 ", "2"], "x": [1, 3, 2], "y": [1.5, 2, 3]}
    )
    frame.write_parquet(path)
    log = read_log(path, joints=["a", "b"])
    assert log.q.tolist() == [[1, 0.5], [2, 1]]
    assert log.dropped == 1
    frame.with_columns(b=pl.Series([True, False, True])).write_parquet(path)
    refused(path, "column 'b' holds Boolean, expected")
    frame.with_columns(b=pl.Series(["1", "two", "3"])).write_parquet(path)
    refused(path, "one usable row")


def test_locked_joints_are_the_medians_of_their_columns(file):
    path = file("wrist,pan,x\n10,1,0\n12,,0\n11,1,0\n")
    values, notes = locked_from_log(
        path, ["pan", "wrist", "other"], degrees=True, prismatic=["pan"]
    )
    assert values == {"pan": 1.0, "wrist": pytest.approx(math.radians(11))}
    assert len(notes) == 1
    assert "wrist is locked but moved by up to 1 deg" in notes[0]
    assert locked_from_log(path, ["w"], columns={"w": "pan"}) == ({"w": 1.0}, [])
    assert locked_from_log(path, ["other"]) == ({}, [])
    with pytest.raises(LogError, match="no column 'pam': did you mean 'pan'"):
        locked_from_log(path, ["w"], columns={"w": "pam"})


def test_a_batch_keeps_its_order_and_names_its_bad_rows(file):
    path = file("x,y,t\n1,2,a\noops,2,b\n3,inf,c\n,4,d\n5,,e\n7,8,g\n\n")
    batch = read_batch(path, ["y", "x"])
    values = batch.values
    assert batch.invalid == (2, 3, 4, 5)
    assert values[[0, 5]].tolist() == [[2, 1], [8, 7]]
    assert np.isnan(values[1:5]).all()
    with pytest.raises(LogError, match="no column 'z'"):
        read_batch(path, ["x", "z"])
    assert read_batch(file("x,y\n"), ["x", "y"]).values.shape == (0, 2)


def test_answers_are_written_in_full_and_no_answer_is_nan(tmp_path, capsys):
    columns = {"x": [0.1 + 0.2, math.nan], "reachable": np.array([1, 0])}
    write_table(tmp_path / "out.csv", columns)
    expected = "x,reachable\n0.30000000000000004,1\nnan,0\n"
    assert (tmp_path / "out.csv").read_bytes() == expected.encode()
    write_table("-", columns)
    assert capsys.readouterr().out == expected
    write_table(tmp_path / "out.parquet", columns)
    assert pl.read_parquet(tmp_path / "out.parquet")["reachable"].to_list() == [1, 0]
    with pytest.raises(CalibError, match="no folder"):
        write_table(tmp_path / "no" / "out.csv", columns)


def test_what_is_known_of_the_clock_is_taken_and_nothing_estimated(arm, tmp_path):
    time = np.arange(400) * 0.02
    q = np.stack([0.8 + 0.7 * np.sin(time), 1.4 + np.cos(1.3 * time)], axis=1)
    then = np.stack([0.8 + 0.7 * np.sin(time - 0.03), 1.4 + np.cos(1.3 * (time - 0.03))], axis=1)
    x = arm.forward(then)
    path = tmp_path / "late.csv"
    write_table(
        path, dict(zip(("shoulder", "elbow", "x", "y", "time"), [*q.T, *x.T, time], strict=True))
    )
    log = read_log(path, arm, time_offset=-0.03)
    assert np.abs(arm.forward(log.q) - log.x)[5:-5].max() < 1e-5  # cubic but for both ends
    assert "-0.03 s added" in " ".join(log.notes)
    estimated, believed = (train(read_log(path, arm, time_offset=o), size=5) for o in (None, 0.0))
    distance = [np.linalg.norm(m.forward(then) - x, axis=1).mean() for m in (estimated, believed)]
    assert distance[0] < 1e-4 < 1e-3 < distance[1]
    with pytest.raises(LogError, match="no row's joints"):
        read_log(path, arm, time_offset=60.0)
    write_log(replace(log, time=None), tmp_path / "no_times.csv")
    with pytest.raises(LogError, match="column `time`"):
        read_log(tmp_path / "no_times.csv", arm, time_offset=0.1)
