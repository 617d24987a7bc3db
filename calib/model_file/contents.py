"""Contents of a model file: what of a model is kept, and what no model can be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ..arm.spatial_chain import SpatialChain
from ..body.approach import Approach
from ..body.belief import Body, Second
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..body.views import VIEWS_OF_BODIES
from ..common.arrays import Array, Index, Mask, Own, Shape
from ..common.scale import Scale
from ..errors import ModelError
from ..maps.association import Association
from ..maps.lattice import Graph, Lattice
from ..maps.links import Compressed, Wiring
from ..maps.local_models import MOST_DEGREE, NO_MODELS, LocalModels, exponents
from ..maps.map import HISTORY, Map
from ..maps.predictor import BodyInBox, Predictor
from ..model.about import About
from ..model.alignment import Alignment
from ..model.baseline import Baseline
from ..model.measured import MOST_ROWS, Photo, Rows
from ..model.parts import Parts
from .fields import Format

_MOST_JOINTS = 64
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
    return Kept(
        model.about,
        model.motor,
        model.sensory,
        association.motor_shifts,
        association.sensory_shifts,
        Links(
            np.diff(links.indptr).astype(np.intp),
            np.asarray(links.indices, dtype=np.intp),
            links.data,
            wiring.local,
            wiring.mutual,
            wiring.bandwidth,
        ),
        model.body,
        models if models.degree >= 0 else None,
        model.bounds,
        None if same else model.model_bounds,
        model.visited,
        model.rows,
        model.baseline,
        model.approach,
        model.photo,
        model.history,
    )


def model_of(kept: Kept) -> Parts:
    """The model that a file keeps; each part makes sense, here they are compared."""
    motor, sensory, about, links = kept.motor, kept.sensory, kept.about, kept.links
    places, width = sensory.units.shape
    linked = Compressed(
        links.strengths,
        links.nodes.astype(np.int32),
        np.concatenate([[0], np.cumsum(links.counts)]).astype(np.int32),
        (motor.size, places),
    )
    models = kept.local or NO_MODELS
    body, terms = kept.body, len(exponents(len(about.lower), models.degree)) if kept.local else 0
    # joints are asked in the unit box of the map: other limits would shift every answer
    span, low = motor.scale.span, np.abs(about.lower - motor.scale.lower)
    other = (np.abs((about.upper - about.lower) / span - 1.0) > 1e-6) | (low > 1e-6 * span)
    widths = [b.min() for b in (kept.bounds, kept.model_bounds) if b is not None]
    fits = (
        not other.any()
        and width in (2, 3)
        and not (links.nodes >= places).any()
        and links.counts.sum() == len(links.nodes)
        and terms == models.coefficients.shape[1]
        and (body is None or body.structure.dof == len(about.lower))
        and min(widths) >= 0.0
        and kept.visited.any()
    )
    if not fits:
        raise ModelError("its parts do not fit together")
    for state in kept.history:
        if state.get("frame") is not None:
            Alignment.from_json(state["frame"])
    wiring = Wiring(links.local, links.mutual, links.bandwidth)
    association = Association(
        motor, sensory, linked, wiring, kept.motor_shifts, kept.sensory_shifts
    )
    smooth = association.linear if body is None else BodyInBox(body, motor.scale)
    wider = kept.bounds if kept.model_bounds is None else kept.model_bounds
    return Parts(
        about, association, Predictor(motor, smooth, models), kept.bounds, wider, kept.visited,
        body, kept.rows, tuple(dict(state) for state in kept.history), kept.baseline,
        approach=kept.approach, photo=kept.photo,
    )  # fmt: skip


# --- what parts of a model can be ---------------------------------------------------------------


def _map(own: Map) -> bool:
    fits = own.lattice.size == len(own.units) and own.history.shape[1:] == (len(HISTORY),)
    return fits and own.spacing > 0.0  # steps and cells are counted in the distance of nodes


def _links(own: Links) -> bool:
    above = len(own.strengths) > 0 and bool((own.strengths > 0.0).all())
    return above and 1e-3 <= own.bandwidth <= 100.0


def _local(own: LocalModels) -> bool:
    degree = 0 <= own.degree <= MOST_DEGREE
    return degree and own.samples >= 0 and not (own.radius < _TINY).any()


def _belief(own: Body | Second) -> bool:
    active = own.active  # rising numbers of parameters
    rising = (np.diff(active) > 0).all() and not (active[-1:] >= len(own.beta)).any()
    return bool(rising and own.root.any(axis=1).all() and not (own.noise < _TINY).any())


def _body(own: Body) -> bool:
    structure, second = own.structure, own.second
    beliefs: list[Any] = [own] if second is None else [own, second]
    sizes = {(len(each.beta), len(each.noise)) for each in beliefs}
    numbers = (own.kappa, own.autocorrelation, own.repeat, *own.scales.values())
    return (
        _belief(own)
        and sizes == {(structure.size, structure.outputs)}
        and 1.0 <= own.kappa < np.inf
        and own.nu >= 2.0
        and min(*numbers, own.rows) >= 0.0
        and max(numbers) < np.inf
        and min(own.tau.min(), own.residual.min()) >= 0.0
    )


def _structure(own: Any) -> bool:
    names, sizes = own.joint_names, (own.metre, own.extent)
    return (
        1 <= len(set(names)) == len(names) <= _MOST_JOINTS
        and len(own.revolute) == len(names)
        and own.view in VIEWS_OF_BODIES[own.kind]
        and (min(sizes) > _TINY and sizes[0] >= 1e-12 and max(sizes) < np.inf)
    )


def _planar(own: PlanarStructure) -> bool:
    drawn, n = own.nominal, len(own.joint_names)
    told = [own.signs, *((drawn.lengths, drawn.offsets, drawn.signs) if drawn else ())]
    signs = {*own.signs, own.mirror, *((drawn.mirror, *drawn.signs) if drawn else ())}
    return _structure(own) and all(len(values) == n for values in told) and signs <= {1, -1}


def _spatial(own: SpatialStructure) -> bool:
    chain, names, dof = own.chain, own.chain_names, len(own.joint_names)
    joints = {len(names), len(set(names)), len(chain.revolute), len(chain.axes)}
    known = len(joints) == 1 and chain.coupling.shape[1] == dof
    return _structure(own) and known and dof <= len(names) <= _MOST_JOINTS


def _chain(own: SpatialChain) -> bool:
    turned, lengths = own.rotation @ own.rotation.T, np.linalg.norm(own.axes, axis=1)
    unit = np.abs(lengths - 1.0).max(initial=0.0) <= 1e-6
    rotation = np.abs(turned - np.eye(3)).max() <= 1e-6
    return bool(unit and rotation and len(own.masses) in (0, len(own.axes)))


FORMAT = Format(
    {Structure: (PlanarStructure, SpatialStructure)},
    {
        Map: _map,
        Graph: lambda own: own.pairs.size > 0 and own.pairs.max() < own.size,
        Lattice: lambda own: bool(own.shape) and min(own.shape) >= 1,
        Scale: lambda own: not (own.span < _TINY).any(),
        Links: _links,
        LocalModels: _local,
        Body: _body,
        Second: _belief,
        PlanarStructure: _planar,
        SpatialStructure: _spatial,
        SpatialChain: _chain,
        About: lambda own: own.possible(),
        Rows: lambda own: len(own) <= MOST_ROWS,
        Baseline: lambda own: min(*own.spread, own.noise) >= 0.0,
        Approach: lambda own: not (own.play < 0.0).any(),
    },
)
"""How the classes of a model are written and read."""


def described(model: Parts) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The description of a model and its tensors."""
    return FORMAT.write(kept_of(model), Kept)


def build(header: Mapping[str, Any], tensors: Mapping[str, NDArray[Any]]) -> Parts:
    """Rebuild the model that a file describes; ModelError and others where it makes no sense."""
    return model_of(FORMAT.read(Kept, header, tensors))
