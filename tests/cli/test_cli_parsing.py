"""What may be typed, and what becomes of it."""

import math

import typer
from calib_cli import parsing
from calib_cli.output import plain
from hypothesis import given
from hypothesis import strategies as st

from calib.common.wording import one_line, printable
from calib.errors import RobotError


@given(st.text())
def test_readers_answer_or_say_what_they_expected(text):
    readers = [
        parsing.count,
        parsing.not_negative,
        parsing.above_zero,
        parsing.lattice_sides,
        parsing.sigma,
        parsing.names,
        parsing.reals,
        parsing.column_names,
        parsing.joint_value,
        parsing.joint_range,
        parsing.one_of(("batch", "online")),
        parsing.height,
    ]
    told = []
    for read in readers:
        try:
            read(text)
        except typer.BadParameter as error:
            told.append(error.format_message())
    assert all(told)


def test_json_holds_no_number_that_is_not_finite():
    assert plain({"a": [math.nan, math.inf, 1.0], 2: (True, None, "x")}) == {
        "a": [None, None, 1.0],
        "2": [True, None, "x"],
    }


@given(st.text())
def test_what_is_printable_stays_and_all_else_is_written_out(text):
    shown = printable(text)
    assert shown.isprintable()
    assert (shown == text) == text.isprintable()
    assert str(RobotError(text)) == one_line(text)
