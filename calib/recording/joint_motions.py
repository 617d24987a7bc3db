"""The flange as joints say: a drawn arm, whose zeros, origins and size the pictures correct."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arm.rotations import cross_matrix, logarithm
from ..body.belief import Body
from ..body.settings import FINER, SHIFT, TURN
from ..body.spatial import SpatialStructure
from ..common.arrays import Array, Index
from .bundle import Layout, Motions, scene_slopes
from .fit import Fit, Scale
from .rigid import inverse, rigid, shift_of, turn_of

FREE = ("placement", "offset")
"""Groups of the arm's parameters that the pictures correct."""

SIZE_SD = 2e-3
"""Drawn arms are as large as they say to .2 %."""


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
        beta = self.beta(arm)
        places, turns = self._base.pose(self.rows, beta)
        places = np.exp(arm[-1]) * places
        return rigid(turns, places)

    def slopes(self, arm: Array) -> Array:
        """Turn in the tip's axes and shift in the base's, (n, 6, k), by the parameters."""
        beta = self.beta(arm)
        places, turns = self._base.pose(self.rows, beta)
        _, in_base = self._base.linearise(self.rows, beta, self.active)
        shift, turn = np.split(in_base, 2, axis=1)
        scale = np.exp(arm[-1])
        turn_in_tip = np.swapaxes(turns, 1, 2) @ turn
        # the size shifts the tip and turns it nowhere
        slopes = np.zeros((len(places), 6, self.size))
        slopes[:, :3, :-1] = turn_in_tip
        slopes[:, 3:, :-1] = scale * shift
        slopes[:, 3:, -1] = scale * places
        return slopes

    def beta(self, arm: Array) -> Array:
        """The structure's parameters (d,)."""
        step = np.zeros(self.structure.size)
        step[self.active] = arm[:-1]
        return self.structure.retract(self.structure.neutral(), step)

    def largest_move(self, arm: Array) -> tuple[str, float, float]:
        """The joint whose origin differs most from the drawing's, by how much [m, rad]."""
        structure = self.structure
        beta = self.beta(arm)
        shifts = np.linalg.norm(beta[structure.shifts], axis=1)
        turns = np.linalg.norm(beta[structure.turns], axis=1)
        moves = shifts / SHIFT + turns / TURN
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
            scale = Scale(places[numbers], hyper.scale, lowest, highest)
            scales.append(scale)
        return scales

    def body(
        self, fit: Fit, layout: Layout, hand_number: int, base_number: int
    ) -> Body:
        """The fit as a belief whose readings are poses of what is in the hand.

        hand_number, base_number : frames of what is in the hand and of what stands still
        """
        structure = self.structure
        groups = structure.groups
        hand = fit.unknowns.frames[hand_number]
        base = fit.unknowns.frames[base_number]
        view = inverse(base)

        # mean
        beta = self.beta(fit.unknowns.values[layout.arm])
        turns = turn_of(np.stack([hand, view]))
        hand_turn, view_turn = logarithm(turns)
        beta[groups["tool"]] = shift_of(hand)
        beta[groups["view.shift"]] = shift_of(view)
        beta[groups["tool.rotation"]] = hand_turn
        beta[groups["view.rotation"]] = view_turn

        # covariance; the view is the inverse of the frame that is fitted
        view_slope = scene_slopes(np.eye(4), base, inverted=True)
        view_slope[3:] -= cross_matrix(shift_of(view)) @ view_slope[:3]
        view_places = [*groups["view.rotation"], *groups["view.shift"]]
        tool_places = [*groups["tool.rotation"], *groups["tool"]]
        slope = np.zeros((structure.size, layout.size))
        slope[np.ix_(view_places, layout.frames[base_number])] = view_slope
        slope[np.ix_(tool_places, layout.frames[hand_number])] = np.eye(6)
        slope[self.active, layout.arm[:-1]] = 1.0
        covariance = slope @ fit.covariance @ slope.T

        # its root, of the parameters that are uncertain
        variances = np.diag(covariance)
        active = np.flatnonzero(variances > 0.0)
        uncertain = covariance[np.ix_(active, active)]
        values, vectors = np.linalg.eigh(uncertain)
        sds = np.sqrt(np.maximum(values, 0.0))
        zeros = np.zeros(6)
        return Body(
            structure,
            beta,
            active,
            root=vectors * sds,
            noise=np.ones(6),
            kappa=1.0,
            tau=zeros,
            residual=zeros,
            nu=np.inf,
            autocorrelation=0.0,
            scales={},
            rows=len(self.rows),
            simulated=False,
            member="chain",
        )

    @cached_property
    def _base(self) -> SpatialStructure:
        return self.structure.with_sensor(view="base pose")
