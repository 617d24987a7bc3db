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
from .bundle import Layout, Motions, follow
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
        places, turns = self._base.pose(self.rows, self.beta(arm))
        return rigid(turns, np.exp(arm[-1]) * places)

    def slopes(self, arm: Array) -> Array:
        """Turn in the tip's axes and shift in the base's, (n, 6, k), by the parameters."""
        beta = self.beta(arm)
        places, turns = self._base.pose(self.rows, beta)
        _, moved = self._base.linearise(self.rows, beta, self.active)
        shift, turn = np.split(moved, 2, axis=1)
        scale = np.exp(arm[-1])
        own_turn = np.swapaxes(turns, 1, 2) @ turn
        by_arm = np.concatenate([own_turn, scale * shift], axis=1)
        still = np.zeros_like(places)
        by_size = np.concatenate([still, scale * places], axis=1)
        return np.concatenate([by_arm, by_size[:, :, None]], axis=2)

    def beta(self, arm: Array) -> Array:
        """The structure's parameters (d,)."""
        step = np.zeros(self.structure.size)
        step[self.active] = arm[:-1]
        return self.structure.retract(self.structure.neutral(), step)

    def largest_move(self, arm: Array) -> tuple[str, float, float]:
        """The joint whose origin differs most from the drawing's, by how much [m, rad]."""
        beta = self.beta(arm)
        shifts = np.linalg.norm(beta[self.structure.shifts], axis=1)
        turns = np.linalg.norm(beta[self.structure.turns], axis=1)
        worst = int(np.argmax(shifts / SHIFT + turns / TURN))
        name = self.structure.chain_names[worst]
        return name, float(shifts[worst]), float(turns[worst])

    def scales(self, places: Index) -> list[Scale]:
        """Prior scales that the evidence finds, of parameters at places; that of the size stays."""
        prior = self.structure.prior(FREE)
        scales = [Scale(places[-1:], SIZE_SD, SIZE_SD, SIZE_SD)]
        for hyper in prior.hypers:
            some = places[np.searchsorted(self.active, hyper.indices)]
            is_placement = hyper.name.startswith("placement")
            within = FINER if is_placement else hyper.within
            lowest, highest = hyper.scale * np.array(within)
            scales.append(Scale(some, hyper.scale, lowest, highest))
        return scales

    def body(
        self, fit: Fit, layout: Layout, carried: int, standing: int
    ) -> Body:
        """What the pictures tell, as a belief of readings of poses of what is in the hand."""
        structure = self.structure
        groups = structure.groups
        hand = fit.unknowns.frames[carried]
        base = fit.unknowns.frames[standing]
        view = inverse(base)
        turns = logarithm(turn_of(np.stack([hand, view])))
        beta = self.beta(fit.unknowns.values[layout.arm])
        beta[groups["tool"]] = shift_of(hand)
        beta[groups["view.shift"]] = shift_of(view)
        beta[groups["tool.rotation"]], beta[groups["view.rotation"]] = turns
        # a step of the standing frame, in its own axes and the base's, as one of its inverse
        back = follow(np.eye(4), base, inverted=True)
        back[3:] -= cross_matrix(shift_of(view)) @ back[:3]
        scene = [*groups["view.rotation"], *groups["view.shift"]]
        tool = [*groups["tool.rotation"], *groups["tool"]]
        slope = np.zeros((structure.size, layout.size))
        slope[np.ix_(scene, layout.frames[standing])] = back
        slope[np.ix_(tool, layout.frames[carried])] = np.eye(6)
        slope[self.active, layout.arm[:-1]] = 1.0
        covariance = slope @ fit.covariance @ slope.T
        active = np.flatnonzero(np.diag(covariance) > 0.0)
        uncertain = covariance[np.ix_(active, active)]
        values, vectors = np.linalg.eigh(uncertain)
        sds = np.sqrt(np.maximum(values, 0.0))
        none = np.zeros(6)
        return Body(
            structure,
            beta,
            active,
            root=vectors * sds,
            noise=np.ones(6),
            kappa=1.0,
            tau=none,
            residual=none,
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
