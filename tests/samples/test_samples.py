"""Samples and rows: checked and read-only, named columns by name, nothing but numbers."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from models import draw, trained
from refusals import refused

import calib
from calib import LogError, Samples


def make(n=4, **changes):
    rng = np.random.default_rng(0)
    fields = {
        "q": rng.random((n, 2)),
        "x": rng.random((n, 2)),
        "joint_names": ("a", "b"),
        "lower": [0, 0],
        "upper": [1, 1],
        "revolute": (True, False),
    }
    return Samples(**{**fields, **changes})


def test_arrays_are_float_contiguous_and_read_only():
    s = make(q=np.asfortranarray(np.arange(8).reshape(4, 2)))
    assert s.q.dtype == np.float64
    assert s.q.flags.c_contiguous
    assert s.q.tolist() == [[0, 1], [2, 3], [4, 5], [6, 7]]
    for array in (s.q, s.x, s.lower, s.upper):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_take_keeps_everything_but_the_rows():
    s = make(5, unit="px", notes=["n"], dropped=3)
    for index in ([3, 1], np.array([3, 1]), np.array([3, 1], dtype=np.uint8)):
        part = s.take(index)
        assert (part.q == s.q[[3, 1]]).all()
        assert (part.x == s.x[[3, 1]]).all()
    assert (part.unit, part.notes, part.dropped, len(part), part.dof) == ("px", ("n",), 3, 2, 2)
    assert (s.take(slice(1, None, 2)).q == s.q[1::2]).all()
    assert (s.take(s.q[:, 0] > 0.5).q == s.q[s.q[:, 0] > 0.5]).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"q": np.zeros((4, 3))}, r"q of shape \(4, 3\): expected"),
        ({"x": np.zeros((3, 2))}, r"x has shape \(3, 2\), expected \(4, 2\)"),
        ({"orientation": np.zeros((4, 3))}, r"orientation has shape \(4, 3\)"),
        ({"time": [0.0, 1.0]}, r"time has shape \(2,\), expected \(4,\)"),
        ({"time": [0.0, 1.0, np.nan, 2.0]}, "time is not finite"),
        ({"covariance": np.zeros((4, 3, 3))}, r"covariance has shape \(4, 3, 3\)"),
        ({"upper": [1.0, np.inf]}, "'b' has the range 0:inf"),
        ({"lower": [0.0, 1.0]}, "'b' has the range 1:1"),
        ({"joint_names": ("a", "a")}, "different names"),
        ({"q": np.zeros((0, 2)), "x": np.zeros((0, 2))}, "no rows"),
        ({"q": [["a", "b"]] * 4}, "expected numbers"),
        ({"x": [[0, 0], [0, np.nan], [0, 0], [0, 0]]}, r"x of row 2"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(changes, message):
    refused(LogError, message, make, **changes)


Q = np.array([[0.0, 1.0], [0.5, 1.0], [0.5, 0.2], [0.0, 1.0], [0.0, 1.0 + 1e-9]])
SAMPLES = Samples(Q, np.arange(10.0).reshape(5, 2), ("one", "two"))


def test_each_joint_came_from_the_side_of_its_last_motion():
    side = SAMPLES.side
    assert side[:, 0].tolist() == [0, 1, 1, -1, -1]
    assert side[:, 1].tolist() == [0, 0, -1, 1, 1]


def test_rows_at_one_pose_share_its_number():
    assert SAMPLES.pose_index.tolist() == [0, 1, 2, 0, 0]


def test_rows_are_numbered_from_1_where_no_numbers_are_stated():
    assert make(5, rows=None).rows.tolist() == [1, 2, 3, 4, 5]
    assert make(5, rows=np.arange(9, 14)).take([2]).rows.tolist() == [11]
    other = replace(make(5), q=np.zeros((2, 2)), x=np.zeros((2, 2)), side=None)
    assert other.rows.tolist() == [1, 2]


NAMES = ("shoulder", "elbow")
JOINTS = np.array([[0.3, 1.0], [0.5, 1.4], [0.9, 2.0]])


class Pandas(dict):
    """As much of a pandas table as is needed: `columns` and columns by name."""

    @property
    def columns(self):
        return list(self)


def record(q):
    table = np.zeros(len(q), dtype=[("elbow", float), ("time", float), ("shoulder", float)])
    table["shoulder"], table["elbow"] = q.T
    return table


SWAPPED = {
    "dict": lambda q: {"elbow": q[:, 1], "shoulder": q[:, 0]},
    "polars": lambda q: pl.DataFrame({"elbow": q[:, 1], "t": q[:, 0], "shoulder": q[:, 0]}),
    "pandas": lambda q: Pandas(elbow=q[:, 1], shoulder=q[:, 0]),
    "record": record,
}


@pytest.mark.parametrize("kind", SWAPPED)
def test_named_columns_are_taken_by_name_wherever_joint_values_go(kind):
    swapped = SWAPPED[kind](JOINTS)
    model, arm = trained(), calib.load_arm("two_link")
    np.testing.assert_array_equal(model.forward(swapped), model.forward(JOINTS))
    np.testing.assert_array_equal(model.expected_error(swapped), model.expected_error(JOINTS))
    np.testing.assert_array_equal(arm.forward(swapped), arm.forward(JOINTS))
    s = calib.Samples(swapped, arm.forward(JOINTS), NAMES, arm.lower, arm.upper, arm.revolute)
    np.testing.assert_array_equal(s.q, JOINTS)


def test_positions_and_near_are_taken_by_name_too():
    model = trained()
    q = draw(model, 5, margin=0.2)
    x = model.forward(q)
    named = {"y": x[:, 1], "x": x[:, 0]}
    near = {"elbow": q[:, 1], "shoulder": q[:, 0]}
    np.testing.assert_array_equal(model.inverse(named, near), model.inverse(x, q))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"elbow": [1.0]}, "no column 'shoulder'"),
        ({"elbow": [1.0], "sholder": [1.0]}, "did you mean sholder"),
        (np.ma.masked_array(JOINTS, mask=JOINTS > 1.9), "masked"),
        (np.array([["2024-01-01", "2024-01-02"]], dtype="datetime64[s]"), "datetime64"),
        (np.array([[1, 2]], dtype="timedelta64[s]"), "timedelta64"),
        (JOINTS + 0j, "complex"),
        (JOINTS > 1, "bool"),
        ([["a", "b"]], "numbers"),
        ({"shoulder": [1.0, 2.0], "elbow": [1.0]}, "one length"),
    ],
)
def test_what_is_no_table_of_numbers_is_refused_in_one_line(values, words):
    for take in (trained().forward, calib.load_arm("two_link").forward):
        refused(calib.QueryError, words, take, values)
