"""ISO 9283: pose accuracy and repeatability of positions, from a log that went to poses again.

A pose is attained n times at x_j, about its barycentre b.  Commanded was c::

    AP = |b - c|,    l_j = |x_j - b|,    RP = mean(l) + 3 sd(l)

A controller that trusts the drawing commands joints by the drawing's kinematics (as
delivered); one that corrects its joints, by the model's (as corrected).
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from ..common.rows import finite_rows, group_means, row_lengths
from ..errors import CalibError, LogError
from ..model.model import Model
from ..samples.motion import visits_of
from ..samples.samples import Samples
from .nominal_target import NominalTarget

POSES = 5
"""Poses that the standard requires."""

CYCLES = 30
"""How often the standard requires to go to each."""


@dataclass(frozen=True)
class PoseTest:
    """One pose that was attained again and again."""

    joints: Array  # (dof,) [rad or m], mean of its visits
    cycles: int  # visits
    RP: float  # repeatability [unit]
    # AP by the drawing [unit]; None where the model knows none
    as_delivered: float | None
    as_corrected: float  # AP by the model [unit]


@dataclass(frozen=True)
class Iso9283:
    """A test's poses; the figures of the whole are those of the worst pose.

    Poses that were attained once have no repeatability and are left out.
    """

    poses: tuple[PoseTest, ...]
    unit: str
    repeatability: float  # RP [unit]
    # AP [unit] by the model, and by the drawing; None where there is no drawing
    corrected: float
    delivered: float | None
    cycles: int  # visits of the pose with the fewest
    notes: tuple[str, ...]  # where the test falls short of the standard

    def to_json(self) -> dict[str, object]:
        """Return what `calib evaluate --iso9283 --json` prints as `"iso9283"`."""
        return {
            "AP": self.corrected,
            "RP": self.repeatability,
            "as_delivered": {"AP": self.delivered, "RP": self.repeatability},
            "as_corrected": {"AP": self.corrected, "RP": self.repeatability},
            "poses": len(self.poses),
            "cycles": self.cycles,
            "each": self.poses,
            "unit": self.unit,
            "notes": self.notes,
        }


def iso9283(model: Model, samples: Samples) -> Iso9283:
    """Return pose accuracy and repeatability of the poses that a log went to again.

    Readings of one visit count once, by their mean.
    Raises LogError if the arm went to no pose twice.
    """
    tests, repeated = _pose_tests(model, samples)
    if not tests:
        raise LogError(
            "the log went to no pose twice that the model has learned: ISO 9283 needs poses that "
            "were attained repeatedly",
            hint=f"go to {POSES} poses {CYCLES} times each, in turn",
        )
    by_drawing = [t.as_delivered for t in tests if t.as_delivered is not None]
    return Iso9283(
        tuple(tests),
        samples.unit,
        repeatability=max(test.RP for test in tests),
        corrected=max(test.as_corrected for test in tests),
        delivered=max(by_drawing, default=None),
        cycles=min(test.cycles for test in tests),
        notes=tuple(_shortfalls(tests, repeated)),
    )


def _pose_tests(model: Model, samples: Samples) -> tuple[list[PoseTest], int]:
    """Tests of the poses that the model has learned, of those that the log went to again.

    Returns these, and how many poses the log went to again.
    """
    q = model.about.joints_of(samples)
    visits = visits_of(q)
    joints = group_means(visits.visit, q[visits.rows])
    attained = group_means(visits.visit, samples.x[visits.rows])
    first = np.unique(visits.visit, return_index=True)[1]
    # of each visit its pose, of each pose its visits
    _, pose, counts = np.unique(
        visits.pose[first], return_inverse=True, return_counts=True
    )
    corrected = model.forward(joints)
    answered = finite_rows(corrected)
    delivered = None
    if model.about.urdf:
        with suppress(CalibError):
            delivered = NominalTarget.of(model).target(joints)
    repeated = np.flatnonzero(counts > 1)
    tests = []
    for k in repeated:
        members = pose == k
        if not answered[members].all():
            continue
        barycentre = attained[members].mean(axis=0)
        distance = row_lengths(attained[members] - barycentre)
        as_delivered = None
        if delivered is not None:
            as_delivered = _distance(delivered[members], barycentre)
        test = PoseTest(
            joints=joints[members].mean(axis=0),
            cycles=int(counts[k]),
            RP=float(distance.mean() + 3.0 * distance.std(ddof=1)),
            as_delivered=as_delivered,
            as_corrected=_distance(corrected[members], barycentre),
        )
        tests.append(test)
    return tests, len(repeated)


def _shortfalls(tests: list[PoseTest], repeated: int) -> list[str]:
    """Where a test falls short of the standard, given its number of repeated poses."""
    cycles = min(test.cycles for test in tests)
    notes = []
    if len(tests) < repeated:
        notes.append(
            f"{repeated - len(tests)} of {repeated} poses are outside of what the "
            "model has learned and left out"
        )
    if len(tests) < POSES or cycles < CYCLES:
        notes.append(
            f"ISO 9283 asks for {POSES} poses with {CYCLES} cycles each: the log has "
            f"{len(tests)} with {cycles} or more"
        )
    if tests[0].as_delivered is None:
        notes.append(
            "the model knows no URDF: there is no accuracy as delivered"
        )
    return notes


def _distance(commanded: Array, barycentre: Array) -> float:
    """Distance [unit] of the middle of commanded positions (n, m) from where they led."""
    return float(np.linalg.norm(commanded.mean(axis=0) - barycentre))
