"""Contents of a model file: what of a model is kept, and what no model can be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ..body.approach import Approach
from ..body.belief import Body
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..common.arrays import Array, Index, Mask, Own, Shape
from ..errors import ModelError
from ..maps.association import Association
from ..maps.lattice import Graph
from ..maps.links import Compressed, Wiring
from ..maps.local_models import MOST_DEGREE, NO_MODELS, LocalModels, exponents
from ..maps.map import HISTORY, Map
from ..maps.predictor import BodyInBox, Predictor
from ..model.about import MOST_ROWS, About, Photo, Rows
from ..model.alignment import Alignment
from ..model.baseline import Baseline
from ..model.facts import shown_errors
from ..model.parts import Parts
from .fields import Tensors, read, write

_TINY = 1e-300  # the least number above zero


@dataclass(frozen=True)
class Links:
    """The links as sparse rows, and how they were learned and are read."""

    counts: Annotated[Index, Shape("nodes")]  # links of each motor node
    nodes: Annotated[Index, Shape("links")]  # sensory node of each link
    strengths: Annotated[Array, Shape("links", kept="f4")]
    local: bool
    mutual: bool
    bandwidth: float  # [node spacings]


@dataclass(frozen=True)
class Kept:
    """What a model file holds; axes are those of the motor map's `nodes` and `places`."""

    about: About
    motor: Annotated[Map, Own(nodes="nodes", d="dof")]
    sensory: Annotated[Map, Own(nodes="places", d="width")]
    # mean position of the samples at which a node was active, less its weight [node spacings]
    motor_shifts: Annotated[Array, Shape("nodes", "dof", kept="f2")] | None
    sensory_shifts: Annotated[Array, Shape("places", "width", kept="f2")] | None
    links: Annotated[Links, Own(nodes="nodes")]
    body: Annotated[Body, Own()] | None
    local: LocalModels | None
    bounds: Annotated[Array, Shape("nodes")]
    model_bounds: Annotated[Array, Shape("nodes")] | None  # where they are others
    visited: Annotated[Mask, Shape("nodes")]
    rows: Rows | None
    baseline: Baseline | None
    approach: Approach | None
    photo: Annotated[Photo, Own()] | None
    history: tuple[Mapping[str, Any], ...]


def kept_of(model: Parts) -> Kept:
    """What of a model is kept."""
    association, models = model.association, model.predictor.models
    links, wiring = association.linked, association.wiring
    same = np.array_equal(model.model_bounds, model.bounds)
    counts, nodes = np.diff(links.indptr).astype(np.intp), np.asarray(links.indices, np.intp)
    return Kept(
        model.about, model.motor, model.sensory, association.motor_shifts,
        association.sensory_shifts,
        Links(counts, nodes, links.data, wiring.local, wiring.mutual, wiring.bandwidth),
        model.body, models if models.degree >= 0 else None, model.bounds,
        None if same else model.model_bounds, model.visited, model.rows, model.baseline,
        model.approach, model.photo, model.history,
    )  # fmt: skip


def model_of(kept: Kept) -> Parts:
    """The model that a file keeps; ModelError and others where it makes no sense."""
    motor, sensory, about, links = kept.motor, kept.sensory, kept.about, kept.links
    if not _fits(kept):
        raise ModelError("its parts do not fit together")
    models, body = kept.local or NO_MODELS, kept.body
    first = np.append(0, np.cumsum(links.counts)).astype(np.int32)
    size = motor.size, sensory.size
    linked = Compressed(links.strengths, links.nodes.astype(np.int32), first, size)
    for state in kept.history:
        if state.get("frame") is not None:
            Alignment.from_json(state["frame"])
    wiring = Wiring(links.local, links.mutual, links.bandwidth)
    association = Association(
        motor, sensory, linked, wiring, kept.motor_shifts, kept.sensory_shifts
    )
    smooth = association.linear if body is None else BodyInBox(body, motor.scale)
    wider = kept.bounds if kept.model_bounds is None else kept.model_bounds
    model = Parts(
        about, association, Predictor(motor, smooth, models), kept.bounds, wider, kept.visited,
        body, kept.rows, tuple(dict(state) for state in kept.history), kept.baseline,
        approach=kept.approach, photo=kept.photo,
    )  # fmt: skip
    middle = np.full((1, len(about.lower)), 0.5)
    tuple(shown_errors(about, about.errors) if about.errors else ())
    answer = model.predictor.value(middle)  # what makes no sense breaks here, if nowhere before
    bound = 0.0 if body is None else body.bound(motor.scale.from_unit(middle))
    if not np.isfinite(answer + bound).all():
        raise ModelError("it has no answer in the middle of its range")
    return model


def _fits(kept: Kept) -> bool:
    """Whether the parts of a file make sense, and one model."""
    motor, links, about, models = kept.motor, kept.links, kept.about, kept.local
    # joints are asked in the unit box of the map: other limits would shift every answer
    span, low = motor.scale.span, np.abs(about.lower - motor.scale.lower)
    other = (np.abs((about.upper - about.lower) / span - 1.0) > 1e-6) | (low > 1e-6 * span)
    widths = [b.min() for b in (kept.bounds, kept.model_bounds) if b is not None]
    if models is not None and not (
        0 <= models.degree <= MOST_DEGREE
        and len(exponents(len(about.lower), models.degree)) == models.coefficients.shape[1]
        and not (models.radius < _TINY).any()
    ):
        return False
    return bool(
        about.possible()
        and all(map(_map, (motor, kept.sensory)))
        and not other.any()
        and kept.sensory.units.shape[1] in (2, 3)
        and not (links.nodes >= kept.sensory.size).any()
        and links.counts.sum() == len(links.nodes) > 0
        and (links.strengths > 0.0).all()
        and 1e-3 <= links.bandwidth <= 100.0
        and (kept.body is None or _body(kept.body, len(about.lower)))
        and min(widths) >= 0.0
        and kept.visited.any()
        and (kept.rows is None or len(kept.rows) <= MOST_ROWS)
        and (kept.approach is None or not (kept.approach.play < 0.0).any())
    )


def _map(own: Map) -> bool:
    lattice: Any = own.lattice
    graph = isinstance(lattice, Graph)
    fine = lattice.pairs.max(initial=0) < lattice.size if graph else min(lattice.shape) >= 1
    return bool(
        own.history.shape[1:] == (len(HISTORY),)
        and fine
        and lattice.size == len(own.units)
        and not (own.scale.span < _TINY).any()
        and own.spacing > 0.0  # steps and cells are counted in the distance of nodes
    )


def _body(own: Body, dof: int) -> bool:
    structure, beliefs = own.structure, tuple(each for each in (own, own.second) if each)
    return (
        structure.dof == dof
        and all(
            (len(each.beta), len(each.noise)) == (structure.size, structure.outputs)
            and (np.diff(each.active) > 0).all()
            and each.root.any(axis=1).all()
            and not (each.noise < _TINY).any()
            for each in beliefs
        )
        and 1.0 <= own.kappa < np.inf
        and own.nu >= 2.0
        and min(own.autocorrelation, own.repeat, own.rows, own.tau.min(), own.residual.min()) >= 0.0
    )


KINDS = {Structure: (PlanarStructure, SpatialStructure)}


def described(model: Parts) -> tuple[dict[str, Any], Tensors]:
    """The description of a model and its tensors."""
    return write(kept_of(model), Kept, KINDS)


def build(header: Mapping[str, Any], tensors: Tensors) -> Parts:
    """Rebuild the model that a file describes; ModelError and others where it makes no sense."""
    return model_of(read(Kept, header, tensors, KINDS))
