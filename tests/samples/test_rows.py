"""Rows: named columns are taken by name; what is no table of numbers is refused."""

import numpy as np
import polars as pl
import pytest
from models import draw, trained

import calib

NAMES = ("shoulder", "elbow")
Q = np.array([[0.3, 1.0], [0.5, 1.4], [0.9, 2.0]])


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
    swapped = SWAPPED[kind](Q)
    model, arm = trained(), calib.load_arm("two_link")
    np.testing.assert_array_equal(model.forward(swapped), model.forward(Q))
    np.testing.assert_array_equal(model.expected_error(swapped), model.expected_error(Q))
    np.testing.assert_array_equal(arm.forward(swapped), arm.forward(Q))
    s = calib.Samples(swapped, arm.forward(Q), NAMES, arm.lower, arm.upper, arm.revolute)
    np.testing.assert_array_equal(s.q, Q)


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
        (np.ma.masked_array(Q, mask=Q > 1.9), "masked"),
        (np.array([["2024-01-01", "2024-01-02"]], dtype="datetime64[s]"), "datetime64"),
        (np.array([[1, 2]], dtype="timedelta64[s]"), "timedelta64"),
        (Q + 0j, "complex"),
        (Q > 1, "bool"),
        ([["a", "b"]], "numbers"),
        ({"shoulder": [1.0, 2.0], "elbow": [1.0]}, "one length"),
    ],
)
def test_what_is_no_table_of_numbers_is_refused_in_one_line(values, words):
    for take in (trained().forward, calib.load_arm("two_link").forward):
        with pytest.raises(calib.QueryError, match=words) as caught:
            take(values)
        assert "\n" not in str(caught.value)
