"""Parts of a model file: smooth parts, local models, baselines."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.basis import Basis, exponents
from ..body.belief import Body
from ..body.trend import Trend
from ..common.scale import Scale
from ..errors import ModelError
from ..maps.linear_models import LinearModels
from ..maps.local_models import FULL, MOST_DEGREE, NO_MODELS, OLD_SILENT, LocalModels
from ..maps.predictor import BodyInBox, Both, Smooth
from ..model.baseline import Baseline
from .bodies import body_arrays, body_header, rebuild_body
from .checked import POSITIVE, Tensors, given, given_fields, plain_fields, refuse_impossible

_SMALL = 1e-9  # radians that are a range
_FUNCTIONS = 100_000  # of a trend
_DEGREE = 60  # of a trend
_BODY = "body."  # prefix of the body's arrays

_BASELINE = ("spread", "noise")
_LOCAL = ("degree", "samples")
_TREND = ("turns", "degree", "each")


def models_header(models: LocalModels) -> dict[str, Any]:
    """JSON-ready description of local models; earlier files keep their bytes."""
    told = plain_fields(models, _LOCAL)
    if not models.votes:
        return told
    return {**told, "votes": True if models.votes == OLD_SILENT else models.votes}


def _votes_in(told: Mapping[str, Any]) -> float:
    """The votes of silent nodes, see :class:`LocalModels`; true is the share of earlier files."""
    votes = told.get("votes", False)
    if isinstance(votes, bool):
        return OLD_SILENT if votes else 0.0
    share: float = given(float, votes, "local.votes")
    refuse_impossible({f"votes of a share below {FULL:g}": not 0.0 < share < FULL}, "local")
    return share


def build_models(
    told: Any,
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
    found = given_fields(LocalModels, {"fades": fades, **told}, "local", (*_LOCAL, "fades"))
    degree, votes = found["degree"], _votes_in(told)
    refuse_impossible(
        {f"a degree from -1 to {MOST_DEGREE}": not -1 <= degree <= MOST_DEGREE}, "local"
    )
    refuse_impossible({"samples of 0 or more": not 0 <= found["samples"] <= 10**9}, "local")
    if degree < 0:
        return replace(NO_MODELS, **found, votes=votes)
    return LocalModels(
        **found,
        radius=tensors.take(names[0], (nodes,), kind, least=POSITIVE),
        coefficients=tensors.take(names[1], (nodes, len(exponents(dof, degree)), width), kind),
        votes=votes,
        gates=tensors.take(names[2], (nodes, dof + 1), kind) if names[2] in tensors else None,
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
    """JSON-ready description of a smooth part."""
    body, trend = _parts(smooth)
    return {
        "linear": isinstance(smooth, LinearModels),
        "body": body and body_header(body),
        "trend": trend and plain_fields(trend.basis, _TREND),
    }


def smooth_tensors(smooth: Smooth) -> dict[str, NDArray[Any]]:
    """Arrays of a smooth part, by name."""
    body, trend = _parts(smooth)
    tensors = {_BODY + name: array for name, array in (body_arrays(body) if body else {}).items()}
    return tensors | ({"trend.coefficients": trend.coefficients} if trend else {})


def _parts(smooth: Smooth) -> tuple[Body | None, Trend | None]:
    """The body and the trend that a smooth part consists of; linear models are made of maps."""
    parts = (smooth.first, smooth.second) if isinstance(smooth, Both) else (smooth,)
    body = next((part.body for part in parts if isinstance(part, BodyInBox)), None)
    return body, next((part for part in parts if isinstance(part, Trend)), None)


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
    told = {"body": None, "trend": header["trend"]} if "trend" in header else header["smooth"]
    if told.get("linear"):
        return linear(), None
    body = None
    if told["body"] is not None:
        body = rebuild_body(told["body"], tensors.under(_BODY))
        refuse_impossible({"a body of this arm": body.structure.dof != len(scale.span)}, "smooth")
    trend = _trend(told["trend"], tensors, scale, outputs) if told["trend"] else None
    if body is None:
        if trend is None:
            raise ModelError("there is neither a body nor a trend")
        return trend, None
    inside = BodyInBox(body, scale)
    return (inside if trend is None else Both(inside, trend)), body


def _trend(told: Any, tensors: Tensors, scale: Scale, outputs: int) -> Trend:
    basis, dof = given(Basis, told, "trend"), len(scale.span)
    refuse_impossible(
        {
            f"{dof} turns, 0 of slides": len(basis.turns) != dof
            or not all(turn == 0.0 or turn >= _SMALL for turn in basis.turns),
            f"degrees from 0 to {_DEGREE}": not min(basis.degree, basis.each) >= 0
            or max(basis.degree, basis.each) > _DEGREE
            or math.comb(basis.degree + dof, dof) > _FUNCTIONS,
        },
        "trend",
    )
    return Trend(basis, tensors.take("trend.coefficients", (len(basis.orders), outputs)))
