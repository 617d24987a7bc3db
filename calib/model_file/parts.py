"""Parts that models and kept schemas share: tensors, smooth parts, local models, baselines.

A file may come from anyone: each tensor is taken with the shape and the type that it must have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.basis import Basis, exponents
from ..body.belief import Body
from ..body.storing import body_arrays, body_header, rebuild_body
from ..body.trend import Trend
from ..common.checks import LARGEST, finite, numbers, of_type
from ..common.scale import Scale
from ..maps.linear_models import LinearModels
from ..maps.local_models import FULL, MOST_DEGREE, NO_MODELS, OLD_SILENT, LocalModels
from ..maps.predictor import BodyInBox, Both, Smooth
from ..model.baseline import Baseline

WHOLE = "whole numbers"
"""Stands for unsigned integers of any width: as few bytes as the numbers need."""

_SMALL = 1e-9  # radians that are a range
_FUNCTIONS = 100_000  # of a trend
_DEGREE = 60  # of a trend
_BODY = "body."  # prefix of the body's arrays


@dataclass(frozen=True)
class Tensors:
    """The tensors of a file whose names begin with a prefix."""

    arrays: Mapping[str, NDArray[Any]]
    prefix: str = ""

    def __contains__(self, name: str) -> bool:
        return self.prefix + name in self.arrays

    def under(self, prefix: str) -> Tensors:
        """Tensors whose names go on with a further prefix."""
        return Tensors(self.arrays, self.prefix + prefix)

    def named(self) -> dict[str, NDArray[Any]]:
        """Tensors by the rest of their names, unchecked."""
        start = len(self.prefix)
        return {n[start:]: array for n, array in self.arrays.items() if n.startswith(self.prefix)}

    def take(self, name: str, shape: tuple[int, ...], kind: str = "float64") -> NDArray[Any]:
        """Return a tensor, floats of any width as float64; -1 in `shape` stands for any length.

        Raises KeyError, ValueError if it is not there, has another shape or type, or a value that
        is not finite.
        """
        name = self.prefix + name
        array = self.arrays[name]
        fits = array.dtype.kind == "u" if kind == WHOLE else array.dtype == kind
        lengths = len(shape) == array.ndim and all(
            n in (-1, m) for n, m in zip(shape, array.shape, strict=True)
        )
        if not (fits and lengths):
            raise ValueError(f"{name} is {array.dtype} {array.shape}, expected {kind} {shape}")
        if array.dtype.kind == "u":
            return array
        array = array.astype(float, copy=False)
        if not (np.abs(array) < LARGEST).all():  # nor is NaN below it
            raise ValueError(f"{name} holds a value that is not finite, or beyond {LARGEST:g}")
        return array


def whole(value: Any, most: int, least: int = 0) -> int:
    """Return a whole number within bounds, else raise ValueError."""
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{value!r} is not a whole number from {least} to {most}")
    return value


def models_header(models: LocalModels) -> dict[str, Any]:
    """JSON-ready description of local models; earlier files keep their bytes."""
    stated: dict[str, Any] = {"degree": models.degree, "samples": models.samples}
    if not models.votes:
        return stated
    return {**stated, "votes": True if models.votes == OLD_SILENT else models.votes}


def _votes_in(stated: Mapping[str, Any]) -> float:
    """The votes of silent nodes, see :class:`LocalModels`; true is the share of earlier files."""
    votes = stated.get("votes", False)
    if isinstance(votes, bool):
        return OLD_SILENT if votes else 0.0
    share = of_type("votes", votes, float)
    if not 0.0 < share < FULL:
        raise ValueError(f"votes {share:g}: expected a share below {FULL:g}")
    return share


def build_models(
    stated: Mapping[str, Any],
    tensors: Tensors,
    names: tuple[str, str, str],
    size: tuple[int, int, int],
    *,
    kind: str = "float64",
    fades: bool = False,
) -> LocalModels:
    """Rebuild local models from their description and their tensors.

    names : of the tensors with the radii, the coefficients and, where there are some, the gates
    size : nodes, joints and coordinates of a position
    fades : where the description does not say so; format 1 did not
    """
    nodes, dof, width = size
    degree = whole(stated["degree"], MOST_DEGREE, least=-1)
    samples = whole(stated["samples"], 10**9)
    fades = of_type("fades", stated.get("fades", fades), bool)
    votes = _votes_in(stated)
    if degree < 0:
        return replace(NO_MODELS, samples=samples, fades=fades, votes=votes)
    radius = tensors.take(names[0], (nodes,), kind)
    if not (radius > 0.0).all():
        raise ValueError(f"{tensors.prefix}{names[0]} is not above zero")
    terms = len(exponents(dof, degree))
    coefficients = tensors.take(names[1], (nodes, terms, width), kind)
    gates = tensors.take(names[2], (nodes, dof + 1), kind) if names[2] in tensors else None
    return LocalModels(degree, samples, radius, coefficients, fades, votes, gates)


def build_baseline(stated: Any, tensors: Tensors, motor: int, sensory: int) -> Baseline | None:
    """Rebuild a baseline for so many motor and sensory nodes; None where none was kept."""
    if stated is None:
        return None
    told = of_type("baseline", stated, dict)
    if min(*numbers("spread", told["spread"], 2), finite("noise", told["noise"])) < 0.0:
        raise ValueError("a variance of the baseline is negative")
    parts = tensors.under("baseline.")
    nodes = {"motor": motor, "sensory": sensory}
    return Baseline.from_json(told, *(parts.take(n, (k,), "float32") for n, k in nodes.items()))


def baseline_tensors(baseline: Baseline | None) -> dict[str, NDArray[Any]]:
    """Arrays of a baseline, by name."""
    if baseline is None:
        return {}
    parts = {"motor": baseline.motor, "sensory": baseline.sensory}
    return {f"baseline.{name}": part.astype(np.float32) for name, part in parts.items()}


def smooth_header(smooth: Smooth) -> dict[str, Any]:
    """JSON-ready description of a smooth part."""
    body, trend = _parts(smooth)
    basis = None if trend is None else trend.basis
    return {
        "linear": isinstance(smooth, LinearModels),
        "body": body and body_header(body),
        "trend": basis and {"turns": [*basis.turns], "degree": basis.degree, "each": basis.each},
    }


def smooth_tensors(smooth: Smooth) -> dict[str, NDArray[Any]]:
    """Arrays of a smooth part, by name."""
    body, trend = _parts(smooth)
    own = {} if body is None else body_arrays(body)
    tensors = {_BODY + name: array for name, array in own.items()}
    if trend is not None:
        tensors["trend.coefficients"] = trend.coefficients
    return tensors


def _parts(smooth: Smooth) -> tuple[Body | None, Trend | None]:
    """The body and the trend that a smooth part consists of."""
    if isinstance(smooth, Both):
        first, second = _parts(smooth.first), _parts(smooth.second)
        return first[0] or second[0], first[1] or second[1]
    if isinstance(smooth, BodyInBox):
        return smooth.body, None
    if isinstance(smooth, Trend):
        return None, smooth
    if isinstance(smooth, LinearModels):  # made of the maps and the links
        return None, None
    raise TypeError(f"{type(smooth).__name__} is no smooth part that a file can hold")


def build_smooth(
    header: Mapping[str, Any],
    tensors: Tensors,
    scale: Scale,
    outputs: int,
    linear: Callable[[], LinearModels],
) -> tuple[Smooth, Body | None]:
    """Rebuild a smooth part from a file's description and arrays; both are checked.

    Raises CalibError, KeyError, TypeError, ValueError if they make no sense.
    """
    stated = {"body": None, "trend": header["trend"]} if "trend" in header else header["smooth"]
    if stated.get("linear"):
        return linear(), None
    body = None
    if stated["body"] is not None:
        body = rebuild_body(stated["body"], tensors.under(_BODY).named())
        if body.structure.dof != len(scale.span):
            raise ValueError("the body is of another arm")
    trend = _trend(stated["trend"], tensors, scale, outputs) if stated["trend"] else None
    if body is None:
        if trend is None:
            raise ValueError("there is neither a body nor a trend")
        return trend, None
    inside = BodyInBox(body, scale)
    return (inside if trend is None else Both(inside, trend)), body


def _trend(stated: Mapping[str, Any], tensors: Tensors, scale: Scale, outputs: int) -> Trend:
    dof = len(scale.span)
    turns = tuple(float(t) for t in stated["turns"])
    if len(turns) != dof:
        raise ValueError("the trend is of another arm")
    if not all(turn == 0.0 or _SMALL <= turn < LARGEST for turn in turns):  # zero of slides
        raise ValueError(f"{turns} are no turns")
    degree, each = (whole(stated[name], _DEGREE) for name in ("degree", "each"))
    if math.comb(degree + dof, dof) > _FUNCTIONS:
        raise ValueError("the trend has too many functions")
    basis = Basis(turns, degree, each)
    return Trend(basis, tensors.take("trend.coefficients", (len(basis.orders), outputs)))
