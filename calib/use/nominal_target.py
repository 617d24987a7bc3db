"""Nominal target: where the nominal arm's tip would be, to which a correction brings the real one.

The nominal arm is the one that the URDF describes.  `NominalTarget.target` and `pose` are where its
tip is at some joint values; `solve` finds joint values at which the real arm's tip is there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..body.planar import PlanarStructure
from ..body.structure import Structure
from ..body.views import is_camera
from ..common.arrays import Array, Mask, frozen
from ..common.scale import TURN
from ..inverse.task import Poses
from ..model.alignment import Alignment
from ..model.answers import joints_and_reach, near_in_box
from ..model.model import Model
from ..model.nominal import (
    assumption,
    frame_moves,
    has_free_frame,
    is_simulated,
    moves_in_space,
    nominal_arm,
    nominal_in_plane,
    nominal_parameters,
    nominal_structure,
)
from ..model.parts import remembered
from ..model.reach import Reach
from ..model.space import REACHED, Space, measured_chain
from ..model.turns import joint_limits, within_limits
from ..samples.joint_values import wrap
from .geometry_fit import fit_geometry
from .settings import CORRECTION

_POSITIONS = (
    "positions alone are corrected; the tool's orientation follows from the smallest change of the "
    "joints"
)


@dataclass(frozen=True, eq=False)
class NominalTarget:
    """The nominal arm, as the sensor would see it, and the model of the real one."""

    model: Model
    frame_is_free: bool  # whether the sensor's frame was fitted
    # nominal positions (n, m) [unit] of joint values (n, dof), before the frame moved
    predict: Callable[[Array], Array]
    moves: tuple[Alignment, ...] = ()  # of the frame, in their order
    # whether the user wants the tool's orientation kept
    keeps_orientation: bool = True
    # where the reading alone is not enough: for the tool's pose of an arm with six joints, or the
    # tip's place before a camera, whose pixel does not determine how far away the tip is
    space: Space | None = None

    @classmethod
    def of(cls, model: Model) -> NominalTarget:
        """Return that of a model, which keeps it, since a controller corrects row by row."""
        return remembered(
            model, "nominal target", lambda: _find_nominal_target(model)
        )

    @property
    def keeps_pose(self) -> bool:
        """Whether the tool's orientation is kept."""
        if self.space is None or not self.keeps_orientation:
            return False
        return len(self.model.about.lower) >= CORRECTION.posed

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what was assumed."""
        notes: list[str] = []
        if self.frame_is_free:
            notes.append(assumption(self.model))
        if moves_in_space(self.model) and not self.keeps_pose:
            notes.append(_POSITIONS)
        return tuple(notes)

    def target(self, q: Array) -> Array:
        """Positions (n, m) [unit] of joint values (n, dof) on any turn."""
        x = self.predict(self._in_range(q))
        for alignment in self.moves:
            x = alignment.apply(x)
        return x

    def pose(self, q: Array) -> tuple[Array, Array]:
        """Position (n, 3) [m] and orientation (n, 3, 3) of the nominal tool in the base frame."""
        assert self.space is not None  # noqa: S101
        structure = self.space.structure
        nominal = nominal_parameters(structure, self.space.body.beta)
        position, rotation = structure.pose(q, nominal)
        return position, rotation

    def solve(self, q: Array) -> tuple[Array, Mask]:
        """Joints (n, dof), on the same turn as `q`, and whether they reach the target, (n,).

        With six joints or more a row is reached only where its orientation is, too, so that the
        tool is not tilted beside a singularity.  A joint within its limits does not leave them.
        """
        start, placed = self._placed_start(q)
        nearest, reachable = self._solve_reading(self.target(q), start)
        turns = TURN * np.round((q - nearest) / TURN)
        answers = nearest + np.where(self.model.about.revolute, turns, 0.0)
        was_beyond = ~within_limits(self.model, q)
        within = within_limits(self.model, answers) | was_beyond
        lower, upper = joint_limits(self.model).T
        allowed = np.where(within, answers, np.clip(answers, lower, upper))
        return allowed, reachable & placed & within.all(axis=1)

    def _placed_start(self, q: Array) -> tuple[Array, Mask]:
        """Joints (n, dof) in range that have the target's place or pose in `space`, and whether.

        Where the reading alone counts they are `q` in range.
        """
        start = self._in_range(q)
        placed = np.ones(len(start), bool)
        if self.space is not None:
            position, rotation = self.pose(start)
            reach = Reach.of(self.space, posed=self.keeps_pose)
            goal = position
            if self.keeps_pose:
                goal = Poses.target(position, rotation)
            start, distance = reach.lead(goal, start)
            placed = distance <= REACHED * self.space.length
        about = self.model.about
        return np.clip(start, about.lower, about.upper), placed

    def _solve_reading(self, target: Array, start: Array) -> tuple[Array, Mask]:
        """Joints (n, dof) near `start` at which the sensor reads `target`, and whether it does."""
        if self.model.default_readout == "local":
            near = near_in_box(self.model, start, len(start))
            return joints_and_reach(self.model, target, near)
        answer = self.model.solve(target, start)
        return answer.q, answer.reachable

    def _in_range(self, q: Array) -> Array:
        """Joint values (n, dof) with those that turn moved by whole turns into their range."""
        about = self.model.about
        near = q.copy()
        for k in np.flatnonzero(about.revolute):
            near[:, k] = wrap(
                q[:, k], float(about.lower[k]), float(about.upper[k])
            )
        return near


def _find_nominal_target(model: Model) -> NominalTarget:
    """Find the nominal arm behind the sensor that the model knows best."""
    body = model.body
    is_free = has_free_frame(model)
    moves = tuple(frame_moves(model))
    space = None
    structure: Structure
    if body is not None and isinstance(body.structure, PlanarStructure):
        structure, beta = nominal_in_plane(model, in_root_frame=not is_free)
        if is_free:  # the body knows the frame as it is after all adaptations
            moves = ()
    elif is_simulated(model) or not moves_in_space(model):
        # in its base frame, moved to a planar log's frame by a fit to the model's maps
        if is_free and not moves_in_space(model):
            to_sensor = fit_geometry(model).frame
            if to_sensor is not None:
                moves = (to_sensor, *moves)
        return NominalTarget(model, is_free, nominal_arm(model).forward, moves)
    elif body is not None and measured_chain(body) is not None:
        structure, beta = nominal_structure(model)
        moves = ()
        if structure.dof >= CORRECTION.posed or is_camera(structure.view):
            space = Space.of(model)
    else:  # by a fit to the model's answers
        geometry = fit_geometry(model)
        structure = geometry.structure
        beta = nominal_parameters(structure, geometry.beta)
    predict = partial(structure.predict, beta=frozen(beta))
    return NominalTarget(model, is_free, predict, moves, space=space)
