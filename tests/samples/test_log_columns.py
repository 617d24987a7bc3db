"""Columns of a log: found by name, renamed, elements of lists."""

import numpy as np
import polars as pl
import pytest
from log_files import GOOD, refused

from calib.arm.loading import load_arm
from calib.errors import CalibError, OptionError
from calib.samples.logs import read_log
from calib.samples.roles import parse_columns


@pytest.fixture(scope="module")
def arm():
    return load_arm("two_link")  # shoulder 0..90, elbow 15..150 deg


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
    refused(path, "taken twice", OptionError, joints=["b", "b"])
    refused(path, "taken twice", OptionError, joints=["b", "x"])
    refused(path, "c named as sliding", OptionError, prismatic=["c"])


NUMBERS = pl.List(pl.Float64)


PLACES = {"a": "state[0]", "b": "state[2]", "x": "tip[1]", "y": "tip[0]"}


def write_lists(path, state, tip, kind=NUMBERS, **others):
    """Write columns of lists; `kind` is the type of the first."""
    frame = pl.DataFrame(
        {"state": state, "tip": tip, **others}, schema_overrides={"state": NUMBERS}
    )
    frame.cast({"state": kind}).write_parquet(path)


@pytest.mark.parametrize(
    "kind", [NUMBERS, pl.Array(pl.Float64, 3), pl.List(pl.Float32), pl.List(pl.Int16)], ids=str
)
def test_an_element_of_a_list_is_a_column(tmp_path, kind):
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
    assert "of state[0], state[2]; left out: rows 1, 21, 34" in log.notes[0]


def test_a_column_named_like_an_element_goes_first(tmp_path):
    path = tmp_path / "log.parquet"
    state = [[1.0, 2.0, 3.0], [4.0, 5.0, 7.0]]
    write_lists(path, state, state, x=[1, 2], y=[3, 4], **{"state[0]": [8, 9]})
    log = read_log(path, joints=["state[0]", "state[2]"])
    assert log.q.tolist() == [[8, 3], [9, 7]]
    path = tmp_path / "log.csv"
    path.write_text("s,s[0],b,x,y\n1,2,3,4,5\n2,3,5,6,7\n")
    assert read_log(path, joints=["s[0]", "b"]).q.tolist() == [[2, 3], [3, 5]]


@pytest.mark.parametrize(
    ("state", "place", "message"),
    [
        ([[1.0, 2.0]] * 3, "state[2]", r"miss a finite number .* of state\[2\]"),
        ([None, None, None], "state[0]", "holds Null, expected lists"),
        ([1.0, 2.0, 3.0], "state[0]", "holds Float64, expected lists"),
        (["1", "2", "3"], "state[0]", "holds String, expected lists"),
        ([[[1.0]], [[2.0]], [[3.0]]], "state[0]", r"holds List\(Float64\), expected num"),
        ([[1.0]] * 3, "state", r"name one element, such as state\[0\]"),
        ([[1.0]] * 3, "stat[0]", r"no column 'stat\[0\]': did you mean 'state'"),
        ([[1.0]] * 3, "state[-1]", "no column"),
        ([[1.0]] * 3, f"state[{'9' * 5000}]", "no column"),
    ],
)
def test_elements_that_are_none(tmp_path, state, place, message):
    path = tmp_path / "log.parquet"
    pl.DataFrame({"state": state, "b": [1, 2, 3], "x": [1, 2, 4], "y": [1, 3, 4]}).write_parquet(
        path
    )
    refused(path, message, CalibError, columns={"a": place})


def test_csv_has_no_lists(file):
    refused(file(GOOD), "holds String, expected lists", columns={"a": "b[0]"})
    refused(file(GOOD), r"no column 'c\[0\]'", columns={"a": "c[0]"})


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


def test_rows_without_a_finite_value_are_left_out_and_counted(file):
    rows = "1,2,3,4,\n2,,3,4,\n3,4,nan,5,\n4,5,1e999,2,\n\n5,6,NA,2,\n5,6,1e300,2,\n7,8,1,9,\n\n"
    path = file("a,b,x,y,t\n" + rows)
    log = read_log(path, joints=["a", "b"])
    assert log.q.tolist() == [[1, 2], [7, 8]]
    assert log.dropped == 6  # a line in which nothing stands too
    assert log.notes[0].startswith("6 of 8 rows miss a finite number")
    assert log.rows.tolist() == [1, 8]
