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
    close: float = 1e-9  # residual of a solution: a hundredth of the least noise of any sensor
    same: float = 1e-5  # solutions that are closer are one
    # Branches.
    folded: float = 0.1  # least singular value, of the Jacobian's squares, beside a fold
    beyond: float = 0.3  # the far side of a fold is looked for so far away
    beside: float = 0.005  # an answer so near to what was asked is on the nearest branch
    surely: float = 0.3  # the same, of redundant joints and of poses
    margin: float = 0.1  # a start may be so much further away than the answer it leads to
    tries: int = 48  # starts of a position, those beside known solutions not counted
    spare_tries: int = 30  # the same, of redundant joints: a third of them once there is an answer
    # redundant joints start where this times the squared gap of the position, and the squared
    # distance from the joints asked for, are least: of 1 to 16 the quickest, answers are as near
    pull: int = 16
    # Poses: the branches of a UR5 at 140 poses are all found with half as many runs.
    postures: int = 4096  # of the table of starts: nearest postures are some .4 rad away
    scanned: int = 600  # postures nearest to a pose that are looked at
    runs: int = 24  # runs without a new branch that end the search
    apart: float = 0.12  # postures closer to a solution than this lead to it


SEARCH = SearchSettings()
