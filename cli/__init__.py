"""Command line of calib, installed as the command `calib`."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line and end the process with its exit code."""
    try:
        from .app import app

        app(prog_name="calib")
    except KeyboardInterrupt:  # while Python was still importing
        sys.exit(130)
