"""Kept schemas in a model file: what distinguishes each, in single precision, within a limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..body.basis import exponents
from ..common.checks import LARGEST, finite, numbers, of_type
from ..errors import OptionError
from ..maps.linear_models import LinearModels
from ..maps.local_models import MOST_DEGREE, LocalModels
from ..maps.map import Map
from ..maps.predictor import Predictor
from ..model.baseline import Baseline
from ..model.schemas import Schema, check_name
from .smooth_part import build_smooth, smooth_header, smooth_tensors, votes_in, votes_of

if TYPE_CHECKING:
    from ..model.model import Model

Tensors = Mapping[str, NDArray[Any]]

PREFIX = "schema."
"""Tensors of schema k are named "schema.k.NAME"."""

BYTES = 2_000_000
"""All kept schemas take no more; those that were kept longest are left out of the file."""

SMOOTH = "smooth."
"""Those of its smooth part, body or trend, "schema.k.smooth.NAME"."""

_MOST = 100


def pack(schemas: Sequence[Schema]) -> tuple[list[dict[str, Any]], dict[str, NDArray[Any]]]:
    """Descriptions and tensors of the schemas that fit into :data:`BYTES`."""
    described: list[dict[str, Any]] = []
    tensors: dict[str, NDArray[Any]] = {}
    total = 0
    for k, schema in enumerate(schemas[:_MOST]):
        own = _tensors(schema)
        total += sum(array.nbytes for array in own.values())
        if total > BYTES:
            break
        tensors.update({f"{PREFIX}{k}.{name}": array for name, array in own.items()})
        models = schema.predictor.models
        described.append(
            {
                "name": schema.name,
                "bound_of": schema.bound_of,
                "samples": schema.samples,
                "most": schema.most,
                "smooth": smooth_header(schema.predictor.smooth),
                "local": {
                    "degree": models.degree,
                    "samples": models.samples,
                    **votes_of(models.votes),
                },
                "baseline": None if schema.baseline is None else schema.baseline.to_json(),
            }
        )
    return described, tensors


def _tensors(schema: Schema) -> dict[str, NDArray[Any]]:
    predictor = schema.predictor
    arrays = {
        "motor": predictor.motor.units.astype(np.float32),
        "sensory": schema.sensory.units.astype(np.float32),
        **{SMOOTH + name: array for name, array in smooth_tensors(predictor.smooth).items()},
        "bounds": _rounded_up(schema.bounds),
        "model_bounds": _rounded_up(schema.model_bounds),
        "visited": np.packbits(schema.visited),
    }
    if isinstance(predictor.smooth, LinearModels):  # what its links would say
        arrays["linear.values"] = predictor.smooth.values.astype(np.float32)
        arrays["linear.slopes"] = predictor.smooth.slopes.astype(np.float32)
    if predictor.models.degree >= 0:
        arrays["radius"] = predictor.models.radius.astype(np.float32)
        arrays["local"] = predictor.models.coefficients.astype(np.float32)
    if schema.baseline is not None:
        arrays["baseline.motor"] = schema.baseline.motor.astype(np.float32)
        arrays["baseline.sensory"] = schema.baseline.sensory.astype(np.float32)
    return arrays


def _rounded_up(bounds: NDArray[np.float64]) -> NDArray[np.float32]:
    """Single precision, never below: a bound stays one."""
    single = bounds.astype(np.float32)
    return np.where(single < bounds, np.nextafter(single, np.float32(np.inf)), single)


def unpack(model: Model, described: Any, tensors: Tensors) -> tuple[Schema, ...]:
    """Rebuild what :func:`pack` returned, for the model that kept it.

    Raises
    ------
    ValueError, KeyError, TypeError
        If it makes no sense: a file may come from anyone.
    """
    states = of_type("schemas", described, list)
    if len(states) > _MOST:
        raise ValueError(f"{len(states)} schemas are too many")
    found = [
        _schema(model, of_type("schema", state, dict), tensors, f"{PREFIX}{k}.")
        for k, state in enumerate(states)
    ]
    names = [model.schema, *(s.name for s in found)]
    if len(set(names)) < len(names):
        raise ValueError("two schemas have one name")
    return tuple(found)


def _schema(model: Model, state: dict[str, Any], tensors: Tensors, prefix: str) -> Schema:
    name = schema_name(state["name"])
    if state["bound_of"] not in ("true position", "sensor reading"):
        raise ValueError(f"schema {name!r} bounds {state['bound_of']!r}")
    dof, nodes, others = model.motor.units.shape[1], model.motor.size, model.sensory.size
    width = model.sensory.units.shape[1]

    def take(what: str, shape: tuple[int, ...], kind: type = np.float32) -> NDArray[Any]:
        array = tensors[prefix + what]
        if array.shape != shape or array.dtype != kind:
            raise ValueError(
                f"{prefix}{what} is {array.dtype} {array.shape}, expected {kind.__name__} {shape}"
            )
        if array.dtype.kind == "f" and not (np.abs(array.astype(float)) < LARGEST).all():
            raise ValueError(f"{prefix}{what} holds a value that is not finite")
        return array if kind is np.uint8 else array.astype(float)

    motor, sensory = (
        Map(units, part.lattice, part.scale, part.history)
        for units, part in (
            (take("motor", (nodes, dof)), model.motor),
            (take("sensory", (others, width)), model.sensory),
        )
    )
    if not (motor.spacing > 0.0 and sensory.spacing > 0.0):
        raise ValueError(f"the nodes of schema {name!r} are all in one place")
    local = state["local"]
    own = {
        n[len(prefix + SMOOTH) :]: a for n, a in tensors.items() if n.startswith(prefix + SMOOTH)
    }

    def linear() -> LinearModels:
        values = take("linear.values", (nodes, width))
        return LinearModels(motor, values, take("linear.slopes", (nodes, dof, width)))

    smooth, _ = build_smooth(state, own, motor.scale, width, linear)
    models = LocalModels(-1, 0, np.zeros(0), np.zeros((0, 0, width)))
    order = _small(local["degree"], MOST_DEGREE, least=-1)
    if order >= 0:
        radius = take("radius", (nodes,))
        if not (radius > 0.0).all():
            raise ValueError(f"a radius of schema {name!r} is not above zero")
        terms = len(exponents(dof, order))
        coefficients = take("local", (nodes, terms, width))
        votes = votes_in(local)
        samples = _small(local["samples"], 10**9)
        models = LocalModels(order, samples, radius, coefficients, votes=votes)
    bounds, model_bounds = take("bounds", (nodes,)), take("model_bounds", (nodes,))
    most = finite("most", state["most"])
    visited = np.unpackbits(take("visited", (-(-nodes // 8),), np.uint8), count=nodes) > 0
    if not visited.any() or min(bounds.min(), model_bounds.min(), most) < 0.0:
        raise ValueError(f"schema {name!r} was visited nowhere, or a bound is negative")
    baseline = None
    if state["baseline"] is not None:
        told = of_type("baseline", state["baseline"], dict)
        if min(*numbers("spread", told["spread"], 2), finite("noise", told["noise"])) < 0.0:
            raise ValueError("a variance of the baseline is negative")
        parts = (take("baseline.motor", (nodes,)), take("baseline.sensory", (others,)))
        baseline = Baseline.from_json(told, *parts)
    samples = _small(state["samples"], 2**62)
    return Schema(
        name,
        sensory,
        Predictor(motor, smooth, models),
        bounds,
        model_bounds,
        most,
        visited,
        baseline,
        state["bound_of"],
        samples,
    )


def schema_name(value: Any) -> str:
    """A schema's name from a file.

    Raises
    ------
    ValueError
        If it is none.
    """
    try:
        check_name(value)
    except OptionError as error:
        raise ValueError(str(error)) from None
    return str(value)


def _small(value: Any, most: int, least: int = 0) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{value!r} is not a whole number from {least} to {most}")
    return value
