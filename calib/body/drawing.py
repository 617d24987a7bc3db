"""The drawing of a planar arm: lengths, directions and frame of a chain of parallel axes.

Links are complex numbers, directions in the plane; see `planar.PlanarState`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arm.arm import Arm, PlanarArm
from ..common.rows import row_lengths
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
        vectors = slides / row_lengths(chain.axes)
        end = tip
        for joint in reversed(np.flatnonzero(turning)):
            vectors[joint] = end - origins[joint]
            end = complex(origins[joint])
        mirror = int(turns[turning][0]) if turning.any() else 1
        signs = np.where(turning, turns * mirror, 1)
        from_front = vectors if mirror > 0 else vectors.conj()
        lengths = np.where(turning, np.abs(vectors), 0.0)
        return PlanarDrawing(
            lengths=tuple(lengths.tolist()),
            offsets=tuple(offsets_of(from_front, arm.revolute)),
            rotation=float(np.angle(vectors[0])),
            shift=(end.real, end.imag),
            mirror=mirror,
            signs=tuple(signs.tolist()),
        )


def offsets_of(links: Complex, revolute: tuple[bool, ...]) -> list[float]:
    """Angles (dof,) [rad] of links against the last one that turns; 0 of one without a length."""
    sizes = np.abs(links)
    angles = np.angle(links)
    angles -= angles[0]
    offsets: list[float] = []
    before = 0.0
    for angle, size, turns in zip(angles, sizes, revolute, strict=True):
        along = before
        if size > 1e-9 * sizes.max():
            along = float(angle)
        turn = along - before + np.pi
        offsets.append(turn % (2 * np.pi) - np.pi)
        if turns:
            before = along
    return offsets
