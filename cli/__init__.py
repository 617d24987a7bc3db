"""Command line of calib, installed as the command `calib`."""

from __future__ import annotations

__all__ = ["main"]


def main() -> None:
    """Run the command line and end the process with its exit code."""
    import signal
    import sys

    from . import streams

    streams.prepare()
    # a polite kill ends as Ctrl-C does: what is half written is removed
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        from .app import app

        app(prog_name="calib")
    except KeyboardInterrupt:  # while modules were imported
        print("error: interrupted", file=sys.stderr)
        sys.exit(128 + signal.SIGINT)
