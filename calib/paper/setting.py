"""The setting of the experiments: the arm, how much is babbled, how often."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arm.arm import Arm
from ..arm.loading import load_arm
from ..common.arrays import Array
from ..samples.samples import Samples, babble

_Report = Callable[[float, str], None]
"""Called with the share of the work that is done and what is being done."""

ROBOT = "two_link"
"""Links of 0.30 and 0.25 m, shoulder 0..90 deg, elbow 15..150 deg.  The paper states
neither lengths nor ranges, and its tables do not settle them."""

NETWORKS = ("som", "vdsom")

_VALIDATION = 77  # stream of the points on which schedules are chosen


@dataclass(frozen=True)
class Setting:
    """How large the experiments are."""

    side: int = 70  # nodes along each side of the lattices
    sides: tuple[int, ...] = (30, 50, 70)  # those of Table 2
    # babbled samples; the paper does not state how many it used
    samples: int = 100_000
    # each gives other samples, another start and other test points
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    # small lattices and few samples, to see that everything runs
    quick: bool = False
    report: _Report = lambda *_: None

    @staticmethod
    def of(
        seed: int = 0, *, quick: bool = False, report: _Report = lambda *_: None
    ) -> Setting:
        """The paper's setting, or a small one; the seeds start at `seed`."""
        seeds = tuple(range(seed, seed + 5))
        if quick:
            return Setting(12, (8, 12), 1500, seeds[:2], quick, report)
        return Setting(seeds=seeds, report=report)

    @cached_property
    def arm(self) -> Arm:
        """The arm."""
        return load_arm(ROBOT)

    def babble(
        self,
        seed: int,
        n: int | None = None,
        *,
        noise: float = 0.0,
        changes: Iterable[str] = (),
    ) -> Samples:
        """Babbled samples of one seed."""
        return babble(
            self.arm,
            n or self.samples,
            seed=seed,
            noise=noise,
            changes=tuple(changes),
        )

    def validation(
        self, samples: Samples, seed: int, n: int | None = None
    ) -> tuple[Array, Array]:
        """Joints and exact positions that neither training nor the tables see."""
        simulation = samples.simulation
        assert simulation is not None  # noqa: S101
        rng = np.random.default_rng(
            np.random.SeedSequence(seed, spawn_key=(_VALIDATION,))
        )
        q = simulation.draw(2000 if self.quick else n or 6000, rng)
        return q, simulation.exact(q)
