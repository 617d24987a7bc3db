"""Options of a training, and the lattices that suit its samples."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

from numpy.random import SeedSequence

from ..common.choices import BODIES, FREED, VIEWS, check_choice
from ..common.inputs import whole
from ..errors import OptionError
from ..maps.density import Gain
from ..maps.lattice import Size, shape_of
from ..maps.links import wiring_of
from ..samples.samples import Samples
from .settings import LEARNING

Progress = Callable[[float, str, float], None]
"""Called with the share of the work done, of each sensor in turn, the stage, the error (or NaN)."""

LATTICE = "vdsom:residual"
"""The default map."""

UNFOLD = "give a larger `size`, more `epochs` or samples, or `rule='batch'`"
"""What to do about a map that did not spread over its samples."""

_STREAMS = ("motor", "sensory", "imagined", "bounds", "evaluation")
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
        Network: "vdsom:residual" (default) or another name that :class:`calib.SOM` knows, or a
        function of a :class:`calib.Visit`.
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
        What the sensor measures: ``base`` means positions in the robot's root frame,
        ``auto`` is rigid for lengths, a homography for pixels, a pinhole for an arm in space.
    free : {"all", "offsets"}
        What of a drawing may be off: with ``offsets`` its geometry is true, the joints' zeros and
        the sensor's frame are not.
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
    free: str = "all"
    seed: int = 0

    def __post_init__(self) -> None:
        whole("seed", self.seed, 0, 2**63 - 1)
        wiring_of(self.links)
        check_choice("body", self.body, BODIES)
        check_choice("view", self.view, VIEWS)
        check_choice("free", self.free, FREED)

    @property
    def shapes(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The motor and the sensory lattice, where they are given."""
        both = self.size or LEARNING.side
        motor = shape_of(self.motor_size or both)
        sensory = shape_of(self.sensory_size or both)
        return motor, sensory

    def to_json(self) -> dict[str, Any]:
        """Plain data for a model file."""
        data = asdict(self)
        del data["size"]
        data["seed"] = int(self.seed)
        if callable(self.map):
            data["map"] = getattr(self.map, "__name__", "custom")
        return data

    def stream(self, name: str) -> SeedSequence:
        """Seed of one of the independent random streams."""
        return SeedSequence(self.seed, spawn_key=(_STREAMS.index(name),))


def options_for(
    samples: Samples, options: TrainingOptions
) -> tuple[TrainingOptions, list[str]]:
    """The options with lattices and map for these samples, and notes for the user."""
    notes: list[str] = []
    size = options.size
    sizes = (size, options.motor_size, options.sensory_size)
    is_free = all(part is None for part in sizes)
    if samples.simulation is None and is_free:
        count = len(samples)
        least = LEARNING.least_side_of_body
        if options.body == "none":
            least = LEARNING.least_side
        side = max(least, round(math.sqrt(count / LEARNING.rows_per_node)))
        size = min(LEARNING.side, side)
        notes = [
            f"lattices of {size}x{size} nodes for {count:,} rows, `size` chooses others"
        ]
    motor = shape_of(LEARNING.side if size is None else size)
    sensory = motor if len(motor) == 2 else shape_of(LEARNING.side)
    dof = samples.dof
    width = samples.x.shape[1]
    # as many nodes in a lattice of the joints' dimension, and in one of the space
    if len(motor) == 2 and dof in (1, 3):
        motor = _of_dimension(dof, motor)
    if width == 3:
        sensory = _of_dimension(3, sensory)
    if options.motor_size is not None:
        motor = shape_of(options.motor_size, "motor_size")
    if options.sensory_size is not None:
        sensory = shape_of(options.sensory_size, "sensory_size")
    for name, shape, most in (
        ("motor", motor, dof),
        ("sensory", sensory, width),
    ):
        if len(shape) > most:
            raise OptionError(
                f"{name} size {'x'.join(map(str, shape))}: expected at most {most} numbers, one "
                "for each axis",
                parameter=f"{name}_size",
            )
    network = options.map or LATTICE
    made = replace(options, map=network, motor_size=motor, sensory_size=sensory)
    return made, notes


def _of_dimension(dim: int, nodes: tuple[int, ...]) -> tuple[int, ...]:
    """A lattice of another number of axes with as many nodes as this one."""
    side = round(math.prod(nodes) ** (1 / dim))
    return (max(2, side),) * dim
