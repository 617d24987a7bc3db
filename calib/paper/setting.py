"""The setting of the experiments: the arm, how much is babbled, how often."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arm.arm import PlanarArm
from ..arm.loading import load_arm
from ..common.arrays import Array
from ..errors import OptionError
from ..samples.samples import Samples, babble

_Report = Callable[[float, str], None]
"""Called with the share of the work that is done and what is being done."""

ROBOT = "two_link"
"""Links of 0.30 and 0.25 m, shoulder 0..90 deg, elbow 15..150 deg.  The paper states
neither lengths nor ranges, and its tables do not settle them."""

NETWORKS = ("som", "vdsom")

_VALIDATION = 77  # stream of the points on which schedules are chosen


def _no_report(_share: float, _what: str) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Setting:
    """How large the experiments are."""

    side: int = 70  # nodes along each side of the lattices
    sides: tuple[int, ...] = (30, 50, 70)  # those of Table 2
    # babbled samples; the paper does not say how many it used
    samples: int = 100_000
    # each gives other samples, another start and other test points
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    # small lattices and few samples, to see that everything runs
    quick: bool = False
    report: _Report = _no_report
    robot: str = ROBOT  # a bundled robot or a URDF with two joints that turn
    # which two of its joints, where it has more
    named: tuple[str, ...] | None = None

    @staticmethod
    def of(
        seed: int = 0,
        *,
        quick: bool = False,
        robot: str = ROBOT,
        named: Sequence[str] | None = None,
        report: _Report = _no_report,
    ) -> Setting:
        """The paper's setting, or a small one; the seeds start at `seed`.

        Raises OptionError if the robot has not two joints that turn in a plane.
        """
        setting = Setting(
            seeds=tuple(range(seed, seed + 5)),
            report=report,
            robot=robot,
            named=None if named is None else tuple(named),
        )
        if quick:
            setting = replace(
                setting,
                side=12,
                sides=(8, 12),
                samples=1500,
                seeds=(seed, seed + 1),
                quick=True,
            )
        _ = setting.joints  # an arm that does not fit is told here
        return setting

    @property
    def printed(self) -> bool:
        """Whether the paper's figures stand beside these: for its arm and its lattices."""
        return not self.quick and self.robot == ROBOT

    @cached_property
    def arm(self) -> PlanarArm:
        """The arm."""
        arm = load_arm(self.robot, joints=self.named)
        if (
            not isinstance(arm, PlanarArm)
            or len(arm.joint_names) != 2
            or not all(arm.revolute)
        ):
            raise OptionError(
                f"robot {self.robot!r} has the joints {', '.join(arm.joint_names)}: the paper's "
                "experiments need two that turn in a plane"
            )
        return arm

    @property
    def joints(self) -> tuple[str, str]:
        """Names of theta_1 and theta_2."""
        first, second = self.arm.joint_names
        return first, second

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
