"""Parameters: named blocks with unit and prior, and beliefs over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, ReadOnly, frozen

Indices = NDArray[np.intp]


class Label(NamedTuple):
    """What one parameter is, for words and JSON."""

    group: str  # its block
    joint: str | None  # the joint that it belongs to
    name: str  # its name within the body, unique: ``"elbow_joint.offset"``, ``"view.rotation"``
    unit: str  # ``"rad"``, ``"1"``, the unit of positions


class Hyper(NamedTuple):
    """Parameters whose common prior scale follows from the evidence.

    The prior variance of parameter ``indices[k]`` is ``scale**2 * shape[k]``.
    """

    name: str  # name of the scale in `Body.scales`: ``"length"``, ``"curve.0"``
    # initial scale, and scale of the pseudo-observations
    scale: float
    # times `scale`, between which the evidence looks
    within: tuple[float, float] = (0.0, np.inf)
    # number of pseudo-observations at `scale` (an inverse-gamma hyperprior)
    pseudo: float = 0.0
    # the parameters, in a block those of the block, in a prior (g,) of all
    indices: Any = slice(None)
    shape: Any = 1.0  # (g,), relative variances


@dataclass(frozen=True, eq=False)
class Block:
    """Parameters of one kind, which are freed together."""

    name: str
    # joint, name and unit of each, as `Label`
    parts: tuple[tuple[str | None, str, str], ...]
    mean: Array | float = 0.0  # prior mean
    # prior sd where the block is freed; 0 holds a parameter at its mean
    sd: Array | float = 0.0
    scales: tuple[Hyper, ...] = ()  # whose sd the evidence chooses instead

    @staticmethod
    def of(
        name: str,
        unit: str | Sequence[str],
        parts: Sequence[str] = (),
        sd: Array | float = 0.0,
        mean: Array | float = 0.0,
        scales: tuple[Hyper, ...] = (),
        joints: Sequence[str | None] = (None,),
    ) -> Block:
        """Parameters named `parts`, once for each joint; `unit` may be a cycle."""
        units = cycle([unit] if isinstance(unit, str) else unit)
        labels: list[tuple[str | None, str, str]] = []
        for joint in joints:
            owner = joint or name
            for label in [f"{owner}.{part}" for part in parts] or [owner]:
                labels.append((joint, label, next(units)))
        return Block(name, tuple(labels), mean, sd, scales)

    def with_sensor_name(self, sensor: str) -> Block:
        """The block with the name of a sensor before its parameters'."""
        if not sensor:
            return self
        parts = tuple(
            (joint, f"{sensor}.{part}", u) for joint, part, u in self.parts
        )
        return replace(self, parts=parts)


@dataclass(frozen=True)
class Prior:
    """A Gaussian prior over the parameters: a zero `sd` keeps a parameter at its `mean`."""

    # (d,), prior mean and standard deviation, in each parameter's own unit
    mean: Array
    sd: Array
    # groups whose scale the evidence chooses; `sd` holds their starting values
    hypers: tuple[Hyper, ...] = ()
    # (k, k), precision of the active parameters where they depend on each other, in place of `sd`
    precision: Array | None = None

    @property
    def active(self) -> Indices:
        """Indices (k,) of the parameters that are fitted."""
        return np.flatnonzero(self.sd > 0)


class Gaussian(ReadOnly):
    """A Gaussian belief over some parameters, kept as the root of a covariance."""

    beta: Array  # (d,)
    active: Indices  # (k,), those that it is over
    root: Array  # (k, r), of their covariance

    @cached_property
    def covariance(self) -> Array:
        """Covariance (k, k) of the active parameters."""
        return frozen(self.root @ self.root.T)

    @property
    def full_root(self) -> Array:
        """Root (d, r) of the covariance of all parameters, zero where nothing was fitted."""
        root = np.zeros((len(self.beta), self.root.shape[1]))
        root[self.active] = self.root
        return root
