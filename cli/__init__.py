"""Command line of calib, installed as the command `calib`."""

from __future__ import annotations


def main() -> None:
    """Run the command line and end the process with its exit code."""
    import io
    import os
    import signal
    import sys

    for number, name in enumerate(("stdin", "stdout", "stderr")):
        stream = getattr(sys, name)
        if stream is None:
            # the lowest free number is that of the closed stream: no file shall take its place
            stream = open(os.devnull, "w" if number else "r", encoding="utf-8")  # noqa: PTH123, SIM115
            setattr(sys, name, stream)
        elif number and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    # small products gain nothing from threads: on a busy machine two take four times as long
    for library in ("OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    # a polite kill ends as Ctrl-C does: what is half written is removed
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        from .app import app

        app(prog_name="calib")
    except KeyboardInterrupt:  # while modules were imported
        print("error: interrupted", file=sys.stderr)
        sys.exit(128 + signal.SIGINT)
