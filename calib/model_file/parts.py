"""Parts that models and kept schemas have in common: tensors, local models, baselines, checked.

A file may come from anyone: each tensor is taken with the shape and the type that it must have.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.basis import exponents
from ..common.checks import LARGEST, finite, numbers, of_type
from ..maps.local_models import FULL, MOST_DEGREE, NO_MODELS, OLD_SILENT, LocalModels
from ..model.baseline import Baseline

WHOLE = "whole numbers"
"""Stands for unsigned integers of any width: as few bytes as the numbers need."""


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
        if not (np.abs(array) < LARGEST).all():
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
