"""Model parts: its maps, body and bounds, and the predictions and readouts that follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np

from ..body.approach import Approach
from ..body.belief import Body
from ..common.arrays import Array, Document, Mask, Shape, freeze
from ..common.choices import MAP_READOUTS, READOUTS, check_choice
from ..common.rows import row_lengths
from ..common.wording import one_line, unit_of_joint
from ..errors import OptionError
from ..inverse.link_starts import solver_by_links
from ..inverse.solver import Solver
from ..kernel.compiled import Library
from ..maps.association import Association
from ..maps.blend import blend_nodes
from ..maps.linear_models import LinearModels
from ..maps.local_models import NO_MODELS, LocalModels
from ..maps.map import Map
from ..maps.predictor import BodyInBox, Predictor
from .about import About, MeasuredRows, Photo, range_in_words
from .baseline import Baseline, RowPlaces

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from ..kernel.posterior import CompactPosterior


# joints up to which bounds are blended between the motor map's nodes
MOST_BLENDED = 3
# extents of the workspace that a position may change by over the range of a joint
STEEP = 2.0
# of the reach: where the bound on the position exceeds it, there is no answer
MOST_SHARE = 0.1
# share of a joint's range by which values may be beyond it: an encoder at its stop reads a hair
# more than the limit
ROUNDED = 1e-5

_P = TypeVar("_P", bound="ModelParts")
_T = TypeVar("_T")

PREDICTOR = "local"
"""Readout of `ModelParts.predictor`: of maps alone it stands for the default, `linear`."""

BoundName = Literal["bounds", "model_bounds"]
"""Reading bound, on what `about.bound_of` names, or position bound, on the true position."""


@dataclass(frozen=True, eq=False, repr=False)
class ModelParts:
    """The fields of a :class:`calib.Model`, as a model file keeps them."""

    about: About  # what it is a model of and where it came from
    # motor map, sensory map and the links between them
    association: Association
    # models of the motor nodes, of what the body leaves over
    local: LocalModels
    # [unit], 95 % bounds around each motor node: the reading bound, on what `about.bound_of` names,
    # and the position bound, on the true position in the sensor's frame
    bounds: Annotated[Array, Shape("nodes")]
    model_bounds: Annotated[Array, Shape("nodes")]
    # motor nodes that training samples have visited
    visited: Annotated[Mask, Shape("nodes")]
    # the kinematic model under the maps, with intervals
    body: Body | None = None
    # measured rows that are kept with the model of a log
    rows: MeasuredRows | None = None
    # earlier states of this model: trained, adapted, with their errors
    history: tuple[Document, ...] = ()
    # what an undisturbed arm's distortions look like
    baseline: Baseline | None = None
    # how long the steps of its training took
    seconds: dict[str, float] = field(
        default_factory=dict, metadata={"kept": False}
    )
    # backlash, where the direction of motion counts
    approach: Approach | None = None
    # by the camera that measured the arm, to draw the map over
    photo: Photo | None = None
    # the same arm as its further sensors see it, each with its own maps, local models and bounds
    others: tuple[ModelParts, ...] = ()

    # compiled by `warm_up`, or for a large batch; no field, so that no changed model takes it over
    kernel: ClassVar[Library | None] = None

    def __post_init__(self) -> None:
        freeze(self, "bounds", "model_bounds", "visited")
        # the same array, so that equal bounds are computed once
        if np.array_equal(self.bounds, self.model_bounds):
            object.__setattr__(self, "model_bounds", self.bounds)

    def __getstate__(self) -> dict[str, object]:
        """State to pickle: all but the compiled kernel and the cache."""
        unpickled = ("kernel", "cache")
        return {k: v for k, v in vars(self).items() if k not in unpickled}

    def __repr__(self) -> str:
        """Name in a line the arm of the model and what it has learned."""
        about = self.about
        title = (
            f"Model of {about.robot or 'a log'}: {', '.join(about.joint_names)}"
        )
        return f"{one_line(title)}; {about.samples:,} samples, {self.size_in_words}"

    @property
    def size_in_words(self) -> str:
        """The lattices, such as `motor 70x70, sensory 70x70`."""
        motor = "x".join(map(str, self.motor.lattice.shape))
        sensory = "x".join(map(str, self.sensory.lattice.shape))
        if motor == sensory:
            return f"{motor} nodes"
        return f"motor {motor}, sensory {sensory}"

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
        return tuple(model.about.sensor for model in (self, *self.others))

    @cached_property
    def cache(self) -> dict[str, Any]:
        """Results that functions of a model keep for their next call."""
        return {}

    @cached_property
    def predictor(self) -> Predictor:
        """The default readout: body, or linear models of the links, and the nodes' own models."""
        body = self.body
        scale = self.motor.scale
        smooth = (
            self.association.linear if body is None else BodyInBox(body, scale)
        )
        return Predictor(self.motor, smooth, self.local)

    @cached_property
    def solver(self) -> Solver:
        """Solver for joints of positions."""
        return solver_by_links(self.association, self.predictor)

    @cached_property
    def body_predictor(self) -> Predictor:
        """The body alone, without local models."""
        if self.body is None:
            raise OptionError(
                "readout 'body': the model has no body, choose another readout"
            )
        return replace(self.predictor, models=NO_MODELS)

    @cached_property
    def most_bound(self) -> float:
        """Largest bound [unit] with which a position is still an answer."""
        return MOST_SHARE * self.reach

    @cached_property
    def reach(self) -> float:
        """Largest distance [unit] of the tip from the middle of what it reaches."""
        if self.body is None:
            return 0.5 * self.solver.extent
        structure = self.body.structure
        return float(structure.extents[structure.position].max())

    @property
    def row_places(self) -> RowPlaces | None:
        """Places of the rows of a log without a body; None of others."""
        if self.baseline is None or self.body is not None:
            return None
        return self.baseline.seen

    @cached_property
    def posterior(self) -> CompactPosterior | None:
        """Belief for bounds of more than three joints; None where nodes' bounds are blended."""
        if self.body is None or self.motor.units.shape[1] <= MOST_BLENDED:
            return None
        from ..kernel.posterior import CompactPosterior

        try:
            return CompactPosterior.of(
                self.body, self.about.lower, self.about.upper
            )
        except OptionError:
            return None

    @cached_property
    def answers_whole_range(self) -> bool:
        """Whether there is an answer wherever joints are within their range."""
        within = bool((self.model_bounds <= self.most_bound).all())
        return within and self.row_places is None

    def in_range(self, q: Array) -> Mask:
        """Which joint values (n, dof) [rad or m] are within the joints' range.

        Periodic joints may be a turn beyond it: no arm is further away.
        """
        scale = self.motor.scale
        with np.errstate(over="ignore"):
            share = (q - scale.lower) / scale.span
        slack = np.where(scale.periodic, 1.0, ROUNDED)
        return (share >= -slack) & (share <= 1.0 + slack)

    def beyond_range(self, q: Array, *, degrees: bool = False) -> str | None:
        """The first of joint values (dof,) that is outside of its learned range, in words, or None.

        degrees : whether angles are in degrees
        """
        about = self.about
        for k in np.flatnonzero(~self.in_range(q[None])[0]).tolist():
            factor, unit = unit_of_joint(about.revolute[k], degrees)
            ends = range_in_words(about, k, degrees=degrees)
            value = f"{about.joint_names[k]} = {q[k] * factor:.6g} {unit}"
            return f"{value} is outside of the learned range {ends}"
        return None

    def covers(self, q: Array) -> Mask:
        """Whether joint values (n, dof) [rad or m] are answered, (n,)."""
        covered = np.asarray(self.in_range(q).all(axis=1))
        if not self.answers_whole_range and covered.any():
            u = self.motor.scale.to_unit(q[covered])
            bound = self._bound_of_nodes(u, self.model_bounds, noise=False)
            covered[covered] = bound <= self.most_bound
        return covered

    def bound_at(
        self,
        u: Array,
        which: BoundName = "bounds",
        *,
        side_known: Mask | None = None,
    ) -> Array:
        """95 % bound (n,) [unit] at points `u` of the unit box (n, dof).

        It is the sum of three: the posterior of the arm, how far joint values are from the
        rows of a log without a body, and what unknown play adds.

        side_known : (n,), whether `u` are the joints' true values; None: they are the encoders',
            and the true ones may be anywhere within the play
        """
        noise = which == "bounds" and self.about.bound_of == "sensor reading"
        scale = self.motor.scale
        belief = self.posterior or self.body
        if belief is not None and u.shape[1] > MOST_BLENDED:
            # a lattice covers too little of their box to blend between its nodes
            bound = belief.bound(scale.from_unit(u), noise=noise)
        else:
            bound = self._bound_of_nodes(u, getattr(self, which), noise=noise)
        if self.approach is None:
            return bound
        # with all joints at the worst side of their play
        slope = self.predictor.value_and_slope(u)[1] / scale.span
        reach = row_lengths(slope * self.approach.play).sum(axis=1)
        if side_known is not None:
            reach = np.where(side_known, 0.0, reach)
        return np.asarray(bound + reach)

    def _bound_of_nodes(self, u: Array, nodes: Array, *, noise: bool) -> Array:
        """Bounds (n,) at points `u` (n, dof), from those of the nodes (nodes,)."""
        bound = blend_nodes(self.motor, nodes, u)
        scale = self.motor.scale
        wide = bound > self.most_bound
        if self.body is not None and wide.any():
            # where a joint hardly moved the posterior widens within less than a node's
            # spacing: a blended bound would refuse the measured rows themselves
            belief = self.body.bound(scale.from_unit(u[wide]), noise=noise)
            bound[wide] = np.minimum(bound[wide], belief)
        if self.row_places is not None:
            beside = self.row_places.beside(scale, u)
            bound = bound + STEEP * self.solver.extent * beside
        return bound

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of a position's coordinates: x and y, and z for an arm in space."""
        return ("x", "y", "z")[: self.sensory.units.shape[1]]

    @property
    def default_readout(self) -> str:
        """``local``, the body and its local models; ``linear`` for maps and links alone."""
        if isinstance(self.predictor.smooth, LinearModels):
            return "linear"
        return "local"

    @property
    def readouts(self) -> tuple[str, ...]:
        """Readouts that differ, the default first."""
        if self.default_readout == "linear":
            return MAP_READOUTS
        if self.body is not None and self.predictor.models.degree >= 0:
            return ("local", "body", *MAP_READOUTS)
        return ("local", *MAP_READOUTS)

    def positions_at(self, u: Array, readout: str) -> Array:
        """Positions (n, m) that a readout answers at points (n, dof) of the unit box [unit]."""
        if readout == PREDICTOR:
            return self.predictor.value(u)
        if readout == "body":
            return self.body_predictor.value(u)
        return self.sensory.scale.from_unit(
            self.association.forward(u, readout)
        )

    def _resolve_readout(self, name: str | None) -> str:
        """`PREDICTOR` for the default readout, else the name itself."""
        check_choice("readout", name or PREDICTOR, READOUTS)
        if name == "local" and self.default_readout == "linear":
            raise OptionError(
                "readout 'local': the model has no body, choose 'linear'"
            )
        if name is None or name == self.default_readout:
            return PREDICTOR
        return name


def remembered(model: ModelParts, key: str, make: Callable[[], _T]) -> _T:
    """What `make` returned when it was first called for a model and a key."""
    if key not in model.cache:
        model.cache[key] = make()
    value: _T = model.cache[key]
    return value


def bounds_of_nodes(motor: Map, body: Body) -> tuple[Array, Array]:
    """A body's reading and position bounds (nodes,) [unit] at a map's nodes."""
    nodes = motor.scale.from_unit(motor.units_in_box)
    return body.bound(nodes), body.bound(nodes, noise=False)


def with_arm_of(parts: _P, adapted: _P, events: Sequence[Document]) -> _P:
    """Return one sensor's parts with the arm of another one's adapted model.

    The parts of the sensor that was adapted are the adapted model's.

    events : of the adaptation, as the adapted model's history has them
    """
    if parts.about.sensor == adapted.about.sensor:
        return replace(adapted, others=())
    alone = replace(parts, others=())
    before = parts.body
    after = adapted.body
    if before is None or after is None:
        return alone
    names = [label.name for label in before.structure.labels]
    if names != [label.name for label in after.structure.labels]:
        return alone
    body = replace(
        before,
        beta=after.beta,
        active=after.active,
        root=after.root,
        scales=after.scales,
        second=after.second,
    )
    reading_bounds, position_bounds = bounds_of_nodes(parts.motor, body)
    of_that_sensor = ("frame", "before", "after")
    shared = [
        {name: event[name] for name in event if name not in of_that_sensor}
        for event in events
    ]
    return replace(
        alone,
        body=body,
        bounds=np.maximum(parts.bounds, reading_bounds),
        model_bounds=np.maximum(parts.model_bounds, position_bounds),
        history=(*parts.history, *shared),
        approach=adapted.approach,
    )
