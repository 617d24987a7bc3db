"""The flange by its joints: a drawn arm, whose zeros, origins and size the pictures correct."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arm.rigid import (
    adjoint,
    along_parent,
    inverse,
    rigid,
    shift_of,
    shifts_along_parents,
    turn_of,
)
from ..arm.rotations import logarithm
from ..body.covariance import root_of
from ..body.settings import DRAWN_SHIFT_SD, DRAWN_TURN_SD, FINER
from ..body.spatial import SpatialStructure
from ..body.structure import OfStructure
from ..common.arrays import Array, Index
from ..common.rows import row_lengths
from .bundle import CornerLayout, Motions
from .fit import CornerFit, Scale

FREE = ("placement", "offset")
"""Groups of the arm's parameters that the pictures correct."""

SIZE_SD = 2e-3
"""Drawn arms have the right size to .2 %."""


@dataclass(frozen=True, eq=False)
class ArmBelief(OfStructure):
    """A drawn arm, with what is in its hand and what is at rest, as pictures determine them."""

    structure: SpatialStructure
    beta: Array  # (d,)
    active: Index  # (k,), parameters that are uncertain
    root: Array  # (k, k), of their covariance


@dataclass(frozen=True, eq=False)
class JointMotions(Motions):
    """Motions of an arm at joint values (n, dof); parameters are those of `FREE`, and its size."""

    structure: SpatialStructure  # with view "pose"

    @cached_property
    def active(self) -> Index:
        """The structure's parameters that are fitted."""
        return self.structure.prior(FREE).active

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.active) + 1

    def poses(self, arm: Array) -> Array:
        """The tip in the base (n, 4, 4) [m] at parameters (k,); the last is the log of its size."""
        places, turns = self._base.pose(self.values, self.beta(arm))
        return rigid(turns, np.exp(arm[-1]) * places)

    def slopes(self, arm: Array) -> Array:
        """Steps of the tip, (n, 6, k), by the parameters."""
        poses = self.poses(arm)
        _, in_base = self._base.linearise(
            self.values, self.beta(arm), self.active
        )
        shift, turn = np.split(in_base, 2, axis=1)
        # the size shifts the tip and turns it nowhere
        along_base = np.zeros((len(poses), 2, 3, self.size))
        along_base[:, 0, :, :-1] = turn
        along_base[:, 1, :, :-1] = np.exp(arm[-1]) * shift
        along_base[:, 1, :, -1] = shift_of(poses)
        along_tip: Array = turn_of(poses).mT[:, None] @ along_base
        return along_tip.reshape(len(poses), 6, self.size)

    def beta(self, arm: Array) -> Array:
        """The structure's parameters (d,)."""
        drawn = self.structure.neutral()
        return self.structure.after_step(drawn, self.active, arm[:-1])

    def largest_move(self, arm: Array) -> tuple[str, float, float]:
        """The joint whose origin differs most from the drawing's, by how much [m, rad]."""
        structure = self.structure
        beta = self.beta(arm)
        shifts = row_lengths(beta[structure.shifts])
        turns = row_lengths(beta[structure.turns])
        moves = shifts / DRAWN_SHIFT_SD + turns / DRAWN_TURN_SD
        worst = int(np.argmax(moves))
        name = structure.chain_names[worst]
        return name, float(shifts[worst]), float(turns[worst])

    def scales(self, places: Index) -> list[Scale]:
        """Prior scales of the parameters, at their places (k,) among the unknowns.

        The evidence finds all but that of the size.
        """
        prior = self.structure.prior(FREE)
        scales = [Scale(places[-1:], SIZE_SD, SIZE_SD, SIZE_SD)]
        for hyper in prior.hypers:
            numbers = np.searchsorted(self.active, hyper.indices)
            is_placement = hyper.name.startswith("placement")
            within = FINER if is_placement else hyper.within
            lowest, highest = hyper.scale * np.array(within)
            scales.append(Scale(places[numbers], hyper.scale, lowest, highest))
        return scales

    def body(
        self,
        fit: CornerFit,
        layout: CornerLayout,
        hand_number: int,
        base_number: int,
    ) -> ArmBelief:
        """The fit as a belief whose readings are poses of what is in the hand.

        hand_number, base_number : frames of what is in the hand and of what is at rest
        """
        groups = self.structure.groups
        tool = [*groups["tool.rotation"], *groups["tool"]]
        view = [*groups["view.rotation"], *groups["view.shift"]]
        hand = fit.unknowns.frames[hand_number]
        base = fit.unknowns.frames[base_number]
        # the view is the inverse of its frame
        poses = np.stack([hand, inverse(base)])
        beta = self.beta(fit.unknowns.values[layout.arm])
        turns = logarithm(turn_of(poses))
        beta[tool + view] = np.hstack([turns, shift_of(poses)]).ravel()

        # slope (d, s) of the structure's parameters by the unknowns
        slope = np.zeros((self.structure.size, layout.size))
        slope[self.active, layout.arm[:-1]] = 1.0
        by_hand = shifts_along_parents(hand[None])
        by_base = -along_parent(inverse(base)) @ adjoint(base)
        slope[np.ix_(tool, layout.frames[hand_number])] = by_hand
        slope[np.ix_(view, layout.frames[base_number])] = by_base

        covariance = slope @ fit.covariance @ slope.T
        active = np.flatnonzero(np.diag(covariance) > 0.0)
        root = root_of(covariance[np.ix_(active, active)])
        return ArmBelief(self.structure, beta, active, root)

    @cached_property
    def _base(self) -> SpatialStructure:
        return self.structure.with_sensor(view="base pose")
