"""Logs come back to the last bit, or are refused in one line that says what to do."""

import io
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.arm.loading import load_arm
from calib.errors import CalibError, LogError, OptionError
from calib.samples import parquet
from calib.samples.babbling import babble
from calib.samples.columns import open_source, read_batches, read_columns
from calib.samples.locked import locked_from_log
from calib.samples.log_ranges import one_turn
from calib.samples.logs import read_log, write_log
from calib.samples.roles import parse_columns
from calib.samples.samples import Samples
from calib.samples.tables import read_table, write_table

TURN = 2 * math.pi
GOOD = "a,b,x,y\n0.1,0.2,1,2\n0.2,0.4,3,4\n0.3,0.1,5,6\n"


@pytest.fixture(scope="module")
def arm():
    return load_arm("two_link")  # shoulder 0..90, elbow 15..150 deg


@pytest.fixture
def file(tmp_path):
    def write(content, name="log.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def refused(path, message, error=LogError, **options):
    with pytest.raises(error, match=message) as caught:
        read_log(path, **({"joints": ["a", "b"]} | options))
    assert "\n" not in str(caught.value)


def table(joints, n=40):
    """A log of these joint columns and of positions that move."""
    names = list(joints)
    rows = np.column_stack([*joints.values(), np.linspace(0, 1, n), np.linspace(0, 1, n) ** 2])
    body = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    return ",".join([*names, "x", "y"]) + "\n" + body + "\n"


# Round trips


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


def test_standard_streams(arm, monkeypatch, capsys):
    log = babble(arm, 20)
    write_log(log, "-")
    written = capsys.readouterr().out
    assert written.startswith("shoulder,elbow,x,y\n")
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(written.encode())))
    assert (read_log("-", arm).q == log.q).all()


def test_parquet_from_standard_input(arm, tmp_path, monkeypatch):
    log = babble(arm, 20)
    write_log(log, tmp_path / "log.parquet")
    content = (tmp_path / "log.parquet").read_bytes()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(content)))
    assert (read_log("-", arm).x == log.x).all()


def test_heavy_libraries_wait_until_they_are_needed():
    program = (
        "import sys, calib.samples.logs, calib.samples.babbling\n"
        "print(sorted({'polars', 'scipy', 'pinocchio', 'yourdfpy'} & set(sys.modules)))"
    )
    root = Path(__file__).parents[1]
    command = [sys.executable, "-c", program]
    run = subprocess.run(command, capture_output=True, text=True, check=True, cwd=root)
    assert run.stdout.strip() == "[]"


# Columns


def test_columns_are_found_by_name_in_any_order_and_others_are_ignored(file):
    path = file("\ufeffy, x ,note,b,a\r\n2,1, text,0.2,0.1\r\n4,3,,0.4,0.2\r\n")
    log = read_log(path, joints=["a", "b"], unit="px")
    assert log.q.tolist() == [[0.1, 0.2], [0.2, 0.4]]
    assert log.x.tolist() == [[1, 2], [3, 4]]
    assert log.unit == "px"
    assert log.lower.tolist() == [0.1, 0.2]
    assert log.upper.tolist() == [0.2, 0.4]


def test_columns_with_other_names(file):
    path = file("j1,b,cam_u,cam_v,x\n1,2,3,4,9\n2,4,6,8,9\n")
    mapping = parse_columns("x=cam_u, y=cam_v,a=j1")
    log = read_log(path, joints="a,b", columns=mapping)
    assert log.joint_names == ("a", "b")
    assert log.q.tolist() == [[1, 2], [2, 4]]
    assert log.x.tolist() == [[3, 4], [6, 8]]
    refused(path, "'q' is neither", OptionError, columns={"q": "j1"})
    refused(path, "taken twice", OptionError, columns={"a": "b"})


@pytest.mark.parametrize("text", ["", "x", "x=", "=x", "x=u,,y=v", "x=u,x=v"])
def test_column_names_that_say_nothing(text):
    with pytest.raises(OptionError, match="columns"):
        parse_columns(text)


@pytest.mark.parametrize("mark", [";", "\t"])
def test_other_separators(file, mark):
    assert len(read_log(file(GOOD.replace(",", mark)), joints=["a", "b"])) == 3


def test_the_arms_order_holds_and_its_joints_are_the_log(arm, file):
    path = file("elbow,shoulder,x,y\n0.5,0.1,1,2\n0.6,0.2,3,4\n")
    assert read_log(path, arm).q.tolist() == [[0.1, 0.5], [0.2, 0.6]]
    assert read_log(path, arm, joints=["elbow", "shoulder"]).joint_names == ("shoulder", "elbow")
    with pytest.raises(OptionError, match="loaded with"):
        read_log(path, arm, joints=["elbow"])


def test_without_joints_the_choices_are_listed(file):
    path = file("b,a,x,y,t\n1,2,3,4,5\n")
    refused(path, "choices: 'b', 'a', 't'; name them in .joints", OptionError, joints=None)
    refused(path, "'b' is given 2 times", OptionError, joints=["b", "b"])
    refused(path, "cannot be told", OptionError, joints=["b", "x"])
    refused(path, "'c' is named as sliding", OptionError, prismatic=["c"])


# Elements of lists

NUMBERS = pl.List(pl.Float64)
PLACES = {"a": "state[0]", "b": "state[2]", "x": "tip[1]", "y": "tip[0]"}


def write_lists(path, state, tip, kind=NUMBERS, **others):
    """Write columns of lists; `kind` is the type of the first."""
    frame = pl.DataFrame(
        {"state": state, "tip": tip, **others}, schema_overrides={"state": NUMBERS}
    )
    frame.cast({"state": kind}).write_parquet(path)


@pytest.mark.parametrize("batch", [1, 7, 16, 1 << 18])
@pytest.mark.parametrize(
    "kind",
    [NUMBERS, pl.Array(pl.Float64, 3), pl.List(pl.Float32), pl.List(pl.Int16)],
    ids=str,
)
def test_an_element_of_a_list_is_a_column(tmp_path, monkeypatch, kind, batch):
    monkeypatch.setattr(parquet, "BATCH", batch)
    rng = np.random.default_rng(0)
    state = rng.integers(-99, 99, (50, 3)).astype(float)
    tip = rng.standard_normal((50, 2))
    holes = state.tolist()
    holes[0], holes[20], holes[33][0] = None, None, None
    holes[34][1] = None  # which nobody asked for
    write_lists(tmp_path / "log.parquet", holes, tip.tolist(), kind)
    path, joints = tmp_path / "log.parquet", ["a", "b"]
    log = read_log(path, joints=joints, columns=PLACES, prismatic=joints)
    there = np.delete(np.arange(50), [0, 20, 33])
    assert (log.q == state[there][:, [0, 2]]).all()
    assert (log.x == tip[there][:, [1, 0]]).all()
    assert log.dropped == 3
    assert "row 1, column 'state[0]'" in log.notes[0]


def test_a_column_named_like_an_element_goes_first(tmp_path):
    path = tmp_path / "log.parquet"
    state = [[1.0, 2.0, 3.0], [4.0, 5.0, 7.0]]
    write_lists(path, state, state, x=[1, 2], y=[3, 4], **{"state[0]": [8, 9]})
    log = read_log(path, joints=["state[0]", "state[2]"])
    assert log.q.tolist() == [[8, 3], [9, 7]]
    path = tmp_path / "log.csv"
    path.write_text("s,s[0],b,x,y\n1,2,3,4,5\n2,3,5,6,7\n")
    assert read_log(path, joints=["s[0]", "b"]).q.tolist() == [[2, 3], [3, 5]]


@pytest.mark.parametrize("batch", [1, 1 << 18])
@pytest.mark.parametrize(
    ("state", "place", "message"),
    [
        ([[1.0, 2.0]] * 3, "state[2]", r"lists of 2, counted from 0: there is no 'state\[2\]'"),
        ([[1.0, 2.0]] * 3, "state[999999999]", "lists of 2, counted from 0"),
        ([[], [], []], "state[0]", "lists of 0, counted from 0"),
        (
            [[1.0, 2.0], None, [1.0]],
            "state[0]",
            "row 3, column 'state': a list of 1 after lists of",
        ),
        ([[1.0], [1.0, 2.0], [1.0]], "state[1]", "row 2, column 'state': a list of 2|lists of 1"),
        ([None, [1.0], []], "state[0]", "row 3, column 'state': a list of 0 after lists of 1"),
        ([None, None, None], "state[0]", r"column 'state\[0\]' has no finite value"),
        ([1.0, 2.0, 3.0], "state[0]", "'state' holds Float64, expected lists"),
        (["1", "2", "3"], "state[0]", "'state' holds String, expected lists"),
        (
            [[[1.0]], [[2.0]], [[3.0]]],
            "state[0]",
            r"'state\[0\]' holds List\(Float64\), expected num",
        ),
        ([["1"], ["two"], ["3"]], "state[0]", r"row 2, column 'state\[0\]': 'two'"),
        ([[1.0]] * 3, "state", r"name one element, such as state\[0\]"),
        ([[1.0]] * 3, "stat[0]", r"no column 'stat\[0\]': did you mean 'state'"),
        ([[1.0]] * 3, "state[0][0]", "no column"),
        ([[1.0]] * 3, "[0]", "no column"),
        ([[1.0]] * 3, "state[-1]", "'-1' is no place in a list, expected a whole number"),
        ([[1.0]] * 3, "state[]", "'' is no place"),
        ([[1.0]] * 3, "state[00]", "'00' is no place"),
        ([[1.0]] * 3, "state[1.0]", "'1.0' is no place"),
        ([[1.0]] * 3, "state[\u0661]", "is no place"),
        ([[1.0]] * 3, f"state[{'9' * 5000}]", "is no place"),
    ],
)
def test_elements_that_are_none(tmp_path, monkeypatch, batch, state, place, message):
    monkeypatch.setattr(parquet, "BATCH", batch)
    path = tmp_path / "log.parquet"
    pl.DataFrame({"state": state, "b": [1, 2, 3], "x": [1, 2, 4], "y": [1, 3, 4]}).write_parquet(
        path
    )
    refused(path, message, CalibError, columns={"a": place})


def test_csv_has_no_lists(file):
    refused(
        file(GOOD), r"is CSV, which has no lists: .* 'b' but none 'b\[0\]'", columns={"a": "b[0]"}
    )
    refused(file(GOOD), r"no column 'c\[0\]'", columns={"a": "c[0]"})


def test_long_lists_are_read_a_few_rows_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr(parquet, "ELEMENTS", 50)
    path = tmp_path / "log.parquet"
    write_lists(path, np.arange(400.0).reshape(40, 10).tolist(), [[0.0, 1.0]] * 40)
    parts = list(read_batches(open_source(path), ["state[3]", "tip[1]"]))
    assert max(map(len, parts)) == 5
    assert np.concatenate(parts).tolist() == [[10.0 * row + 3, 1] for row in range(40)]


def test_only_the_columns_asked_for_are_read(tmp_path):
    path = tmp_path / "log.parquet"
    frame = pl.DataFrame({"state": [[1.0, 2.0], [3.0, 5.0]], "x": [1, 2], "y": [4, 3]})
    frame = frame.with_columns(note=pl.Series(["unread", "unread"]))
    frame.write_parquet(path, compression="uncompressed", statistics=False)
    content = path.read_bytes()
    assert b"unread" in content
    path.write_bytes(content.replace(b"unread", b"\xff" * 6))
    with pytest.raises(pl.exceptions.PolarsError):
        pl.read_parquet(path)
    log = read_log(path, joints=["state[0]", "state[1]"])
    assert log.q.tolist() == [[1, 2], [3, 5]]


@given(st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
def test_damaged_lists_are_a_log_or_a_one_line_error(tmp_path, capfd, data):
    path = tmp_path / "log.parquet"
    rows = np.random.default_rng(0).standard_normal((30, 3))
    write_lists(path, rows.tolist(), rows.tolist())
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(4, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    error = ""
    try:
        assert np.isfinite(read_log(path, joints=["a", "b"], columns=PLACES).q).all()
    except CalibError as caught:
        error = str(caught)
    assert len(error.splitlines()) <= 1
    assert capfd.readouterr().err == ""


# Rows


def test_rows_without_a_finite_value_are_left_out_and_counted(file):
    rows = "1,2,3,4,\n2,,3,4,\n3,4,nan,5,\n4,5,1e999,2,\n\n5,6,NA,2,\n5,6,1e300,2,\n7,8,1,9,\n\n"
    path = file("a,b,x,y,t\n" + rows)
    log = read_log(path, joints=["a", "b"])
    assert log.q.tolist() == [[1, 2], [7, 8]]
    assert log.dropped == 5
    assert log.notes[0].startswith("5 of 7 rows dropped")
    assert "row 2, column 'b'" in log.notes[0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        ("a,b,x,y\n", "no rows"),
        ("a,b,x,y\n1,2,3,4\n", "one usable row"),
        ("a,b,x,y\n1,2,3,4\n1,2,,4\n", "one usable row"),
        ("a,b,x\n1,2,3\n", "no column 'y': columns: 'a', 'b', 'x'"),
        ("a,B,x,y\n1,2,3,4\n", "no column 'b'"),
        ("a,bb,x,y\n1,2,3,4\n", "did you mean 'bb'"),
        ("a,b,b,x,y\n1,2,2,3,4\n", "2 columns 'b'"),
        ("a,b,x,y\n1,2,3,4\n2,zwei,3,4\n", "row 2, column 'b': 'zwei' is not a number"),
        ("a,b,x,y\n1,2,3,true\n", "row 1, column 'y': 'true'"),
        ("a,b,x,y\n1,1_0,3,4\n", "'1_0'"),
        ("a,b,x,y\n1,\u0661,3,4\n", "row 1, column 'b'"),
        ("a;b;x;y\n1;0,5;3;4\n", "'0,5' is not a number; write decimals with a point"),
        ("a,b,x,y\n1,2,3,4\n0,5,0,6,3,4\n", "row 2 has 6 fields under a header of 4"),
        ("a,b,x,y\n1,2,,4\n2,3,,5\n", "column 'x' has no finite value"),
        ("a,b,x,y\n1,,3,4\n,3,3,5\n", "each of the 2 rows"),
        ("a,b,x,y\n1,2,3,4\n1,3,4,5\n", "joint 'a' is 1 in every row"),
        ("a,b,x,y\n1,1,3,4\n2,2,4,5\n", "'a' and 'b' have the same values"),
        ("a,b,x,y\n1,2,3,4\n2,3,3,5\n", "x is 3 in every row"),
        (b"a,b,x,y,\xb0\n1,2,3,4,5\n", "UTF-8"),
        (b"a,b,x,y,t\n1,2,3,4,\xff\n", "UTF-8"),
        (GOOD.encode("utf-16"), "UTF-8|no column"),
        (b"PAR1 and nothing else", "damaged Parquet"),
        (b"a" * (1 << 20), "no line end"),
        ('a,b,x,y\n1,2,3,"4\n' + "5" * 200_000, "is no CSV"),
    ],
)
def test_bad_files_are_refused_in_one_line(file, content, message):
    refused(file(content), message)


def test_files_that_are_none(tmp_path, file):
    refused(tmp_path / "no.csv", "there is no file")
    refused(tmp_path, "is a folder")
    refused("a\0b", "cannot read")
    refused(file(GOOD, "log.parquet"), "not a Parquet file")


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
    refused(path, "row 2, column 'b': 'two'")


@given(st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
def test_a_damaged_parquet_file_is_a_log_or_a_one_line_error(arm, tmp_path, capfd, data):
    path = tmp_path / "log.parquet"
    write_log(babble(arm, 50), path)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(4, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content[: data.draw(st.integers(4, len(content)))])
    error = ""
    try:
        assert np.isfinite(read_log(path, arm).q).all()
    except CalibError as caught:
        error = str(caught)
    assert len(error.splitlines()) <= 1
    assert capfd.readouterr().err == ""


@given(
    st.lists(
        st.lists(
            st.one_of(
                st.floats().map(repr),
                st.integers().map(str),
                st.sampled_from(
                    ["", " ", "NA", "nan", "1_0", " 2 ", '"3"', '"', "+1", "1e5", "0x1"]
                ),
            ),
            max_size=4,
        ),
        max_size=6,
    )
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_fast_reader_agrees_with_the_careful_one(file, rows):
    """A header that spans two lines sends the same rows through the careful reader."""
    body = "\n".join(",".join(row) for row in rows)
    results = []
    for header in ("a,b,c", 'a,b,"c\n"'):
        try:
            results.append(
                read_columns(open_source(file(f"{header}\n{body}")), ["b", "a"]).tolist()
            )
        except LogError as error:
            results.append(str(error))
    assert repr(results[0]) == repr(results[1])


@given(st.binary(max_size=200) | st.text(alphabet="a,bxy\n10.-\"'", max_size=200).map(str.encode))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_are_a_log_or_a_one_line_error(file, content):
    for start in (b"", b"a,b,x,y\n", b"PAR1"):
        error = ""
        try:
            assert np.isfinite(read_log(file(start + content), joints=["a", "b"]).q).all()
        except CalibError as caught:
            error = str(caught)
        assert len(error.splitlines()) <= 1


# Angles and limits


def test_degrees(arm, file):
    q = np.deg2rad([[10, 20], [80, 140], [90, 150], [0, 15]])
    text = "shoulder,elbow,x,y\n10,20,1,2\n80,140,2,3\n90,150,2,5\n0,15,6,6\n"
    log = read_log(file(text), arm, degrees=True)
    np.testing.assert_allclose(log.q, q, atol=1e-15)
    assert log.notes == ()
    np.testing.assert_allclose([log.lower, log.upper], [arm.lower, arm.upper], atol=1e-12)
    refused(file(text), "give `degrees=True`", arm=arm, joints=None)
    refused(file(text), "14.3 turns; if the log is in degrees.*3.14", joints=["shoulder"])


def test_sliding_joints_are_never_in_degrees(file):
    log = read_log(file(GOOD), joints="a,b", degrees=True, prismatic=["b"])
    np.testing.assert_allclose(log.q[:, 0], np.deg2rad([0.1, 0.2, 0.3]))
    assert log.q[:, 1].tolist() == [0.2, 0.4, 0.1]
    assert log.revolute == (True, False)
    assert "leave out `degrees`" in log.notes[0]


def test_values_just_beyond_the_limits_widen_the_range_aloud(arm, file):
    rows = "shoulder,elbow,x,y\n-0.05,0.5,1,2\n1.5708,1,2,3\n1,{},3,4\n"
    log = read_log(file(rows.format(2.0)), arm)
    assert log.lower[0] == -0.05
    assert log.upper[0] == 1.5708
    assert log.arm.lower[0] == -0.05
    assert len(log.notes) == 1
    assert "shoulder: the log goes beyond" in log.notes[0]
    refused(
        file(rows.format(3.0)), "row 3: elbow is 3 rad.*ranges={'elbow': ", arm=arm, joints=None
    )


def test_the_row_that_is_named_counts_the_rows_left_out(arm, file):
    rows = "shoulder,elbow,x,y\n,0.5,1,2\n1,1,2,3\n1.1,3,3,4\n"
    refused(file(rows), "row 3: elbow", arm=arm, joints=None)


def test_a_chosen_range_goes_before_the_limits(arm, file):
    rows = "shoulder,elbow,x,y\n0.1,0.5,1,2\n0.2,1,2,3\n0.3,3,3,4\n0.4,7,3,5\n"
    log = read_log(file(rows), arm, ranges={"elbow": (0.6, 3.1)})
    np.testing.assert_allclose(log.q[:, 1], [1, 3, 7 - TURN])
    assert log.q[:, 0].tolist() == [0.2, 0.3, 0.4]
    assert (log.lower[1], log.upper[1]) == (0.6, 3.1)
    assert any("1 rows dropped: elbow outside" in note for note in log.notes)
    assert any("1 values wrapped" in note for note in log.notes)
    for bad in ((1.0, 0.6), (0.0, 9.0), (0.0, math.nan)):
        refused(file(rows), "range elbow", OptionError, arm=arm, joints=None, ranges={"elbow": bad})
    refused(file(rows), "no value of 'elbow'", arm=arm, joints=None, ranges={"elbow": (4, 5)})


def test_whole_turns_are_taken_off_where_that_meets_the_limits(arm, file):
    elbow = np.linspace(0.3, 2.6, 40)
    path = file(table({"shoulder": np.linspace(0, 1.5, 40), "elbow": elbow + TURN}))
    log = read_log(path, arm)
    np.testing.assert_allclose(log.q[:, 1], elbow, atol=1e-12)
    assert "elbow: 40 values wrapped" in log.notes[0]


def test_more_than_one_turn_becomes_one(file):
    a = np.linspace(-4.0, 4.0, 400)
    log = read_log(file(table({"a": a, "b": np.cos(a)}, 400)), joints=["a", "b"])
    assert (log.lower[0], log.upper[0]) == (-math.pi, math.pi)
    np.testing.assert_allclose(np.exp(1j * log.q[:, 0]), np.exp(1j * a), atol=1e-12)
    assert "wrapped" in log.notes[0]
    inside = np.abs(a) <= math.pi
    assert (log.q[inside, 0] == a[inside]).all()


def test_a_joint_that_works_across_the_seam_gets_a_range_without_the_gap(file):
    a = np.linspace(2.0, 4.5, 60)
    wrapped = np.angle(np.exp(1j * a))
    log = read_log(file(table({"a": wrapped, "b": np.cos(a)}, 60)), joints=["a", "b"])
    np.testing.assert_allclose(log.q[:, 0], a - TURN, atol=1e-12)
    assert log.lower[0] == pytest.approx(2.0 - TURN)
    assert log.upper[0] == pytest.approx(4.5 - TURN)


def test_a_joint_of_the_arm_that_turns_all_round_has_its_turn_about_the_log(arm, file):
    free = replace(arm, lower=[0, -math.pi], upper=[1.6, math.pi])
    elbow = np.linspace(-4.0, -1.0, 40)
    log = read_log(file(table({"shoulder": np.linspace(0, 1.5, 40), "elbow": elbow})), free)
    assert (log.q[:, 1] == elbow).all()
    assert log.lower[1] == pytest.approx(-2.5 - math.pi)
    assert log.upper[1] - log.lower[1] == pytest.approx(TURN)
    elbow = np.linspace(-3.0, 3.0, 40)
    log = read_log(file(table({"shoulder": np.linspace(0, 1.5, 40), "elbow": elbow})), free)
    assert (log.lower[1], log.upper[1]) == (-math.pi, math.pi)


@given(st.lists(st.floats(-40, 40), min_size=1, max_size=30))
def test_one_turn_moves_angles_by_whole_turns_into_one(angles):
    angles = np.array(angles)
    wrapped, (low, high), gap = one_turn(angles)
    assert high - low == pytest.approx(TURN)
    assert abs((low + high) / 2) <= math.pi + 1e-9
    assert (wrapped >= low).all()
    assert (wrapped <= high).all()
    turns = (wrapped - angles) / TURN
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    assert 0 < gap <= TURN + 1e-9


# Positions in space


def test_positions_in_space_get_their_plane(file):
    rng = np.random.default_rng(0)
    q, flat = rng.random((200, 2)), rng.random((200, 2))
    c, s = math.cos(0.4), math.sin(0.4)
    ux, uy = np.array([1.0, 0, 0]), np.array([0, c, s])
    normal = np.cross(ux, uy)
    points = flat[:, :1] * ux + flat[:, 1:] * uy + 0.5 * normal
    points += 1e-3 * rng.standard_normal((200, 1)) * normal
    rows = np.hstack([q, points])
    path = file("a,b,x,y,z\n" + "\n".join(",".join(map(repr, r)) for r in rows.tolist()))
    log = read_log(path, joints=["a", "b"])
    np.testing.assert_allclose(log.x, flat, atol=2e-3)
    np.testing.assert_allclose(np.abs(log.plane.normal @ normal), 1.0, atol=1e-5)
    assert log.out_of_plane_rms == pytest.approx(1e-3, rel=0.2)
    assert "out-of-plane rms" in log.notes[0]
    assert read_log(path, joints=["a", "b", "z"]).plane is None  # z is a joint then


# Locked joints


def test_locked_joints_are_the_medians_of_their_columns(file):
    path = file("wrist,pan,x\n10,1,0\n12,,0\n11,1,0\n")
    values, notes = locked_from_log(
        path, ["pan", "wrist", "other"], degrees=True, prismatic=["pan"]
    )
    assert values == {"pan": 1.0, "wrist": pytest.approx(math.radians(11))}
    assert len(notes) == 1
    assert "wrist is taken as locked but moved by up to 1 deg" in notes[0]
    assert locked_from_log(path, ["w"], columns={"w": "pan"}) == ({"w": 1.0}, ())
    assert locked_from_log(path, ["other"]) == ({}, ())
    with pytest.raises(LogError, match="no column 'pam': did you mean 'pan'"):
        locked_from_log(path, ["w"], columns={"w": "pam"})


def test_columns_may_name_locked_joints_too(tmp_path):
    arm = load_arm("three_link", joints=["shoulder", "elbow"])
    path = tmp_path / "log.parquet"
    state = [[0.1, 0.5, 0.3], [0.2, 0.7, 0.3], [0.4, 0.6, 0.3]]
    pl.DataFrame({"s": state, "x": [1, 2, 4], "y": [1, 3, 4]}).write_parquet(path)
    columns = {"shoulder": "s[0]", "elbow": "s[1]", "wrist": "s[2]"}
    assert read_log(path, arm, columns=columns).q.tolist() == [row[:2] for row in state]
    assert locked_from_log(path, ["wrist"], columns=columns) == ({"wrist": 0.3}, ())
    refused(path, "choices: .*wrist", OptionError, arm=arm, joints=None, columns={"wrst": "s[2]"})


# Batches


def test_a_batch_keeps_its_order_and_names_its_bad_rows(file):
    path = file("x,y,t\n1,2,a\noops,2,b\n3,inf,c\n,4,d\n5,6,e,f\n7,8,g\n")
    values, invalid = read_table(path, ["y", "x"])
    assert invalid == (2, 3, 4, 5)
    assert values[[0, 5]].tolist() == [[2, 1], [8, 7]]
    assert np.isnan(values[1:5]).all()
    with pytest.raises(LogError, match="no column 'z'"):
        read_table(path, ["x", "z"])
    assert read_table(file("x,y\n"), ["x", "y"])[0].shape == (0, 2)


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
