"""The errors of calib: one family, each message one line.

A message says what was given, what was expected and what to do about it.
"""

from __future__ import annotations

from .common.wording import one_line


class CalibError(Exception):
    """Base of every error that calib raises on purpose.

    Parameters
    ----------
    message : str
        What happened; names within it may come from a stranger's file.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(one_line(message))


class RobotError(CalibError):
    """A URDF, a joint or a tip that cannot be used as a planar arm."""


class LogError(CalibError):
    """A log of joint values and positions that cannot be read or learned from."""


class OptionError(CalibError):
    """An option or an argument outside of what is possible."""


class ModelError(CalibError):
    """A model file that is damaged, foreign or newer than this program."""


class QueryError(CalibError):
    """A query that the model cannot answer: wrong shape, not finite, out of range."""
