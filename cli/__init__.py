"""Command line of calib, installed as the command `calib`."""

from __future__ import annotations

__all__ = ["main"]


def main() -> None:
    """Run the command line and end the process with its exit code."""
    from . import process

    process.prepare()
    process.install()
    try:
        from .app import app

        app(prog_name="calib")
    except BaseException as error:
        code = error.code if isinstance(error, SystemExit) else None
        process.leave(code if isinstance(code, int) else None)
        raise
