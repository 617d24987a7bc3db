"""Options: what commands take, declared once by the names of their functions' parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, TypeVar, cast, get_args, get_origin

from calib.common.choices import CAUSES, FRAMES, LOG_FRAMES, MAPS, MOTIONS, READOUTS, RULES

from . import parsing
from .usage import argument, choice, flag, option

_Command = TypeVar("_Command", bound=Callable[..., None])

_OF_TRAINING: dict[str, tuple[str, str, parsing.Reader[Any]]] = {
    "size": (
        "--size N|NxN|NxNxN",
        "Nodes of both maps: 70 or 70x70 if not given, for three joints 17x17x17 in the "
        "motor map; a log chooses its own.",
        parsing.size,
    ),
    "map": (
        "--map NAME",
        "Kind of map: " + ", ".join(MAPS) + ". Default vdsom:residual, which also follows the "
        "body's residuals (vdsom is the paper's); for a log with --body none gas where held-out "
        "blocks prefer it.",
        parsing.one_of(MAPS),
    ),
    "rule": (f"--rule {'|'.join(RULES)}", "Training rule.", parsing.one_of(RULES)),
    "epochs": (
        "--epochs N",
        "Passes over the samples; the full lattice alone is trained then.",
        parsing.integer(1),
    ),
    "sigma": (
        "--sigma START:END",
        "Neighbourhood radius at the start and the end [nodes]; the full lattice alone is trained "
        "then.",
        parsing.sigma,
    ),
    "samples": (
        "--samples -n N",
        "How many samples to babble (default 20000).",
        parsing.integer(1),
    ),
    "noise": (
        "--noise S",
        "Standard deviation of the simulated sensor along each axis [m] (default 0).",
        parsing.at_least_zero("m"),
    ),
}
"""Usage, help and reader of the options that a sweep takes several values of."""

GRID: dict[str, Any] = {
    name: option(f"{usage},..", text, parsing.several(read))
    for name, (usage, text, read) in _OF_TRAINING.items()
}

_SHARED: dict[str, Any] = {
    **{name: option(*row) for name, row in _OF_TRAINING.items()},
    "robot": argument("ROBOT", "A URDF file, or a bundled robot (calib robots)."),
    "model": argument("MODEL", "A model file, as written by calib train."),
    # which arm
    "joints": option(
        "--joints A,B",
        "Active joints; the others are locked. Found automatically where only one choice makes "
        "sense.",
        parsing.names,
    ),
    "tip": option("--tip FRAME", "The frame whose position is sensed."),
    "planar": flag(
        "--planar", "Take the planar part of a robot that moves in space: positions x, y."
    ),
    "lock": option(
        "--lock JOINT=VALUE",
        "Hold another joint at this value [rad or m]; repeatable. Neutral if not given.",
        parsing.joint_value,
    ),
    "ranges": option(
        "--range JOINT=LO:HI",
        "Use only this part of a joint's range [rad or m]; repeatable.",
        parsing.joint_range,
    ),
    # simulated babbling
    "motion": choice("--motion", MOTIONS, "How the simulated arm babbles (default uniform)."),
    "change": option(
        "--change JOINT.WHAT=VALUE",
        "Change the simulated arm or sensor, such as elbow.length=+20%, "
        "shoulder.offset=0.05, sensor.rotate=0.14 or sensor.mirror=x; repeatable.",
    ),
    "seed": option("--seed K", "Seed of the random numbers.", parsing.integer(0)),
    # logs
    "data": option(
        "--data LOG", "A measured log: CSV or Parquet with the joints' columns and x, y."
    ),
    "columns": option(
        "--columns x=U,y=V",
        "Columns of the log that have other names; an element of a Parquet list is tip[0].",
        parsing.typed_columns,
    ),
    "unit": option(
        "--unit m|mm|px|..", "Unit of the log's positions (default m, or that of the model)."
    ),
    "prismatic": option(
        "--prismatic A,B", "For a log without ROBOT: the joints that slide.", parsing.names
    ),
    "degrees": flag(
        "--degrees", "Joint values are typed, read and printed in degrees (default rad)."
    ),
    "photo": option(
        "--photo FILE",
        "A picture, or a video, by the camera that made the log: the map is drawn over it.",
    ),
    "no_photo": flag("--no-photo", "Keep no photo in the model and draw none."),
    # queries
    "readout": choice(
        "--readout",
        READOUTS,
        "Readout of the query (default local: body and local models; without a body linear: maps "
        "and Hebbian links alone).",
    ),
    "frame": choice(
        "--in", FRAMES, "Frame of positions: what the sensor reads, or the arm's base [m]."
    ),
    "input_": option("--input FILE", "Answer every row of this CSV file (- for standard input)."),
    "output": option(
        "--output FILE", "Write the answers to this CSV file (default standard output)."
    ),
    "as_json": flag("--json", "One JSON document on standard output, in SI units."),
}
"""Options by the Python names of the parameters that they set, with the same meaning wherever no
command declares its own."""

NEW_LOG: dict[str, Any] = {
    "data": option("--data LOG", "New samples: CSV or Parquet with the joints' columns and x, y."),
    "cause": choice(
        "--cause", CAUSES, "What changed, if known: the sensor, or the arm's joints and links."
    ),
}
"""Options of commands that compare a model with a new log."""

OF_FRAMES: dict[str, Any] = {
    "view": choice(
        "--view",
        LOG_FRAMES,
        "base: the log is in the robot's root frame; auto: the sensor's frame is free.",
    ),
    "cause": choice(
        "--cause",
        CAUSES,
        "What changed, if a turned sensor and an offset of the first joint look the same.",
    ),
}
"""Options of commands for which a turned sensor is not a turned arm."""


def takes(**own: Any) -> Callable[[_Command], Callable[..., None]]:
    """Declare what a command takes: its own options, and the shared ones for other parameters.

    A parameter that is a dataclass stands for the options of its fields, which are typed one by one
    and given together.
    """

    def declared(command: _Command) -> Callable[..., None]:
        known, taken, groups = _SHARED, dict[str, Parameter](), dict[str, Any]()
        # annotations are texts in these modules, and Typer looks at types
        for parameter in signature(command, eval_str=True).parameters.values():
            kind = parameter.annotation
            if not is_dataclass(kind):
                taken[parameter.name] = parameter
                continue
            groups[parameter.name] = kind
            known = known | getattr(kind, "OPTIONS", {})
            taken |= signature(cast(type, kind), eval_str=True).parameters
        known = known | own

        @wraps(command)
        def run(**typed: Any) -> None:
            given = {
                group: kind(**{each.name: typed.pop(each.name) for each in fields(kind)})
                for group, kind in groups.items()
            }
            command(**typed, **given)

        # keywords alone: a dataclass's field has a default where a later parameter has none
        run.__signature__ = Signature(  # type: ignore[attr-defined]
            [
                each.replace(
                    kind=Parameter.KEYWORD_ONLY,
                    annotation=Annotated[_typed(each.annotation), known[name]],
                )
                for name, each in taken.items()
            ]
        )
        return run

    return declared


def _typed(kind: Any) -> Any:
    """What Typer is told of a parameter: a flag, a text or several; readers make values of it."""
    # of numbers and tuples Typer makes values by itself, with errors of several lines
    kinds = get_args(kind) or (kind,)
    if bool in kinds:
        return kind
    several = list in (get_origin(kind), *map(get_origin, kinds))
    return list[str] | None if several else str | None
