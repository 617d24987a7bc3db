"""What a model file describes, rebuilt: each of its parts is checked on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..body.approach import Approach
from ..common.arrays import Array
from ..common.checks import numbers, of_type
from ..common.scale import Scale
from ..maps.association import Association
from ..maps.compressed import Compressed
from ..maps.graph import Graph
from ..maps.lattice import Lattice
from ..maps.linear_models import from_shifts
from ..maps.links import Wiring
from ..maps.map import HISTORY, Map
from ..maps.predictor import Predictor
from ..model.about import About
from ..model.alignment import Alignment
from ..model.measured import MOST_ROWS, Photo, Rows
from .parts import WHOLE, Tensors, build_baseline, build_models, build_smooth
from .schemas import schema_name, unpack

if TYPE_CHECKING:
    from ..model.model import Model


def build(header: Mapping[str, Any], tensors: Tensors) -> Model:
    """Rebuild the model that the description and the tensors of a file are.

    Raises CalibError, AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError if
    they make no sense.
    """
    from ..model.model import Model

    about = About.from_json(header["about"])
    dof = len(about.joint_names)
    motor = _map("motor", header, tensors, dof)
    # joints are asked in the unit box of the map: other limits would shift every answer
    if (
        not np.allclose((about.upper - about.lower) / motor.scale.span, 1.0, rtol=0, atol=1e-6)
        or (np.abs(about.lower - motor.scale.lower) > 1e-6 * motor.scale.span).any()
    ):
        raise ValueError("the motor map has other limits than the joints")
    # nothing but a tensor's shape says whether positions are in a plane or in space
    width = len(tensors.take("sensory.lower", (-1,)))
    if width not in (2, 3):
        raise ValueError(f"positions have {width} coordinates")
    sensory = _map("sensory", header, tensors, width)
    nodes = (motor.size,)
    means = _means(tensors, "motor", motor), _means(tensors, "sensory", sensory)
    links = _links(tensors, motor.size, sensory.size)
    association = Association(motor, sensory, links, _wiring(header["links"]), *means)
    smooth, body = build_smooth(header, tensors, motor.scale, width, lambda: association.linear)
    names = "local.radius", "local.coefficients", "local.gates"
    models = build_models(header["local"], tensors, names, (*nodes, dof, width))
    bounds = tensors.take("bounds", nodes)
    # of a simulation they are the same, and format 1 had one
    model_bounds = tensors.take("model_bounds", nodes) if "model_bounds" in tensors else bounds
    visited = tensors.take("visited", nodes, "uint8").astype(bool)
    if not visited.any() or min(bounds.min(), model_bounds.min()) < 0:
        raise ValueError("no node was visited, or a bound is negative")
    model = Model(
        about,
        association,
        Predictor(motor, smooth, models),
        bounds,
        model_bounds,
        visited,
        body,
        _rows(tensors, dof, width),
        _history(header["history"]),
        build_baseline(header.get("baseline"), tensors, motor.size, sensory.size),
    )
    if "approach" in header:
        model = replace(model, approach=_approach(header["approach"], tensors, motor.size, dof))
    if "photo" in header:
        left, right, low, high = numbers("photo", header["photo"], 4)
        photo = tensors.take("photo", (-1,), "uint8").tobytes()
        model = replace(model, photo=Photo(photo, (left, right, low, high)))
    if "schemas" in header:
        model = replace(model, schema=schema_name(header["schema"]))
        model = replace(model, schemas=unpack(model, header["schemas"], tensors))
    return model


def _links(tensors: Tensors, motor: int, sensory: int) -> Compressed:
    """The links, sparse rows by motor node: how many each has, to which nodes, how strong."""
    counts = tensors.take("links.counts", (motor,), WHOLE).astype(np.int64)
    indices = tensors.take("links.indices", (-1,), WHOLE).astype(np.int32)
    data = tensors.take("links.data", indices.shape, "float32")
    if counts.sum() != len(indices):
        raise ValueError("the links' lengths differ")
    if not len(indices) or indices.max() >= sensory or not (data > 0.0).all():
        raise ValueError("there are no links, one is not above zero, or one ends at no node")
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return Compressed(data, indices, indptr, (motor, sensory))


def _rows(tensors: Tensors, dof: int, width: int) -> Rows | None:
    if "rows.q" not in tensors:
        return None
    q = tensors.take("rows.q", (-1, dof))
    if len(q) > MOST_ROWS:
        raise ValueError("there are too many rows")
    return Rows(q, tensors.take("rows.x", (len(q), width)))


def _approach(stated: Any, tensors: Tensors, nodes: int, dof: int) -> Approach:
    play = np.array(numbers("approach", stated, dof))
    bounds = tensors.take("approach.bounds", (nodes,))
    if (play < 0.0).any() or (bounds < 0.0).any():
        raise ValueError("a play or its bound is negative")
    return Approach(play, bounds)


def _history(stated: Any) -> tuple[dict[str, Any], ...]:
    states = tuple(of_type("history", state, dict) for state in of_type("history", stated, list))
    for state in states:
        if state.get("frame") is not None:
            Alignment.from_json(
                [numbers("frame", row, len(state["frame"]) + 1) for row in state["frame"]]
            )
    return states


def _map(name: str, header: Mapping[str, Any], tensors: Tensors, dim: int) -> Map:
    own = tensors.under(f"{name}.")
    lattice: Lattice | Graph
    if "edges" not in own:
        lattice = Lattice(tuple(int(n) for n in header[name]["lattice"]))
    else:
        nodes, edges = len(own.take("units", (-1, dim))), own.take("edges", (-1, 2), WHOLE)
        if not len(edges) or edges.max() >= nodes:
            raise ValueError(f"an edge of the {name} map ends at no node")
        lattice = Graph(nodes, edges.astype(np.intp))
    units = own.take("units", (lattice.size, dim))
    lower, span = own.take("lower", (dim,)), own.take("span", (dim,))
    if not (span > 0.0).all():
        raise ValueError(f"{name}.span is not above zero")
    periodic = own.take("periodic", (dim,), "uint8").astype(bool)
    history = own.take("history", (-1, len(HISTORY)))
    found = Map(units, lattice, Scale(lower, span, periodic), history)
    if not found.spacing > 0.0:  # which steps and cells are counted in
        raise ValueError(f"the nodes of the {name} map are all in one place")
    return found


def _means(tensors: Tensors, name: str, part: Map) -> Array | None:
    """Mean positions at which the nodes were active, None in a file of format 1."""
    if f"{name}.shifts" not in tensors:
        return None
    return from_shifts(part, tensors.take(f"{name}.shifts", part.units.shape, "float16"))


def _wiring(stated: Mapping[str, Any]) -> Wiring:
    bandwidth = float(stated["bandwidth"])
    if not 1e-3 <= bandwidth <= 100.0:
        raise ValueError(f"{bandwidth!r} is no bandwidth")
    return Wiring(bool(stated["local"]), bool(stated["mutual"]), bandwidth)
