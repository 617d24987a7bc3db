"""A body: structure, parameters at their maximum and their covariance; what ``model.body`` is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, NamedTuple, TypeVar

import numpy as np

from ..common.arrays import TRIANGLE, Array, Shape
from ..common.rows import row_lengths
from .covariance import Z95, as_kept, radius_95, root_of, spread_of
from .parameters import Gaussian, Indices, Prior
from .sensor_pose import SensorPose
from .settings import PRIOR_SHARE, SHARED
from .structure import OfStructure, Structure
from .views import is_camera
from .words import words_of

_Belief = TypeVar("_Belief", "Body", "GuardFit")

_CHUNK = 2000  # rows that a bound is evaluated for at a time


class Parameter(NamedTuple):
    """One parameter of a body with its 95 % interval."""

    name: str
    group: str
    joint: str | None
    value: float  # in `unit`
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class GuardFit(Gaussian):
    """A second fit with a wider hyperprior of the curves; the bound takes the worse of both."""

    beta: Annotated[Array, Shape("parameters")]
    # the fitted parameters: those of the first fit and the curves
    active: Annotated[Indices, Shape("k")]
    # root of their covariance
    root: Annotated[Array, Shape("k", "k", storage=TRIANGLE)]


@dataclass(frozen=True)
class Body(OfStructure):
    """A Gaussian belief over the parameters of an arm and its sensor.

    The bound takes the worse of two fits, this one and `second`::

        bound = max(kappa r95(S^2 J C J' + R), |f - f2| + r95(J2 C2 J2' + R))
        R = residual^2 + noise^2            of readings
        R = residual^2 + noise^2 - repeat^2 of the true position; residual^2 in a simulation

    with `SHARED` S, predictions f, their derivatives J, covariances C, and the radius r95 that
    holds 95 % of a Gaussian.  `tau` has no part in it: it is the size of the smooth error that a
    log of an unchanged arm may show (`calib.change`).
    """

    structure: Structure
    # parameters at the maximum of the posterior
    beta: Annotated[Array, Shape("parameters")]
    active: Annotated[Indices, Shape("k")]  # the parameters that were fitted
    # (k, r), root of their posterior covariance, which is root root'; a triangle after a fit
    root: Annotated[Array, Shape("k", "k", storage=TRIANGLE)]
    # noise sd of each output [unit; rad for rotations]
    noise: Annotated[Array, Shape("outputs")]
    kappa: float  # inflation of the bound by held-out errors, at least 1
    # (m,), sd of the body's own error: held-out errors beyond the noise [unit]
    tau: Annotated[Array, Shape("outputs")]
    # (m,), sd of an error that an adaptation could not explain [unit]
    residual: Annotated[Array, Shape("outputs")]
    # prior scales that the evidence chose, by the name of their `Hyper`
    scales: Mapping[str, float] = field(default_factory=dict)
    rows: int = 0  # rows of the fit
    # whether the rows were samples of a simulation
    simulated: bool = False
    member: str = ""  # name of the gate's member
    second: GuardFit | None = None
    # sd of readings of one pose [unit]; 0 where no pose was repeated
    repeat: float = 0.0

    def with_covariance(self, indices: Indices, covariance: Array) -> Body:
        """The belief with a further covariance (p, p) of some parameters (p,)."""
        root = self.full_root
        total = root @ root.T
        total[np.ix_(indices, indices)] += covariance
        active = np.union1d(self.active, indices)
        root = root_of(total[np.ix_(active, active)])
        return replace(self, active=active, root=root)

    def prior(self, free: Sequence[str]) -> Prior:
        """Prior that frees the blocks of `free`, as wide as the evidence found them, at least."""
        prior = self.structure.prior(free)
        sd = prior.sd.copy()
        for hyper in prior.hypers:
            larger = max(self.scales.get(hyper.name, 0.0) / hyper.scale, 1.0)
            sd[hyper.indices] *= larger
        return replace(prior, sd=sd)

    def predict(self, q: Array) -> Array:
        """Outputs (n, m) at joint values (n, dof) [rad or m]."""
        q = np.asarray(q, dtype=float)
        return self.structure.predict(q, self.beta)

    def predict_and_slope(self, q: Array) -> tuple[Array, Array]:
        """Outputs (n, m) and their derivative (n, m, dof) by the joint values."""
        q = np.asarray(q, dtype=float)
        return self.structure.predict_and_slope(q, self.beta)

    def bound(self, q: Array, *, noise: bool = True) -> Array:
        """95 % bound (n,) on the distance of positions to what the sensor reads, or to the truth.

        q : (n, dof), joint values
        noise : whether the sensor's noise is part of the distance
        """
        q = np.asarray(q, dtype=float)
        limits = range(_CHUNK, len(q), _CHUNK)
        chunks = np.split(q, limits)
        bounds = [self._bound(chunk, noise) for chunk in chunks]
        return np.concatenate(bounds)

    def remaining_variance(self, *, noise: bool) -> Array:
        """Variance R (p,) of positions that no parameter explains, of readings or of the truth.

        Only repeated poses separate the noise of readings from errors of the model: without them
        all of a log's residual counts as the model's.  That of a simulation is the sensor's.
        """
        position = self.structure.position
        variance = self.noise[position] ** 2
        if not noise:
            variance = np.maximum(variance - self.repeat**2, 0.0)
            if self.simulated:
                variance = np.zeros_like(variance)
        return self.residual[position] ** 2 + variance

    def spread(self, q: Array) -> Array:
        """Covariance (n, m, m) of the predictions from the parameters alone, without kappa."""
        q = np.asarray(q, dtype=float)
        _, slope = self.structure.linearise(q, self.beta, self.active)
        return spread_of(slope, self.root)

    def _bound(self, q: Array, noise: bool) -> Array:
        structure = self.structure
        position = structure.position
        second = self.second
        remaining = np.diag(self.remaining_variance(noise=noise))
        predicted, slope = structure.linearise(q, self.beta, self.active)
        spread = SHARED**2 * spread_of(slope[:, position], self.root)
        bound = self.kappa * radius_95(spread + remaining)
        if second is not None:
            other, slope = structure.linearise(q, second.beta, second.active)
            difference = structure.residual(predicted, other)
            distance = row_lengths(difference[:, position])
            spread = spread_of(slope[:, position], second.root)
            bound_of_second = distance + radius_95(spread + remaining)
            bound = np.maximum(bound, bound_of_second)
        return bound

    def with_beliefs(
        self, change: Callable[[Gaussian], tuple[Array, Array]]
    ) -> Body:
        """The body with other beliefs in both its fits.

        change : gives the parameters (d,) and the root (d, r) of their covariance
        """
        body = _with_belief(self, *change(self))
        if self.second is None:
            return body
        second = _with_belief(self.second, *change(self.second))
        return replace(body, second=second)

    @property
    def sds(self) -> Array:
        """Posterior sd (d,) of each parameter, zero where nothing was fitted."""
        sd = np.zeros(self.structure.size)
        sd[self.active] = row_lengths(self.root)
        return sd

    @property
    def sds_by_rows(self) -> Array:
        """Sd (d,) of each parameter as the rows determine it.

        The last joint's offset and the turn of an unknown tool are one: where the posterior is
        the prior, the rows do not determine it, and its sd is that of a turn.
        """
        sd = self.sds
        groups = self.structure.groups
        last = groups["offset"][-1]
        vague = PRIOR_SHARE * self.scales.get("offset", np.inf)
        tool_is_free = sd[groups.get("tool", [])].any()
        if tool_is_free and self.structure.revolute[-1] and sd[last] >= vague:
            sd[last] = np.pi / Z95
        return sd

    def parameters(self) -> tuple[Parameter, ...]:
        """The fitted parameters with 95 % intervals; the curves' harmonics are left out.

        Offsets are those from the drawing, in the joint's own sense.
        """
        half = Z95 * self.sds_by_rows
        values = self.beta.copy()
        values[self.structure.groups["offset"]] = self.structure.zeros(
            self.beta
        )
        parameters: list[Parameter] = []
        for k in self.active.tolist():
            group, joint, name, unit = self.structure.labels[k]
            if not group.startswith("curve"):
                value = float(values[k])
                ends = (float(value - half[k]), float(value + half[k]))
                parameters.append(
                    Parameter(name, group, joint, value, *ends, unit)
                )
        return tuple(parameters)

    def __repr__(self) -> str:
        """Summarise what was learned, a line for each joint and view."""
        return "\n".join([f"Body of {self.rows} rows", *self.describe()])

    def describe(
        self, lower: Array | float = -np.pi, upper: Array | float = np.pi
    ) -> tuple[str, ...]:
        """The body in words, one line for each joint and view.

        lower, upper : (dof,) [rad or m], range within which loads bend the joints; by default
            a turn
        """
        structure = self.structure
        sd = self.sds_by_rows
        lines = [*words_of(structure, self.beta, sd, lower, upper)]
        if not self.simulated:  # both bounds of a simulation are on the truth
            repeats = "no pose was repeated: all of the residual counts as the model's"
            if self.repeat:
                repeats = f"readings of one pose repeat to {self.repeat:.2g} {structure.unit}"
            lines.append(
                "`expected_error` bounds what the sensor reads, `model_error` where the tip is; "
                f"{repeats}"
            )
        pose = SensorPose.of(self)
        if pose is not None and structure.view != "base":
            is_seen = is_camera(structure.view)
            lines += pose.words("camera" if is_seen else "sensor's frame")
        return tuple(lines)

    def to_json(self) -> dict[str, Any]:
        """JSON-ready summary: member, view, noise, parameters with intervals, words."""
        return {
            "member": self.member,
            "view": self.structure.view,
            "unit": self.structure.unit,
            "rows": self.rows,
            "noise": self.noise.tolist(),
            "kappa": self.kappa,
            "parameters": [p._asdict() for p in self.parameters()],
            "words": list(self.describe()),
        }


def _with_belief(belief: _Belief, beta: Array, root: Array) -> _Belief:
    """A fit with other parameters (d,) and the root (d, r) of their covariance."""
    active = np.flatnonzero(root.any(axis=1))
    kept = as_kept(root[active])
    return replace(belief, beta=beta, active=active, root=kept)


def knows_orientation(body: Body | None) -> bool:
    """Whether a body was learned from orientations too."""
    if body is None:
        return False
    turns = body.structure.groups.get("tool.rotation")
    if turns is None:
        return False
    is_fitted = np.isin(turns, body.active)
    return bool(is_fitted.all())
