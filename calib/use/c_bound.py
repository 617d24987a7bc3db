"""C source and tables of the posterior's bound, for an arm of more than three joints.

The whole covariance of 600 parameters would take a megabyte.  Kept are the covariance of the
geometry, of each joint's curve by itself (one function of the joint's value), and of what couples
them the `RANK` directions that move positions most.  Python's bound has all of it: on the UR10 the
header's is within a thirtieth of it, of a planar chain that 120 rows tell of within a tenth.  The
nodes' bounds, blended, were off by a factor of 4, the covariance's own largest directions by half.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..body.belief import SHARED
from ..body.bound import NORMAL_95, root_of
from ..body.curves import HARMONICS, powers
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.spatial_view import compose
from ..common.arrays import Array
from . import c_planar, c_slopes
from .c_curves import curves_of
from .c_source import array, integers

if TYPE_CHECKING:
    from ..body.belief import Body, Second
    from ..body.structure import Structure

RANK = 32
"""Directions that are kept of what couples curves with each other and with the geometry."""


SOURCE = """\

/* How a position moves along a direction of the parameters. */
static inline void calib_along(const float *direction, calib_real geometry[][3],
                               calib_real own[][3], calib_real wave[][4 * @waves@],
                               calib_real out[3]) {
  int i, k, n;
  for (k = 0; k < 3; ++k) out[k] = 0;
  for (i = 0; i < CALIB_GEOMETRY; ++i)
    for (k = 0; k < 3; ++k) out[k] += direction[i] * geometry[i][k];
  if (!wave) return;
  for (i = 0; i < CALIB_DOF; ++i) {
    const float *curve = direction + CALIB_GEOMETRY + 2 * @waves@ * i;
    calib_real sum = 0;
    for (n = 0; n < @waves@; ++n)
      sum += curve[n] * wave[i][2 * n] + curve[@waves@ + n] * wave[i][2 * n + 1];
    for (k = 0; k < 3; ++k) out[k] += sum * own[i][k];
  }
}

/* Radius of 95 % of a Gaussian of covariance S (xx, xy, xz, yy, yz, zz) and more (3). */
static inline calib_real calib_radius_95(const calib_real S[6], calib_real share,
                                         const calib_real more[3]) {
  const calib_real a = share * S[0] + more[0], d = share * S[3] + more[1];
  const calib_real f = share * S[5] + more[2], trace = a + d + f;
  const calib_real off = share * share * (S[1] * S[1] + S[2] * S[2] + S[4] * S[4]);
  const calib_real square = a * a + d * d + f * f + 2 * off;
  calib_real g, r;
  if (!(trace > 0)) return 0;
  g = (calib_real)2 / 9 * square / (trace * trace);
  r = 1 - g + @normal@ * sqrt(g);
  return sqrt(trace * r * r * r);
}

static inline calib_real calib_posterior(const calib_real q[CALIB_DOF]) {
  static const int first[6] = {0, 0, 0, 1, 1, 2}, other[6] = {0, 1, 2, 1, 2, 2};
  calib_real geometry[CALIB_GEOMETRY][3], own[CALIB_DOF][3], wave[CALIB_DOF][4 * @waves@];
  calib_real S[6], y[3], bound = 0, apart;
  int b, i, k, n;
  calib_derivatives(q, geometry, own);
  for (i = 0; i < CALIB_DOF; ++i) {
    const calib_real c = cos(q[i]), s = sin(q[i]);
    wave[i][0] = c;
    wave[i][1] = s;
    for (n = 1; n < 2 * @waves@; ++n) {
      wave[i][2 * n] = wave[i][2 * n - 2] * c - wave[i][2 * n - 1] * s;
      wave[i][2 * n + 1] = wave[i][2 * n - 2] * s + wave[i][2 * n - 1] * c;
    }
  }
  for (b = 0; b < @beliefs@; ++b) {
    for (k = 0; k < 6; ++k) S[k] = 0;
    for (i = 0; i < CALIB_GEOMETRY; ++i) {
      calib_along(calib_root[b * CALIB_GEOMETRY + i], geometry, own, 0, y);
      for (k = 0; k < 6; ++k) S[k] += y[first[k]] * y[other[k]];
    }
    for (i = 0; i < CALIB_DOF; ++i) {
      const float *term = calib_own[b * CALIB_DOF + i];
      calib_real size = term[0];
      for (n = 0; n < 4 * @waves@; ++n) size += term[1 + n] * wave[i][n];
      for (k = 0; k < 6; ++k) S[k] += size * own[i][first[k]] * own[i][other[k]];
    }
    for (i = 0; i < @rank@; ++i) {
      calib_along(calib_coupled[b * (@rank@ + 1) + i], geometry, own, wave, y);
      for (k = 0; k < 6; ++k) S[k] += calib_gains[b * @rank@ + i] * y[first[k]] * y[other[k]];
    }
    calib_along(calib_coupled[b * (@rank@ + 1) + @rank@], geometry, own, wave, y);
    apart = sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
    apart += calib_scale[b][0] * calib_radius_95(S, calib_scale[b][1], calib_more);
    if (apart > bound) bound = apart;
  }
  return bound;
}
"""


def source(body: Body) -> str:
    """The bound's source, after that of the body."""
    if not isinstance(body.structure, SpatialStructure):
        return c_slopes.PLANAR + SOURCE
    return (c_slopes.PIXELS if body.structure.camera else "") + c_slopes.SPATIAL + SOURCE


def words(body: Body) -> dict[str, object]:
    """Numbers that stand in the source itself."""
    structure = body.structure
    own: dict[str, object] = {}
    if isinstance(structure, SpatialStructure):
        own["bends"] = int(len(structure.groups["elastic"]) > 0)
        own["seen"] = "  calib_in_pixels(p, geometry, own);\n" if structure.camera else ""
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
    scale = np.array([(body.kappa, SHARED**2), (1.0, 1.0)][: len(parts)])
    more = np.zeros(3)
    more[:seen] = body.residual[:seen] ** 2 + (body.noise[:seen] ** 2 if noise else 0.0)
    size, waves = "CALIB_GEOMETRY", 2 * HARMONICS
    return (
        f"\nenum {{ {size} = {geometry} }};\n"
        + array("float", "calib_root", [str(len(root)), size], root, True)
        + array("float", "calib_own", [str(len(own)), str(2 * waves + 1)], own, True)
        + array("float", "calib_coupled", [str(len(coupled)), str(coupled.shape[1])], coupled, True)
        + integers("calib_gains", str(max(len(signs), 1)), signs if rank else [0])
        + array("calib_real", "calib_scale", [str(len(scale)), "2"], scale, single)
        + array("calib_real", "calib_more", ["3"], more, single)
        + _own(structure, body.beta, single)
    )


def _own(structure: Structure, beta: Array, single: bool) -> str:
    """What the derivatives need beyond the body's own tables."""
    if isinstance(structure, PlanarStructure):
        return c_planar.shears(structure, beta, single)
    assert isinstance(structure, SpatialStructure)  # noqa: S101
    return array("calib_real", "calib_flange", ["9"], structure.chain.rotation.ravel(), single)


def _rank(body: Body) -> int:
    """Directions that are kept: none where no curve is uncertain."""
    active = body.active if body.second is None else body.second.active
    label = body.structure.label
    return RANK if any(label(int(k)).group.startswith("curve") for k in active[-1:]) else 0


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
    root = root_of(covariance[:geometry, :geometry]).T
    left = covariance.copy()
    left[:geometry, :geometry] = 0.0
    own = np.zeros((dof, 4 * HARMONICS + 1))
    # of a curve by itself the variance is a trigonometric polynomial, sampled at enough places
    turn: Array = np.linspace(0.0, 2 * np.pi, 8 * HARMONICS, endpoint=False)
    wave = powers(turn)
    waves = np.concatenate([wave.real, wave.imag], axis=1)
    curves = curves_of(structure)
    for k, curve in curves.items():
        block = np.ix_(curve, curve)
        terms = np.fft.rfft(((waves @ covariance[block]) * waves).sum(axis=1)) / len(waves)
        own[k, 0], left[block] = float(terms[0].real), 0.0
        own[k, 1::2] = 2 * terms[1 : 2 * HARMONICS + 1].real
        own[k, 2::2] = -2 * terms[1 : 2 * HARMONICS + 1].imag
    strength, kept = np.linalg.eigh((vectors * weight).T @ left @ (vectors * weight))
    most = np.argsort(-np.abs(strength))[:rank]
    directions = ((vectors / weight) @ kept[:, most] * np.sqrt(np.abs(strength[most]))).T
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
