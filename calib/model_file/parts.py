"""Parts of a model file: smooth parts, local models, baselines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body
from ..common.scale import Scale
from ..errors import ModelError
from ..maps.linear_models import LinearModels
from ..maps.local_models import MOST_DEGREE, NO_MODELS, LocalModels, exponents
from ..maps.predictor import BodyInBox, Smooth
from ..model.baseline import Baseline
from .bodies import body_arrays, body_header, rebuild_body
from .checked import POSITIVE, Tensors, given_fields, plain_fields, refuse_impossible

_BODY = "body."  # prefix of the body's arrays

_BASELINE = ("spread", "noise")
_LOCAL = ("degree", "samples")


def models_header(models: LocalModels) -> dict[str, Any]:
    """JSON-ready description of local models."""
    return plain_fields(models, _LOCAL)


def build_models(
    told: Any, tensors: Tensors, names: tuple[str, str], size: tuple[int, int, int]
) -> LocalModels:
    """Rebuild local models from their description and their tensors.

    names : of the tensors with the radii and the coefficients
    size : nodes, joints and coordinates of a position
    """
    nodes, dof, width = size
    found = given_fields(LocalModels, told, "local", _LOCAL)
    degree = found["degree"]
    refuse_impossible(
        {f"a degree from -1 to {MOST_DEGREE}": not -1 <= degree <= MOST_DEGREE}, "local"
    )
    refuse_impossible({"samples of 0 or more": not 0 <= found["samples"] <= 10**9}, "local")
    if degree < 0:
        return replace(NO_MODELS, **found)
    return LocalModels(
        **found,
        radius=tensors.take(names[0], (nodes,), least=POSITIVE),
        coefficients=tensors.take(names[1], (nodes, len(exponents(dof, degree)), width)),
    )


def baseline_header(baseline: Baseline | None) -> dict[str, Any] | None:
    """JSON-ready description of a baseline; `baseline_tensors` are the rest."""
    return None if baseline is None else plain_fields(baseline, _BASELINE)


def baseline_tensors(baseline: Baseline | None) -> dict[str, NDArray[Any]]:
    """Arrays of a baseline, by name."""
    if baseline is None:
        return {}
    parts = {"motor": baseline.motor, "sensory": baseline.sensory}
    return {f"baseline.{name}": part.astype(np.float32) for name, part in parts.items()}


def build_baseline(told: Any, tensors: Tensors, motor: int, sensory: int) -> Baseline | None:
    """Rebuild a baseline for so many motor and sensory nodes; None where none was kept."""
    if told is None:
        return None
    found = given_fields(Baseline, told, "baseline", _BASELINE)
    refuse_impossible(
        {"variances of 0 or more": min(*found["spread"], found["noise"]) < 0.0}, "baseline"
    )
    own = tensors.under("baseline.")
    found["motor"] = own.take("motor", (motor,), "float32")
    return Baseline(sensory=own.take("sensory", (sensory,), "float32"), **found)


def smooth_header(smooth: Smooth) -> dict[str, Any]:
    """JSON-ready description of a smooth part; linear models are made of maps and links."""
    body = smooth.body if isinstance(smooth, BodyInBox) else None
    return {"linear": isinstance(smooth, LinearModels), "body": body and body_header(body)}


def smooth_tensors(smooth: Smooth) -> dict[str, NDArray[Any]]:
    """Arrays of a smooth part, by name."""
    arrays = body_arrays(smooth.body) if isinstance(smooth, BodyInBox) else {}
    return {_BODY + name: array for name, array in arrays.items()}


def build_smooth(
    header: Mapping[str, Any],
    tensors: Tensors,
    scale: Scale,
    linear: Callable[[], LinearModels],
) -> tuple[Smooth, Body | None]:
    """Rebuild a smooth part from a file's description and arrays; both are checked.

    Raises CalibError, KeyError, TypeError, ValueError if they make no sense.
    """
    told = header["smooth"]
    if told.get("linear"):
        return linear(), None
    if told["body"] is None:
        raise ModelError("there is neither a body nor maps that stand alone")
    body = rebuild_body(told["body"], tensors.under(_BODY))
    refuse_impossible({"a body of this arm": body.structure.dof != len(scale.span)}, "smooth")
    return BodyInBox(body, scale), body
