"""References that the tests compare with: Pinocchio itself, on the URDF's own text."""

import numpy as np
import pinocchio as pin

from calib.arm.arm import Arm


def pinocchio_forward(arm: Arm, q: np.ndarray) -> np.ndarray:
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


def random_joints(arm: Arm, n: int, seed: int = 0) -> np.ndarray:
    """Joint values drawn uniformly from the arm's range: (n, dof)."""
    return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (n, arm.dof))
