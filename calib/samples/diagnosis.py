"""Diagnosis of a log: mistakes in its columns and units, found by a predictor of its positions.

Interpretations of the rows are tried in turn.  One that a predictor explains far better than the
log itself is a finding; the place of the predictor's frame does not matter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arm.rotations import logarithm, matrix_of, nearest_rotation, similarity
from ..common.arrays import Array, Mask
from ..common.rows import finite_rows, median_length, spread_rows
from ..common.scale import METRES
from .findings import Finding, interpretations, units
from .misfit import align, misfit, spread
from .samples import Samples
from .settings import DIAGNOSIS

Predict = Callable[[Array], Array]
"""Positions (n, m) at joint values (n, dof), NaN where none is known."""

PosePredict = Callable[[Array], tuple[Array, Array]]
"""Positions (n, 3) and quaternions (n, 4) at joint values (n, dof)."""


def diagnose(
    samples: Samples, predict: Predict, pose: PosePredict | None
) -> list[Finding]:
    """Find what is wrong with a log, the gravest first; empty where it fits.

    predict : positions of an arm that may differ from the log's by some percent, in the log's unit
    pose : where known, positions and orientations of the arm; a tool of unknown size may hide a
        wrist joint that is reversed from positions alone

    Examples
    --------
    >>> import calib
    >>> from dataclasses import replace
    >>> arm = calib.load_arm("two_link")
    >>> log = calib.babble(arm, 100, seed=0)
    >>> for finding in diagnose(replace(log, q=log.q[:, ::-1]), arm.forward, None):
    ...     print(finding.kind, finding.value)
    exchanged ['shoulder', 'elbow']
    """
    rows = samples.take(spread_rows(len(samples), DIAGNOSIS.rows))
    x = rows.x
    predicted = predict(rows.q)
    answered = finite_rows(predicted)
    # few places, such as those of touches, fit any prediction
    few = len(np.unique(x, axis=0)) < DIAGNOSIS.fewest_rows
    unknown = answered.mean() <= 0.5
    if few or unknown or not np.ptp(predicted[answered], axis=0).any():
        return []
    affine = rows.unit == "px" or predicted.shape[1] != x.shape[1]
    fit = _PositionFit(x, predict, pose, affine)

    mistake = None
    if rows.unit in METRES:
        mistake = _wrong_unit(fit, rows, spread(predicted))
    if mistake is None and rows.orientation is not None and pose is not None:
        mistake = _wrong_orientations(*pose(rows.q), x, rows.orientation)
    if mistake is not None:
        return [mistake]

    joints = _wrong_joints(fit, rows)
    findings = [] if joints is None else [joints]
    if joints is not None and joints.mistake:
        return findings
    has_own_axes = rows.plane is None and not affine
    if has_own_axes and _is_mirrored(predicted[answered], x[answered]):
        words = (
            "the positions are mirrored, compared with the robot: the sensor's axes are "
            "left-handed, or one of them is reversed"
        )
        findings.append(Finding("mirrored", words, mistake=False))
    return findings


@dataclass(frozen=True, eq=False)
class _PositionFit:
    """A log's positions, and the predictor that interpretations of its joints are judged by."""

    x: Array  # (n, m) [unit]
    predict: Predict
    pose: PosePredict | None
    affine: bool  # whether any affine map is a frame, as before a camera

    def misfit(self, q: Array, *, tool: bool = True) -> float:
        """Median distance of rows with joints `q` (n, dof) from the predictor, in the best frame.

        tool : whether a tool of unknown size may explain some of it
        """
        predicted = self.predict(q)
        answered = finite_rows(predicted)
        if answered.mean() < 0.6:
            return float("inf")
        x = self.x[answered]
        if not tool or self.pose is None or len(q) < DIAGNOSIS.tool_rows:
            return misfit(predicted[answered], x, affine=self.affine)
        position, orientation = self.pose(q)
        # positions are linear in the tool
        features = np.column_stack(
            [position, matrix_of(orientation).reshape(-1, 9)]
        )
        return misfit(features[answered], x, affine=True)


def _is_mirrored(predicted: Array, x: Array) -> bool:
    """Whether positions (n, m) fit predicted ones (n, m) far better with one axis reversed."""
    reflected = x.copy()
    reflected[:, 0] *= -1.0
    as_it_is = misfit(predicted, x)
    return misfit(predicted, reflected) < DIAGNOSIS.far_better * as_it_is


def _wrong_unit(
    fit: _PositionFit, rows: Samples, nominal: float
) -> Finding | None:
    """The finding that positions extend otherwise than the nominal ones [unit], with the remedy."""
    ratio = spread(rows.x) / max(nominal, 1e-300)
    low, high = DIAGNOSIS.usual_size
    hint = unit_hint(ratio, rows.unit).removeprefix("; ")
    if not hint or low < ratio < high:
        return None
    # angles in another unit may make positions extend so, too
    as_it_is = fit.misfit(rows.q)
    for q, finding in units(rows.q, rows.revolute):
        if fit.misfit(q) < DIAGNOSIS.far_better * as_it_is:
            return finding
    words = (
        f"the positions extend over {ratio:.4g} times what the robot's links allow, "
        f"in {rows.unit}"
    )
    return Finding("unit", words, hint, "unit", rows.unit)


def _wrong_joints(fit: _PositionFit, rows: Samples) -> Finding | None:
    """The simplest interpretation of the joints that fits far better than the log itself."""
    size = spread(rows.x)
    as_it_is = fit.misfit(rows.q)
    if as_it_is <= DIAGNOSIS.small * size:
        return None
    names = rows.joint_names
    is_far_off = as_it_is > DIAGNOSIS.good * size
    any_order = is_far_off and len(names) <= DIAGNOSIS.most_ordered
    least = DIAGNOSIS.far_better * as_it_is
    for others in interpretations(
        rows.q, names, rows.revolute, any_order=any_order
    ):
        better = [item for item in others if fit.misfit(item[0]) < least]
        if not better:
            continue
        # without a tool, which if of unknown size explains what a mirror does; of equals the last
        _, best = min(
            reversed(better), key=lambda item: fit.misfit(item[0], tool=False)
        )
        if best.kind == "reversed" and rows.x.shape[1] == 2:
            # it may be learned
            return replace(best, hint="", mistake=False)
        return best
    return None


def _wrong_orientations(
    place: Array, nominal: Array, x: Array, quaternions: Array
) -> Finding | None:
    """The finding that quaternions (n, 4) are written otherwise than this reads them.

    place, nominal : positions (n, 3) and quaternions (n, 4) that the joints predict
    """
    answered = finite_rows(np.hstack([place, nominal]))
    if answered.sum() < DIAGNOSIS.fewest_rows:
        return None
    place = place[answered]
    drawn = matrix_of(nominal[answered])
    frame = similarity(place, align(place, x[answered]))[0]
    quaternions = quaternions[answered]
    as_it_is = _angle_left(drawn, frame, quaternions)
    if as_it_is <= DIAGNOSIS.turned:
        return None
    order = "{'qx': 'qy', 'qy': 'qz', 'qz': 'qw', 'qw': 'qx'}"
    others = (
        (
            quaternions[:, [1, 2, 3, 0]],
            "qx, qy, qz, qw are in the order w, x, y, z",
            f"give `columns={order}`",
        ),
        (
            quaternions * [-1.0, -1.0, -1.0, 1.0],
            "the orientations are inverted: of the sensor in the tool's frame",
            "conjugate the quaternions: change the signs of qx, qy and qz",
        ),
    )
    for other, words, hint in others:
        angle = _angle_left(drawn, frame, other)
        if angle < DIAGNOSIS.far_better * as_it_is:
            return Finding("turns", words, hint, "columns")
    return None


def _angle_left(drawn: Array, frame: Array, quaternions: Array) -> float:
    """Median angle [rad] of orientations (n, 4) from the drawn ones, with the best tool.

    drawn : (n, 3, 3), orientations that the joints predict
    frame : (3, 3), the base frame's rotation to the sensor's
    """
    rotation = matrix_of(quaternions)
    between = (np.swapaxes(drawn, 1, 2) @ frame.T @ rotation).sum(axis=0)
    expected = frame @ drawn @ nearest_rotation(between)
    return median_length(logarithm(rotation @ np.swapaxes(expected, 1, 2)))


def unit_hint(ratio: float, unit: str) -> str:
    """Return what a log's scale against its model's suggests of its unit, as the end of a message.

    ratio : of the log's positions to the model's, both taken to be in `unit`
    """
    per_metre = ratio * METRES.get(unit, 1.0)
    for name, factor in METRES.items():
        if name != unit and abs(per_metre / factor - 1.0) < DIAGNOSIS.same_unit:
            named = f"name the columns x [{name}], y [{name}]"
            return f"; if they are in {name}, give `unit={name!r}`, or {named}"
    if ratio > DIAGNOSIS.pixels_ratio:
        mixed = "if some rows are in another unit, convert them"
        return f"; if they are pixels, give `unit='px'`; {mixed}"
    return ""


def rows_behind(q: Array, predicted: Array, x: Array) -> int:
    """Return by how many rows positions follow the joints, 0 where no shift fits far better.

    q, predicted, x : (n, dof), (n, m), (n, m), joints, positions there and measured ones

    Rows along a path fit nearly as well a row later; poses in any order fit not at all.
    """
    n = len(q)
    most = min(DIAGNOSIS.most_behind, n // 5)
    if most < 1 or not np.isfinite(predicted).all():
        return 0
    rows = most + spread_rows(n - 2 * most, DIAGNOSIS.rows)
    misfits = {
        shift: misfit(predicted[rows - shift], x[rows])
        for shift in range(-most, most + 1)
    }
    best = min(misfits, key=lambda shift: (misfits[shift], abs(shift)))
    share = 0.5 if is_path(q) else DIAGNOSIS.far_better
    return best if misfits[best] < share * misfits[0] else 0


def is_path(q: Array, steps: Mask | slice = slice(None)) -> bool:
    """Whether rows (n, dof) are those of a motion, by some of their `steps` (n - 1,)."""
    step = np.median(np.abs(np.diff(q, axis=0)[steps]), axis=0)
    extent = np.maximum(np.ptp(q, axis=0), 1e-12)
    return bool(np.max(step / extent) <= DIAGNOSIS.path)
