"""Options of a training: what `calib.train`, `calib train` and `calib sweep` take, each once."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from ..common.choices import BODIES, VIEWS
from ..errors import OptionError
from ..maps.density import Gain
from ..maps.lattice import Size, shape_of
from ..maps.links import wiring_of

_STREAMS = {"motor": 0, "sensory": 1, "imagined": 2, "bounds": 3, "evaluation": 4}
"""Independent random streams of one seed."""


@dataclass(frozen=True)
class TrainingOptions:
    """How a model is trained.

    Attributes
    ----------
    size, motor_size, sensory_size : int, str or tuple of int, optional
        Nodes along each axis of both lattices, or of one.  70 by default, which stands for 70x70
        and, with three joints, a 17x17x17 motor map; for a log about five rows per node.
    map : str or gain function, optional
        Network: "vdsom:residual" (default; "gas" where held-out blocks of a log without a body
        prefer it) or another name that :class:`calib.SOM` knows, or a function of a
        :class:`calib.Visit`.
    rule : {"batch", "online"}
        Kohonen's batch map, or the paper's eq. 1 to 8, sample by sample.
    epochs : int, optional
        Passes over the samples; with `sigma` it trains the full lattice alone, without
        the coarse lattices that come first by default.
    sigma : (float, float), optional
        Neighbourhood radius at the start and at the end [nodes].
    links : {"reciprocal", "oja", "local", "mutual"}
        How the links (eq. 5) are learned and read (eq. 6), see docs/paper.md.
    body : {"auto", "none"}
        ``auto`` fits a kinematic body under the maps; ``none`` learns from maps and links
        alone, as the paper does.
    view : {"auto", "base", "rigid", "similarity", "affine", "homography", "pinhole"}
        What the sensor measures: ``base`` says that positions are in the robot's root frame,
        ``auto`` is rigid for lengths, a homography for pixels, a pinhole for an arm in space.
    seed : int
        The same seed gives the same model, byte for byte.

    Examples
    --------
    >>> import calib
    >>> calib.TrainingOptions(size=20, map="som").seed
    0
    """

    size: Size | None = None
    motor_size: Size | None = None
    sensory_size: Size | None = None
    map: str | Gain | None = None
    rule: str = "batch"
    epochs: int | None = None
    sigma: tuple[float, float] | None = None
    links: str = "reciprocal"
    body: str = "auto"
    view: str = "auto"
    seed: int = 0

    def __post_init__(self) -> None:
        seed = self.seed
        if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
            raise OptionError(f"seed {seed!r}: expected a whole number, 0 or more")
        wiring_of(self.links)
        for name, value, choices in (("body", self.body, BODIES), ("view", self.view, VIEWS)):
            if value not in choices:
                raise OptionError(f"{name} {value!r}: expected one of {', '.join(choices)}")

    @property
    def shapes(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The motor and the sensory lattice, where they are given."""
        both = self.size or 70
        return shape_of(self.motor_size or both), shape_of(self.sensory_size or both)

    def to_json(self) -> dict[str, Any]:
        """Plain data for a model file."""
        data = {k: v for k, v in asdict(self).items() if k != "size"} | {"seed": int(self.seed)}
        if callable(self.map):
            data["map"] = getattr(self.map, "__name__", "custom")
        return data

    def stream(self, name: str) -> SeedSequence:
        """Seed of one of the independent random streams."""
        return SeedSequence(self.seed, spawn_key=(_STREAMS[name],))
