"""Plausibility: units, columns and times of a log that its robot's kinematics contradict.

Use it once a log has been read for a robot with a URDF.  What can only be a mistake is an error
with the option that mends it; what may be intended is a note.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import similarity
from ..common.arrays import Array
from ..common.rows import thinned
from ..common.scale import METRES
from ..errors import LogError

if TYPE_CHECKING:
    from ..arm.arm import Arm

_OUT_OF_PLANE = 0.02
"""Share of the extent by which positions of a planar arm may leave their plane (rms)."""

_ROWS = 400  # rows that are compared
_SIZE = (0.5, 2.0)  # an extent this many times the nominal one needs no word
_UNIT = 0.05  # by how much a ratio may differ from that of two units: 900 is no millimetre
_PIXELS = 5.0  # a ratio above, of no unit of length, is that of pixels most likely
_CLEAR = 0.2  # a misfit this many times another one's is a mistake
_GOOD = 0.1  # of the extent: a misfit that shows that the kinematics are right
_SMALL = 0.005  # of the extent: a reversed wrist joint leaves 2 %, a drawing is right to 0.2 %
_LAGS = 20  # rows
_PATH = 0.1  # median step of the joints over their spread, above which rows are no path


def check_against_robot(
    label: str,
    arm: Arm,
    q: Array,
    x: Array,
    unit: str,
    names: Sequence[str],
    *,
    fitted_plane: bool = False,
) -> list[str]:
    """Compare a log with the nominal kinematics, whatever the sensor's frame.

    arm : its kinematics are nominal: errors of some percent are none
    q, x : (n, dof) [unit], joint values and positions in the order of the log
    fitted_plane : whether the axes of the positions are those of a plane that was fitted to x, y, z
    Raises LogError for another unit of length than was said, for exchanged columns of joints and,
    of an arm in space, for a joint that counts the other way.
    """
    if len(q) < 8:
        return []
    rows = thinned(len(q), _ROWS)
    some, seen = q[rows], x[rows]
    nominal = arm.forward(some)
    if nominal.shape != seen.shape or not np.isfinite(nominal).all():
        return []
    if unit == "m":
        _check_size(label, _size(seen) / max(_size(nominal), 1e-300))
    extent, own = _size(seen), aligned_misfit(nominal, seen)
    notes = []
    if own > _SMALL * extent:
        _check_order(label, arm, some, seen, own, names, any_order=own > _GOOD * extent)
        notes += _check_signs(label, arm, some, seen, names)
    flipped = nominal * np.array([-1.0, 1.0, 1.0])[: nominal.shape[1]]
    mirrored = aligned_misfit(flipped, seen) < _CLEAR * max(own, 1e-12 * extent)
    if mirrored and unit == "m" and not fitted_plane:
        notes.append(
            f"{label}: the positions are mirrored, compared with the robot: the sensor's axes are "
            "left-handed, or one of them is reversed"
        )
    if lag := lag_behind_arm(arm, q, x):
        side = "follow" if lag > 0 else "precede"
        rows_apart = "1 row" if abs(lag) == 1 else f"{abs(lag)} rows"
        notes.append(
            f"{label}: the positions {side} the joints by {rows_apart}: align the two in time "
            "before the log is written"
        )
    return notes


def aligned_misfit(a: Array, b: Array) -> float:
    """Root mean square distance of `b` (n, m) from `a` (n, m), turned, shifted and scaled."""
    # no reflection: a mirrored sensor is to be seen as a misfit
    turn, shift, scale = similarity(a, b)
    return _rms(b - scale * a @ turn.T - shift)


def unit_of_ratio(ratio: float) -> str:
    """Return the unit of which so many are a metre, empty where none fits.

    Examples
    --------
    >>> unit_of_ratio(1012.0), unit_of_ratio(900.0)
    ('mm', '')
    """
    return next((n for n, f in METRES.items() if n != "m" and abs(ratio / f - 1.0) < _UNIT), "")


def unit_hint(ratio: float) -> str:
    """Return what a log's scale against its model's says of its unit, as the end of a message."""
    name = unit_of_ratio(ratio)
    if name:
        return f"; if they are in {name}, `unit={name!r}` converts them"
    return "; if they are pixels, train a model of such a log" if ratio > _PIXELS else ""


def lag_behind_arm(arm: Arm, q: Array, x: Array) -> int:
    """Return by how many rows positions follow the joints, 0 where no shift fits far better.

    Rows along a path fit nearly as well a row later; poses in any order fit not at all.
    """
    n = len(q)
    most = min(_LAGS, n // 5)
    if most < 1:
        return 0
    step = np.median(np.abs(np.diff(q, axis=0)), axis=0)
    path = float(np.max(step / np.maximum(np.ptp(q, axis=0), 1e-12))) <= _PATH
    nominal = arm.forward(q)
    rows = np.linspace(most, n - 1 - most, min(n - 2 * most, _ROWS)).round().astype(np.intp)
    found = {
        shift: aligned_misfit(nominal[rows - shift], x[rows]) for shift in range(-most, most + 1)
    }
    best = min(found, key=lambda shift: (found[shift], abs(shift)))
    return best if found[best] < (0.5 if path else _CLEAR) * found[0] else 0


def check_flat(label: str, x: Array, distance: Array, unit: str, rows: NDArray[np.intp]) -> None:
    """Refuse positions (n, 3) of a planar arm whose distances (n,) from their plane are large.

    Raises LogError if their root mean square is above `_OUT_OF_PLANE` of the extent.
    """
    rms = float(np.sqrt(np.mean(distance**2)))
    share = rms / max(_size(x), 1e-300)
    if share <= _OUT_OF_PLANE:
        return
    worst = int(np.argmax(np.abs(distance)))
    raise LogError(
        f"{label}: x, y, z leave their plane by {rms:.4g} {unit} rms, {100 * share:.2g} % of the "
        f"extent (at most {100 * _OUT_OF_PLANE:g} %); row {rows[worst]} by "
        f"{abs(float(distance[worst])):.4g} {unit}",
        hint="other joints moved the tip: name all that moved in `joints`, or leave out the rows "
        "in which they did",
        parameter="joints",
        value=share,
    )


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(rows**2, axis=1))))


def _size(x: Array) -> float:
    """Root mean square distance of rows (n, m) from their middle."""
    return _rms(x - x.mean(axis=0))


def _check_size(label: str, ratio: float) -> None:
    """Refuse positions that extend over a multiple of what they should, if that is a unit's."""
    name = unit_of_ratio(ratio)
    if _SIZE[0] < ratio < _SIZE[1] or not (name or ratio > _PIXELS):
        return
    other = "for pixels give `unit='px'`, for another unit its name"
    raise LogError(
        f"{label}: the positions extend over {ratio:.4g} times what the robot's links allow for "
        "these joint values, if they are in m",
        hint=f"if they are in {name}, give `unit={name!r}`" if name else other,
        parameter="unit",
        value="m",
    )


def _check_order(
    label: str, arm: Arm, q: Array, x: Array, own: float, names: Sequence[str], *, any_order: bool
) -> None:
    """Refuse columns of joints that fit in another order alone: in any, or with two exchanged."""
    if q.shape[1] > 6:
        return
    orders = [
        order
        for order in itertools.permutations(range(q.shape[1]))
        if any_order or sum(k != j for k, j in enumerate(order)) == 2
    ]
    found = {order: aligned_misfit(arm.forward(q[:, list(order)]), x) for order in orders}
    best = min(orders, key=lambda order: found[order])
    if found[best] < _CLEAR * own:
        pairs = {names[k]: names[j] for k, j in enumerate(best) if k != j}
        raise LogError(
            f"{label}: the log fits the robot only if columns of joints are exchanged",
            hint=f"give `columns={pairs}`, or correct the header",
            parameter="columns",
            value=list(pairs),
        )


def _with_tool(arm: Arm, q: Array, x: Array) -> float:
    """`aligned_misfit` of an arm, in space with an unknown tool: linear in place and orientation.

    A tool of 30 mm hides a reversed wrist joint from `aligned_misfit`.
    """
    if arm.outputs == 2:
        return aligned_misfit(arm.forward(q), x)
    place, turn = arm.pose(q)
    i, j = np.triu_indices(4)  # products of a quaternion: all of a rotation, and a constant
    features = np.hstack([place, turn[:, i] * turn[:, j]])
    if len(q) < 3 * features.shape[1]:
        return aligned_misfit(place, x)
    return _rms(x - features @ np.linalg.lstsq(features, x, rcond=None)[0])


def _check_signs(label: str, arm: Arm, q: Array, x: Array, names: Sequence[str]) -> list[str]:
    """Refuse a log that fits once one or two joints count the other way.

    The body of a planar arm learns signs, so that it is a note; all of them turned are a mirror.
    """
    joints = range(q.shape[1])
    own = _with_tool(arm, q, x)
    for some in [(k,) for k in joints] + list(itertools.combinations(joints, 2)):
        sign = np.where(np.isin(joints, some), -1.0, 1.0)
        if len(some) == len(joints) or _with_tool(arm, sign * q, x) >= _CLEAR * own:
            continue
        reversed_ones = [names[k] for k in some]
        told = (
            f"{label}: the log fits the robot only if {' and '.join(reversed_ones)} counts the "
            "other way"
        )
        if arm.outputs == 2:
            return [f"{told}; the model learns it so"]
        raise LogError(
            told,
            hint="its encoder or servo is reversed: change the sign of its column",
            parameter="joints",
            value=reversed_ones,
        )
    return []
