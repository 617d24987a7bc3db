"""What may be typed, and what becomes of it."""

import math

import pytest
from calib_cli import parsing
from calib_cli.output import fixed, number, plain
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import OptionError


@given(st.text())
def test_readers_answer_or_say_what_they_expected(text):
    readers = [
        parsing.count, parsing.not_negative, parsing.above_zero, parsing.size, parsing.sigma,
        parsing.names, parsing.reals, parsing.typed_columns, parsing.joint_value,
        parsing.joint_range, parsing.one_of(("batch", "online")), parsing.height,
    ]  # fmt: skip
    told = []
    for read in readers:
        try:
            read(text)
        except (ValueError, OptionError) as error:
            told.append(str(error))
    assert all(told)


def test_other_values():
    assert parsing.sigma("5:0.5") == (5.0, 0.5)
    assert parsing.names(" a, b ") == ("a", "b")
    assert parsing.reals("-1,2e-3") == (-1.0, 0.002)
    assert parsing.joint_value("wrist=-1") == ("wrist", -1.0)
    assert parsing.typed_columns("x=u,elbow=j 2") == {"x": "u", "elbow": "j 2"}


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (1.0, "1.000"), (0.00123456, "0.001235"), (123.456, "123.5"),
        (123456.0, "123456"), (1e-9, "<1e-6"), (1e9, "1.000e+09"), (math.nan, "-"), (None, "-"),
    ],
)  # fmt: skip
def test_numbers_have_four_digits(value, text):
    assert number(value) == text


def test_fixed_numbers_are_never_minus_zero():
    assert fixed(-1e-9, 4) == "0.0000"
    assert fixed(-0.12344, 4) == "-0.1234"
    assert fixed(math.inf, 4) == "-"


def test_json_holds_no_number_that_is_not_finite():
    assert plain({"a": [math.nan, math.inf, 1.0], 2: (True, None, "x")}) == {
        "a": [None, None, 1.0],
        "2": [True, None, "x"],
    }
