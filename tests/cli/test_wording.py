"""Wording: whatever a name holds, a message stays one printable line of bearable length."""

from hypothesis import given
from hypothesis import strategies as st

from calib.common.wording import one_line, printable
from calib.errors import CalibError, RobotError


@given(st.text())
def test_what_is_printable_stays_and_all_else_is_written_out(text):
    shown = printable(text)
    assert shown.isprintable()
    assert (shown == text) == text.isprintable()
    assert str(RobotError(text)) == one_line(text)


def test_an_error_has_no_line_breaks_and_no_commands_for_the_terminal():
    for name in ("a\nb", "a\u2028b", "a\x1b[2Jb", "a\u009bb", "a\u202eb", "a\0b"):
        message = str(CalibError(f"joint {name} does not exist"))
        assert message.isprintable()
        assert message == f"joint {repr(name)[1:-1]} does not exist"
