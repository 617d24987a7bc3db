"""Command line of calib, installed as the command `calib`."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

__all__ = ["main"]


def main() -> None:
    """Run the command line and end the process with its exit code."""
    try:
        from .app import INTERRUPTED, app

        app(prog_name="calib")
    except KeyboardInterrupt:  # while Python was still importing
        _stop(130)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            _stop(INTERRUPTED)
        raise


def _stop(code: int) -> None:
    """End at once: SciPy's threads may still be at work, and would outlive Python's memory."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)
