"""Joint motions: the flange by joints and a drawn arm, corrected in zeros, origins and size."""

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
from .fit import CornerFit, PriorScale

CORRECTED_GROUPS = ("placement", "offset")
"""Groups of the arm's parameters that the pictures correct."""

SIZE_SD = 2e-3
"""Prior sd of the log of an arm's size over the drawn one."""


@dataclass(frozen=True, eq=False)
class ArmBelief(OfStructure):
    """The arm, and the places of what is in its hand and what is at rest, by the pictures."""

    structure: SpatialStructure
    beta: Array  # (d,)
    active: Index  # (k,), parameters that are uncertain
    root: Array  # (k, k), of their covariance


@dataclass(frozen=True, eq=False)
class JointMotions(Motions):
    """Motions of an arm at joint values (n, dof), by `CORRECTED_GROUPS` and the arm's size."""

    structure: SpatialStructure  # with view "pose"

    @cached_property
    def active(self) -> Index:
        """The structure's parameters that are fitted."""
        return self.structure.prior(CORRECTED_GROUPS).active

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
        """The joint whose origin differs most from the drawing's, and by how much [m, rad]."""
        structure = self.structure
        beta = self.beta(arm)
        shifts = row_lengths(beta[structure.shifts])
        turns = row_lengths(beta[structure.turns])
        moves = shifts / DRAWN_SHIFT_SD + turns / DRAWN_TURN_SD
        worst = int(np.argmax(moves))
        name = structure.chain_names[worst]
        return name, float(shifts[worst]), float(turns[worst])

    def scales(self, indices: Index) -> list[PriorScale]:
        """Prior scales of the parameters, which have indices (k,) among the unknowns.

        The evidence finds all scales but that of the size.
        """
        prior = self.structure.prior(CORRECTED_GROUPS)
        scales = [PriorScale(indices[-1:], SIZE_SD, SIZE_SD, SIZE_SD)]
        for hyper in prior.hypers:
            numbers = np.searchsorted(self.active, hyper.indices)
            is_placement = hyper.name.startswith("placement")
            within = FINER if is_placement else hyper.within
            lowest, highest = hyper.scale * np.array(within)
            scales.append(
                PriorScale(indices[numbers], hyper.scale, lowest, highest)
            )
        return scales

    def body(
        self,
        fit: CornerFit,
        layout: CornerLayout,
        hand_number: int,
        base_number: int,
    ) -> ArmBelief:
        """The belief of a fit, whose readings are poses of what is in the hand.

        hand_number, base_number : of the frames of what is in the hand and of what is at rest
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
