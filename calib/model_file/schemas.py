"""Kept schemas in a model file: what distinguishes each, in single precision, within a limit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..common.checks import LARGEST, of_type
from ..maps.linear_models import LinearModels
from ..maps.map import Map
from ..maps.predictor import Predictor
from ..model.schemas import Schema, check_name
from .checked import Tensors, given_fields, plain_fields, refuse_impossible
from .parts import (
    baseline_header,
    baseline_tensors,
    build_baseline,
    build_models,
    build_smooth,
    models_header,
    smooth_header,
    smooth_tensors,
)

if TYPE_CHECKING:
    from ..model.model import Model

_PREFIX = "schema."
"""Tensors of schema k are named "schema.k.NAME"."""

BYTES = 2_000_000
"""All kept schemas take no more; those that were kept longest are left out of the file."""

_SMOOTH = "smooth."
"""Those of its smooth part, body or trend, "schema.k.smooth.NAME"."""

_MOST = 100

_PLAIN = ("name", "bound_of", "samples", "most")
"""Fields of a schema that stand in its description as they are."""


def pack_schemas(schemas: Sequence[Schema]) -> tuple[list[dict[str, Any]], dict[str, NDArray[Any]]]:
    """Descriptions and tensors of the schemas that fit into :data:`BYTES`."""
    described: list[dict[str, Any]] = []
    tensors: dict[str, NDArray[Any]] = {}
    for k, schema in enumerate(schemas[:_MOST]):
        own = {f"{_PREFIX}{k}.{name}": array for name, array in _tensors(schema).items()}
        if sum(array.nbytes for array in (*tensors.values(), *own.values())) > BYTES:
            break
        tensors |= own
        described.append(
            {
                **plain_fields(schema, _PLAIN),
                "smooth": smooth_header(schema.predictor.smooth),
                "local": models_header(schema.predictor.models),
                "baseline": baseline_header(schema.baseline),
            }
        )
    return described, tensors


def _tensors(schema: Schema) -> dict[str, NDArray[Any]]:
    predictor = schema.predictor
    arrays = {
        "motor": predictor.motor.units.astype(np.float32),
        "sensory": schema.sensory.units.astype(np.float32),
        **{_SMOOTH + name: array for name, array in smooth_tensors(predictor.smooth).items()},
        "bounds": _rounded_up(schema.bounds),
        "model_bounds": _rounded_up(schema.model_bounds),
        "visited": np.packbits(schema.visited),  # an eighth of a byte a node
    }
    if isinstance(predictor.smooth, LinearModels):  # what its links would say
        arrays["linear.values"] = predictor.smooth.values.astype(np.float32)
        arrays["linear.slopes"] = predictor.smooth.slopes.astype(np.float32)
    if predictor.models.degree >= 0:
        arrays["radius"] = predictor.models.radius.astype(np.float32)
        arrays["local"] = predictor.models.coefficients.astype(np.float32)
        if predictor.models.gates is not None:
            arrays["gates"] = predictor.models.gates.astype(np.float32)
    return arrays | baseline_tensors(schema.baseline)


def _rounded_up(bounds: NDArray[np.float64]) -> NDArray[np.float32]:
    """Single precision, never below: a bound stays one."""
    single = bounds.astype(np.float32)  # rounds to the nearest, below in half of the cases
    return np.where(single < bounds, np.nextafter(single, np.float32(np.inf)), single)


def unpack_schemas(model: Model, described: Any, tensors: Tensors) -> tuple[Schema, ...]:
    """Rebuild what :func:`pack_schemas` returned, for the model that kept it.

    Raises CalibError, ValueError, KeyError, TypeError if it makes no sense: a file may come from
    anyone.
    """
    states = of_type("schemas", described, list)
    refuse_impossible({f"at most {_MOST} schemas": len(states) > _MOST}, "schemas")
    found = [
        _schema(model, state, tensors.under(f"{_PREFIX}{k}.")) for k, state in enumerate(states)
    ]
    names = [model.schema, *(s.name for s in found)]
    refuse_impossible({"schemas of different names": len(set(names)) < len(names)}, "schemas")
    return tuple(found)


def _schema(model: Model, state: Any, tensors: Tensors) -> Schema:
    told = given_fields(Schema, state, "schema", _PLAIN)
    schema_name(told["name"])
    nodes, dof = model.motor.units.shape
    others, width = model.sensory.units.shape

    def take(what: str, *shape: int, least: float = -LARGEST) -> NDArray[Any]:
        return tensors.take(what, shape, "float32", least)

    motor, sensory = (
        Map(take(part, *lattice.units.shape), lattice.lattice, lattice.scale, lattice.history)
        for part, lattice in (("motor", model.motor), ("sensory", model.sensory))
    )

    def linear() -> LinearModels:
        slopes = take("linear.slopes", nodes, dof, width)
        return LinearModels(motor, take("linear.values", nodes, width), slopes)

    smooth, _ = build_smooth(state, tensors.under(_SMOOTH), motor.scale, width, linear)
    models = build_models(
        state["local"], tensors, ("radius", "local", "gates"), (nodes, dof, width),
        kind="float32", fades=True,
    )  # fmt: skip
    packed = tensors.take("visited", (-(-nodes // 8),), "uint8")
    visited = np.unpackbits(packed, count=nodes) > 0
    refuse_impossible(
        {
            "a schema that bounds readings or positions": told["bound_of"]
            not in ("true position", "sensor reading"),
            "nodes that stand apart": not (motor.spacing > 0.0 and sensory.spacing > 0.0),
            "a node that was visited": not visited.any(),
            "bounds and samples of 0 or more": min(told["most"], told["samples"]) < 0.0,
        },
        "schema",
    )
    return Schema(
        sensory=sensory,
        predictor=Predictor(motor, smooth, models),
        bounds=take("bounds", nodes, least=0.0),
        model_bounds=take("model_bounds", nodes, least=0.0),
        visited=visited,
        baseline=build_baseline(state["baseline"], tensors, nodes, others),
        **told,
    )


def schema_name(value: Any) -> str:
    """A schema's name from a file.

    Raises OptionError if it is none.
    """
    check_name(value)
    return str(value)
