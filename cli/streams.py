"""Standard streams that are closed, cannot hold every character, or lose their reader."""

from __future__ import annotations

import io
import os
import sys
from typing import TextIO


def prepare() -> None:
    """Make every standard stream one that can be read or written.

    A closed one becomes the null device; a character that an encoding lacks is written as its
    code.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        stream = getattr(sys, name)
        if stream is None:
            # the lowest free number is that of the closed stream: no file shall take its place
            stream = open(os.devnull, "w" if number else "r", encoding="utf-8")  # noqa: PTH123, SIM115
            setattr(sys, name, stream)
        elif number and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def silence(stream: TextIO) -> None:
    """Point a stream at nothing, so that no later flush, Python's last one too, fails."""
    try:
        handle = os.open(os.devnull, os.O_WRONLY)
        os.dup2(handle, stream.fileno())
        os.close(handle)
    except (OSError, ValueError):  # no real stream, as in tests
        pass
