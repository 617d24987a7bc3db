"""About a model: what it is a model of, how it was made, how well it does."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.checks import finite, numbers, of_type, texts
from ..common.frozen import ReadOnly
from ..errors import LogError
from ..samples.samples import Samples

_TYPES: dict[type, tuple[str, ...]] = {
    str: ("robot", "tip", "unit", "bound_of", "source", "urdf"),
    bool: ("taught",),
    int: ("samples", "seed", "tested", "left_out"),
    dict: ("locked", "options", "errors"),
}
_OPTIONS = ("map", "rule", "epochs", "sigma")
_WIDEST = 1e9  # range of a joint [rad or m]


@dataclass(frozen=True, eq=False)
class About(ReadOnly):
    """Plain facts that travel with a model."""

    # name of the robot and of the frame whose position is sensed ("" without a URDF)
    robot: str
    tip: str
    joint_names: tuple[str, ...]  # active joints from base to tip
    revolute: tuple[bool, ...]  # whether each joint turns (rad) or slides (m)
    # (dof,) [rad or m], learned range of each joint
    lower: Array
    upper: Array
    locked: Mapping[str, float]  # other joints and where they are held [rad or m]
    # "origin", "x" and "y" of the plane in the root link's frame [m]
    plane: Mapping[str, Any] | None
    unit: str  # unit of the positions
    bound_of: str  # "true position" or "sensor reading": what the expected error bounds
    source: str  # "simulation" or "log"
    # whether the maps learned from positions that the body predicts, besides the samples
    taught: bool
    # number of training samples, and the seed
    samples: int
    seed: int
    options: Mapping[str, Any]  # "map", "rule", "epochs", "sigma" of the training
    simulation: Mapping[str, Any] | None  # noise and changes of the simulated arm
    urdf: str  # the URDF's own text ("" without one)
    # errors per readout as ``calib evaluate --json`` prints them
    errors: Mapping[str, Any] = field(default_factory=dict)
    # "p95" and "covered" of the answers' distances, see `calib.Evaluation.within`
    within: Mapping[str, float] = field(default_factory=dict)
    # samples behind those errors, and samples outside of what was learned from the others
    tested: int = 0
    left_out: int = 0
    notes: tuple[str, ...] = ()  # notes that were printed while the model was made
    # columns of its log that have other names than what they hold
    columns: Mapping[str, str] = field(default_factory=dict)
    # whether its log has turning joints in degrees; later logs are read alike
    degrees: bool = False
    # [px], width and height of the pictures of a camera that sees an arm in space
    picture: tuple[int, int] | None = None
    frame: str = ""  # the sensor's, as its log names it

    @property
    def units_of_joints(self) -> tuple[str, ...]:
        """Unit of each joint: "rad" or "m"."""
        return tuple("rad" if turns else "m" for turns in self.revolute)

    def measured(self, **facts: Any) -> About:
        """The same facts but for these, of a model that now rests on what a sensor read."""
        told: dict[str, Any] = {"source": "log", "bound_of": "sensor reading", "simulation": None}
        return replace(self, **told, taught=False, **facts)

    def joints_of(self, log: Samples) -> Array:
        """Joint values (n, dof) of a log in the order of the model's joints.

        Raises LogError if the log is of other joints.
        """
        if sorted(log.joint_names) != sorted(self.joint_names):
            raise LogError(
                f"the log's joints are {', '.join(log.joint_names)}, the model's are "
                f"{', '.join(self.joint_names)}: give a log of the same arm"
            )
        return log.q[:, [log.joint_names.index(name) for name in self.joint_names]]

    def to_json(self) -> dict[str, Any]:
        """Plain data, as it is stored in a model file."""
        data = asdict(self)
        data["lower"], data["upper"] = self.lower.tolist(), self.upper.tolist()
        data["errors"] = _known_numbers(data["errors"])
        return data

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> About:
        """Rebuild what `to_json` returned.

        Raises
        ------
        ValueError
            If it is not of that form: a file may come from anyone.
        """
        known = {f.name for f in fields(cls)}
        values = {k: v for k, v in data.items() if k in known}
        _check_about(values)
        for name in ("joint_names", "revolute", "notes"):
            values[name] = tuple(values[name])
        for name in ("lower", "upper"):
            values[name] = np.array(values[name], dtype=float)
        if values.get("picture") is not None:
            values["picture"] = tuple(values["picture"])
        return cls(**values)


def _known_numbers(errors: Any) -> Any:
    """Return errors in which what could not be measured (NaN) is None, as JSON has it."""
    if isinstance(errors, Mapping):
        return {key: _known_numbers(value) for key, value in errors.items()}
    if isinstance(errors, float) and not math.isfinite(errors):
        return None
    return errors


def _check_about(data: Mapping[str, Any]) -> None:
    """Check the plain data of an `About`, which may come from a stranger's file.

    Raises KeyError, ValueError if something is missing or is not what it should be.
    """
    for kind, names in _TYPES.items():
        for name in names:
            of_type(name, data[name], kind)
    joints = texts("joint_names", data["joint_names"])
    dof = len(joints)
    if not dof or len(set(joints)) < dof or not all(joints):
        raise ValueError("joint_names: expected names, each once")
    turns = of_type("revolute", data["revolute"], list)
    if len(turns) != dof or not all(isinstance(turn, bool) for turn in turns):
        raise ValueError("revolute: expected true or false for each joint")
    lower, upper = (numbers(name, data[name], dof) for name in ("lower", "upper"))
    if not all(0.0 < high - low < _WIDEST for low, high in zip(lower, upper, strict=True)):
        raise ValueError("lower, upper: expected a range for each joint")
    for name, value in data["locked"].items():
        finite(f"locked {name}", value)
    if data["plane"] is not None:
        for name in ("origin", "x", "y"):
            numbers(f"plane {name}", of_type("plane", data["plane"], dict)[name], 3)
    if data["simulation"] is not None:
        simulation = of_type("simulation", data["simulation"], dict)
        finite("noise", simulation["noise"])
        texts("changes", simulation["changes"])
    texts("notes", data["notes"])
    columns = of_type("columns", data.get("columns", {}), dict)
    texts("columns", [*columns, *columns.values()])
    of_type("degrees", data.get("degrees", False), bool)
    of_type("frame", data.get("frame", ""), str)
    if data.get("picture") is not None:
        if not all(0 < of_type("picture", side, int) < 1e6 for side in data["picture"]):
            raise ValueError("picture: expected a width and a height [px]")
        numbers("picture", list(data["picture"]), 2)
    if min(data["samples"], data["seed"], data["tested"], data["left_out"]) < 0:
        raise ValueError("samples, seed, tested, left_out: expected zero or more")
    for name in _OPTIONS:
        _ = data["options"][name]  # a KeyError where one is missing
    _check_errors(data["errors"], joints)


def _check_errors(errors: Mapping[str, Any], joints: Sequence[str]) -> None:
    for readout, directions in errors.items():
        for direction, names in (("forward", ("x", "y")), ("inverse", joints)):
            found = of_type(readout, directions, dict)[direction]
            for name in (*names, "distance"):
                error = of_type(name, of_type(direction, found, dict)[name], dict)
                for key in ("mean", "max", "p99"):
                    if error[key] is not None:
                        finite(f"error {key}", error[key])
