"""Commands on demand: a command line imports the module of the command that it runs, no other."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

import typer
import typer.core
from typer.main import get_command

COMMANDS = {
    "robots": "List the bundled robots.",
    "plan": "Plan poses to measure: well spread, within the limits.",
    "train": "Learn a model from simulated babbling or from a measured log.",
    "query": "Ask a model for positions or for joint values.",
    "evaluate": "Print the errors of a model, on fresh samples or on a log.",
    "sweep": "Train with every combination of options, on all cores.",
    "check": "Compare a model with new samples: is it still calibrated?",
    "adapt": "Re-calibrate a model from a few new samples.",
    "recognise": "Tell which of some models the arm is in.",
    "correct": "Correct joint values so that the real arm goes where they lead.",
    "urdf": "Write a copy of the URDF with what the model has learned.",
    "export": "Write a model as one C99 header for controllers without Python.",
    "babble": "Write a log of simulated babbling [rad, m].",
    "log": "Turn a ROS bag, pictures or a video into a log.",
    "tag": "Write a tag for the arm's tip, or a board for the desk.",
    "preview": "Show the arm and its learned maps in a browser.",
    "report": "Write figures and tables that explain a calibration.",
    "reproduce": "Repeat the paper's tables, figures and experiments.",
    "info": "Show what a model is and how it was made.",
}
"""What the command line can do, in the order of its use, and what ``calib --help`` says of it."""


@cache
def load_command(name: str) -> Any:
    """Import the module of a command, and return its command."""
    module = import_module(f".commands.{name}", __package__)
    app = getattr(module, f"{name}_app", None)  # a command of several
    if app is None:
        app = typer.Typer(add_completion=False, rich_markup_mode=None)
        app.command(name)(getattr(module, name))
    command: Any = get_command(app)
    # a command of several is named after its function, if at all
    command.name = name
    return command


class _Plain:
    """Values from what was typed, in the place of Typer's adapter of Pydantic.

    That is imported otherwise, which takes a tenth of a second of each command.
    """

    def __init__(self, descriptor: Any) -> None:
        self._read = descriptor.parameter_info.parser or str

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:  # noqa: ARG002
        """Read texts; a flag, and a default that is no text, are values already."""
        if param.multiple or param.nargs == -1:
            return [self._read(text) for text in value or ()]
        return self._read(value) if isinstance(value, str) else value


# Typer has no public way; of 0.26, which reads plainly itself, it is no name
typer.core.build_runtime_param = _Plain  # type: ignore[attr-defined, assignment]
