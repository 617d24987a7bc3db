"""Columns of a log: found by name, renamed."""

import math
from dataclasses import replace

import numpy as np
import pytest
from log_files import GOOD, refused

from calib import OptionError, read_log


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
    mapping = {"x": "cam_u", "y": "cam_v", "a": "j1"}
    log = read_log(path, joints="a,b", columns=mapping)
    assert log.joint_names == ("a", "b")
    assert log.q.tolist() == [[1, 2], [2, 4]]
    assert log.x.tolist() == [[3, 4], [6, 8]]
    refused(path, "'q' is neither", OptionError, columns={"q": "j1"})
    refused(path, "taken twice", OptionError, columns={"a": "b"})


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


TURN = 2 * math.pi


def table(joints, n=40):
    """A log of these joint columns and of positions that move."""
    names = list(joints)
    rows = np.column_stack([*joints.values(), np.linspace(0, 1, n), np.linspace(0, 1, n) ** 2])
    body = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    return ",".join([*names, "x", "y"]) + "\n" + body + "\n"


def test_degrees(arm, file):
    q = np.deg2rad([[10, 20], [80, 140], [90, 150], [0, 15]])
    text = "shoulder,elbow,x,y\n10,20,1,2\n80,140,2,3\n90,150,2,5\n0,15,6,6\n"
    log = read_log(file(text), arm, degrees=True)
    np.testing.assert_allclose(log.q, q, atol=1e-15)
    assert log.notes == ()
    np.testing.assert_allclose([log.lower, log.upper], [arm.lower, arm.upper], atol=1e-12)
    refused(file(text), "give `degrees=True`", arm=arm, joints=None)
    refused(file(text), "90 rad.*3.14.*degrees=True", joints=["shoulder"])


def test_sliding_joints_are_never_in_degrees(file):
    log = read_log(file(GOOD), joints="a,b", degrees=True, prismatic=["b"])
    np.testing.assert_allclose(log.q[:, 0], np.deg2rad([0.1, 0.2, 0.3]))
    assert log.q[:, 1].tolist() == [0.2, 0.4, 0.1]
    assert log.revolute == (True, False)


def test_the_row_that_is_named_counts_the_rows_left_out(arm, file):
    rows = "shoulder,elbow,x,y\n,0.5,1,2\n1,1,2,3\n1.1,3,3,4\n"
    refused(file(rows), "row 3: elbow", arm=arm, joints=None)


def test_a_chosen_range_goes_before_the_limits(arm, file):
    rows = "shoulder,elbow,x,y\n0.1,0.5,1,2\n0.2,1,2,3\n0.3,3,3,4\n0.4,7,3,5\n"
    log = read_log(file(rows), arm, ranges={"elbow": (0.6, 3.1)})
    np.testing.assert_allclose(log.q[:, 1], [1, 3, 7 - TURN])
    assert log.q[:, 0].tolist() == [0.2, 0.3, 0.4]
    assert (log.lower[1], log.upper[1]) == (0.6, 3.1)
    assert any("1 of 4 rows have elbow outside" in note for note in log.notes)
    for bad in ((1.0, 0.6), (0.0, 9.0), (0.0, math.nan)):
        refused(file(rows), "range elbow", OptionError, arm=arm, joints=None, ranges={"elbow": bad})
    refused(
        file(rows), "4 of 4 rows have elbow outside", arm=arm, joints=None, ranges={"elbow": (4, 5)}
    )


def test_more_than_one_turn_becomes_one(file):
    a = np.linspace(-4.0, 4.0, 400)
    log = read_log(file(table({"a": a, "b": np.cos(a)}, 400)), joints=["a", "b"])
    assert (log.lower[0], log.upper[0]) == (-math.pi, math.pi)
    np.testing.assert_allclose(np.exp(1j * log.q[:, 0]), np.exp(1j * a), atol=1e-12)
    assert "wrapped" in log.notes[0]
    inside = np.abs(a) <= math.pi
    assert (log.q[inside, 0] == a[inside]).all()


def test_a_joint_of_the_arm_that_turns_all_round_has_its_turn_about_the_log(arm, file):
    free = replace(arm, lower=[0, -math.pi], upper=[1.6, math.pi])
    elbow = np.r_[np.linspace(-4.0, -3.8, 20), np.linspace(-1.2, -1.0, 20)]  # with a gap of its own
    log = read_log(file(table({"shoulder": np.linspace(0, 1.5, 40), "elbow": elbow})), free)
    assert (log.q[:, 1] == elbow).all()
    assert log.lower[1] == pytest.approx(-2.5 - math.pi)
    assert log.upper[1] - log.lower[1] == pytest.approx(TURN)
    elbow = np.linspace(-3.0, 3.0, 40)
    log = read_log(file(table({"shoulder": np.linspace(0, 1.5, 40), "elbow": elbow})), free)
    assert (log.lower[1], log.upper[1]) == (-math.pi, math.pi)
