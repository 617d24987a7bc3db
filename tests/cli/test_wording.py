"""Wording: whatever a name holds, a message stays one printable line of bearable length."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from calib.common.wording import listed, one_line, printable, quoted, suggestion
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


@given(st.lists(st.text(min_size=1), min_size=1))
def test_names_are_listed_in_their_order(names):
    short = [name[:57] for name in names]
    assert listed(short, len(short)) == ", ".join(short)


@given(st.text(max_size=50), st.integers(0, 5000))
def test_a_message_keeps_its_beginning_and_its_remedy(text, more):
    message = str(CalibError(f"{text}: {'x' * more}; do this"))
    assert message.startswith(printable(text))
    assert message.endswith("x; do this" if more else "do this")
    assert len(message) < 1500
    assert more > 1400 or "..." not in message.removeprefix(printable(text))


def test_long_names_and_many_names_make_no_long_line():
    names = [f"{k}{'x' * 5000}" for k in range(2000)]
    assert len(quoted(names[0])) < 70
    assert len(listed(names)) < 1000
    assert len(suggestion(names[7] + "y", names[:20])) < 1100
    assert "(2000 in all)" in listed(names)
