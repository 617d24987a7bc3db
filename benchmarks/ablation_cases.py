"""Cases of the ablation: what an arm may be that its smooth model is not.

Each is a log of two joints with an independent truth, or a real log whose blocks are held
out in turn.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm.arm import PlanarArm
from calib.arm.loading import load_arm
from calib.common.arrays import Array
from calib.samples.logs import read_log
from calib.samples.samples import Samples

_Truth = Callable[[Array], Array]
_Defect = tuple[_Truth, Callable[[Array], NDArray[np.bool_]]]
"""Positions (n, 2) of joints (n, 2), and which of these lie in the defect."""

_ROBOT = "two_link_full"
"""Its elbow bends both ways, so that most targets have two branches."""

_NOISE = 2e-4
"""Standard deviation per axis of the cases with a defect [m]."""

_BUMP = np.radians([45.0, 80.0])  # middle of the bump in both joints
_WIDTH = np.radians(1.5)  # its standard deviation
_HEIGHT = 3e-3  # [m]
_WINDOW = np.radians([60.0, 75.0])  # of the elbow, where its gear ripples
_RIPPLE = np.radians(1.0)
_CYCLES = 72  # a turn
_DWELL = 0.7  # share of the rows of an uneven log that lie in a corner
_CORNER = 0.15  # of each joint's range
_STREAM = 91  # of the points on which errors are measured


@dataclass(frozen=True, eq=False)
class Case:
    """A log and what is true of it."""

    name: str
    samples: Samples  # what is learned from
    # (n, dof), (n, 2), joints and positions that were not learned
    q: Array
    x: Array
    defect: NDArray[np.bool_]  # (n,), which of them lie in a defect
    arm: PlanarArm | None  # the arm whose branches are counted, None where the truth is not known


def bump(arm: PlanarArm, height: float = _HEIGHT, width: float = _WIDTH) -> _Defect:
    """The arm with a bump [m] that depends on both joints, `width` [rad] wide; and where it is."""

    def away(q: Array) -> Array:
        return np.asarray(np.linalg.norm((q - _BUMP) / width, axis=1))

    def truth(q: Array) -> Array:
        high = height * np.exp(-0.5 * away(q) ** 2)
        return np.asarray(arm.forward(q) + high[:, None] * np.array([0.8, -0.6]))

    return truth, lambda q: away(q) < 2.0


def ripple(arm: PlanarArm, amplitude: float = _RIPPLE, window: Array = _WINDOW) -> _Defect:
    """The arm whose elbow is off [rad], 72 cycles a turn, within a window [rad]; and where."""
    low, high = window

    def inside(q: Array) -> NDArray[np.bool_]:
        return np.asarray((q[:, 1] > low) & (q[:, 1] < high))

    def truth(q: Array) -> Array:
        moved = q.copy()
        moved[:, 1] += np.where(inside(q), amplitude * np.sin(_CYCLES * (q[:, 1] - low)), 0.0)
        return arm.forward(moved)

    return truth, inside


_SHAPES: dict[str, Callable[..., _Defect]] = {"bump": bump, "ripple": ripple}


def simulated(
    name: str,
    n: int,
    tested: int,
    seed: int,
    defect: Callable[[PlanarArm], _Defect] | None = None,
    noise: float | None = None,
) -> Case:
    """One of the simulated cases.

    name : {"exact", "noise", "bump", "ripple", "uneven"}, an exact sensor, one with a noise of 1
        mm, the two defects with 0.2 mm, and a log that dwells in a corner of the joints' range
    n, tested : rows to learn from and to test on
    defect : another shape than :func:`bump` and :func:`ripple`
    noise : another standard deviation per axis [m]
    """
    defect = defect or _SHAPES.get(name)
    arm = load_arm(_ROBOT if defect is None else "two_link")
    assert isinstance(arm, PlanarArm)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    span = arm.upper - arm.lower
    q = arm.lower + span * rng.random((n, 2))
    if name == "uneven":
        stays = rng.random(n) < _DWELL
        q[stays] = arm.lower + span * (0.1 + _CORNER * rng.random((np.count_nonzero(stays), 2)))
    fresh = arm.lower + span * rng.random((tested, 2))
    truth: _Truth = arm.forward
    wrong = np.zeros(tested, dtype=bool)
    if defect is not None:
        truth, inside = defect(arm)
        wrong = inside(fresh)
    if noise is None:
        noise = {"exact": 0.0, "noise": 1e-3}.get(name, _NOISE)
    x = truth(q) + noise * rng.standard_normal((n, 2))
    samples = Samples(
        q, x, arm.joint_names, arm.lower, arm.upper, arm.revolute, arm=arm, plane=arm.plane
    )
    return Case(name, samples, fresh, truth(fresh), wrong, arm if defect is None else None)


def measured(path: Path, name: str, joints: tuple[str, ...], block: int, blocks: int) -> Case:
    """A real log without one contiguous block of its rows, which is tested on."""
    samples = read_log(path, joints=list(joints))
    held = np.array_split(np.arange(len(samples)), blocks)[block]
    kept = np.setdiff1d(np.arange(len(samples)), held)
    some = replace(samples, q=samples.q[kept], x=samples.x[kept])
    q, x = samples.q[held], samples.x[held]
    return Case(name, some, q, x, np.zeros(len(q), dtype=bool), None)
