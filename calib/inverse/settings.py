"""Settings of the search for joints: the same numbers for NumPy and for the compiled C.

Lengths of joints are shares of their ranges, lengths of what is reached are shares of the extent
of the workspace, or of the arm's length for poses.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """When a step, a solution and a branch count; measured by ``benchmarks/inverse.py``."""

    # Steps.
    longest: float = 0.25  # of a step: longer ones leave the branch of their start
    pulled: float = 1e-4  # slides of redundant joints that are shorter end the slide
    # Solutions.
    close: float = (
        1e-9  # residual of a solution: a hundredth of the least noise of any sensor
    )
    same: float = 1e-5  # solutions that are closer are one
    # Branches.
    folded: float = (
        0.1  # least singular value, of the Jacobian's squares, beside a fold
    )
    beyond: float = 0.3  # the far side of a fold is looked for so far away
    beside: float = (
        0.005  # an answer so near to what was asked is on the nearest branch
    )
    surely: float = 0.3  # the same, of redundant joints and of poses
    margin: float = (
        0.1  # a start may be so much further away than the answer it leads to
    )
    tries: int = 48  # starts of a position, those beside known solutions not counted
    spare_tries: int = (
        30  # the same, of redundant joints: a third of them once there is an answer
    )
    # redundant joints start where this times the squared gap of the position, and the squared
    # distance from the joints asked for, are least: of 1 to 16 the quickest, answers are as near
    pull: int = 16
    # Poses: the branches of a UR5 at 140 poses are all found with half as many runs.
    postures: int = (
        4096  # of the table of starts: nearest postures are some .4 rad away
    )
    scanned: int = 600  # postures nearest to a pose that are looked at
    runs: int = 24  # runs without a new branch that end the search
    apart: float = 0.12  # postures closer to a solution than this lead to it


SEARCH = SearchSettings()


@dataclass(frozen=True)
class StepSettings:
    """How NumPy steps: lengths are shares of the joints' ranges."""

    rounding: float = 1e-15  # of the extent: a target is met as well as numbers allow
    most: int = 40  # steps
    chunk: int = 4096  # rows at once: what belongs to them fits into the cache
    # Damping, as a share of the Jacobian's power.
    first_damping: float = 1e-9  # nearly Gauss-Newton: a start is close to its answer
    least_damping: float = 1e-12
    damping_after_failure: float = 1e-6  # at least
    most_damping: float = 1e3  # ends a search
    easier: float = 30.0  # factor on the damping after a step
    calm: float = 1e-3  # of a single step of a servo
    slow: float = 1e-9  # of the residual: a step that gains less is the last
    # Slides of redundant joints along their self-motion.
    slides: int = 25
    settled: float = 1e-6  # a slide that is shorter is the last
    slack: float = 2e-6  # a slide that has come so close to a limit is there
    # Nearest points out of reach.
    probe: float = 1e-4  # step of second derivatives
    far: float = 0.2  # longest step
    still: float = 1e-10  # a step that is shorter is the last
    least_share: float = 1e-6  # of a step
    flat: float = 1e-6  # of the largest curvature, which every direction has at least


STEPS = StepSettings()
