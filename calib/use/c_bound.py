"""C tables of the posterior's bound, for an arm of more than three joints.

The whole covariance of 600 parameters would take a megabyte.  Kept are the covariance of the
geometry, of each joint's curve by itself (one function of the joint's value), and of what couples
them the `_RANK` directions that move positions most.  Python's bound has all of it: on the UR10 the
header's is within a thirtieth of it, of a planar chain that 120 rows tell of within a tenth.  The
nodes' bounds, blended, were off by a factor of 4, the covariance's own largest directions by half.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..body.belief import SHARED
from ..body.covariance import NORMAL_95, root_of
from ..body.curves import HARMONICS, powers
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.spatial_view import compose
from ..common.arrays import Array
from .c_tables import REAL, array, curves_of, integers, shears

if TYPE_CHECKING:
    from ..body.belief import Body, Second
    from ..body.structure import Structure

_RANK = 32
"""Directions that are kept of what couples curves with each other and with the geometry."""


def words(body: Body) -> dict[str, object]:
    """Numbers that stand in the source itself."""
    structure = body.structure
    own: dict[str, object] = {}
    if isinstance(structure, SpatialStructure):
        own["bends"] = int(len(structure.groups["elastic"]) > 0)
    how = ": within about a tenth of what Python has, which keeps more of it"
    return own | {
        "how": how if _rank(body) else "",
        "waves": HARMONICS,
        "beliefs": 1 if body.second is None else 2,
        "rank": _rank(body),
        "normal": NORMAL_95,
    }


def tables(structure: Structure, body: Body, q: Array, *, noise: bool, single: bool) -> str:
    """Constant tables, most of them in single precision.

    q : (n, dof) [rad or m], joint values, by whose positions directions are compared
    noise : whether the bound counts the noise of a single reading
    single : whether the rest is ``float``, too
    """
    geometry = structure.size - sum(map(len, curves_of(structure).values()))
    seen = structure.blocks[0]
    slope = structure.linearise(q, body.beta)[1][:, :seen].reshape(-1, structure.size)
    values, vectors = np.linalg.eigh(slope.T @ slope)
    scales = vectors, np.sqrt(np.maximum(values, 1e-14 * values[-1]))
    beliefs: list[Body | Second] = [body] if body.second is None else [body, body.second]
    rank = _rank(body)
    parts = [_compact(structure, each, body.beta, geometry, rank, *scales) for each in beliefs]
    root, own, coupled = (np.vstack([part[k] for part in parts]) for k in range(3))
    signs = np.concatenate([part[3] for part in parts])
    # as in `Body.bound`: the first belief is inflated, the second not
    scale = np.array([(body.kappa, SHARED**2), (1.0, 1.0)][: len(parts)])
    more = np.zeros(3)
    more[:seen] = body.unexplained(noise=noise)
    size, waves = "CALIB_GEOMETRY", 2 * HARMONICS
    return (
        f"\nenum {{ {size} = {geometry} }};\n"
        + array("float", "calib_root", [str(len(root)), size], root, True)
        + array("float", "calib_own", [str(len(own)), str(2 * waves + 1)], own, True)
        + array("float", "calib_coupled", [str(len(coupled)), str(coupled.shape[1])], coupled, True)
        + integers("calib_gains", str(max(len(signs), 1)), signs if rank else [0])
        + array(REAL, "calib_scale", [str(len(scale)), "2"], scale, single)
        + array(REAL, "calib_more", ["3"], more, single)
        + _own(structure, body.beta, single)
    )


def _own(structure: Structure, beta: Array, single: bool) -> str:
    """What the derivatives need beyond the body's own tables."""
    if isinstance(structure, PlanarStructure):
        return shears(structure, beta, single)
    assert isinstance(structure, SpatialStructure)  # noqa: S101
    return array(REAL, "calib_flange", ["9"], structure.chain.rotation.ravel(), single)


def _rank(body: Body) -> int:
    """Directions that are kept: none where no curve is uncertain."""
    active = body.active if body.second is None else body.second.active
    label = body.structure.label
    return _RANK if any(label(int(k)).group.startswith("curve") for k in active[-1:]) else 0


def _compact(
    structure: Structure,
    belief: Body | Second,
    beta: Array,
    geometry: int,
    rank: int,
    vectors: Array,
    weight: Array,
) -> tuple[Array, Array, Array, Array]:
    """A root of the geometry, the curves' own terms, coupled directions and their signs.

    Directions are chosen where positions move most: `vectors` (d, d) of parameters times `weight`
    (d,).  What a belief predicts apart from `beta` is the last of them, to first order.
    """
    size, dof = structure.size, structure.dof
    covariance = np.zeros((size, size))
    covariance[np.ix_(belief.active, belief.active)] = belief.covariance
    # a sum of squares stays positive in single precision, which the covariance itself does not
    root = root_of(covariance[:geometry, :geometry]).T
    remaining = covariance.copy()
    remaining[:geometry, :geometry] = 0.0
    own = np.zeros((dof, 4 * HARMONICS + 1))
    # of a curve by itself the variance is a trigonometric polynomial, sampled at enough places
    turn: Array = np.linspace(0.0, 2 * np.pi, 8 * HARMONICS, endpoint=False)
    wave = powers(turn)
    waves = np.concatenate([wave.real, wave.imag], axis=1)
    curves = curves_of(structure)
    for k, curve in curves.items():
        block = np.ix_(curve, curve)
        terms = np.fft.rfft(((waves @ covariance[block]) * waves).sum(axis=1)) / len(waves)
        own[k, 0], remaining[block] = float(terms[0].real), 0.0
        own[k, 1::2] = 2 * terms[1 : 2 * HARMONICS + 1].real
        own[k, 2::2] = -2 * terms[1 : 2 * HARMONICS + 1].imag
    strength, kept = np.linalg.eigh((vectors * weight).T @ remaining @ (vectors * weight))
    most = np.argsort(-np.abs(strength))[:rank]
    directions = ((vectors / weight) @ kept[:, most] * np.sqrt(np.abs(strength[most]))).T
    # on rotations a difference of vectors is no rotation: the one that leads from one to the other
    apart, view = belief.beta - beta, structure.groups["view.rotation"]
    if len(view) == 3:
        apart[view] = compose(belief.beta[view], -beta[view])
    directions = np.vstack([directions, apart])
    coupled = np.zeros((rank + 1, geometry + 2 * HARMONICS * dof))
    coupled[:, :geometry] = directions[:, :geometry]
    for k, curve in curves.items():
        start = geometry + 2 * HARMONICS * k
        coupled[:, start : start + len(curve)] = directions[:, curve]
    return root, own, coupled, np.sign(strength[most])
