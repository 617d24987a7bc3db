"""Translation: library messages name Python parameters, people who type read options.

A message of the library has its parameters in backquotes, such as `degrees=True`; here they
become what is typed, such as --degrees.
"""

from __future__ import annotations

import ast
import re

OPTIONS = {
    "board": "--board",
    "body": "--body",
    "cause": "--cause",
    "columns": "--columns",
    "changes": "--change",
    "degrees": "--degrees",
    "dictionary": "--dictionary",
    "epochs": "--epochs",
    "force": "--force",
    "frames": "--frames",
    "max_gap": "--max-gap",
    "joints": "--joints",
    "joints_topic": "--joints-topic",
    "keep": "--keep",
    "lens": "--lens",
    "limit": "--limit",
    "lock": "--lock",
    "log": "--data",
    "map": "--map",
    "margin": "--margin",
    "meshes": "--meshes",
    "method": "--method",
    "motor_size": "--motor-size",
    "move_base": "--move-base",
    "n": "--samples",
    "near": "--near",
    "noise": "--noise",
    "planar": "--planar",
    "port": "--port",
    "prismatic": "--prismatic",
    "ranges": "--range",
    "readout": "--readout",
    "robot": "ROBOT",
    "rule": "--rule",
    "samples": "--data",
    "seed": "--seed",
    "sensory_size": "--sensory-size",
    "share": "--residual",
    "sigma": "--sigma",
    "size": "--size",
    "since": "--since",
    "start": "--from",
    "still": "--still",
    "tag": "--tag",
    "tag_height": "--tag-height",
    "tag_size": "--tag-size",
    "tags_at": "--tags-at",
    "time_offset": "--time-offset",
    "tip": "--tip",
    "tip_topic": "--tip-topic",
    "tolerance": "--tolerance",
    "unit": "--unit",
    "view": "--view",
    "weights": "--weights",
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
    return None if parameter is None else OPTIONS.get(parameter, parameter)


def _option(match: re.Match[str]) -> str:
    name, value = match[1], match[2]
    option = OPTIONS.get(name)
    if option is None:
        return match[0]
    if value is None:
        return option
    try:
        tree = ast.parse(value.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        return f"{option} {value}"
    if isinstance(tree, ast.Constant) and tree.value is True:
        return option
    if isinstance(tree, ast.Dict) and name != "columns":  # an option for each entry
        return " ".join(f"{option} {entry}" for entry in _entries(tree))
    return f"{option} {_typed(tree)}"


def _entries(tree: ast.Dict) -> list[str]:
    return [
        f"{'' if key is None else _typed(key)}={_typed(value)}"
        for key, value in zip(tree.keys, tree.values, strict=True)
    ]


def _typed(tree: ast.expr) -> str:
    if isinstance(tree, ast.Constant):
        return str(tree.value)
    if isinstance(tree, ast.Dict):
        return ",".join(_entries(tree))
    if isinstance(tree, ast.List):
        return ",".join(map(_typed, tree.elts))
    if isinstance(tree, ast.Tuple):
        return ":".join(map(_typed, tree.elts))
    return ast.unparse(tree)
