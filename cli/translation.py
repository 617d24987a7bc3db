"""Translation: library messages name Python parameters, people who type read options.

A message of the library has its parameters in backquotes, such as `degrees=True`; here they
become what is typed, such as --degrees.
"""

from __future__ import annotations

import re

_SAME = (
    "board body cause columns degrees dictionary distance epochs eye force frame frames joints "
    "joints_topic lens limit lock map margin max_gap method motor_size move_base near "
    "noise planar port prismatic readout rule seed sensory_size sigma size still tag "
    "tag_height tag_size tags_at time_offset tip tip_topic tolerance unit view weights"
)
_OPTIONS = {name: f"--{name.replace('_', '-')}" for name in _SAME.split()} | {
    "changes": "--change",
    "log": "--data",
    "n": "--samples",
    "ranges": "--range",
    "robot": "ROBOT",
    "samples": "--data",
    "start": "--from",
}
"""Options by the Python names of the parameters that they set."""

_QUOTED = re.compile(r"`([A-Za-z_]\w*)(?:=([^`]*))?`")


def as_typed(text: str) -> str:
    """Return a message of the library in the words of the command line.

    Examples
    --------
    >>> as_typed("give `degrees=True`, or `ranges={'elbow': (LOW, HIGH)}`")
    'give --degrees, or --range elbow=LOW:HIGH'
    >>> as_typed("leave it out of `joints`, or give `joints=['a', 'b']`")
    'leave it out of --joints, or give --joints a,b'
    """
    return _QUOTED.sub(_option, text)


def option_of(parameter: str | None) -> str | None:
    """Return the option that sets a parameter, its own name where there is none."""
    return None if parameter is None else _OPTIONS.get(parameter, parameter)


def _option(match: re.Match[str]) -> str:
    name, value = match[1], match[2]
    option = _OPTIONS.get(name)
    if option is None or value in (None, "True"):
        return option or match[0]
    pairs = re.sub(r"\(([^()]*)\)", lambda pair: pair[1].replace(", ", ":"), value)
    typed = re.sub(r"[][{}'\"]", "", pairs).replace(": ", "=").replace(", ", ",")
    # an option for each entry of a mapping
    several = value.startswith("{") and name != "columns"
    return " ".join(f"{option} {part}" for part in (typed.split(",") if several else [typed]))
