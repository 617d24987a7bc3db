"""The guard itself, which would otherwise find nothing in silence."""

from __future__ import annotations

import socket
import subprocess
import sys

import pytest

from hostile.guard import Violation, guarded, one_line


def test_other_files_processes_and_connections_are_noticed(tmp_path):
    outside, inside = tmp_path / "outside.txt", tmp_path / "work"
    outside.write_text("secret")
    inside.mkdir()
    (inside / "a").write_text("")
    with guarded(inside, [str(outside)]):
        (inside / "a").read_text()
        outside.read_text()
    with pytest.raises(Violation, match=r"open .*outside"), guarded(inside):
        outside.read_text()
    with pytest.raises(Violation, match="subprocess"), guarded(inside):
        subprocess.run([sys.executable, "-c", ""], check=False)
    with (
        pytest.raises(Violation, match="socket"),
        guarded(inside),
        socket.create_server(("127.0.0.1", 0)),
    ):
        pass


@pytest.mark.parametrize(
    "text", ["a\nb", "a\x1b[2J", "", "x" * 3000, "Traceback (most recent call last)"]
)
def test_a_message_in_other_than_one_line_is_noticed(text):
    with pytest.raises(Violation):
        one_line(text)
