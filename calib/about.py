"""About a model: what it is a model of, how it was made, how well it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class About:
    """Plain facts that travel with a model.

    Attributes
    ----------
    robot, tip : str
        Name of the robot and of the frame whose position is sensed ("" without a URDF).
    joint_names : tuple of str
        Active joints from base to tip.
    revolute : tuple of bool
        Whether each joint turns (rad) or slides (m).
    lower, upper : (dof,) array [rad or m]
        Learned range of each joint.
    locked : dict of str to float
        Other joints and where they are held [rad or m].
    plane : dict or None
        "origin", "x" and "y" of the plane in the root link's frame [m].
    unit : str
        Unit of the positions.
    bound_of : str
        "true position" or "sensor reading": what the expected error bounds.
    source : str
        "simulation" or "log".
    taught : bool
        Whether a Gaussian process of a small log taught the maps.
    samples, seed : int
        Number of training samples, and the seed.
    options : dict
        "map", "rule", "epochs", "sigma" of the training.
    simulation : dict or None
        Noise and changes of the simulated arm.
    urdf : str
        The URDF's own text ("" without one).
    errors : dict
        Errors per readout as ``calib evaluate --json`` prints them.
    tested, left_out : int
        Samples behind those errors, and samples outside of what was learned from the others.
    notes : tuple of str
        What was said aloud while the model was made.
    """

    robot: str
    tip: str
    joint_names: tuple[str, ...]
    revolute: tuple[bool, ...]
    lower: Array
    upper: Array
    locked: Mapping[str, float]
    plane: Mapping[str, Any] | None
    unit: str
    bound_of: str
    source: str
    taught: bool
    samples: int
    seed: int
    options: Mapping[str, Any]
    simulation: Mapping[str, Any] | None
    urdf: str
    errors: Mapping[str, Any] = field(default_factory=dict)
    tested: int = 0
    left_out: int = 0
    notes: tuple[str, ...] = ()

    @property
    def units_of_joints(self) -> tuple[str, ...]:
        """Unit of each joint: "rad" or "m"."""
        return tuple("rad" if turns else "m" for turns in self.revolute)

    def to_json(self) -> dict[str, Any]:
        """Plain data, as it is stored in a model file."""
        data = asdict(self)
        data["lower"], data["upper"] = self.lower.tolist(), self.upper.tolist()
        return data

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> About:
        """Rebuild what `to_json` returned."""
        known = {f.name for f in fields(cls)}
        values = {k: v for k, v in data.items() if k in known}
        for name in ("joint_names", "revolute", "notes"):
            values[name] = tuple(values[name])
        for name in ("lower", "upper"):
            values[name] = np.array(values[name], dtype=float)
        return cls(**values)
