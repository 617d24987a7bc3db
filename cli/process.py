"""Process: Ctrl-C and a polite kill end it at once, nothing half done; closed streams work too."""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
import time
from contextlib import suppress
from types import FrameType


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


_PATIENCE = 0.7  # for what is under way, before the process ends without it [s]
_STARTING, _WORKING = 0.1, 10.0  # how long to wait for another thread [s]
_RESTORED = b"\r\x1b[2K\x1b[?25h"  # no bar, and a cursor again

_received: list[int] = []


class _Watchdog(threading.Thread):
    """Ends the process where the main thread is too deep in compiled code to notice."""

    def __init__(self, pipe: int) -> None:
        super().__init__(daemon=True)
        self._pipe = pipe

    def run(self) -> None:
        number = os.read(self._pipe, 1)[0]  # written by Python's own handler, without delay
        time.sleep(_PATIENCE)
        if sys.stderr is not None and sys.stderr.isatty():
            os.write(sys.stderr.fileno(), _RESTORED)
        os._exit(128 + number)


def install() -> None:
    """Take over the signals of this process, which has one main thread and one purpose."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _handle)
    if sys.platform != "win32":
        reader, writer = os.pipe()
        os.set_blocking(writer, False)
        signal.set_wakeup_fd(writer)
        _Watchdog(reader).start()


def received() -> int | None:
    """Exit code that a signal asks for, None if there was none."""
    return 128 + _received[0] if _received else None


def leave(code: int | None) -> None:
    """End the process if a signal came, without waiting for threads that are still at work.

    Its exit code is that of the signal where `code` is None.
    """
    asked = received()
    if asked is not None:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, RuntimeError):  # or interrupted while it wrote
                stream.flush()
        os._exit(asked if code is None else code)


def _handle(number: int, _frame: FrameType | None) -> None:
    """Interrupt once SciPy's threads have ended: they use arrays that would be freed."""
    if _received:  # it ends already, and what it tidies up shall not be interrupted
        return
    _received.append(number)
    sys.unraisablehook = lambda _: None  # raised where nobody can catch it: the watchdog ends it
    for thread in threading.enumerate():
        if type(thread) is not threading.Thread:  # ours and Rich's, which need nothing of this one
            continue
        deadline = time.monotonic() + _STARTING
        while not thread.is_alive() and time.monotonic() < deadline:
            time.sleep(0.001)
        if thread.is_alive():
            thread.join(_WORKING)
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + number)
