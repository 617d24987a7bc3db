"""The smooth part in a model file: a body, a trend, or both."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.basis import Basis
from ..body.belief import Body
from ..body.trend import Trend
from ..common.checks import LARGEST, of_type
from ..common.scale import Scale
from ..maps.linear_models import LinearModels
from ..maps.local_models import FULL, OLD_SILENT
from ..maps.predictor import BodyInBox, Both, Smooth

_SMALL = 1e-9  # radians that are a range
_FUNCTIONS = 100_000  # of a trend
_DEGREE = 60  # of a trend
_BODY = "body."  # prefix of the body's arrays


def smooth_header(smooth: Smooth) -> dict[str, Any]:
    """JSON-ready description of a smooth part."""
    body, trend = _parts(smooth)
    return {
        "linear": isinstance(smooth, LinearModels),
        "body": None if body is None else body.header(),
        "trend": None
        if trend is None
        else {
            "turns": list(trend.basis.turns),
            "degree": trend.basis.degree,
            "each": trend.basis.each,
        },
    }


def smooth_tensors(smooth: Smooth) -> dict[str, NDArray[Any]]:
    """Arrays of a smooth part, by name."""
    body, trend = _parts(smooth)
    tensors: dict[str, NDArray[Any]] = {}
    if body is not None:
        tensors |= {_BODY + name: array for name, array in body.arrays().items()}
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
    tensors: Mapping[str, NDArray[Any]],
    scale: Scale,
    outputs: int,
    linear: Callable[[], LinearModels],
) -> tuple[Smooth, Body | None]:
    """Rebuild a smooth part from a file's description and arrays; both are checked.

    Raises
    ------
    CalibError, KeyError, TypeError, ValueError
        If they make no sense.
    """
    stated = {"body": None, "trend": header["trend"]} if "trend" in header else header["smooth"]
    if stated.get("linear"):
        return linear(), None
    body = None
    if stated["body"] is not None:
        arrays = {n[len(_BODY) :]: a for n, a in tensors.items() if n.startswith(_BODY)}
        body = Body.rebuild(stated["body"], arrays)
        if body.structure.dof != len(scale.span):
            raise ValueError("the body is of another arm")
    trend = _trend(stated["trend"], tensors, scale, outputs) if stated["trend"] else None
    if body is None:
        if trend is None:
            raise ValueError("there is neither a body nor a trend")
        return trend, None
    inside = BodyInBox(body, scale)
    return (inside if trend is None else Both(inside, trend)), body


def _trend(
    stated: Mapping[str, Any], tensors: Mapping[str, NDArray[Any]], scale: Scale, outputs: int
) -> Trend:
    dof = len(scale.span)
    turns = tuple(float(t) for t in stated["turns"])
    if len(turns) != dof:
        raise ValueError("the trend is of another arm")
    if not all(turn == 0.0 or _SMALL <= turn < LARGEST for turn in turns):  # zero of slides
        raise ValueError(f"{turns} are no turns")
    if math.comb(_whole(stated["degree"]) + dof, dof) > _FUNCTIONS:
        raise ValueError("the trend has too many functions")
    basis = Basis(turns, *(_whole(stated[k]) for k in ("degree", "each")))
    coefficients = tensors["trend.coefficients"]
    if coefficients.shape != (len(basis.orders), outputs):
        raise ValueError(f"trend.coefficients has the shape {coefficients.shape}")
    if not (np.abs(coefficients) < LARGEST).all():
        raise ValueError("trend.coefficients holds a value that is not finite")
    return Trend(basis, coefficients)


def _whole(value: Any) -> int:
    if not isinstance(value, int) or not 0 <= value <= _DEGREE:
        raise ValueError(f"{value!r} is not a degree")
    return value


def votes_of(votes: float) -> dict[str, float]:
    """What a file says of the votes of silent nodes, see :class:`LocalModels`."""
    if not votes:
        return {}
    return {"votes": True if votes == OLD_SILENT else votes}  # an earlier file keeps its bytes


def votes_in(local: Mapping[str, Any]) -> float:
    """What a file's `local` says of the votes; true is the share of earlier files."""
    votes = local.get("votes", False)
    if isinstance(votes, bool):
        return OLD_SILENT if votes else 0.0
    share = of_type("votes", votes, float)
    if not 0.0 < share < FULL:
        raise ValueError(f"votes {share:g}: expected a share below {FULL:g}")
    return share
