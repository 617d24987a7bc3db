"""The nominal geometry of a planar arm, found from any planar forward function by regression."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..errors import OptionError


@dataclass(frozen=True)
class Nominal:
    """Lengths, offsets and frame of a planar chain, in metres and radians."""

    # length beyond each turning joint; along a slide its displacement at zero
    lengths: tuple[float, ...]
    # angle of each link against the one before; direction of a slide.  The first is zero.
    offsets: tuple[float, ...]
    rotation: float = 0.0  # angle of the chain's own frame in the forward function's frame [rad]
    # origin of the chain in the forward function's frame [m]
    shift: tuple[float, float] = (0.0, 0.0)
    mirror: int = 1  # -1 where the first turning joint turns clockwise in that frame
    # direction of each joint against the first turning one; slides are +1
    signs: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.signs:
            object.__setattr__(self, "signs", (1,) * len(self.lengths))


def chain_of(
    t: NDArray[np.complexfloating[Any, Any]], mirror: int, revolute: tuple[bool, ...]
) -> tuple[Array, Array, float]:
    """Magnitudes (dof,), offsets (dof,) and rotation of a chain from its coefficients (dof,).

    The coefficients are those of `regressors`, of their conjugates where `mirror` is -1.
    """
    angles, size = np.angle(t), np.abs(t)
    rotation = float(angles[0])
    offsets, before = np.zeros(len(t)), 0.0
    tiny = 1e-9 * float(size.max(initial=0.0))
    for i, turns in enumerate(revolute):
        along = mirror * (angles[i] - rotation) if size[i] > tiny else before
        offsets[i] = (along - before + np.pi) % (2 * np.pi) - np.pi
        if turns:
            before = along
    offsets[0] = 0.0
    return size, offsets, rotation


def regressors(q: Array, signs: Array, revolute: tuple[bool, ...]) -> Array:
    """Columns (n, dof) complex of which a chain's tip is a linear combination.

    A turning joint gives ``exp(j psi_i)``, a slide ``q_i exp(j psi_i)``; psi sums the signed
    angles up to the joint.
    """
    turning = np.asarray(revolute)
    signed = q * signs
    waves = np.exp(1j * np.cumsum(np.where(turning, signed, 0.0), axis=1))
    return np.where(turning, waves, signed * waves)


def nominal_of(
    forward: Callable[[Array], Array], lower: Array, upper: Array, revolute: tuple[bool, ...]
) -> Nominal:
    """Nominal geometry of a planar arm from its forward function.

    forward : positions (n, 2) [m] at joint values (n, dof)
    lower, upper : (dof,), range in which the function is asked [rad or m]
    revolute : which joints turn
    Returns Nominal, with ``forward(q) = shift + rotation mirror chain(q)`` to rounding.
    Raises OptionError if the function is not that of a planar chain whose joints all turn or slide
    in its plane.
    """
    generator = np.random.default_rng(0)
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    span = np.where(np.asarray(revolute), np.maximum(upper - lower, 2.0), upper - lower)
    middle = (lower + upper) / 2
    q = middle + (generator.random((400, len(revolute))) - 0.5) * np.maximum(span, 1e-3)
    z = np.asarray(forward(q), dtype=float)
    tip = z[:, 0] + 1j * z[:, 1]
    best: Nominal | None = None
    least = np.inf
    turning = np.flatnonzero(np.asarray(revolute))
    # A joint whose axis points into the plane turns the other way: every sign is tried.
    for code in range(2 ** len(revolute)):
        signs = np.array([1.0 if not code >> i & 1 else -1.0 for i in range(len(revolute))])
        if (signs[~np.asarray(revolute)] < 0).any():  # a slide that is reversed is another offset
            continue
        columns = np.c_[regressors(q, signs, revolute), np.ones(len(q))]
        t = np.linalg.lstsq(columns, tip, rcond=None)[0]
        error = float(np.abs(columns @ t - tip).max())
        if error < least:
            mirror = int(signs[turning[0]]) if len(turning) else 1
            size, offsets, rotation = chain_of(t[:-1], mirror, revolute)
            least, best = error, Nominal(
                tuple(np.where(revolute, size, 0.0).tolist()), tuple(offsets.tolist()), rotation,
                (float(t[-1].real), float(t[-1].imag)), mirror,
                tuple(np.where(revolute, signs * mirror, 1).astype(int).tolist()),
            )  # fmt: skip
    if best is None or not least <= 1e-6 * (1e-9 + float(np.abs(tip).max())):
        raise OptionError(
            f"nominal: the forward function is no planar chain (off by {least:.3g} m), expected "
            "joints that turn about or slide along one plane; give nominal=None"
        )
    return best
