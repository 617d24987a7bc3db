"""Contents of a model file: a model as a JSON header and tensors, and back, each part checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.approach import Approach
from ..common.arrays import Array
from ..common.checks import numbers, of_type
from ..common.scale import Scale
from ..errors import ModelError
from ..maps.association import Association
from ..maps.compressed import Compressed
from ..maps.graph import Graph
from ..maps.lattice import Lattice
from ..maps.linear_models import from_shifts, to_shifts
from ..maps.links import Wiring
from ..maps.map import HISTORY, Map
from ..maps.predictor import Predictor
from ..model.about import About
from ..model.alignment import Alignment
from ..model.measured import MOST_ROWS, Photo, Rows
from ..model.model import Model
from .checked import POSITIVE, WHOLE, Tensors, given, given_key, plain_fields, refuse_impossible
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

_WIRING = {"local": bool, "mutual": bool, "bandwidth": float}


def described(model: Model) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The description of a model and its tensors."""
    models, association = model.predictor.models, model.association
    links, means = association.linked, (association.motor_means, association.sensory_means)
    header: dict[str, Any] = {
        "about": model.about.to_json(),
        "history": list(model.history),
        "baseline": baseline_header(model.baseline),
        "motor": {"lattice": list(model.motor.lattice.shape)},
        "sensory": {"lattice": list(model.sensory.lattice.shape)},
        "links": plain_fields(association.wiring, _WIRING),
        "smooth": smooth_header(model.predictor.smooth),
        "local": models_header(models),
    }
    tensors: dict[str, NDArray[Any]] = {
        "links.data": links.data.astype(np.float32),
        "links.indices": links.indices.astype(_unsigned(model.sensory.size)),
        # of each row, not where it begins: numbers that fit into two bytes
        "links.counts": np.diff(links.indptr).astype(_unsigned(model.sensory.size + 1)),
        "local.radius": models.radius,
        "local.coefficients": models.coefficients,
        "bounds": model.bounds,
        "visited": model.visited.astype(np.uint8),
        **_map_tensors("motor", model.motor, means[0]),
        **_map_tensors("sensory", model.sensory, means[1]),
        **smooth_tensors(model.predictor.smooth),
        **baseline_tensors(model.baseline),
    }
    if not np.array_equal(model.model_bounds, model.bounds):
        tensors["model_bounds"] = model.model_bounds
    if model.rows is not None:
        tensors["rows.q"], tensors["rows.x"] = model.rows.q, model.rows.x
    if model.approach is not None:
        header["approach"] = model.approach.play.tolist()
        tensors["approach.bounds"] = model.approach.bounds
    if model.photo is not None:
        header["photo"] = list(model.photo.box)
        tensors["photo"] = np.frombuffer(model.photo.jpeg, np.uint8)
    return header, tensors


def _unsigned(count: int) -> type[np.unsignedinteger[Any]]:
    return np.uint16 if count <= 1 << 16 else np.uint32


def build(header: Mapping[str, Any], tensors: Tensors) -> Model:
    """Rebuild the model that the description and the tensors of a file are.

    Raises CalibError, AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError if
    they make no sense.
    """
    about = About.from_json(header["about"])
    dof = len(about.joint_names)
    motor, motor_means = _map("motor", header, tensors, dof)
    # joints are asked in the unit box of the map: other limits would shift every answer
    wide, low = motor.scale.span, np.abs(about.lower - motor.scale.lower)
    other = np.abs((about.upper - about.lower) / wide - 1.0) > 1e-6
    refuse_impossible(
        {"a motor map of the joints' limits": bool((other | (low > 1e-6 * wide)).any())}, "motor"
    )
    # nothing but a tensor's shape says whether positions are in a plane or in space
    width = len(tensors.take("sensory.lower", (-1,)))
    refuse_impossible({"positions of 2 or 3 coordinates": width not in (2, 3)}, "sensory")
    sensory, sensory_means = _map("sensory", header, tensors, width)
    wiring = Wiring(*(given_key(k, header["links"], n, "links") for n, k in _WIRING.items()))
    refuse_impossible(
        {"a bandwidth of 0.001 to 100": not 1e-3 <= wiring.bandwidth <= 100.0}, "links"
    )
    links = _links(tensors, motor.size, sensory.size)
    association = Association(motor, sensory, links, wiring, motor_means, sensory_means)
    smooth, body = build_smooth(header, tensors, motor.scale, lambda: association.linear)
    names = "local.radius", "local.coefficients"
    models = build_models(header["local"], tensors, names, (motor.size, dof, width))
    bounds = tensors.take("bounds", (motor.size,), least=0.0)
    model_bounds = bounds  # of a simulation they are the same, and format 1 had one
    if "model_bounds" in tensors:
        model_bounds = tensors.take("model_bounds", (motor.size,), least=0.0)
    visited = tensors.take("visited", (motor.size,), "uint8").astype(bool)
    refuse_impossible({"a node that was visited": not visited.any()}, "visited")
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
        play = np.array(numbers("approach", header["approach"], dof))
        refuse_impossible({"plays of 0 or more": bool((play < 0.0).any())}, "approach")
        wide = tensors.take("approach.bounds", (motor.size,), least=0.0)
        model = replace(model, approach=Approach(play, wide))
    if "photo" in header:
        box = given(tuple[float, float, float, float], header["photo"], "photo")
        photo = tensors.take("photo", (-1,), "uint8").tobytes()
        model = replace(model, photo=Photo(photo, box))
    return model


def _links(tensors: Tensors, motor: int, sensory: int) -> Compressed:
    """The links, sparse rows by motor node: how many each has, to which nodes, how strong."""
    counts = tensors.take("links.counts", (motor,), WHOLE).astype(np.int64)
    indices = tensors.take("links.indices", (int(counts.sum()),), WHOLE).astype(np.int32)
    data = tensors.take("links.data", indices.shape, "float32")
    wrong = not len(indices) or indices.max() >= sensory or not (data > 0.0).all()
    refuse_impossible({"links above zero that end at nodes": wrong}, "links")
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return Compressed(data, indices, indptr, (motor, sensory))


def _rows(tensors: Tensors, dof: int, width: int) -> Rows | None:
    if "rows.q" not in tensors:
        return None
    q = tensors.take("rows.q", (-1, dof))
    refuse_impossible({f"at most {MOST_ROWS} rows": len(q) > MOST_ROWS}, "rows")
    return Rows(q, tensors.take("rows.x", (len(q), width)))


def _history(told: Any) -> tuple[dict[str, Any], ...]:
    states = tuple(given(dict, state, "history") for state in of_type("history", told, list))
    for state in states:
        if state.get("frame") is not None:
            Alignment.from_json(
                [numbers("frame", row, len(state["frame"]) + 1) for row in state["frame"]]
            )
    return states


def _map_tensors(name: str, part: Map, means: Array | None) -> dict[str, NDArray[Any]]:
    """Tensors of a map, and of the mean positions at which its nodes were active."""
    tensors: dict[str, NDArray[Any]] = {
        "units": part.units,
        "history": part.history,
        "lower": part.scale.lower,
        "span": part.scale.span,
        "periodic": part.scale.periodic.astype(np.uint8),
    }
    if means is not None:
        tensors["shifts"] = to_shifts(part, means)
    if isinstance(part.lattice, Graph):
        tensors["edges"] = part.edges.astype(_unsigned(part.size))
    return {f"{name}.{key}": array for key, array in tensors.items()}


def _map(
    name: str, header: Mapping[str, Any], tensors: Tensors, dim: int
) -> tuple[Map, Array | None]:
    """A map and its mean positions, which a file of format 1 has not."""
    own = tensors.under(f"{name}.")
    lattice: Lattice | Graph
    if "edges" not in own:
        lattice = Lattice(given(tuple[int, ...], header[name]["lattice"], name))
    else:
        nodes, edges = len(own.take("units", (-1, dim))), own.take("edges", (-1, 2), WHOLE)
        refuse_impossible({"edges that end at nodes": not len(edges) or edges.max() >= nodes}, name)
        lattice = Graph(nodes, edges.astype(np.intp))
    units = own.take("units", (lattice.size, dim))
    lower, span = own.take("lower", (dim,)), own.take("span", (dim,), least=POSITIVE)
    periodic = own.take("periodic", (dim,), "uint8").astype(bool)
    history = own.take("history", (-1, len(HISTORY)))
    found = Map(units, lattice, Scale(lower, span, periodic), history)
    if not found.spacing > 0.0:  # which steps and cells are counted in
        raise ModelError(f"the nodes of the {name} map are all in one place")
    means = own.take("shifts", units.shape, "float16") if "shifts" in own else None
    return found, None if means is None else from_shifts(found, means)
