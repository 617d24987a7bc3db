"""Command line of calib, installed as the command `calib`."""

from __future__ import annotations

import signal
import sys
import threading
import time
from types import FrameType

__all__ = ["main"]

_STARTING, _WORKING = 0.1, 10.0  # how long to wait for a thread [s]


def main() -> None:
    """Run the command line and end the process with its exit code."""
    try:
        signal.signal(signal.SIGINT, _interrupt)
        from .app import app

        app(prog_name="calib")
    except KeyboardInterrupt:  # while Python was still importing
        sys.exit(130)


def _interrupt(_signal: int, _frame: FrameType | None) -> None:
    """Interrupt once SciPy's threads have ended: they use arrays that would be freed."""
    for thread in threading.enumerate():
        if type(thread) is not threading.Thread:  # Rich's, which draws until told to stop
            continue
        deadline = time.monotonic() + _STARTING
        while not thread.is_alive() and time.monotonic() < deadline:
            time.sleep(0.001)
        if thread.is_alive():
            thread.join(_WORKING)
    raise KeyboardInterrupt
