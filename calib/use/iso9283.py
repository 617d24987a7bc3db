"""ISO 9283: pose accuracy and repeatability of positions, from a log that went to poses again.

A pose is attained n times at x_j, about its barycentre b.  Commanded was c::

    AP = |b - c|,    l_j = |x_j - b|,    RP = mean(l) + 3 sd(l)

A controller that trusts the drawing commands where the drawing says that the joints lead (as
delivered); one that corrects its joints by the model, where the model says so (as corrected).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array, Index
from ..errors import CalibError, LogError
from ..model.model import Model
from ..samples.poses import visits_of
from ..samples.samples import Samples
from .wanted import nominal_positions

POSES = 5
"""Poses that the standard asks for."""

CYCLES = 30
"""How often the standard asks to go to each."""


@dataclass(frozen=True)
class PoseTest:
    """One pose that was attained again and again."""

    joints: Array  # (dof,) [rad or m], mean of its visits
    cycles: int  # visits
    repeatability: float  # RP [unit]
    delivered: (
        float | None
    )  # AP by the drawing [unit]; None where the model knows none
    corrected: float  # AP by the model [unit]

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "joints": self.joints.tolist(),
            "cycles": self.cycles,
            "RP": self.repeatability,
            "as_delivered": self.delivered,
            "as_corrected": self.corrected,
        }


@dataclass(frozen=True)
class Iso9283:
    """A test's poses; the figures of the whole are those of the worst pose.

    Poses that were attained once have no repeatability and are left out.
    """

    poses: tuple[PoseTest, ...]
    unit: str

    @property
    def repeatability(self) -> float:
        """RP [unit] of the worst pose."""
        return max(pose.repeatability for pose in self.poses)

    @property
    def corrected(self) -> float:
        """AP [unit] of the worst pose where the joints are corrected by the model."""
        return max(pose.corrected for pose in self.poses)

    @property
    def delivered(self) -> float | None:
        """AP [unit] of the worst pose by the drawing; None where there is no drawing."""
        values = [
            pose.delivered for pose in self.poses if pose.delivered is not None
        ]
        return max(values) if values else None

    @property
    def notes(self) -> tuple[str, ...]:
        """Return where the test falls short of the standard."""
        notes = []
        cycles = min(pose.cycles for pose in self.poses)
        if len(self.poses) < POSES or cycles < CYCLES:
            notes.append(
                f"ISO 9283 asks for {POSES} poses with {CYCLES} cycles each: the log has "
                f"{len(self.poses)} with {cycles} or more"
            )
        if self.delivered is None:
            notes.append(
                "the model knows no URDF: there is no accuracy as delivered"
            )
        return tuple(notes)

    def to_json(self) -> dict[str, Any]:
        """Return what `calib evaluate --iso9283 --json` prints as `"iso9283"`."""
        return {
            "AP": self.corrected,
            "RP": self.repeatability,
            "as_delivered": {"AP": self.delivered, "RP": self.repeatability},
            "as_corrected": {"AP": self.corrected, "RP": self.repeatability},
            "poses": len(self.poses),
            "cycles": min(pose.cycles for pose in self.poses),
            "each": [pose.to_json() for pose in self.poses],
            "unit": self.unit,
            "notes": list(self.notes),
        }


def iso9283(model: Model, samples: Samples) -> Iso9283:
    """Return pose accuracy and repeatability of the poses that a log went to again.

    Readings of one visit count once, by their mean.
    Raises LogError if the arm went to no pose twice.
    """
    q = model.about.joints_of(samples)
    visits = visits_of(q)
    joints = _means(visits.visit, q[visits.rows])
    attained = _means(visits.visit, samples.x[visits.rows])
    first = np.unique(visits.visit, return_index=True)[1]
    pose = visits.pose[first]
    corrected = model.forward(joints) if len(joints) else joints
    delivered = _delivered(model, joints) if len(joints) else None
    tests = []
    for number in np.unique(pose):
        members = pose == number
        if members.sum() < 2:
            continue
        barycentre = attained[members].mean(axis=0)
        distance = np.linalg.norm(attained[members] - barycentre, axis=1)
        by_drawing = (
            None
            if delivered is None
            else _apart(delivered[members], barycentre)
        )
        test = PoseTest(
            joints=joints[members].mean(axis=0),
            cycles=int(members.sum()),
            repeatability=float(distance.mean() + 3.0 * distance.std(ddof=1)),
            delivered=by_drawing,
            corrected=_apart(corrected[members], barycentre),
        )
        tests.append(test)
    if not tests:
        raise LogError(
            "the log went to no pose twice: ISO 9283 needs poses that were attained repeatedly",
            hint=f"go to {POSES} poses {CYCLES} times each, in turn",
        )
    return Iso9283(tuple(tests), samples.unit)


def _apart(commanded: Array, barycentre: Array) -> float:
    return float(np.linalg.norm(commanded.mean(axis=0) - barycentre))


def _means(group: Index, values: Array) -> Array:
    """Return the mean (groups, k) of each group's rows (n, k)."""
    counts = np.bincount(group)
    sums = [np.bincount(group, column) for column in values.T]
    return np.asarray(np.stack(sums, axis=1) / counts[:, None])


def _delivered(model: Model, joints: Array) -> Array | None:
    """Return where the drawing says that joints lead, in the sensor's frame; None without one."""
    if not model.about.urdf:
        return None
    try:
        return nominal_positions(model, joints)
    except CalibError:
        return None
