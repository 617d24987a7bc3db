"""One query of a planar body in plain Python floats: microseconds instead of NumPy's overhead.

Use it in a control loop.  The answers equal those of `PlanarStructure` to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..common.arrays import Array
from .curves import curve_table, in_table, in_table_with_slope
from .planar import PlanarStructure

Sloped = tuple[float, float, list[float], list[float]]
"""x, y, and their derivatives by each joint."""

_Step = tuple[float, float, float, float]  # rate, or direction of a slide; where the joint stands


class PlanarRow(NamedTuple):
    """A compiled body; joint values [rad or m] are not checked."""

    # ``predict(q) -> (x, y)`` for a sequence of joint values
    predict: Callable[[Sequence[float]], tuple[float, float]]
    sloped: Callable[[Sequence[float]], Sloped]  # ``sloped(q) -> (x, y, dx/dq, dy/dq)``

    @staticmethod
    def of(structure: PlanarStructure, beta: Array) -> PlanarRow:
        """Compile the parameters (d,) of a body."""
        lay, cos, sin = structure.groups, math.cos, math.sin
        dof, slide, turning = (
            structure.dof,
            structure.slide,
            [i for i, t in enumerate(structure.revolute) if t],
        )
        signs = [float(s) for s in structure.signs]
        curves = [
            curve_table(beta[lay[f"curve.{i}"]]) if structure.revolute[i] else None
            for i in range(dof)
        ]
        gains = (beta[lay["gain"]] * structure.signs).tolist()
        parts = gains, beta[lay["offset"]].tolist(), beta[lay["length"]].tolist(), curves
        joints = tuple(zip(structure.revolute, *parts, strict=True))
        waves = beta[lay["elastic"]].reshape(-1, 2).tolist()
        bends = [
            (i, j, a, b) for (i, j), (a, b) in zip(structure.pairs, waves, strict=True) if a or b
        ]
        none = [0.0] * dof
        see, spread = _view(structure, beta)

        def loads(q: Sequence[float], tilts: list[tuple[int, int, float]]) -> list[float]:
            """Elastic part of each angle; `tilts` gets the derivatives by the nominal angles."""
            more, sums, total = [0.0] * dof, [0.0] * dof, 0.0
            for i in turning:
                total += signs[i] * q[i]
                sums[i] = total
            for i, j, a, b in bends:
                c, s = cos(sums[j]), sin(sums[j])
                more[i] += a * c + b * s
                tilts.append((i, j, b * c - a * s))
            return more

        def predict(q: Sequence[float]) -> tuple[float, float]:
            phi = x = y = 0.0
            extra = loads(q, []) if bends else none
            for (turns, gain, offset, length, table), value, more in zip(
                joints, q, extra, strict=True
            ):
                if turns:
                    phi += gain * value + offset + more
                    if table is not None:
                        phi += in_table(table, value)
                    x += length * cos(phi)
                    y += length * sin(phi)
                else:
                    reach = length + gain * value * slide
                    x += reach * cos(phi + offset)
                    y += reach * sin(phi + offset)
            return see(x, y)

        def sloped(q: Sequence[float]) -> Sloped:
            tilts: list[tuple[int, int, float]] = []
            steps: list[_Step] = []
            phi = x = y = 0.0
            extra = loads(q, tilts) if bends else none
            for (turns, gain, offset, length, table), value, more in zip(
                joints, q, extra, strict=True
            ):
                if turns:
                    rate = gain
                    phi += gain * value + offset + more
                    if table is not None:
                        wave, slope = in_table_with_slope(table, value)
                        phi += wave
                        rate += slope
                    steps.append((rate, 0.0, x, y))
                    x += length * cos(phi)
                    y += length * sin(phi)
                else:
                    c, s = cos(phi + offset), sin(phi + offset)
                    steps.append((c * gain * slide, s * gain * slide, x, y))
                    reach = length + gain * value * slide
                    x += reach * c
                    y += reach * s
            # a joint turns all that comes after it about its own place
            gx, gy = [], []
            for turns, (along, across, at_x, at_y) in zip(structure.revolute, steps, strict=True):
                gx.append(-(y - at_y) * along if turns else along)
                gy.append((x - at_x) * along if turns else across)
            for i, j, bend in tilts:
                for n in turning:
                    if n <= j:
                        gx[n] -= (y - steps[i][3]) * bend * signs[n]
                        gy[n] += (x - steps[i][2]) * bend * signs[n]
            (v00, v01), (v10, v11) = spread(x, y)
            return (
                *see(x, y),
                [v00 * a + v01 * b for a, b in zip(gx, gy, strict=True)],
                [v10 * a + v11 * b for a, b in zip(gx, gy, strict=True)],
            )

        return PlanarRow(predict, sloped)


_Pair = tuple[float, float]


def _view(
    structure: PlanarStructure, beta: Array
) -> tuple[Callable[[float, float], _Pair], Callable[[float, float], tuple[_Pair, _Pair]]]:
    """What the sensor sees of a point of the chain's plane, and the derivative of that."""
    (a, b), (c, d) = structure.measurement.matrix(structure.seeing(beta)).tolist()
    tx, ty, hx, hy, k, cx, cy = beta[4:11].tolist()
    mx, my = structure.centre
    size, law = structure.measurement.size_of_lens, structure.seen_as.bend

    def flat(x: float, y: float) -> _Pair:
        w = 1.0 + x * hx + y * hy
        return (a * x + b * y) / w + tx, (c * x + d * y) / w + ty

    def tilt(x: float, y: float) -> tuple[_Pair, _Pair]:
        w = 1.0 + x * hx + y * hy
        px, py = (a * x + b * y) / w, (c * x + d * y) / w
        return ((a - px * hx) / w, (b - px * hy) / w), ((c - py * hx) / w, (d - py * hy) / w)

    def see(x: float, y: float) -> _Pair:
        x, y = flat(x, y)
        u, v = (x - mx) / size - cx, (y - my) / size - cy
        rise, ratio, _ = law(k, u * u + v * v)
        grow = size * rise * ratio
        return x + grow * u, y + grow * v

    def spread(x: float, y: float) -> tuple[_Pair, _Pair]:
        (v00, v01), (v10, v11) = tilt(x, y)
        x, y = flat(x, y)
        u, v = (x - mx) / size - cx, (y - my) / size - cy
        rise, ratio, _ = law(k, u * u + v * v)
        l00, l11 = (1.0 + rise * (ratio + 2.0 * w * w) for w in (u, v))
        l01 = 2.0 * rise * u * v
        return (
            (l00 * v00 + l01 * v10, l00 * v01 + l01 * v11),
            (l01 * v00 + l11 * v10, l01 * v01 + l11 * v11),
        )

    if k:
        return see, spread
    return (flat, tilt) if hx or hy else (flat, lambda _x, _y: ((a, b), (c, d)))
