"""Diagnosis of a log: what is wrong with its columns and units, told by what predicts it.

Other readings of the rows are tried in turn.  One that a predictor explains far better than the log
as it stands is a finding; where the predictor's frame stands does not matter.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arm.rotations import logarithm, matrix_of, nearest_rotation, similarity
from ..common.arrays import Array, Mask
from ..common.robust import solve_least_squares
from ..common.rows import thinned
from ..common.scale import METRES
from ..common.wording import listed
from ..errors import LogError
from . import settings

Predict = Callable[[Array], Array]
"""Positions (n, m) at joint values (n, dof), NaN where none is known."""

PosePredict = Callable[[Array], tuple[Array, Array]]
"""Positions (n, 3) and quaternions (n, 4) at joint values (n, dof)."""


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with a log, or looks so."""

    # still, copied, unit, inverted, turns, degrees, exchanged, reversed, mirrored
    kind: str
    words: str
    hint: str = ""  # the remedy, with Python's names of options
    parameter: str | None = None
    value: Any = None
    mistake: bool = True  # whether it can be nothing else; otherwise it may be intended


_Reading = tuple[Array, Finding]
"""Joint values (n, dof) read otherwise, and what that would mean, "... only if" its words hold."""


def diagnose(
    predict: Predict | None,
    q: Array,
    x: Array,
    names: Sequence[str],
    revolute: Sequence[bool],
    *,
    unit: str = "m",
    turns: Array | None = None,
    pose: PosePredict | None = None,
    left_handed: bool = False,
) -> tuple[Finding, ...]:
    """Find what is wrong with a log, the gravest first; empty where it fits as it is.

    predict : positions of an arm that may differ from the log's by some percent; without it what
        never moves, or is a copy, is told
    q, x : (n, dof), (n, m), joint values [rad or m] and positions [unit], in the order of the log
    names, revolute : of the joints: their names, and which of them turn
    unit : of the positions; a scale is doubted in metres alone
    turns : (n, 4), the log's orientations as qx, qy, qz, qw
    pose : where known, positions and orientations of the arm; a tool of unknown size may hide a
        wrist joint that is reversed from positions alone
    left_handed : whether axes that are mirrored need no word

    Examples
    --------
    >>> import calib
    >>> arm = calib.load_arm("two_link")
    >>> log = calib.babble(arm, 100, seed=0)
    >>> for finding in diagnose(arm.forward, log.q[:, ::-1], log.x, arm.joint_names, (True, True)):
    ...     print(finding.kind, finding.value)
    exchanged ['shoulder', 'elbow']
    """
    if predict is None:
        return _unmoved(q, x, names)
    rows = thinned(len(q), settings.DIAGNOSED_ROWS)
    q = q[rows]
    x = x[rows]
    turns = None if turns is None else turns[rows]
    predicted = predict(q)
    known = np.isfinite(predicted).all(axis=1)
    few = len(q) < settings.FEWEST_ROWS or known.mean() <= 0.5
    if few or not np.ptp(predicted[known], axis=0).any():
        return ()
    flat = unit == "px" or predicted.shape[1] != x.shape[1]
    size = spread(x)

    def left(q: Array, *, tool: bool = True) -> float:
        """Median distance that is left of rows read otherwise; `tool`: one of unknown size."""
        found = predict(q)
        affine = flat
        known = np.isfinite(found).all(axis=1)
        if known.mean() < 0.6:
            return float("inf")
        if (
            tool and pose is not None and len(q) >= settings.TOOL_ROWS
        ):  # positions are linear in it
            place, turn = pose(q)
            found = np.column_stack([place, matrix_of(turn).reshape(-1, 9)])
            affine = True
        return misfit(found[known], x[known], affine=affine)

    ratio = size / max(spread(predicted), 1e-300)
    usual = settings.USUAL_SIZE[0] < ratio < settings.USUAL_SIZE[1]
    if unit == "m" and not usual and (hint := unit_hint(ratio)):
        words = f"the positions extend over {ratio:.4g} times what the robot's links allow, in m"
        return (Finding("unit", words, hint.removeprefix("; "), "unit", "m"),)
    if (
        turns is not None
        and pose is not None
        and (wrong := _turned(*pose(q), x, turns))
    ):
        return (wrong,)
    own = left(q)
    found: tuple[Finding, ...] = ()
    any_order = own > settings.GOOD * size and len(names) <= settings.MOST_ORDERED
    tried = (
        readings(q, names, revolute, any_order=any_order)
        if own > settings.SMALL * size
        else ()
    )
    for (
        others
    ) in tried:  # the simplest first; of two that explain the log the first is told
        fits = [r for r in others if left(r[0]) < settings.FAR_BETTER * own]
        if (
            fits
        ):  # a tool of unknown size explains what a mirror does: by the place alone
            _, best = min(fits, key=lambda r: left(r[0], tool=False))
            best = replace(best, words=f"the log fits the robot only if {best.words}")
            if (
                best.kind == "reversed" and predicted.shape[1] == 2
            ):  # its signs may be learned
                best = replace(best, hint="", mistake=False)
            found = (best,)
            break
    if not (left_handed or flat or any(each.mistake for each in found)):
        mirror = np.array([-1.0, *[1.0] * (x.shape[1] - 1)])
        plain, mirrored = (
            misfit(predicted[known], x[known] * m) for m in (1.0, mirror)
        )
        if mirrored < settings.FAR_BETTER * plain:
            words = (
                "the positions are mirrored, compared with the robot: the sensor's axes are "
                "left-handed, or one of them is reversed"
            )
            found = (*found, Finding("mirrored", words, mistake=False))
    return found


def refuse_mistakes(findings: Sequence[Finding], label: str = "the log") -> list[str]:
    """Refuse a log for the first finding that is a mistake; return the others as notes.

    Raises LogError.
    """
    for f in findings:
        if f.mistake:
            words = f"{label}: {f.words}"
            raise LogError(
                words, hint=f.hint or None, parameter=f.parameter, value=f.value
            )
    return [f"{label}: {'; '.join(filter(None, (f.words, f.hint)))}" for f in findings]


def readings(
    q: Array, names: Sequence[str], revolute: Sequence[bool], *, any_order: bool
) -> tuple[Iterator[_Reading], ...]:
    """Other readings of joint values (n, dof): their unit, their order, one sign, two signs.

    any_order : whether columns are tried in all orders, not only with two exchanged
    """
    joints = range(len(names))

    def units() -> Iterator[_Reading]:
        words = "its joint values are"
        kind = "degrees"
        degrees = Finding(
            kind, f"{words} degrees", "give `degrees=True`", kind, value=False
        )
        radians = Finding(
            kind, f"{words} radians", "leave out `degrees`", kind, value=True
        )
        yield np.where(revolute, np.deg2rad(q), q), degrees
        yield np.where(revolute, np.rad2deg(q), q), radians

    def orders() -> Iterator[_Reading]:
        for order in itertools.permutations(joints):
            pairs = {names[k]: names[j] for k, j in enumerate(order) if k != j}
            if pairs and (any_order or len(pairs) == 2):
                told = listed(f"{other} holds {name}" for name, other in pairs.items())
                hint = f"give `columns={pairs}`, or correct the header"
                words = f"columns are exchanged ({told})"
                yield (
                    q[:, list(order)],
                    Finding("exchanged", words, hint, "columns", list(pairs)),
                )

    def signs(count: int) -> Iterator[_Reading]:
        hint = "its encoder or servo is reversed: change the sign of its column"
        # all of them turned are a mirror
        for some in itertools.combinations(joints, count) if count < len(names) else ():
            ones = [names[k] for k in some]
            words = f"{' and '.join(ones)} counts the other way"
            turned = q * np.where(np.isin(joints, some), -1.0, 1.0)
            yield turned, Finding("reversed", words, hint, "joints", ones)

    return units(), orders(), signs(1), signs(2)


def unit_hint(ratio: float) -> str:
    """Return what a log's scale against its model's says of its unit, as the end of a message."""
    for name, factor in METRES.items():
        if name != "m" and abs(ratio / factor - 1.0) < settings.SAME_UNIT:
            return f"; if they are in {name}, give `unit={name!r}`"
    return (
        "; if they are pixels, give `unit='px'`"
        if ratio > settings.PIXELS_RATIO
        else ""
    )


def spread(x: Array) -> float:
    """Median distance of rows (n, m) from their middle: one wrong row does not move it."""
    x = x[np.isfinite(x).all(axis=1)]
    return float(np.median(np.linalg.norm(x - np.median(x, axis=0), axis=1)))


def _unmoved(q: Array, x: Array, names: Sequence[str]) -> tuple[Finding, ...]:
    """What never moves, and joints that are copies; in space a sensor may see a plane's points."""
    found = []
    if len(q) < 2:
        found.append(Finding("still", "one usable row; learning needs two or more"))
    axes = ("x", "y") if x.shape[1] == 2 else ()
    for name, column in zip((*names, *axes), (*q.T, *x.T), strict=False):
        if not np.ptp(column):
            words = f"{name} is {column[0]:g} in every row; what does not move cannot be learned"
            hint = "leave it out of `joints`" if name in names else ""
            found.append(Finding("still", words, hint, "joints", name))
    for one, other in itertools.combinations(range(len(names)), 2):
        if np.array_equal(q[:, one], q[:, other]):
            words = f"joints {names[one]!r} and {names[other]!r} have the same values: a copy"
            found.append(Finding("copied", words))
    return tuple(found)


def _turned(place: Array, nominal: Array, x: Array, turns: Array) -> Finding | None:
    """Quaternions `turns` that do not turn as the joints predict, and the reading that does."""
    known = np.isfinite(place).all(axis=1) & np.isfinite(nominal).all(axis=1)
    if known.sum() < settings.FEWEST_ROWS:
        return None
    place = place[known]
    nominal = matrix_of(nominal[known])
    x = x[known]
    turns = turns[known]
    seen = matrix_of(turns)
    back = np.swapaxes(seen, 1, 2)

    def away(x: Array, seen: Array) -> Array:
        """Median distance and angle [rad] that the best frames leave of x and seen."""
        off = np.linalg.norm(x - aligned(place, x), axis=1)
        agree = off <= 3.0 * np.median(off) + 1e-300
        frame, shift, scale = similarity(place[agree], x[agree])
        y = nearest_rotation((np.swapaxes(nominal, 1, 2) @ frame.T @ seen).sum(axis=0))
        angle = logarithm(seen @ np.swapaxes(frame @ nominal @ y, 1, 2))
        far = x - scale * place @ frame.T - shift
        return np.array([np.median(np.linalg.norm(v, axis=1)) for v in (far, angle)])

    own = away(x, seen)
    order = "{'qx': 'qy', 'qy': 'qz', 'qz': 'qw', 'qw': 'qx'}"
    others = (
        (
            -(back @ x[:, :, None])[:, :, 0],
            back,
            "the poses are inverted: they are those of the sensor in the tool's frame",
            "write the tool's pose in the sensor's: -R'x, the conjugate quaternion",
        ),
        (
            x,
            matrix_of(turns[:, [1, 2, 3, 0]]),
            "qx, qy, qz, qw are in the order w, x, y, z",
            f"give `columns={order}`",
        ),
        (
            x,
            back,
            "the orientations are inverted: of the sensor in the tool's frame",
            "conjugate the quaternions: change the signs of qx, qy and qz",
        ),
    )
    for where, read, words, hint in others if own[1] > settings.TURNED else ():
        better = away(where, read) < settings.FAR_BETTER * own
        if better[1] and (better[0] or where is x):
            return Finding("turns", words, hint, "columns")
    return None


def rows_behind(
    predict: Predict, q: Array, x: Array, unit: str = "m", most: int = 20
) -> int:
    """Return by how many rows positions follow the joints, 0 where no shift fits far better.

    Rows along a path fit nearly as well a row later; poses in any order fit not at all.
    """
    n = len(q)
    predicted = predict(q)
    most = min(most, n // 5)
    if most < 1 or not np.isfinite(predicted).all():
        return 0
    rows = most + thinned(n - 2 * most, settings.DIAGNOSED_ROWS)
    found = {
        shift: misfit(predicted[rows - shift], x[rows], affine=unit == "px")
        for shift in range(-most, most + 1)
    }
    best = min(found, key=lambda shift: (found[shift], abs(shift)))
    return (
        best
        if found[best] < (0.5 if is_path(q) else settings.FAR_BETTER) * found[0]
        else 0
    )


def is_path(q: Array, joined: Mask | slice = slice(None)) -> bool:
    """Whether rows (n, dof) are those of a motion, by the steps that are `joined` (n - 1,)."""
    step = np.median(np.abs(np.diff(q, axis=0)[joined]), axis=0)
    return bool(np.max(step / np.maximum(np.ptp(q, axis=0), 1e-12)) <= settings.PATH)


def misfit(a: Array, b: Array, *, affine: bool = False) -> float:
    """Median distance of `b` (n, m) from `a` (n, k), `aligned`."""
    return float(np.median(np.linalg.norm(b - aligned(a, b, affine=affine), axis=1)))


def aligned(a: Array, b: Array, *, affine: bool = False) -> Array:
    """`a` (n, k), turned, shifted and scaled to `b` (n, m), whatever a few rows contradict.

    Where `affine`, or the one has more coordinates, by the best affine map instead.  No reflection:
    a mirrored sensor is to be seen as a misfit.
    """
    affine = affine or a.shape[1] != b.shape[1]
    features = np.column_stack([a, np.ones(len(a))])
    # spreads about the median: single wrong rows decide nothing
    spread = np.linalg.norm(b - np.median(b, axis=0), axis=1)
    kept = spread <= 5.0 * np.median(spread) + 1e-300
    for _ in range(4):
        if affine:
            moved = features @ solve_least_squares(features[kept], b[kept])
        else:
            turn, shift, scale = similarity(a[kept], b[kept])
            moved = scale * a @ turn.T + shift
        away = np.linalg.norm(b - moved, axis=1)
        kept = away <= 3.0 * np.median(away) + 1e-300
    return np.asarray(moved)
