"""The setting of the experiments: the arm, how much is babbled, how often."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..samples.babbling import babble
from ..samples.samples import Samples

Array = NDArray[np.float64]

Report = Callable[[float, str], None]
"""Called with the share of the work that is done and what is being done."""

ROBOT = "two_link"
"""Links of 0.30 and 0.25 m, shoulder 0..90 deg, elbow 15..150 deg.  The paper states
neither lengths nor ranges, and its tables do not settle them."""

NETWORKS = {"som": "som", "vdsom": "vdsom:border"}
"""The paper's networks by our names: its varying density is that of the border."""

_VALIDATION = 77  # stream of the points on which schedules are chosen


@dataclass(frozen=True)
class Setting:
    """How large the experiments are.

    Attributes
    ----------
    side : int
        Nodes along each side of the lattices.
    sides : tuple of int
        Those of Table 2.
    samples : int
        Babbled samples; the paper does not say how many it used.
    seeds : tuple of int
        Each gives other samples, another start and other test points.
    quick : bool
        Small lattices and few samples, to see that everything runs.
    data : Path or None
        Folder of real logs, for the ablation.
    """

    side: int = 70
    sides: tuple[int, ...] = (30, 50, 70)
    samples: int = 100_000
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    quick: bool = False
    report: Report = field(default=lambda _share, _what: None)
    data: Path | None = None

    @staticmethod
    def of(seed: int = 0, *, quick: bool = False, report: Report | None = None) -> Setting:
        """The paper's setting, or a small one; the seeds start at `seed`."""
        say = report or (lambda _share, _what: None)
        if quick:
            return Setting(12, (8, 12), 1500, (seed, seed + 1), quick=True, report=say)
        return Setting(seeds=tuple(range(seed, seed + 5)), report=say)

    def babble(
        self, seed: int, n: int | None = None, *, noise: float = 0.0, changes: Iterable[str] = ()
    ) -> Samples:
        """Babbled samples of one seed."""
        from ..arm.loading import load_arm

        arm = load_arm(ROBOT)
        return babble(arm, n or self.samples, seed=seed, noise=noise, changes=tuple(changes))

    def validation(self, samples: Samples, seed: int, n: int | None = None) -> tuple[Array, Array]:
        """Joints and exact positions that neither training nor the tables see."""
        simulation = samples.simulation
        assert simulation is not None  # noqa: S101
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_VALIDATION,)))
        q = simulation.draw(2000 if self.quick else n or 6000, rng)
        return q, simulation.exact(q)
