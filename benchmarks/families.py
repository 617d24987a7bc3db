"""Families of joints that reach a position, against dense random solves by Pinocchio.

    python benchmarks/families.py URDF [--joints a,b,..] [--tip FRAME] [--targets N]

An arm of more joints than coordinates reaches a position on connected families of joints, and
`inverse_all` names one of each.  The truth is made by other means: random starts solved by
Pinocchio one by one, and small steps along the self-motion from one solution to its neighbours.
Families of less than 2 % of the solutions are not counted: random starts overlook them, too.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import calib

Array = NDArray[np.float64]

SOLVES = 400  # random starts of a target
STEP = 0.02  # of the joints' range, along a self-motion
NEAREST = 12  # neighbours that are walked to


class Chain:
    """An arm by Pinocchio: positions of its tip, and steps that keep them."""

    def __init__(self, arm: Any) -> None:
        whole = pin.buildModelFromXML(arm.urdf)
        locked = [k for k, name in enumerate(whole.names) if k and name not in arm.joint_names]
        self.model = whole
        if locked:
            self.model = pin.buildReducedModel(whole, locked, pin.neutral(whole))
        self.data, self.lower, self.upper = self.model.createData(), arm.lower, arm.upper
        self.span = arm.upper - arm.lower
        # ends of a full turn are the same place
        self.round = np.array(arm.revolute) & (np.abs(self.span - 2 * np.pi) < 1e-9)
        self.tip = self.model.getFrameId(arm.tip, pin.FrameType.BODY)

    def apart(self, u: Array, v: Array) -> Array:
        """The way from v to u, the short one round where joints go round."""
        return np.asarray(u - v - np.where(self.round, np.round(u - v), 0.0))

    def inside(self, u: Array) -> Array:
        """Joints within their limits."""
        return np.where(self.round, u % 1.0, np.clip(u, 0.0, 1.0))

    def place(self, u: Array) -> tuple[Array, Array]:
        """Position (3,) and its derivative (3, dof) at joints of the unit box."""
        local = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        q = self.lower + u * self.span
        jacobian = pin.computeFrameJacobian(self.model, self.data, q, self.tip, local)[:3]
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.tip].translation.copy(), jacobian * self.span

    def solved(self, u: Array, x: Array, steps: int = 40) -> Array | None:
        """Joints on the target from a start, within the limits; None where it is not met."""
        for _ in range(steps):
            place, slope = self.place(u)
            gap = x - place
            if gap @ gap < 1e-20:
                return u
            push = slope.T @ gap
            stuck = (((u <= 0) & (push < 0)) | ((u >= 1) & (push > 0))) & ~self.round
            slope = np.where(stuck, 0.0, slope)
            move = slope.T @ np.linalg.solve(slope @ slope.T + 1e-9 * np.eye(3), gap)
            u = self.inside(u + move * min(1.0, 0.2 / max(np.abs(move).max(), 1e-12)))
        return None

    def walks(self, u: Array, goal: Array, x: Array) -> bool:
        """Whether small steps on the target lead from joints to others."""
        for _ in range(200):
            wish = self.apart(goal, u)
            if np.linalg.norm(wish) < 0.5 * STEP:
                return True
            held = np.zeros(len(u), dtype=bool)
            for _ in u:  # joints at a limit stay, one after another
                slope = np.where(held, 0.0, self.place(u)[1])
                along = np.where(held, 0.0, wish)
                move = along - slope.T @ np.linalg.solve(
                    slope @ slope.T + 1e-12 * np.eye(3), slope @ along
                )
                out = ((u <= 1e-7) & (move < 0)) | ((u >= 1 - 1e-7) & (move > 0))
                out &= ~self.round
                if not (out & ~held).any():
                    break
                held |= out
            length = np.linalg.norm(move)
            trial = self.solved(self.inside(u + move * min(1.0, STEP / max(length, 1e-12))), x)
            if trial is None or np.linalg.norm(self.apart(trial, u)) > 2 * STEP:
                return False
            if np.linalg.norm(self.apart(goal, trial)) >= np.linalg.norm(wish) - 1e-6:
                return False
            u = trial
        return False


def families(chain: Chain, x: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.intp]]:
    """Solutions (n, dof) of a target in the unit box, and the family (n,) of each."""
    solved = [chain.solved(u, x) for u in rng.random((SOLVES, len(chain.lower)))]
    rows = np.array([u for u in solved if u is not None])
    label = np.arange(len(rows))
    for k in range(len(rows)):
        for other in np.argsort(np.linalg.norm(chain.apart(rows, rows[k]), axis=1))[
            1 : NEAREST + 1
        ]:
            if label[k] != label[other] and chain.walks(rows[k], rows[other], x):
                label[label == label[other]] = label[k]
    return rows, label


def main() -> None:
    """Count the families that are found, named twice, overlooked and invented."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot")
    parser.add_argument("--joints", type=lambda text: text.split(","))
    parser.add_argument("--tip")
    parser.add_argument("--targets", type=int, default=5)
    options = parser.parse_args()
    arm = calib.load_arm(options.robot, joints=options.joints, tip=options.tip)
    model, chain = calib.train(calib.babble(arm, 2000, seed=0), size=15), Chain(arm)
    rng = np.random.default_rng(1)
    targets = arm.forward(rng.uniform(arm.lower, arm.upper, (options.targets, arm.dof)))
    total = found_all = 0
    for x, answers in zip(targets, model.inverse_all(targets), strict=True):
        rows, label = families(chain, x, rng)
        names, counts = np.unique(label, return_counts=True)
        large = names[counts >= 0.02 * len(rows)]
        own = []
        for u in (answers - arm.lower) / chain.span:
            u = chain.solved(u, x)
            order = (
                np.argsort(np.linalg.norm(chain.apart(rows, u), axis=1))[:40]
                if u is not None
                else ()
            )
            own.append(next((label[k] for k in order if chain.walks(u, rows[k], x)), -1))
        hit = set(own) & set(large.tolist())
        total, found_all = total + len(large), found_all + len(hit)
        print(
            f"{len(large)} families of {len(rows)} solutions: {len(hit)} found, "
            f"{len(own) - len(set(own))} named twice, {own.count(-1)} not joined to any", flush=True
        )  # fmt: skip
    print(f"{options.robot}: {found_all} of {total} families")


if __name__ == "__main__":
    main()
