"""The flange as joints say: a drawn arm, whose zeros, origins and size the pictures correct."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arm.rotations import cross_matrix, logarithm
from ..body.belief import Body
from ..body.settings import FINER
from ..body.spatial import SpatialStructure
from ..common.arrays import Array, Index
from .bundle import Fit, Layout, Scale, inverse, poses_of

FREE = ("placement", "offset")
"""Groups of the arm's parameters that the pictures correct."""

SIZE_SD = 2e-3
"""Drawn arms are as large as they say to .2 %."""


@dataclass(frozen=True, eq=False)
class JointMotions:
    """Motions of an arm at joint values; its parameters are those of `FREE`, and its size."""

    structure: SpatialStructure  # with view "pose"
    q: Array  # (n, dof) [rad or m]

    @cached_property
    def active(self) -> Index:
        """The structure's parameters that are fitted."""
        return self.structure.prior(FREE).active

    @property
    def count(self) -> int:
        """Number of motions."""
        return len(self.q)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.active) + 1

    def poses(self, arm: Array) -> Array:
        """The tip in the base (n, 4, 4) [m] at parameters (k,); the last is the log of its size."""
        places, turns = self._base.pose(self.q, self.beta(arm))
        return poses_of(turns, np.exp(arm[-1]) * places)

    def slopes(self, arm: Array) -> Array:
        """Turn in the tip's axes and shift in the base's, (n, 6, k), by the parameters."""
        beta = self.beta(arm)
        places, turns = self._base.pose(self.q, beta)
        moved = self._base.linearise(self.q, beta, self.active)[1]
        slopes = np.zeros((self.count, 6, self.size))
        slopes[:, :3, :-1] = np.swapaxes(turns, 1, 2) @ moved[:, 3:]
        slopes[:, 3:, :-1] = np.exp(arm[-1]) * moved[:, :3]
        slopes[:, 3:, -1] = np.exp(arm[-1]) * places
        return slopes

    def take(self, rows: Index) -> JointMotions:
        """Some of the motions."""
        return replace(self, q=self.q[rows])

    def beta(self, arm: Array) -> Array:
        """The structure's parameters (d,)."""
        step = np.zeros(self.structure.size)
        step[self.active] = arm[:-1]
        return self.structure.retract(self.structure.neutral(), step)

    def scales(self, layout: Layout) -> tuple[list[Scale], Array]:
        """Prior scales that the evidence finds, and where they start, sd (k,)."""
        first = layout.values - layout.arm
        prior = self.structure.prior(FREE)
        found = []
        for hyper in prior.hypers:
            some = first + np.searchsorted(self.active, hyper.indices)
            within = FINER if hyper.name.startswith("placement") else hyper.within
            lowest, highest = hyper.scale * np.array(within)
            found.append(Scale(hyper.name, some, lowest, highest))
        return found, np.append(prior.sd[self.active], SIZE_SD)

    def body(self, fit: Fit, layout: Layout, camera: int, in_hand: bool) -> Body:
        """What the pictures tell, as a belief of readings of poses of what is in the hand."""
        structure = self.structure
        groups = structure.groups
        board = layout.cameras + layout.board_of(in_hand)
        hand, standing = (camera, board) if in_hand else (board, camera)
        held = fit.unknowns.frames[hand]
        view = inverse(fit.unknowns.frames[standing])
        arm = fit.unknowns.values[layout.arm_values]
        beta = self.beta(arm)
        beta[groups["tool"]] = held[:3, 3]
        beta[groups["tool.rotation"]] = logarithm(held[None, :3, :3])[0]
        beta[groups["view.shift"]] = view[:3, 3]
        beta[groups["view.rotation"]] = logarithm(view[None, :3, :3])[0]
        # a step of the standing frame, in its own axes and the base's, as one of its inverse
        slope = np.zeros((structure.size, layout.size))
        at = 6 * standing + np.arange(6)
        slope[np.ix_(groups["view.rotation"], at[:3])] = -np.eye(3)
        slope[np.ix_(groups["view.shift"], at[:3])] = cross_matrix(view[:3, 3])
        slope[np.ix_(groups["view.shift"], at[3:])] = -view[:3, :3]
        slope[np.ix_(groups["tool.rotation"], 6 * hand + np.arange(3))] = np.eye(3)
        slope[np.ix_(groups["tool"], 6 * hand + np.arange(3, 6))] = np.eye(3)
        places = 6 * layout.frames + layout.arm_values[:-1]
        slope[self.active, places] = 1.0
        covariance = slope @ fit.covariance @ slope.T
        active = np.flatnonzero(np.diag(covariance) > 0.0)
        values, vectors = np.linalg.eigh(covariance[np.ix_(active, active)])
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        none = np.zeros(6)
        return Body(
            structure,
            beta,
            active,
            root,
            np.ones(6),
            kappa=1.0,
            tau=none,
            residual=none,
            nu=np.inf,
            autocorrelation=0.0,
            scales={},
            rows=self.count,
            simulated=False,
            member="chain",
        )

    @cached_property
    def _base(self) -> SpatialStructure:
        return self.structure.with_view("base pose")
