"""The errors of calib: one family, each message one line with structured fields.

A message states what was given and what was expected, the hint what to do.  They name Python
parameters in backquotes, such as `degrees=True`, which the command line turns into options.
"""

from __future__ import annotations

from typing import TypeVar

from .common.wording import one_line

_E = TypeVar("_E", bound="CalibError")


class CalibError(Exception):
    """Base of every error that calib raises on purpose.

    Parameters
    ----------
    message : str
        What was given and what was expected; names within it may come from a stranger's file.
    hint : str or None
        What to do; it follows the message after a semicolon.
    parameter : str or None
        Python name of the parameter that is wrong or that would help.
    value : object
        The value that is wrong, None if there is none. Attributes have the same four names.

    Examples
    --------
    >>> error = CalibError("seed is -1", hint="give 0 or more", parameter="seed", value=-1)
    >>> str(error), error.parameter, error.value
    ('seed is -1; give 0 or more', 'seed', -1)
    """

    def __init__(
        self,
        message: str = "",
        *,
        hint: str | None = None,
        parameter: str | None = None,
        value: object = None,
    ) -> None:
        self.message = one_line(message)
        self.hint = None if hint is None else one_line(hint)
        self.parameter = parameter
        self.value = value
        text = self.message
        if self.hint is not None:
            text = f"{self.message}; {self.hint}"
        super().__init__(text)

    def within(self: _E, label: str) -> _E:
        """Return the same error with the place of what is wrong, such as a file, before it."""
        return type(self)(
            f"{label}: {self.message}",
            hint=self.hint,
            parameter=self.parameter,
            value=self.value,
        )


class RobotError(CalibError):
    """A URDF, a joint or a tip that cannot be used as an arm."""


class LogError(CalibError):
    """A log of joint values and positions that cannot be read or learned from."""


class OptionError(CalibError):
    """An argument outside of what is possible."""


class ModelError(CalibError):
    """A model file that is damaged, foreign or newer than this program."""


class QueryError(CalibError):
    """A query that the model cannot answer: wrong shape, not finite, out of range."""


def require(name: str, value: object, kind: type) -> None:
    """Raise OptionError where an argument is of another type, as of two that are exchanged."""
    if not isinstance(value, kind):
        raise OptionError(
            f"{name}: expected {kind.__name__}, got {type(value).__name__}",
            parameter=name,
        )
