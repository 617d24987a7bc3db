"""The drawing of a planar arm: lengths, directions and frame of a chain of parallel axes.

With complex positions in the plane, and psi_i the sum of the turning joints' signed angles up to
joint i, the tip is linear in the links::

    tip = shift + sum over turning joints of t_i exp(j mirror psi_i)
                + sum over slides of q_i t_i exp(j mirror psi_i)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arm.arm import Arm, PlanarArm
from ..common.arrays import Array
from ..errors import OptionError

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class PlanarDrawing:
    """Lengths, offsets and frame of a planar chain, in metres and radians."""

    # length beyond each turning joint; along a slide its displacement at zero
    lengths: tuple[float, ...]
    # angle of each link against the one before; direction of a slide.  The first is zero.
    offsets: tuple[float, ...]
    # angle of the chain's own frame in the plane's frame [rad]
    rotation: float
    shift: tuple[float, float]  # origin of the chain in the plane's frame [m]
    # -1 where the first turning joint turns clockwise in that frame
    mirror: int
    # direction of each joint against the first turning one; slides are +1
    signs: tuple[int, ...]

    @staticmethod
    def of(arm: Arm) -> PlanarDrawing:
        """The drawing of a planar arm, in its plane's frame.

        Raises OptionError if a joint is not parallel to the others or follows another one.
        """
        if not isinstance(arm, PlanarArm) or arm.chain.joints != arm.dof:
            raise OptionError(
                f"{arm.name or 'the arm'} is no planar chain: expected joints that turn about or "
                "slide along one plane, and none that follows another one"
            )
        chain = arm.chain
        turning = np.asarray(arm.revolute)
        plane = arm.plane
        number = np.array([1, 1j])
        origins: Complex = plane.project(chain.points) @ number
        tip = complex(plane.project(chain.tip) @ number)
        turns = np.sign(chain.axes @ plane.normal).astype(int)
        slides: Complex = chain.axes @ plane.basis[:2].T @ number
        vectors = slides / np.linalg.norm(chain.axes, axis=1)
        end = tip
        for joint in reversed(np.flatnonzero(turning)):
            vectors[joint] = end - origins[joint]
            end = complex(origins[joint])
        mirror = int(turns[turning][0]) if turning.any() else 1
        signs = np.where(turning, turns * mirror, 1)
        return drawing_of(
            vectors, end, tuple(signs.tolist()), mirror, arm.revolute
        )


def waves(
    q: Array, signs: Sequence[int], mirror: int, revolute: tuple[bool, ...]
) -> Complex:
    """What the links (dof,) are multiplied by at joint values (n, dof), (n, dof)."""
    turning = np.asarray(revolute)
    signed = q * np.asarray(signs, dtype=float)
    turns = np.exp(
        1j * mirror * np.cumsum(np.where(turning, signed, 0.0), axis=1)
    )
    return np.where(turning, turns, signed * turns)


def drawing_of(
    vectors: Complex,
    shift: complex,
    signs: tuple[int, ...],
    mirror: int,
    revolute: tuple[bool, ...],
) -> PlanarDrawing:
    """The drawing of links (dof,) at zero."""
    sizes = np.abs(vectors)
    angles = np.angle(vectors)
    offsets: list[float] = []
    before = 0.0
    for angle, size, turns in zip(angles, sizes, revolute, strict=True):
        along = before  # of a link without a length
        if size > 1e-9 * sizes.max():
            along = mirror * (float(angle) - float(angles[0]))
        turn = (along - before + np.pi) % (2 * np.pi)
        offsets.append(turn - np.pi)
        if turns:
            before = along
    return PlanarDrawing(
        lengths=tuple(np.where(revolute, sizes, 0.0).tolist()),
        offsets=tuple(offsets),
        rotation=float(angles[0]),
        shift=(shift.real, shift.imag),
        mirror=mirror,
        signs=signs,
    )
