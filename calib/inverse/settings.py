"""Settings of the search for joints: the same numbers for NumPy and for the compiled C.

Lengths of joints are shares of their ranges, residuals shares of the task's size: the extent of the
workspace, or the arm's length for poses.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SolverSettings:
    """When a step, a solution and a branch count; measured by ``benchmarks/inverse.py``."""

    # Steps.
    steps: int = 40  # of a start, at most
    # of a step: longer ones leave the branch of their start
    longest: float = 0.25
    slow: float = 1e-9  # of the residual: a step that gains less is the last
    # Damping, as a share of the Jacobian's power.
    easy: float = 1e-9  # nearly Gauss-Newton: a start is close to its answer
    easiest: float = 1e-12
    hard: float = 1e-6  # at least, after a step that failed
    hardest: float = 1e3  # ends a search
    easier: float = 30.0  # factor on the damping after a step
    # Slides of redundant joints along their self-motion.
    rough: float = 3e-2  # residual from which on joints slide
    slides: int = 80
    settled: float = 3e-5  # of the way that is left: joints have settled
    stuck: float = 1e-6  # share of the way that a slide goes at least
    # a joint so close to its limit does not slide towards it
    slack: float = 2e-5
    # Solutions.
    # residual of a solution, a hundredth of any sensor's noise
    close: float = 1e-9
    same: float = 1e-5  # solutions that are closer are one
    # of that residual: where a step will leave less, compiled C does not look again
    surplus: float = 0.1
    # Branches.
    # least singular value beside a fold, of the Jacobian's squares
    fold: float = 0.1
    twin_reach: float = 0.3  # the far side of a fold is looked for so far away
    probe: float = 1e-4  # step of the derivative of a singular value
    # an answer this near to the joints of `near` is the nearest
    near_enough: float = 0.005
    near_enough_spare: float = 0.3  # so near, of redundant joints and of poses
    margin: float = 0.1  # a start may be this much further away than its answer
    drawn: int = 32  # starts all over the ranges where others have failed
    # draws so far beyond a limit are put on it: of poses with joints at three limits and more one
    # of 6 lost a solution where all were drawn between the limits, now one of 150
    overhang: float = 0.2
    tries: int = 48  # starts of a position
    # steps of a search by compiled C from joints and what is near: at most a millisecond
    budget: int = 2000
    bent_steps: int = 4  # that a step of joints that bend counts as
    # steps of a search for redundant joints, which take longer
    spare_budget: int = 1600
    # of the workspace's extent: what redundant joints miss by less may be reached by
    # others, as the edge is where steps are slow
    edge: float = 2e-3
    # of the workspace's extent: a larger expected error does not make a target reachable
    sure: float = 1e-2
    # of redundant joints: a third once there is an answer
    spare_tries: int = 60
    # redundant joints start where this times the squared residual of the position, and the
    # squared distance from the joints of `near`, are least: of 1 to 16 the quickest
    pull: int = 16
    # Poses: a UR5's branches are nearly all reached with a third as many runs.
    # drawn postures: the nearest to a pose is some .4 rad away; of half as many, and 24 runs, 34
    # solutions of 2,100 were missed instead of 24
    postures: int = 8192
    nearest: int = 192  # postures that a pose starts from
    runs: int = 36  # runs without a new branch that end the search
    # postures closer to a solution than this lead to it
    start_spacing: float = 0.12


SOLVER = SolverSettings()
