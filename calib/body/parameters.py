"""Parameters: named blocks with unit and prior, and where each stands in a structure's vector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.frozen import ReadOnly, frozen

Indices = NDArray[np.intp]

Part = tuple[str | None, str, str]
"""Joint that a parameter belongs to, its name within the body, its unit."""


class Label(NamedTuple):
    """What one parameter is, for words and JSON."""

    group: str  # the block that it is of
    joint: str | None  # the joint that it belongs to
    name: str  # its name within the body, unique: ``"elbow_joint.offset"``, ``"view.rotation"``
    unit: str  # ``"rad"``, ``"1"``, the unit of positions


class Hyper(NamedTuple):
    """Parameters whose common prior scale is chosen by evidence.

    The prior variance of parameter ``indices[k]`` is ``scale**2 * shape[k]``.
    """

    name: str  # name of the scale, as `Body.scales` keeps it: ``"length"``, ``"curve.0"``
    scale: float  # where the evidence starts; also the scale of the pseudo-observations
    choices: tuple[float, ...] = ()  # factors that are compared; none: it moves freely by EM
    # number of pseudo-observations at `scale` (an inverse-gamma hyperprior) where it moves
    pseudo: float = 0.0
    # the parameters, in a block those of the block (None: all of it), in a prior (g,) of all
    indices: Any = None
    shape: Any = None  # (g,), relative variances; None: all alike


@dataclass(frozen=True, eq=False)
class Block:
    """Parameters of one kind, which are freed together."""

    name: str
    parts: tuple[Part, ...]
    mean: Array | float = 0.0  # prior mean
    sd: Array | float = 0.0  # prior sd where the block is freed; 0 holds a parameter at its mean
    scales: tuple[Hyper, ...] = ()  # whose sd the evidence chooses instead

    @staticmethod
    def of(name: str, unit: str, names: Sequence[str], sd: Any, mean: Any = 0.0) -> Block:
        """Parameters of no joint, in one unit."""
        return Block(name, tuple((None, each, unit) for each in names), mean, sd)


@dataclass(frozen=True)
class Prior:
    """A Gaussian prior over the parameters: a zero `sd` keeps a parameter at its `mean`."""

    # (d,), prior mean and standard deviation, in each parameter's own unit
    mean: Array
    sd: Array
    # groups whose scale the evidence chooses; `sd` holds their starting values
    hypers: tuple[Hyper, ...] = ()
    # (k, k), precision of the active parameters where they depend on each other, in place of `sd`
    known: Array | None = None

    @property
    def active(self) -> Indices:
        """Indices (k,) of the parameters that are fitted."""
        return np.flatnonzero(self.sd > 0)


class Layout:
    """Where each parameter of some blocks stands in the vector, and what it is."""

    def __init__(self, blocks: tuple[tuple[str, tuple[Part, ...]], ...]) -> None:
        self.labels = tuple(Label(name, *part) for name, parts in blocks for part in parts)
        groups: dict[str, Indices] = {}
        start = 0
        for name, parts in blocks:
            groups[name] = np.arange(start, start := start + len(parts))
            groups[name].setflags(write=False)
        self.groups: Mapping[str, Indices] = groups  # a plain one: models are pickled
        self.size = start


layout_of = lru_cache(maxsize=64)(Layout)  # variants of a structure share theirs


def prior_of(blocks: Sequence[Block], layout: Layout, mean: Array, free: Sequence[str]) -> Prior:
    """Prior that frees the blocks of `free`; ``"curve"`` stands for all joints' curves."""
    sd, hypers = np.zeros(layout.size), []
    for block in blocks:
        if block.name not in free and block.name.partition(".")[0] not in {"curve"} & {*free}:
            continue
        own = layout.groups[block.name]
        sd[own] = block.sd
        for each in block.scales:
            indices = own if each.indices is None else own[each.indices]
            shape = np.ones(len(indices)) if each.shape is None else each.shape
            sd[indices] = each.scale * np.sqrt(shape)
            if len(indices):
                hypers.append(each._replace(indices=indices, shape=shape))
    # offsets before the placements: turned and shifted origins would explain an offset too, by
    # freeing sixfold what they are; of a camera's arm they took 2 deg where 0.2 deg was true
    hypers.sort(key=lambda hyper: hyper.name.startswith("placement"))
    return Prior(mean, sd, tuple(hypers))


class Gaussian(ReadOnly):
    """A Gaussian belief over some parameters, kept as the root of a covariance."""

    beta: Array  # (d,)
    active: Indices  # (k,), those that it is over
    root: Array  # (k, r), of their covariance

    @cached_property
    def covariance(self) -> Array:
        """Covariance (k, k) of the active parameters."""
        return frozen(self.root @ self.root.T)
