"""Command line of calib, installed as the command `calib`."""

import io
import os
import signal
import sys
from contextlib import suppress


def main() -> None:
    """Run the command line and end the process with its exit code."""
    _open_closed_streams()
    # small products gain nothing from threads: on a busy machine two take four times as long
    for library in ("OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    # a polite kill ends as Ctrl-C does: what is half written is removed
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        from .app import run

        code = run(sys.argv[1:])
    except KeyboardInterrupt:  # while modules were imported
        print("error: interrupted", file=sys.stderr)
        code = 128 + signal.SIGINT
    except SystemExit as end:  # a polite kill
        code = end.code if isinstance(end.code, int) else 1
    if code > 128:
        # a thread may still compute: it would crash while Python takes its modules away
        with suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _open_closed_streams() -> None:
    """Give a process that was started without standard streams streams that lead nowhere."""
    # the lowest free number is that of the closed stream: no file shall take its place
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: PTH123, SIM115
            setattr(sys, name, stream)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
