"""Local models: motor nodes keep a polynomial of what the smooth part leaves over."""

import itertools
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np

from ..common.arrays import Array, Index, Mask, ReadOnly, Shape
from .map import Map, nearest_points
from .settings import LOCAL


@dataclass(frozen=True)
class LocalModels(ReadOnly):
    """One polynomial per motor node."""

    # largest total degree, -1 for none: the smooth part stands alone
    degree: int
    samples: int  # number of samples that each was fitted to
    # distance to the first sample that was left out, in the unit box
    radius: Annotated[Array, Shape("nodes")]
    # of the monomials of (u - w) / radius [unit]; a node that is silent, or of a lower degree, has
    # zeros for the others
    coefficients: Annotated[Array, Shape("nodes", "terms", "width")]


NO_MODELS = LocalModels(
    -1,
    0,
    np.zeros(0),
    np.zeros((0, 0, 2)),
)


@lru_cache(maxsize=32)
def exponents(dim: int, degree: int) -> Index:
    """Exponents of all terms of total degree <= `degree`, (terms, dim), lowest first."""
    combinations = itertools.product(range(degree + 1), repeat=dim)
    terms = [term for term in combinations if sum(term) <= degree]
    terms.sort(key=lambda term: (sum(term), term))
    return np.array(terms, dtype=np.intp).reshape(-1, dim)


def monomials(z: Array, terms: Index) -> Array:
    """Products of powers of `z` (..., d) by their exponents (terms, d), (..., terms)."""
    products = np.ones((*z.shape[:-1], len(terms)))
    for axis, exponent in enumerate(terms.T):
        powers = [np.ones(z.shape[:-1])]
        for _ in range(exponent.max(initial=0)):
            powers.append(powers[-1] * z[..., axis])
        products *= np.stack(powers, axis=-1)[..., exponent]
    return products


def fit(
    motor: Map,
    nodes: Index,
    u: Array,
    residual: Array,
    shape: tuple[int, int],
) -> LocalModels:
    """Kernel-weighted least squares around some of the nodes (k,); the others are silent.

    The weight of a sample at the distance d is (1 - (d / radius)^2)^2.  Where samples do not carry
    this degree, as rows on a line, whose noise it multiplies beside them, a lower one is taken.

    u, residual : (n, d), (n, o), samples in the unit box and what the smooth part leaves over
    shape : degree of the polynomials and number of samples that each is fitted to
    """
    degree, samples = shape
    places = motor.units[nodes]
    scale = motor.scale
    dof = u.shape[1]
    outputs = residual.shape[1]
    distance, index = nearest_points(
        u,
        scale,
        places,
        samples + 1,
    )
    near = index[:, :-1]
    radius = np.maximum(distance[:, -1:], 1e-12)
    z = scale.difference(u[near], places[:, None]) / radius[..., None]
    kernel = (1.0 - (distance[:, :-1] / radius) ** 2) ** 2
    ring = _ring(motor, nodes) / radius[..., None]
    coefficients = np.zeros((motor.size, len(exponents(dof, degree)), outputs))
    shaky = np.arange(len(nodes))
    for lower in range(degree, -1, -1):
        terms = exponents(dof, lower)
        together = len(shaky) * near.shape[1] * len(terms)
        parts = np.array_split(shaky, 1 + together // LOCAL.numbers_at_once)
        still_shaky = []
        for part in parts:
            features = monomials(z[part], terms)
            weighted = np.swapaxes(features * kernel[part, :, None], 1, 2)
            moments = weighted @ features
            # rows on a line leave moments singular; the ring then finds the model shaky
            diagonal = np.einsum("nii->ni", moments)
            diagonal += 1e-9 * diagonal.mean(axis=1, keepdims=True) + 1e-300
            on_ring = np.swapaxes(monomials(ring[part], terms), 1, 2)
            values = weighted @ residual[near[part]]
            right_side = np.concatenate([values, on_ring], axis=2)
            solution = np.linalg.solve(moments, right_side)
            models = solution[..., :outputs]
            spread = solution[..., outputs:]
            variance = np.einsum("nta,nta->na", on_ring, spread)
            firm = (variance < LOCAL.firm).all(axis=1)
            coefficients[nodes[part[firm]], : len(terms)] = models[firm]
            still_shaky.append(part[~firm])
        shaky = np.concatenate(still_shaky)
    reach = np.full(motor.size, motor.spacing)
    reach[nodes] = radius[:, 0]
    return LocalModels(
        degree,
        near.shape[1],
        reach,
        coefficients,
    )


def _ring(motor: Map, nodes: Index) -> Array:
    """Offsets (k, places, d) from nodes to places half a spacing around them, within the box."""
    dof = motor.units.shape[1]
    away = np.random.default_rng(0).standard_normal((LOCAL.ring, dof))
    away *= 0.5 / np.linalg.norm(away, axis=1, keepdims=True)
    middle = motor.units[nodes][:, None]
    ring = middle + motor.spacings[nodes][:, None, None] * away
    inside = np.clip(ring, 0.0, 1.0)
    return np.where(motor.scale.periodic, ring, inside) - middle


def blend_size(dim: int) -> int:
    """Number of nodes whose local models are blended."""
    return {1: 3, 2: 4, 3: 6}.get(dim, 8)


def blend(
    motor: Map,
    u: Array,
    m: int,
    *,
    slope: bool = False,
) -> tuple[Index, Array, Array]:
    """Nodes whose models speak for each point, their weights (n, m), and if asked for the slopes.

    A weight falls smoothly to zero where its node leaves the nearest `m`, so that the
    blended prediction has no steps, and its derivative (n, m, d) none inside of each cell.
    """
    m = min(m, motor.size - 1)
    distance, index = motor.nearest(u, m + 1)
    last = np.maximum(distance[:, -1:], 1e-300)
    ratio = (distance[:, :-1] / last) ** 2
    # all at the same distance weigh the same
    raw = np.maximum((1.0 - ratio) ** 2, 1e-30)
    total = raw.sum(axis=1, keepdims=True)
    weight = raw / total
    if not slope:
        return index[:, :-1], weight, np.empty(0)
    # both distances of a ratio move with the point
    gap = motor.scale.difference(u[:, None], motor.units[index])
    moved = gap[:, :-1] - ratio[..., None] * gap[:, -1:]
    ratio_slope = 2.0 * moved / (last * last)[..., None]
    raw_slope = ratio_slope * (-2.0 * (1.0 - ratio)[..., None])
    # the quotient rule for raw / total
    total_slope = raw_slope.sum(axis=1, keepdims=True)
    tilt = raw_slope - weight[..., None] * total_slope
    return index[:, :-1], weight, tilt / total[..., None]


def speaking(motor: Map, u: Array) -> tuple[Index, Array, Array]:
    """Nodes that speak for each point, their weights (n, m), and offsets (n, m, d) from them."""
    index, weight, _ = blend(motor, u, blend_size(u.shape[1]))
    return index, weight, motor.scale.difference(u[:, None], motor.units[index])


def heard(weight: Array, talks: Mask) -> Array:
    """Weights (n, m) of the nodes that talk, by their share beside silent ones.

    The edge of a sharp defect then lies between nodes, and neither side dilutes the other.
    """
    talking = np.where(talks, weight, 0.0)
    share = talking.sum(axis=1, keepdims=True)
    t = (share - LOCAL.silent) / (LOCAL.full - LOCAL.silent)
    t = np.clip(t, 0.0, 1.0)
    smooth_step = t * t * (3.0 - 2.0 * t)
    loudness = smooth_step / np.maximum(share, LOCAL.silent)
    return np.asarray(talking * loudness)


def contributions(models: LocalModels, index: Index, gap: Array) -> Array:
    """What the models of the nodes `index` (n, m) say at the offsets `gap` (n, m, d), (n, m, o)."""
    z = gap / models.radius[index][..., None]
    products = monomials(z, exponents(gap.shape[-1], models.degree))
    coefficients = models.coefficients[index]
    return np.asarray(np.einsum("nmt,nmto->nmo", products, coefficients))


def predict(
    models: LocalModels,
    motor: Map,
    u: Array,
    *,
    slope: bool = False,
) -> tuple[Array, Array]:
    """Blended correction at the points `u` (n, d), (n, m), and if asked for its slope (n, m, d)."""
    index, weight, gap = speaking(motor, u)
    talks = (models.coefficients != 0.0).any(axis=(1, 2))
    weight = heard(weight, talks[index])
    answers = contributions(models, index, gap)
    value = np.einsum("nm,nmo->no", weight, answers)
    if not slope:
        return value, np.empty(0)
    # of the polynomials alone: what the weights add is small where neighbours agree, and a
    # Newton step that is a little off is corrected by the next
    dof = u.shape[1]
    radius = models.radius[index][..., None]
    z = gap / radius
    terms = exponents(dof, models.degree)
    by_axis = []
    for axis in range(dof):
        lower = terms.copy()
        lower[:, axis] = np.maximum(lower[:, axis] - 1, 0)
        by_axis.append(terms[:, axis] * monomials(z, lower))
    slopes = np.stack(by_axis) / radius
    weighted = models.coefficients[index] * weight[..., None, None]
    return value, np.einsum("dnmt,nmto->nod", slopes, weighted)
