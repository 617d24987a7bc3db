"""Streams: standard streams that are closed, narrow or of a small alphabet are still usable."""

from __future__ import annotations

import io
import os
import sys


def prepare() -> None:
    """Make every standard stream one that can be written or read.

    A closed stream becomes the null device, before any file could take its number; a character
    that a stream's encoding lacks is written out as its code.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        stream = getattr(sys, name)
        if stream is None:
            mode = os.O_RDONLY if number == 0 else os.O_WRONLY
            handle = os.open(os.devnull, mode)
            if handle != number:
                try:
                    os.fstat(number)
                except OSError:
                    os.dup2(handle, number)
                    os.close(handle)
                    handle = number
            stream = open(handle, "r" if number == 0 else "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
        elif number and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
