"""Local models: motor nodes keep a polynomial of what the smooth part leaves over."""

import itertools
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np

from ..common.arrays import Array, Index, Mask, ReadOnly, Shape
from .blend import Blend
from .map import Map, nearest_points
from .settings import LOCAL, ModelShape


@dataclass(frozen=True)
class LocalModels(ReadOnly):
    """One polynomial per motor node."""

    # largest total degree, -1 for none: the smooth part alone
    degree: int
    samples: int  # number of samples that each model was fitted to
    # distance to the first sample that was left out, in the unit box
    radius: Annotated[Array, Shape("nodes")]
    # of the monomials of (u - w) / radius [unit]; zeros of a node without a model, and beyond the
    # degree of a node's own
    coefficients: Annotated[Array, Shape("nodes", "terms", "width")]


NO_MODELS = LocalModels(-1, 0, np.zeros(0), np.zeros((0, 0, 2)))


@lru_cache(maxsize=32)
def exponents(dim: int, degree: int) -> Index:
    """Exponents of all terms of total degree <= `degree`, (terms, dim), lowest first."""
    combinations = itertools.product(range(degree + 1), repeat=dim)
    terms = [term for term in combinations if sum(term) <= degree]
    terms.sort(key=lambda term: (sum(term), term))
    return np.array(terms, dtype=np.intp).reshape(-1, dim)


def monomials(z: Array, terms: Index) -> Array:
    """Products of powers of `z` (..., d) by their exponents (terms, d), (..., terms)."""
    rows = z.shape[:-1]
    products = np.ones((*rows, len(terms)))
    for axis, exponent in enumerate(terms.T):
        powers = [np.ones(rows)]
        for _ in range(exponent.max(initial=0)):
            powers.append(powers[-1] * z[..., axis])
        products *= np.stack(powers, axis=-1)[..., exponent]
    return products


def fit(
    motor: Map,
    nodes: Index,
    u: Array,
    residual: Array,
    shape: ModelShape,
) -> LocalModels:
    """Kernel-weighted least squares around some of the nodes (k,); the others have no model.

    The weight of a sample at the distance d is (1 - (d / radius)^2)^2.  Where samples do not carry
    this degree, as rows on a line, whose noise it multiplies beside them, a lower one is taken.

    u, residual : (n, d), (n, o), samples in the unit box and what the smooth part leaves over
    """
    places = motor.units[nodes]
    count = shape.samples + 1
    distance, index = nearest_points(u, motor.scale, places, count)
    near = index[:, :-1]
    radius = np.maximum(distance[:, -1:], 1e-12)
    offsets = motor.scale.difference(u[near], places[:, None])
    z = offsets / radius[..., None]
    share = distance[:, :-1] / radius
    kernel = (1.0 - share**2) ** 2
    ring = _ring(motor, nodes) / radius[..., None]
    dof = u.shape[1]
    terms = len(exponents(dof, shape.degree))
    width = residual.shape[1]
    coefficients = np.zeros((motor.size, terms, width))
    shaky = np.arange(len(nodes))
    for lower in range(shape.degree, -1, -1):
        models, variance = _polynomials(
            exponents(dof, lower),
            z[shaky],
            kernel[shaky],
            residual[near[shaky]],
            ring[shaky],
        )
        firm = (variance < LOCAL.firm).all(axis=1)
        fitted = nodes[shaky[firm]]
        coefficients[fitted, : models.shape[1]] = models[firm]
        shaky = shaky[~firm]
    reach = np.full(motor.size, motor.spacing)
    reach[nodes] = radius[:, 0]
    return LocalModels(shape.degree, near.shape[1], reach, coefficients)


def _polynomials(
    terms: Index,
    z: Array,
    kernel: Array,
    residual: Array,
    ring: Array,
) -> tuple[Array, Array]:
    """Weighted least squares around k nodes, and how firm they are on a ring around each.

    terms : (terms, d), exponents
    z, kernel, residual : (k, s, d), (k, s), (k, s, o), samples around each node, their weights
    ring : (k, places, d)
    Returns (k, terms, o), (k, places), coefficients, and variances of answers over a sample's.
    """
    features = monomials(z, terms)
    weighted = np.swapaxes(features * kernel[..., None], 1, 2)
    moments = weighted @ features
    # rows on a line leave moments singular: the variance on the ring is large then
    diagonal = np.einsum("nii->ni", moments)
    diagonal += 1e-9 * diagonal.mean(axis=1, keepdims=True) + 1e-300
    on_ring = np.swapaxes(monomials(ring, terms), 1, 2)
    values = np.dstack([weighted @ residual, on_ring])
    solution = np.linalg.solve(moments, values)
    width = residual.shape[2]
    models, on_values = np.split(solution, [width], axis=2)
    variance: Array = np.einsum("nta,nta->na", on_ring, on_values)
    return models, variance


def _ring(motor: Map, nodes: Index) -> Array:
    """Offsets (k, places, d) from nodes to places half a spacing around them, within the box."""
    dof = motor.units.shape[1]
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((LOCAL.ring, dof))
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    directions *= 0.5 / length
    middle = motor.units[nodes][:, None]
    spacing = motor.spacings[nodes][:, None, None]
    ring = middle + spacing * directions
    inside = np.clip(ring, 0.0, 1.0)
    return np.where(motor.scale.periodic, ring, inside) - middle


def model_weights(weight: Array, has_model: Mask) -> Array:
    """Weights (n, m) of models, from those of nodes and which of these have one, both (n, m).

    Nodes without a model take no part: where those with one have most of the weight they count in
    full, where they have little not at all.  The edge of a sharp defect then lies between nodes,
    and neither side dilutes the other.
    """
    of_models = np.where(has_model, weight, 0.0)
    share = of_models.sum(axis=1, keepdims=True)
    ramp = LOCAL.full - LOCAL.silent
    t = (share - LOCAL.silent) / ramp
    t = np.clip(t, 0.0, 1.0)
    smooth_step = t * t * (3.0 - 2.0 * t)
    factor = smooth_step / np.maximum(share, LOCAL.silent)
    return np.asarray(of_models * factor)


def model_values(models: LocalModels, blend: Blend) -> Array:
    """Values (n, m, o) [unit] of the models of a blend's nodes at its points."""
    radius = models.radius[blend.index][..., None]
    z = blend.gap / radius
    terms = exponents(z.shape[-1], models.degree)
    products = monomials(z, terms)
    coefficients = models.coefficients[blend.index]
    return np.asarray(np.einsum("nmt,nmto->nmo", products, coefficients))


def _weights(models: LocalModels, blend: Blend) -> Array:
    """Weights (n, m) of the models of a blend's nodes."""
    used = models.coefficients != 0.0
    has_model = used.any(axis=(1, 2))
    return model_weights(blend.weight, has_model[blend.index])


def correction(models: LocalModels, blend: Blend) -> Array:
    """What local models add at the points of a blend, (n, o) [unit]."""
    weight = _weights(models, blend)
    values = model_values(models, blend)
    return np.asarray(np.einsum("nm,nmo->no", weight, values))


def correction_slope(models: LocalModels, blend: Blend) -> Array:
    """Derivatives (n, o, d) of the correction by the coordinates of the points.

    They are those of the polynomials alone: what the weights add is small where neighbours agree,
    and a Newton step that is a little off is corrected by the next.
    """
    radius = models.radius[blend.index][..., None]
    z = blend.gap / radius
    dof = z.shape[-1]
    terms = exponents(dof, models.degree)
    by_axis = []
    for axis, unit in enumerate(np.eye(dof, dtype=int)):
        lower = np.maximum(terms - unit, 0)
        by_axis.append(terms[:, axis] * monomials(z, lower))
    slopes = np.stack(by_axis) / radius
    weight = _weights(models, blend)[..., None, None]
    weighted = models.coefficients[blend.index] * weight
    return np.asarray(np.einsum("dnmt,nmto->nod", slopes, weighted))
