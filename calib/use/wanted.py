"""Where the nominal arm would be, which a correction brings the real one to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..body.planar import PlanarStructure
from ..common.arrays import Array, frozen
from ..common.scale import TURN
from ..inverse.task import Poses
from ..model.alignment import Alignment
from ..model.answers import anchor, joints_and_reach
from ..model.model import Model
from ..model.nominal import (
    moves_in_space,
    nominal_arm,
    nominal_behind,
    nominal_in_plane,
)
from ..model.reach import Reach
from ..model.space import REACHED, Space, measured_chain
from ..model.turns import joint_limits, within_limits
from ..samples.joint_values import wrap
from .frames import assumption, frame_is_free, frames, is_simulated
from .geometry_fit import fit_geometry
from .settings import CORRECTION

_POSITIONS = (
    "positions alone are corrected; the tool's orientation follows from the smallest change of the "
    "joints"
)


@dataclass(frozen=True, eq=False)
class Wanted:
    """Where the nominal arm would be, in the sensor's frame."""

    model: Model
    free: bool  # whether the sensor's frame was fitted
    predict: Callable[
        [Array], Array
    ]  # positions (n, m) of joint values (n, dof)
    moves: tuple[Alignment, ...] = ()  # of the frame, after `predict`
    # whether a tool's orientation is kept where the arm can
    keeps_turn: bool = True
    # where more than what the sensor reads has to be met: the tool's pose, or before a camera,
    # whose pixel does not say how far away the tip is, its place
    space: Space | None = None

    @classmethod
    def of(cls, model: Model) -> Wanted:
        """Find it, once for a model: a controller corrects row by row."""
        if "wanted" not in model.cache:
            model.cache["wanted"] = _wanted_of(model)
        wanted: Wanted = model.cache["wanted"]
        return wanted

    @property
    def posed(self) -> bool:
        """Whether the tool's orientation is kept."""
        if self.space is None or not self.keeps_turn:
            return False
        return len(self.model.about.lower) >= CORRECTION.posed

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed."""
        notes: list[str] = []
        if self.free:
            notes.append(assumption(self.model))
        if moves_in_space(self.model) and not self.posed:
            notes.append(_POSITIONS)
        return tuple(notes)

    def target(self, q: Array) -> Array:
        """Positions (n, m) [unit] of joint values (n, dof) on any turn."""
        x = self.predict(self._in_range(q))
        for alignment in self.moves:
            x = alignment.apply(x)
        return x

    def pose(self, q: Array) -> tuple[Array, Array]:
        """Place (n, 3) and orientation (n, 3, 3) of the nominal tool in the base frame."""
        assert self.space is not None  # noqa: S101
        structure = self.space.structure
        nominal = nominal_behind(structure, self.space.body.beta)
        place, turn = structure.pose(q, nominal)
        return place, turn

    def solve(self, q: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Joints (n, dof), on the turn that `q` is on, and whether they reach, (n,).

        Of six joints or more a row is reached where its orientation is, too: beside a singularity
        the tool is not tilted without a word.  A joint within its limits is not led beyond them.
        """
        model = self.model
        about = model.about
        near = self._in_range(q)
        target = self.target(q)
        placed = np.ones(len(near), dtype=bool)
        if self.space is not None:
            place, turn = self.pose(near)
            reach = Reach.of(self.space, posed=self.posed)
            goal = Poses.target(place, turn) if self.posed else place
            near, distance = reach.beside(goal, near)
            placed = distance <= REACHED * self.space.length
        near = np.clip(near, about.lower, about.upper)
        if model.default_readout == "local":
            start = anchor(model, near, len(near))
            nearest, reachable = joints_and_reach(model, target, start)
        else:
            answer = model.solve(target, near)
            nearest = answer.q
            reachable = answer.reachable
        turns = TURN * np.round((q - nearest) / TURN)
        answers = nearest + np.where(about.revolute, turns, 0.0)
        within = within_limits(model, answers) | ~within_limits(model, q)
        lower, upper = joint_limits(model).T
        allowed = np.where(within, answers, np.clip(answers, lower, upper))
        return allowed, reachable & placed & within.all(axis=1)

    def _in_range(self, q: Array) -> Array:
        """Joint values (n, dof) with those that turn moved by whole turns into their range."""
        about = self.model.about
        near = q.copy()
        for k in np.flatnonzero(about.revolute):
            near[:, k] = wrap(
                q[:, k], float(about.lower[k]), float(about.upper[k])
            )
        return near


def _wanted_of(model: Model) -> Wanted:
    free = frame_is_free(model)
    moves = tuple(frames(model))
    body = model.body
    if body is not None and isinstance(body.structure, PlanarStructure):
        structure, nominal = nominal_in_plane(model, based=not free)
        predict = partial(structure.predict, beta=frozen(nominal))
        if (
            free
        ):  # the body knows the sensor's frame as it is after all adaptations
            moves = ()
        return Wanted(model, free, predict, moves)
    in_space = moves_in_space(model)
    if not in_space or is_simulated(model):
        frame = None
        if free and not in_space:
            frame = fit_geometry(model).frame
        if frame is not None:
            moves = (frame, *moves)
        return Wanted(model, free, nominal_arm(model).forward, moves)
    chain = measured_chain(body)
    if body is not None and chain is not None:
        drawn = frozen(nominal_behind(chain, body.beta))
        predict = partial(chain.predict, beta=drawn)
        wanted = Wanted(model, free, predict)
        if chain.dof >= CORRECTION.posed or chain.camera:
            wanted = replace(wanted, space=Space.of(model))
        return wanted
    geometry = fit_geometry(model)
    nominal = frozen(nominal_behind(geometry.structure, geometry.beta))
    return Wanted(
        model, free, partial(geometry.structure.predict, beta=nominal), moves
    )
