"""References that the tests compare with: Pinocchio itself, on the URDF's own text."""

import csv
import io
from pathlib import Path

import numpy as np
import pinocchio as pin

import calib


def pinocchio_forward(arm, q: np.ndarray) -> np.ndarray:
    """Tip positions by `framesForwardKinematics`, one sample at a time: (n, dof) -> (n, 2 or 3)."""
    model = pin.buildModelFromXML(arm.urdf)
    data = model.createData()
    frame = model.getFrameId(arm.tip, pin.FrameType.BODY)
    assert frame < model.nframes
    out = np.empty((len(q), 3))
    for row, values in enumerate(q):
        velocity = np.zeros(model.nv)
        held = {**arm.locked, **dict(zip(arm.joint_names, values, strict=True))}
        for name, value in held.items():
            assert model.existJointName(name)
            velocity[model.joints[model.getJointId(name)].idx_v] = value
        pin.framesForwardKinematics(model, data, pin.integrate(model, pin.neutral(model), velocity))
        out[row] = data.oMf[frame].translation
    return arm.plane.project(out) if arm.outputs == 2 else out


def random_joints(arm, n: int, seed: int = 0) -> np.ndarray:
    """Joint values drawn uniformly from the arm's range: (n, dof)."""
    return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (n, arm.dof))


OFFSETS = {"spatial_three": np.radians([0.0, 2.0, -3.0]), "six_axis": np.zeros(6)}


class Truth:
    """An arm as Pinocchio moves it, with offsets that its log does not know."""

    def __init__(self, robot: str, seed: int) -> None:
        self.arm = calib.load_arm(robot)
        self.model = pin.buildModelFromUrdf(
            str(Path(calib.__file__).parents[1] / f"robots/{robot}.urdf")
        )
        self.data, self.frame = self.model.createData(), self.model.getFrameId(self.arm.tip)
        self.index = [self.model.idx_qs[self.model.getJointId(n)] for n in self.arm.joint_names]
        self.offset, self.rng = OFFSETS[robot], np.random.default_rng(seed)

    def pose(self, q):
        places, turns = [], []
        for row in np.atleast_2d(q):
            full = pin.neutral(self.model)
            full[self.index] = row + self.offset
            pin.framesForwardKinematics(self.model, self.data, full)
            places.append(self.data.oMf[self.frame].translation.copy())
            turns.append(self.data.oMf[self.frame].rotation.copy())
        return np.array(places), np.array(turns)

    def draw(self, n):
        return self.rng.uniform(self.arm.lower, self.arm.upper, (n, self.arm.dof))


def table(path, names, rows):
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.12g")
    return path


def read(text):
    rows = list(csv.DictReader(io.StringIO(text)))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
