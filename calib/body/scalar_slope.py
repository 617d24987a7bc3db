"""Position and its derivative for one query of a planar body, in plain Python floats.

The counterpart of `PlanarStructure.slope` for a control loop; see :mod:`calib.body.scalar`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from .planar import PlanarStructure
from .scalar import KNOTS, curve_table
from .structure import Array

Sloped = tuple[float, float, list[float], list[float]]
"""x, y, and their derivatives by each joint."""


def compile_slope(structure: PlanarStructure, beta: Array) -> Callable[[Sequence[float]], Sloped]:
    """A function on floats: ``(x, y, dx/dq, dy/dq)`` for joint values [rad or m], unchecked."""
    lay, cos, sin = structure.layout, math.cos, math.sin
    per_radian = KNOTS / (2 * math.pi)
    signs = [float(s) for s in structure.signs]
    gains = (beta[lay.gain] * structure.signs).tolist()
    offsets, lengths = beta[lay.offset].tolist(), beta[lay.length].tolist()
    bends = []
    for c, (i, j) in enumerate(lay.pairs):
        a, b = beta[lay.elastic[2 * c : 2 * c + 2]].tolist()
        if a or b:
            bends.append((i, j, a, b))
    tables = [
        curve_table(beta[lay.curve[i]]) if i in lay.curve and beta[lay.curve[i]].any() else None
        for i in range(structure.dof)
    ]
    joints = tuple(zip(structure.revolute, gains, offsets, lengths, tables, strict=True))
    turning = lay.turning
    slide, dof = structure.slide, structure.dof
    (m00, m01), (m10, m11) = structure.matrix(beta).tolist()
    tx, ty, hx, hy, k, cx, cy = beta[4:11].tolist()
    mx, my = structure.centre
    size, law = structure.size_of_lens, structure.seen_as.bend
    tilted, bent = bool(hx or hy), bool(k)

    def evaluate(q: Sequence[float]) -> Sloped:
        more = [0.0] * dof  # elastic part of each angle
        tilts: list[tuple[int, int, float]] = []
        if bends:
            total = 0.0
            sums = [0.0] * dof
            for i in turning:
                total += signs[i] * q[i]
                sums[i] = total
            for i, j, a, b in bends:
                c, s = cos(sums[j]), sin(sums[j])
                more[i] += a * c + b * s
                tilts.append((i, j, b * c - a * s))
        phi = x = y = 0.0
        own, across, along = [], [], []  # of each joint: d theta, and the links that it carries
        for (turns, gain, offset, length, table), value, extra in zip(joints, q, more, strict=True):
            if not turns:
                c, s = cos(phi + offset), sin(phi + offset)
                reach = length + gain * value * slide
                own.append((c * gain * slide, s * gain * slide))
                across.append(x)
                along.append(y)
                x += reach * c
                y += reach * s
                continue
            theta, rate = gain * value + offset + extra, gain
            if table is not None:
                u = value * per_radian
                knot = math.floor(u)
                u -= knot
                c0, c1, c2, c3, c4, c5 = table[knot % KNOTS]
                theta += c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
                rate += per_radian * (
                    c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + 5.0 * u * c5)))
                )
            phi += theta
            own.append((rate, 0.0))
            across.append(x)
            along.append(y)
            x += length * cos(phi)
            y += length * sin(phi)
        # a joint turns all that comes after it about its own place
        gx, gy = [], []
        for i in range(dof):
            if joints[i][0]:
                rate = own[i][0]
                gx.append(-(y - along[i]) * rate)
                gy.append((x - across[i]) * rate)
            else:
                gx.append(own[i][0])
                gy.append(own[i][1])
        for i, j, bend in tilts:
            for n in turning:
                if n <= j:
                    gx[n] -= (y - along[i]) * bend * signs[n]
                    gy[n] += (x - across[i]) * bend * signs[n]
        if tilted:
            w = 1.0 + x * hx + y * hy
            px, py = (m00 * x + m01 * y) / w, (m10 * x + m11 * y) / w
            v00, v01 = (m00 - px * hx) / w, (m01 - px * hy) / w
            v10, v11 = (m10 - py * hx) / w, (m11 - py * hy) / w
        else:
            px, py = m00 * x + m01 * y, m10 * x + m11 * y
            v00, v01, v10, v11 = m00, m01, m10, m11
        px += tx
        py += ty
        if bent:
            u, v = (px - mx) / size - cx, (py - my) / size - cy
            rise, ratio, _ = law(k, u * u + v * v)
            l00 = 1.0 + rise * (ratio + 2.0 * u * u)
            l01 = 2.0 * rise * u * v
            l11 = 1.0 + rise * (ratio + 2.0 * v * v)
            px, py = px + size * rise * ratio * u, py + size * rise * ratio * v
            v00, v01, v10, v11 = (
                l00 * v00 + l01 * v10,
                l00 * v01 + l01 * v11,
                l01 * v00 + l11 * v10,
                l01 * v01 + l11 * v11,
            )
        return (
            px,
            py,
            [v00 * a + v01 * b for a, b in zip(gx, gy, strict=True)],
            [v10 * a + v11 * b for a, b in zip(gx, gy, strict=True)],
        )

    return evaluate
