"""Columns of a log: found by name, renamed."""

import pytest
from log_files import refused

from calib.errors import OptionError
from calib.samples.logs import read_log
from calib.samples.roles import parse_columns


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


def test_rows_without_a_finite_value_are_left_out_and_counted(file):
    rows = "1,2,3,4,\n2,,3,4,\n3,4,nan,5,\n4,5,1e999,2,\n\n5,6,NA,2,\n5,6,1e300,2,\n7,8,1,9,\n\n"
    path = file("a,b,x,y,t\n" + rows)
    log = read_log(path, joints=["a", "b"])
    assert log.q.tolist() == [[1, 2], [7, 8]]
    assert log.dropped == 6  # a line in which nothing stands too
    assert log.notes[0].startswith("6 of 8 rows miss a finite number")
    assert log.rows.tolist() == [1, 8]


def test_a_log_without_positions_says_what_is_missing(file):
    refused(file("a,b\n0.1,0.2\n0.2,0.4\n"), "has no positions: expected columns x, y and z")
