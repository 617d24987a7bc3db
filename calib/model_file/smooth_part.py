"""The smooth part in a model file: a body, a trend, or both."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from numpy.typing import NDArray

from ..body.basis import Basis
from ..body.belief import Body
from ..body.storing import body_arrays, body_header, rebuild_body
from ..body.trend import Trend
from ..common.checks import LARGEST
from ..common.scale import Scale
from ..maps.linear_models import LinearModels
from ..maps.predictor import BodyInBox, Both, Smooth
from .parts import Tensors, whole

_SMALL = 1e-9  # radians that are a range
_FUNCTIONS = 100_000  # of a trend
_DEGREE = 60  # of a trend
_BODY = "body."  # prefix of the body's arrays


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
    tensors: dict[str, NDArray[Any]] = {}
    if body is not None:
        tensors |= {_BODY + name: array for name, array in body_arrays(body).items()}
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
