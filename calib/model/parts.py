"""Parts: what a model is made of, and what follows from it without a query."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from ..body.approach import Approach
from ..body.belief import Body
from ..common.arrays import Array, Mask, Own, Shape, freeze
from ..common.choices import MAP_READOUTS
from ..common.wording import one_line
from ..errors import OptionError
from ..inverse.solver import Solver
from ..kernel.compiled import Compiled
from ..kernel.posterior import CompactPosterior
from ..maps.association import Association, check_readout
from ..maps.linear_models import LinearModels
from ..maps.local_models import NO_MODELS, LocalModels
from ..maps.map import Map
from ..maps.node_bounds import blend_nodes
from ..maps.predictor import BodyInBox, Predictor
from .about import About, Photo, Rows
from .baseline import Baseline, Seen

if TYPE_CHECKING:
    from scipy.sparse import csr_array


MOST_SHARE = 0.1  # of the reach: where the bound on the position exceeds it, there is no answer
MOST_BLENDED = 3  # joints up to which bounds are blended between the motor map's nodes
STEEP = 2.0  # extents of the workspace that a position may change by over the range of a joint
# of a joint's range by which values beyond it are answered: an encoder at its stop reads a hair
# beyond the limit
ROUNDED = 1e-5


@dataclass(frozen=True, eq=False, repr=False)
class Parts:
    """The fields of a :class:`calib.Model`, as a model file keeps them."""

    about: About  # what it is a model of and where it came from
    association: Association  # motor map, sensory map and the links between them
    # of the motor nodes, for what the body leaves over
    local: Annotated[LocalModels, Own()]
    # [unit], 95 % bounds around each motor node, on what `about.bound_of` says and on the true
    # position in the sensor's frame
    bounds: Annotated[Array, Shape("nodes")]
    model_bounds: Annotated[Array, Shape("nodes")]
    visited: Annotated[Mask, Shape("nodes")]  # motor nodes that training samples have visited
    # the kinematic model under the maps, with intervals
    body: Annotated[Body, Own()] | None = None
    rows: Rows | None = None  # measured rows that are kept with the model of a log
    # earlier states of this model: trained, adapted, with their errors
    history: tuple[Mapping[str, Any], ...] = ()
    baseline: Baseline | None = None  # what an undisturbed arm's distortions look like
    # how long the steps of its training took
    seconds: dict[str, float] = field(default_factory=dict, metadata={"kept": False})
    approach: Approach | None = None  # backlash, where the direction of motion counts
    # by the camera that measured the arm, to draw the map over
    photo: Annotated[Photo, Own()] | None = None
    # the same arm as its further sensors see it, each with maps, local models and bounds of its own
    others: tuple[Parts, ...] = ()

    # what `warm_up` compiled, which answers single queries
    kernel: ClassVar[Compiled | None] = None

    def __post_init__(self) -> None:
        freeze(self, "bounds", "model_bounds", "visited")
        if np.array_equal(self.bounds, self.model_bounds):  # one answer is enough
            object.__setattr__(self, "model_bounds", self.bounds)

    def __getstate__(self) -> dict[str, Any]:
        """What was compiled for single queries stays behind when a model is pickled."""
        kept = {"kernel", "remembered"}
        return {name: value for name, value in vars(self).items() if name not in kept}

    def __repr__(self) -> str:
        """Say in three lines what it is a model of, what it has learned and how well."""
        about = self.about
        errors = about.errors.get(self.default_readout, {}).get("forward", {})
        error = errors.get("distance", {}).get("mean")
        known = "unknown" if error is None else f"{error:.3g} {about.unit}"
        title = f"Model of {about.robot or 'a log'}: {', '.join(about.joint_names)}"
        return one_line(title) + (
            f"\n  {about.samples:,} samples ({about.source}), maps: {self.size_in_words}"
            f"\n  mean error {known}, {len(self.history)} earlier states"
        )

    @property
    def size_in_words(self) -> str:
        """The lattices, such as `motor 70x70, sensory 70x70`."""
        maps = (self.motor, self.sensory)
        motor, sensory = ("x".join(map(str, part.lattice.shape)) for part in maps)
        return f"{motor} nodes" if motor == sensory else f"motor {motor}, sensory {sensory}"

    @property
    def motor(self) -> Map:
        """Motor map; its weights are joint values."""
        return self.association.motor

    @property
    def sensory(self) -> Map:
        """Sensory map; its weights are positions."""
        return self.association.sensory

    @property
    def links(self) -> csr_array:
        """Oja-Hebbian links, (motor nodes, sensory nodes)."""
        return self.association.links

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors that saw the arm, the one whose model this is first."""
        return (self.about.sensor, *(other.about.sensor for other in self.others))

    def by(self, sensor: str) -> Parts:
        """Return the parts as one of the sensors sees the arm."""
        if sensor in ("", self.about.sensor) or self.sensors == ("",):
            return self
        if sensor not in self.sensors:
            choices = ", ".join(self.sensors)
            raise OptionError(f"sensor {sensor!r}: expected one of {choices}", parameter="sensor")
        return self.others[self.sensors.index(sensor) - 1]

    @cached_property
    def remembered(self) -> dict[str, Any]:
        """What functions of a model found once and keep for their next call."""
        return {}

    @cached_property
    def predictor(self) -> Predictor:
        """The default readout: body, or linear models of the links, and the nodes' own models."""
        body, scale = self.body, self.motor.scale
        smooth = self.association.linear if body is None else BodyInBox(body, scale)
        return Predictor(self.motor, smooth, self.local)

    @cached_property
    def solver(self) -> Solver:
        """Solver of the inverse direction."""
        return Solver(self.association, self.predictor)

    @cached_property
    def body_solver(self) -> Solver:
        """Solver of the inverse direction of the body alone, without local models."""
        if self.body is None:
            raise OptionError("readout 'body': the model has no body, choose another readout")
        return Solver(self.association, replace(self.predictor, models=NO_MODELS))

    @cached_property
    def most_bound(self) -> float:
        """Largest bound [unit] with which a position is still an answer."""
        return MOST_SHARE * self.reach

    @property
    def _seen(self) -> Seen | None:
        return None if self.baseline is None or self.body is not None else self.baseline.seen

    @cached_property
    def everywhere(self) -> bool:
        """Whether there is an answer wherever joints are within their range."""
        return self._seen is None and bool((self.model_bounds <= self.most_bound).all())

    def in_range(self, q: Array) -> Mask:
        """Which joint values (n, dof) [rad or m] are within the joints' range.

        Joints that turn round and round may be a turn beyond it: further away is no arm.
        """
        scale = self.motor.scale
        with np.errstate(over="ignore"):
            share = (q - scale.lower) / scale.span
        slack = np.where(scale.periodic, 1.0, ROUNDED)
        return np.asarray((share >= -slack) & (share <= 1.0 + slack))

    def covers(self, q: Array) -> Mask:
        """Whether joint values (n, dof) [rad or m] are answered, (n,)."""
        covered = np.asarray(self.in_range(q).all(axis=1))
        if not self.everywhere and covered.any():
            u = self.motor.scale.to_unit(q[covered])
            bound = self.blended(self.model_bounds, u, noise=False)
            covered[covered] = bound <= self.most_bound
        return covered

    def blended(self, bounds: Array, u: Array, *, noise: bool) -> Array:
        """Bounds (n,) at points of the unit box (n, dof), from those of the nodes (nodes,).

        `noise` says whether they count the noise of a single reading.
        """
        blended, scale = blend_nodes(self.motor, bounds, u), self.motor.scale
        wide = blended > self.most_bound
        if self.body is not None and wide.any():
            # beside a joint that hardly moved the posterior widens within less than a node's
            # spacing: a blended bound would refuse the measured rows themselves
            there = self.body.bound(scale.from_unit(u[wide]), noise=noise)
            blended[wide] = np.minimum(blended[wide], there)
        if self._seen is not None:
            blended = blended + STEEP * self.solver.extent * self._seen.beside(scale, u)
        return blended

    @cached_property
    def posterior(self) -> CompactPosterior | None:
        """What bounds positions of more than three joints; None where nodes' bounds are blended."""
        if self.body is None or self.motor.units.shape[1] <= MOST_BLENDED:
            return None
        try:
            return CompactPosterior.of(self.body, self.about.lower, self.about.upper)
        except OptionError:
            return None

    @cached_property
    def reach(self) -> float:
        """How far the tip can be from the middle of what it reaches [unit]."""
        if self.body is not None:
            return float(self.body.structure.extents[: self.body.structure.blocks[0]].max())
        return 0.5 * self.solver.extent

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of a position's coordinates: x and y, and z for an arm in space."""
        return ("x", "y", "z")[: self.sensory.units.shape[1]]

    @property
    def default_readout(self) -> str:
        """``local``, the body and its local models; ``linear`` where maps and links stand alone."""
        return "linear" if isinstance(self.predictor.smooth, LinearModels) else "local"

    @property
    def readouts(self) -> tuple[str, ...]:
        """Readouts that differ, the default first."""
        if self.default_readout == "linear":
            return MAP_READOUTS
        smooth = self.body is not None and self.predictor.models.degree >= 0
        return ("local", *(("body",) if smooth else ()), *MAP_READOUTS)

    def predicted(self, u: Array, readout: str) -> Array:
        """Positions (n, m) that a readout answers at points (n, dof) of the unit box [unit]."""
        if readout == "local":
            return self.predictor.value(u)
        if readout == "body":
            return self.body_solver.predictor.value(u)
        return self.sensory.scale.from_unit(self.association.forward(u, readout))

    def bound_at(self, u: Array, which: str = "bounds", *, side_known: Mask | None = None) -> Array:
        """95 % bound (n,) [unit] at points of the unit box (n, dof): `bounds` or `model_bounds`.

        side_known : (n,), whether `u` is where the joints stand; by default it is where they read,
            and they may stand anywhere within their play
        """
        bound = self._bound_without_play(u, which)
        if self.approach is None:
            return bound
        if side_known is None:
            side_known = np.zeros(len(u), dtype=bool)
        return bound + np.where(side_known, 0.0, self._play_reach(u))

    def _play_reach(self, u: Array) -> Array:
        """How far the tip may be (n,) [unit] with all joints at the worst side of their play."""
        slope = self.predictor.value_and_slope(u)[1] / self.motor.scale.span
        play = np.zeros(u.shape[1]) if self.approach is None else self.approach.play
        return np.asarray(np.linalg.norm(slope * play, axis=1).sum(axis=1))

    def _bound_without_play(self, u: Array, which: str) -> Array:
        # of more than three joints a lattice covers too little of their box to blend between
        noise = which == "bounds" and self.about.bound_of == "sensor reading"
        if self.posterior is not None:
            return self.posterior.bound(self.motor.scale.from_unit(u), noise=noise)
        if self.body is not None and u.shape[1] > MOST_BLENDED:
            return self.body.bound(self.motor.scale.from_unit(u), noise=noise)
        return self.blended(getattr(self, which), u, noise=noise)

    def _readout(self, name: str | None) -> str:
        """The readout that answers; ``local`` where the predictor does."""
        check_readout(name or "local")
        if name == "local" and self.default_readout == "linear":
            raise OptionError("readout 'local': the model has no body, choose 'linear'")
        return "local" if name in (None, self.default_readout) else str(name)
