"""Diagnosis of a log: what is wrong with its columns and units, told by what predicts it.

Other readings of the rows (another unit, exchanged joints, a joint that counts the other way,
inverted poses, ...) are tried in turn.  One that a predictor explains far better than the log as it
stands is a finding; where the predictor's frame stands does not matter.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arm.rotations import logarithm, matrix_of, nearest_rotation, similarity
from ..common.arrays import Array
from ..common.rows import thinned
from ..common.scale import METRES
from ..common.wording import listed
from ..errors import LogError
from .alignment import Predict, agreeing, aligned_misfit
from .settings import (
    DIAGNOSED_ROWS,
    FAR_BETTER,
    FEWEST_ROWS,
    GOOD,
    MOST_ORDERED,
    PIXELS_RATIO,
    SAME_UNIT,
    SMALL,
    TURNED,
    USUAL_SIZE,
)

PosePredict = Callable[[Array], tuple[Array, Array]]
"""Positions (n, 3) and quaternions (n, 4) at joint values (n, dof)."""

_TOOL_ROWS = 39  # thrice the features of a tool of unknown size


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with a log, or looks so."""

    kind: str  # unit, degrees, exchanged, reversed, mirrored, inverted, turns
    words: str
    hint: str = ""  # the remedy, with Python's names of options
    parameter: str | None = None
    value: Any = None
    mistake: bool = True  # whether it can be nothing else; otherwise it may be intended


_Reading = tuple[Array, Finding]
"""Joint values (n, dof) read otherwise, and what that would mean, "... only if" its words hold."""


def readings(
    q: Array, names: Sequence[str], revolute: Sequence[bool], *, any_order: bool
) -> tuple[Iterator[_Reading], ...]:
    """Other readings of joint values (n, dof): their unit, their order, one sign, two signs.

    any_order : whether columns are tried in all orders, not only with two exchanged
    """
    joints = range(len(names))

    def units() -> Iterator[_Reading]:
        for factor, words, hint in (
            (np.pi / 180, "its joint values are degrees", "give `degrees=True`"),
            (180 / np.pi, "its joint values are radians", "leave out `degrees`"),
        ):
            turned = np.where(revolute, q * factor, q)
            yield turned, Finding("degrees", words, hint, "degrees", factor > 1)

    def orders() -> Iterator[_Reading]:
        for order in itertools.permutations(joints):
            pairs = {names[k]: names[j] for k, j in enumerate(order) if k != j}
            if pairs and (any_order or len(pairs) == 2):
                told = listed(f"{other} holds {name}" for name, other in pairs.items())
                words = f"columns are exchanged ({told})"
                hint = f"give `columns={pairs}`, or correct the header"
                finding = Finding("exchanged", words, hint, "columns", list(pairs))
                yield q[:, list(order)], finding

    def signs(count: int) -> Iterator[_Reading]:
        for some in itertools.combinations(joints, count):
            ones = [names[k] for k in some]
            words = f"{' and '.join(ones)} counts the other way"
            hint = "its encoder or servo is reversed: change the sign of its column"
            if len(ones) < len(names):  # all of them turned are a mirror
                turned = q * np.where(np.isin(joints, some), -1.0, 1.0)
                yield turned, Finding("reversed", words, hint, "joints", ones)

    return units(), orders(), signs(1), signs(2)


def refuse_mistakes(findings: Sequence[Finding], label: str = "the log") -> list[str]:
    """Refuse a log for the first finding that is a mistake; return the others as notes.

    Raises LogError.
    """
    for finding in findings:
        if finding.mistake:
            raise LogError(
                f"{label}: {finding.words}",
                hint=finding.hint or None,
                parameter=finding.parameter,
                value=finding.value,
            )
    return [f"{label}: {'; '.join(filter(None, (f.words, f.hint)))}" for f in findings]


def diagnose(
    predict: Predict,
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

    predict : positions of an arm that may differ from the log's by some percent
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
    if len(q) < FEWEST_ROWS:
        return ()
    rows = thinned(len(q), DIAGNOSED_ROWS)
    log = _Log(predict, q[rows], x[rows], unit == "px", pose)
    if not log.comparable:
        return ()
    wrong = _unit_of(log) if unit == "m" else None
    if wrong is None and turns is not None and pose is not None:
        wrong = _poses(log, pose, turns[rows])
    if wrong is not None:
        return (wrong,)
    found: list[Finding] = []
    if log.own > SMALL * log.size:
        any_order = log.own > GOOD * log.size and len(names) <= MOST_ORDERED
        # the simplest first; of two that explain the log the first is told
        for others in readings(log.q, names, revolute, any_order=any_order):
            fits = [r for r in others if log.left(r[0], log.x) < FAR_BETTER * log.own]
            if fits:  # a tool of unknown size explains what a mirror does: by the place alone
                _, best = min(fits, key=lambda r: log.left(r[0], log.x, tool=False))
                words = f"the log fits the robot only if {best.words}"
                if best.kind != "reversed" or log.predicted.shape[1] != 2:
                    return (replace(best, words=words),)
                # a planar arm's signs may be learned
                found = [replace(best, words=words, hint="", mistake=False)]
                break
    known = np.isfinite(log.predicted).all(axis=1)
    flip = np.array([-1.0, *[1.0] * (x.shape[1] - 1)])
    both = (aligned_misfit(log.predicted[known], log.x[known] * axes) for axes in (flip, 1.0))
    mirrored, own = both if not (left_handed or log.affine) else (1.0, 0.0)
    if mirrored < FAR_BETTER * own:  # with one axis reversed, but for a tool
        words = (
            "the positions are mirrored, compared with the robot: the sensor's axes are "
            "left-handed, or one of them is reversed"
        )
        found.append(Finding("mirrored", words, mistake=False))
    return tuple(found)


def unit_of_ratio(ratio: float) -> str:
    """Return the unit of which so many are a metre, empty where none fits."""
    units = (n for n, f in METRES.items() if n != "m")
    return next((n for n in units if abs(ratio / METRES[n] - 1.0) < SAME_UNIT), "")


def unit_hint(ratio: float) -> str:
    """Return what a log's scale against its model's says of its unit, as the end of a message."""
    name = unit_of_ratio(ratio)
    if name:
        return f"; if they are in {name}, `unit={name!r}` converts them"
    return "; if they are pixels, train a model of such a log" if ratio > PIXELS_RATIO else ""


class _Log:
    """Some rows of a log beside their predictor, and how far other readings of them are off."""

    def __init__(
        self, predict: Predict, q: Array, x: Array, affine: bool, pose: PosePredict | None
    ) -> None:
        self.predict, self.q, self.x, self.pose = predict, q, x, pose
        self.predicted = predict(q)
        self.affine = affine or self.predicted.shape[1] != x.shape[1]
        known = np.isfinite(self.predicted).all(axis=1)
        self.comparable = bool(known.mean() > 0.5 and np.ptp(self.predicted[known], axis=0).any())
        self.size = _spread(x)
        self.own = self.left(q, x)

    def left(self, q: Array, x: Array, *, tool: bool = True) -> float:
        """Median distance that is left of rows read otherwise; infinite where nothing is known.

        tool : whether a tool of unknown size may be part of it
        """
        predicted, affine = self.predict(q), self.affine
        known = np.isfinite(predicted).all(axis=1)
        if known.mean() < 0.6:
            return float("inf")
        if tool and self.pose is not None and len(q) >= _TOOL_ROWS:  # positions are linear in it
            place, turn = self.pose(q)
            predicted, affine = np.column_stack([place, matrix_of(turn).reshape(-1, 9)]), True
        return aligned_misfit(predicted[known], x[known], affine=affine)


def _spread(x: Array) -> float:
    """Median distance of rows (n, m) from their middle: one wrong row does not move it."""
    x = x[np.isfinite(x).all(axis=1)]
    return float(np.median(np.linalg.norm(x - np.median(x, axis=0), axis=1)))


def _unit_of(log: _Log) -> Finding | None:
    """Positions that extend over a multiple of what they should, if that is a unit's."""
    ratio = log.size / max(_spread(log.predicted), 1e-300)
    name = unit_of_ratio(ratio)
    if USUAL_SIZE[0] < ratio < USUAL_SIZE[1] or not (name or ratio > PIXELS_RATIO):
        return None
    words = (
        f"the positions extend over {ratio:.4g} times what the robot's links allow for these joint "
        "values, if they are in m"
    )
    other = "for pixels give `unit='px'`, for another unit its name"
    hint = f"if they are in {name}, give `unit={name!r}`" if name else other
    return Finding("unit", words, hint, "unit", "m")


def _poses(log: _Log, pose: PosePredict, turns: Array) -> Finding | None:
    """Orientations that do not turn as the joints do, and the reading of them that does."""
    place, nominal = pose(log.q)
    known = np.isfinite(place).all(axis=1) & np.isfinite(nominal).all(axis=1)
    if known.sum() < FEWEST_ROWS:
        return None
    place, nominal = place[known], matrix_of(nominal[known])
    x, turns = log.x[known], turns[known]
    seen = matrix_of(turns)

    def away(x: Array, seen: Array) -> Array:
        """Median distance and angle [rad] that the best frames leave of x and seen."""
        frame, shift, scale = similarity(*agreeing(place, x))
        y = nearest_rotation((np.swapaxes(nominal, 1, 2) @ frame.T @ seen).sum(axis=0))
        angle = logarithm(seen @ np.swapaxes(frame @ nominal @ y, 1, 2))
        far = x - scale * place @ frame.T - shift
        return np.array([np.median(np.linalg.norm(v, axis=1)) for v in (far, angle)])

    own = away(x, seen)
    if own[1] < TURNED:
        return None
    back = np.swapaxes(seen, 1, 2)
    if (away(-(back @ x[:, :, None])[:, :, 0], back) < FAR_BETTER * own).all():
        return Finding(
            "inverted",
            "the poses are inverted: they are those of the sensor in the tool's frame",
            "write the tool's pose in the sensor's frame: -R'x and the conjugate quaternion",
            "columns",
        )
    if away(x, matrix_of(turns[:, [1, 2, 3, 0]]))[1] < FAR_BETTER * own[1]:
        order = "{'qx': 'qy', 'qy': 'qz', 'qz': 'qw', 'qw': 'qx'}"
        words = "qx, qy, qz, qw are in the order w, x, y, z"
        return Finding("turns", words, f"give `columns={order}`", "columns", ["qx"])
    if away(x, back)[1] < FAR_BETTER * own[1]:
        return Finding(
            "inverted",
            "the orientations are inverted: of the sensor in the tool's frame, not of the tool",
            "conjugate the quaternions: change the signs of qx, qy and qz",
            "columns",
        )
    return None
