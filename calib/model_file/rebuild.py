"""What a model file describes, rebuilt: each of its parts is checked on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..body.approach import Approach
from ..common.checks import LARGEST, finite, numbers, of_type
from ..common.scale import Scale
from ..maps.association import Association
from ..maps.compressed import Compressed
from ..maps.graph import Graph
from ..maps.lattice import Lattice
from ..maps.linear_models import from_shifts
from ..maps.links import Wiring
from ..maps.local_models import MOST_DEGREE, LocalModels
from ..maps.map import HISTORY, Map
from ..maps.predictor import Predictor
from ..model.about import About
from ..model.baseline import Baseline
from ..model.photo import Photo
from ..model.rows import MOST, Rows
from .smooth_part import build_smooth, votes_in

if TYPE_CHECKING:
    from ..model.model import Model

Array = NDArray[np.float64]


def build(header: Mapping[str, Any], tensors: Mapping[str, NDArray[Any]]) -> Model:
    """Rebuild the model that the description and the tensors of a file are.

    Raises
    ------
    CalibError, AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError
        If they make no sense.
    """
    from ..model.model import Model

    _check_types(tensors)
    about = About.from_json(header["about"])
    dof = len(about.joint_names)
    motor = _map("motor", header, tensors, dof)
    if (
        not np.allclose((about.upper - about.lower) / motor.scale.span, 1.0, rtol=0, atol=1e-6)
        or (np.abs(about.lower - motor.scale.lower) > 1e-6 * motor.scale.span).any()
    ):
        raise ValueError("the motor map has other limits than the joints")
    width = len(tensors["sensory.lower"])
    if width not in (2, 3):
        raise ValueError(f"positions have {width} coordinates")
    sensory = _map("sensory", header, tensors, width)
    counts = _whole(tensors, "links.counts").astype(np.int64)
    indices = _whole(tensors, "links.indices").astype(np.int32)
    _expect("links.data", tensors["links.data"], indices.shape)
    _expect("links.counts", counts, (motor.size,))
    if counts.sum() != len(indices) or len(indices) != len(tensors["links.data"]):
        raise ValueError("the links' lengths differ")
    if len(indices) and indices.max() >= sensory.size:
        raise ValueError("a link points outside of the sensory map")
    if not len(indices) or not (tensors["links.data"] > 0.0).all():
        raise ValueError("there are no links, or one is not above zero")
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    links = Compressed(
        tensors["links.data"].astype(float), indices, indptr, (motor.size, sensory.size)
    )
    association = Association(
        motor,
        sensory,
        links,
        _wiring(header["links"]),
        _means(tensors, "motor", motor),
        _means(tensors, "sensory", sensory),
    )
    smooth, body = build_smooth(header, tensors, motor.scale, width, lambda: association.linear)
    degree = _small(header["local"]["degree"], MOST_DEGREE, least=-1)
    models = LocalModels(
        degree,
        int(header["local"]["samples"]),
        tensors["local.radius"],
        tensors["local.coefficients"],
        # no word of these in format 1
        of_type("fades", header["local"].get("fades", False), bool),
        votes_in(header["local"]),
    )
    if degree >= 0:
        from ..body.basis import exponents

        _expect("local.radius", models.radius, (motor.size,))
        if not (models.radius > 0.0).all():
            raise ValueError("local.radius is not above zero")
        terms = len(exponents(dof, degree))
        _expect("local.coefficients", models.coefficients, (motor.size, terms, width))
    _expect("bounds", tensors["bounds"], (motor.size,))
    # of a simulation they are the same, and format 1 had one
    model_bounds = tensors.get("model_bounds", tensors["bounds"])
    _expect("model_bounds", model_bounds, (motor.size,))
    _expect("visited", tensors["visited"], (motor.size,))
    if not tensors["visited"].any() or min(tensors["bounds"].min(), model_bounds.min()) < 0:
        raise ValueError("no node was visited, or a bound is negative")
    model = Model(
        about,
        association,
        Predictor(motor, smooth, models),
        tensors["bounds"],
        model_bounds,
        tensors["visited"].astype(bool),
        body,
        _rows(tensors, dof, width),
        _history(header["history"]),
        _baseline(header.get("baseline"), tensors, motor, sensory),
    )
    if "approach" in header:
        model = replace(model, approach=_approach(header["approach"], tensors, motor.size, dof))
    if "photo" in header:
        left, right, low, high = numbers("photo", header["photo"], 4)
        model = replace(model, photo=Photo(tensors["photo"].tobytes(), (left, right, low, high)))
    if "schemas" not in header:
        return model
    from . import schemas

    model = replace(model, schema=schemas.schema_name(header["schema"]))
    return replace(model, schemas=schemas.unpack(model, header["schemas"], tensors))


def _check_types(tensors: Mapping[str, NDArray[Any]]) -> None:
    """Refuse numbers of another type than the format states; counts are checked as such."""
    for name, array in tensors.items():
        if name.startswith("schema."):
            continue  # checked one by one
        if name in ("links.data", "baseline.motor", "baseline.sensory"):
            wanted: type = np.float32
        elif name.endswith(".shifts"):
            wanted = np.float16
        elif name in ("visited", "photo") or name.endswith(".periodic"):
            wanted = np.uint8
        elif name.startswith(("links.", "body.")) or name.endswith(".edges"):
            continue
        else:
            wanted = np.float64
        if array.dtype != wanted:
            raise ValueError(f"{name} is of type {array.dtype}, expected {wanted.__name__}")


def _baseline(
    stated: Mapping[str, Any] | None, tensors: Mapping[str, NDArray[Any]], motor: Map, sensory: Map
) -> Baseline | None:
    if stated is None:
        return None
    parts = [tensors[f"baseline.{name}"].astype(float) for name in ("motor", "sensory")]
    for name, part, lattice in zip(("motor", "sensory"), parts, (motor, sensory), strict=True):
        _expect(f"baseline.{name}", part, (lattice.size,))
    if min(*numbers("spread", stated["spread"], 2), finite("noise", stated["noise"])) < 0.0:
        raise ValueError("a variance of the baseline is negative")
    return Baseline.from_json(stated, *parts)


def _rows(tensors: Mapping[str, NDArray[Any]], dof: int, width: int) -> Rows | None:
    if "rows.q" not in tensors:
        return None
    q, x = tensors["rows.q"], tensors["rows.x"]
    if len(q) > MOST:
        raise ValueError("there are too many rows")
    _expect("rows.q", q, (len(q), dof))
    _expect("rows.x", x, (len(q), width))
    return Rows(q, x)


def _approach(stated: Any, tensors: Mapping[str, NDArray[Any]], nodes: int, dof: int) -> Approach:
    play = np.array(numbers("approach", stated, dof))
    _expect("approach.bounds", tensors["approach.bounds"], (nodes,))
    if (play < 0.0).any() or (tensors["approach.bounds"] < 0.0).any():
        raise ValueError("a play or its bound is negative")
    return Approach(play, tensors["approach.bounds"])


def _history(stated: Any) -> tuple[dict[str, Any], ...]:
    from ..model.alignment import Alignment

    states = tuple(of_type("history", state, dict) for state in of_type("history", stated, list))
    for state in states:
        if state.get("frame") is not None:
            Alignment.from_json([numbers("frame", row, 3) for row in state["frame"]])
    return states


def _map(
    name: str, header: Mapping[str, Any], tensors: Mapping[str, NDArray[Any]], dim: int
) -> Map:
    shape = tuple(int(n) for n in header[name]["lattice"])
    units = tensors[f"{name}.units"]
    lattice: Lattice | Graph
    if f"{name}.edges" in tensors:
        edges = _whole(tensors, f"{name}.edges").astype(np.intp)
        _expect(f"{name}.edges", edges, (len(edges), 2))
        if not len(edges) or edges.max() >= len(units):
            raise ValueError(f"an edge of the {name} map ends at no node")
        lattice = Graph(len(units), edges)
    else:
        lattice = Lattice(shape)
    _expect(f"{name}.units", units, (lattice.size, dim))
    lower, span = tensors[f"{name}.lower"], tensors[f"{name}.span"]
    _expect(f"{name}.lower", lower, (dim,))
    _expect(f"{name}.span", span, (dim,))
    if not (span > 0.0).all():
        raise ValueError(f"{name}.span is not above zero")
    periodic = tensors[f"{name}.periodic"].astype(bool)
    _expect(f"{name}.periodic", periodic, (dim,))
    history = tensors[f"{name}.history"]
    _expect(f"{name}.history", history, (len(history), len(HISTORY)))
    found = Map(units, lattice, Scale(lower, span, periodic), history)
    if not found.spacing > 0.0:
        raise ValueError(f"the nodes of the {name} map are all in one place")
    return found


def _means(tensors: Mapping[str, NDArray[Any]], name: str, part: Map) -> Array | None:
    """Mean positions at which the nodes were active, None in a file of format 1."""
    shifts = tensors.get(f"{name}.shifts")
    if shifts is None:
        return None
    _expect(f"{name}.shifts", shifts, part.units.shape)
    return from_shifts(part, shifts)


def _wiring(stated: Mapping[str, Any]) -> Wiring:
    bandwidth = float(stated["bandwidth"])
    if not 1e-3 <= bandwidth <= 100.0:
        raise ValueError(f"{bandwidth!r} is no bandwidth")
    return Wiring(bool(stated["local"]), bool(stated["mutual"]), bandwidth)


def _expect(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}, expected {shape}")
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{name} holds {array.dtype}, expected numbers")
    if array.dtype.kind == "f" and not (np.abs(array.astype(float)) < LARGEST).all():
        raise ValueError(f"{name} holds a value that is not finite, or beyond {LARGEST:g}")


def _whole(tensors: Mapping[str, NDArray[Any]], name: str) -> NDArray[Any]:
    if tensors[name].dtype.kind != "u":
        raise ValueError(f"{name} holds {tensors[name].dtype}, expected whole numbers")
    return tensors[name]


def _small(value: Any, most: int, least: int = 0) -> int:
    if not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{value!r} is not a degree")
    return value
