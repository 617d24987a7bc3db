"""References that the tests compare with: Pinocchio itself, on the URDF's own text."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import polars as pl
import pytest

ROBOTS = Path(pin.__file__).parents[4] / "share/example-robot-data/robots"
"""Descriptions of real robots, where their package is installed."""
needs_robots = pytest.mark.skipif(not ROBOTS.is_dir(), reason="pip install example-robot-data")


def pinocchio_pose(arm, q: np.ndarray):
    """Positions (n, 3), rotations (n, 3, 3) and Jacobians (n, 6, dof), one row at a time."""
    model = pin.buildModelFromXML(arm.urdf)
    data, frame = model.createData(), model.getFrameId(arm.tip, pin.FrameType.BODY)
    assert frame < model.nframes
    columns = [model.joints[model.getJointId(name)].idx_v for name in arm.joint_names]
    places, turns, slopes = [], [], []
    for row in q:
        values = np.zeros(model.nv)
        for name, value in arm.locked.items():
            assert model.existJointName(name)
            values[model.joints[model.getJointId(name)].idx_v] = value
        values[columns] = row
        full = pin.integrate(model, pin.neutral(model), values)
        pin.framesForwardKinematics(model, data, full)
        pin.computeJointJacobians(model, data, full)
        whole = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        places.append(data.oMf[frame].translation.copy())
        turns.append(data.oMf[frame].rotation.copy())
        slopes.append(whole[:, columns])
    return np.array(places), np.array(turns), np.array(slopes)


def pinocchio_forward(arm, q: np.ndarray) -> np.ndarray:
    """Tip positions as the arm tells them: (n, dof) -> (n, 2 or 3)."""
    places = pinocchio_pose(arm, q)[0]
    return arm.plane.project(places) if arm.outputs == 2 else places


def random_joints(arm, n: int, seed: int = 0) -> np.ndarray:
    """Joint values drawn uniformly from the arm's range: (n, dof)."""
    return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (n, arm.dof))


def table(path, names, rows):
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.12g")
    return path


def write_columns(path, columns, about=None):
    """Write columns by name, below what holds for all rows."""
    head = f"# calib {json.dumps(about)}\n" if about else ""
    Path(path).write_text(head + pl.DataFrame(columns).fill_nan(None).write_csv(null_value="nan"))


def read(text):
    rows = list(csv.DictReader(io.StringIO(text)))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
