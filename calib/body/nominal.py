"""The nominal geometry of a planar arm, found from any planar forward function by regression."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..errors import OptionError

Complex = NDArray[np.complex128]

_ALIKE = 3e-5
"""Share of the largest spread below which columns are one."""


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


def linear_chain(
    q: Array, tip: Complex, signs: tuple[int, ...], mirror: int, revolute: tuple[bool, ...]
) -> tuple[Nominal, Array]:
    """The planar chain of given signs that fits tips (n,) best, and its distances (n,) from them.

    It is linear in its links: a turning joint gives ``exp(j psi_i)``, a slide ``q_i exp(j psi_i)``,
    where psi sums the signed angles up to the joint.  Both are conjugated where `mirror` is -1.
    """
    turning, signed = np.asarray(revolute), q * np.asarray(signs, dtype=float)
    waves = np.exp(1j * mirror * np.cumsum(np.where(turning, signed, 0.0), axis=1))
    columns = np.c_[np.where(turning, waves, signed * waves), np.ones(len(q))]
    scale = np.sqrt(np.mean(np.abs(columns) ** 2, axis=0)) + 1e-300
    # a joint that hardly moves makes columns alike: they share what they cannot tell apart
    t = np.linalg.lstsq(columns / scale, tip, rcond=_ALIKE)[0] / scale
    angles, sizes = np.angle(t[:-1]), np.abs(t[:-1])
    offsets, before = np.zeros(len(sizes)), 0.0
    for i, turns in enumerate(revolute):
        known = sizes[i] > 1e-9 * sizes.max()
        along = mirror * (angles[i] - angles[0]) if known else before
        offsets[i] = (along - before + np.pi) % (2 * np.pi) - np.pi
        if turns:
            before = along
    shift = float(t[-1].real), float(t[-1].imag)
    lengths, directions = tuple(sizes.tolist()), tuple(offsets.tolist())
    found = Nominal(lengths, directions, float(angles[0]), shift, mirror, signs)
    return found, np.abs(columns @ t - tip)


def sides(revolute: tuple[bool, ...]) -> Iterator[tuple[tuple[int, ...], int]]:
    """Signs of the joints and mirrors that differ; the first that turns does not: it is a mirror.

    A joint whose axis points into the plane turns the other way; a slide that is reversed is
    another offset.
    """
    first = next((i for i, turns in enumerate(revolute) if turns), None)
    ways = [(1, -1) if turns and i != first else (1,) for i, turns in enumerate(revolute)]
    for signs in product(*ways):
        yield signs, 1
        yield signs, -1


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
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    span = np.maximum(upper - lower, np.where(revolute, 2.0, 1e-3))
    drawn = np.random.default_rng(0).random((400, len(revolute))) - 0.5
    q = (lower + upper) / 2 + drawn * span
    tip = np.asarray(forward(q), dtype=float) @ (1, 1j)
    found = [linear_chain(q, tip, *side, revolute) for side in sides(revolute)]
    best, miss = min(found, key=lambda each: float(each[1].max()))
    if not miss.max() <= 1e-6 * (1e-9 + float(np.abs(tip).max())):
        raise OptionError(
            f"nominal: the forward function is no planar chain (off by {miss.max():.3g} m), "
            "expected joints that turn about or slide along one plane; give nominal=None"
        )
    return replace(best, lengths=tuple(np.where(revolute, best.lengths, 0.0).tolist()))
