"""Diagnosis of a log: mistakes in its columns and units, found by a predictor of its positions.

Other readings of the rows are tried in turn.  One that a predictor explains far better than the log
as it stands is a finding; where the predictor's frame stands does not matter.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arm.rotations import logarithm, matrix_of, nearest_rotation, similarity
from ..common.arrays import Array, Mask
from ..common.least_squares import solve_least_squares
from ..common.rows import finite_rows, median_length, row_lengths, spread_rows
from ..common.scale import METRES
from ..common.wording import listing
from ..errors import LogError
from .samples import Samples
from .settings import DIAGNOSIS

Predict = Callable[[Array], Array]
"""Positions (n, m) at joint values (n, dof), NaN where none is known."""

PosePredict = Callable[[Array], tuple[Array, Array]]
"""Positions (n, 3) and quaternions (n, 4) at joint values (n, dof)."""


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with a log, or looks so."""

    # still, unit, turns, degrees, exchanged, reversed, mirrored
    kind: str
    words: str
    hint: str = ""  # the remedy, with Python's names of options
    parameter: str | None = None
    value: object = None
    # whether it can be nothing else; otherwise it may be intended
    mistake: bool = True


_Reading = tuple[Array, Finding]
"""Joint values (n, dof) read otherwise, and what that would mean, "... only if" its words hold."""


def diagnose(
    samples: Samples, predict: Predict, pose: PosePredict | None = None
) -> list[Finding]:
    """Find what is wrong with a log, the gravest first; empty where it fits as it is.

    predict : positions of an arm that may differ from the log's by some percent, in the log's unit
    pose : where known, positions and orientations of the arm; a tool of unknown size may hide a
        wrist joint that is reversed from positions alone

    Examples
    --------
    >>> import calib
    >>> from dataclasses import replace
    >>> arm = calib.load_arm("two_link")
    >>> log = calib.babble(arm, 100, seed=0)
    >>> for finding in diagnose(replace(log, q=log.q[:, ::-1]), arm.forward):
    ...     print(finding.kind, finding.value)
    exchanged ['shoulder', 'elbow']
    """
    rows = samples.take(spread_rows(len(samples), DIAGNOSIS.rows))
    q = rows.q
    x = rows.x
    predicted = predict(q)
    answered = finite_rows(predicted)
    # few places, such as those of touches, fit any prediction
    few = len(np.unique(x, axis=0)) < DIAGNOSIS.fewest_rows
    unknown = answered.mean() <= 0.5
    if few or unknown or not np.ptp(predicted[answered], axis=0).any():
        return []
    affine = rows.unit == "px" or predicted.shape[1] != x.shape[1]

    def distance_left(q: Array, *, tool: bool = True) -> float:
        """Median distance of rows with joints `q` from the predictor, in the best frame.

        tool : whether a tool of unknown size may explain some of it
        """
        predicted = predict(q)
        answered = finite_rows(predicted)
        if answered.mean() < 0.6:
            return float("inf")
        if not tool or pose is None or len(q) < DIAGNOSIS.tool_rows:
            return misfit(predicted[answered], x[answered], affine=affine)
        place, turn = pose(q)
        # positions are linear in the tool
        features = np.column_stack([place, matrix_of(turn).reshape(-1, 9)])
        return misfit(features[answered], x[answered], affine=True)

    if rows.unit in METRES:
        wrong = _wrong_unit(distance_left, rows, spread(predicted))
        if wrong:
            return [wrong]
    if rows.orientation is not None and pose is not None:
        wrong = _wrong_turns(*pose(q), x, rows.orientation)
        if wrong:
            return [wrong]

    findings = []
    wrong = _other_reading(distance_left, rows)
    if wrong:
        if wrong.kind == "reversed" and x.shape[1] == 2:
            wrong = replace(wrong, hint="", mistake=False)  # it may be learned
        findings.append(wrong)
    if rows.plane is not None or affine or (wrong and wrong.mistake):
        return findings
    if _is_mirrored(predicted[answered], x[answered]):
        words = (
            "the positions are mirrored, compared with the robot: the sensor's axes are "
            "left-handed, or one of them is reversed"
        )
        findings.append(Finding("mirrored", words, mistake=False))
    return findings


def _is_mirrored(predicted: Array, x: Array) -> bool:
    """Whether positions (n, m) fit predicted ones (n, m) far better with one axis reversed."""
    reflected = x.copy()
    reflected[:, 0] *= -1.0
    as_it_is = misfit(predicted, x)
    return misfit(predicted, reflected) < DIAGNOSIS.far_better * as_it_is


def _wrong_unit(
    distance_left: Callable[..., float], rows: Samples, nominal: float
) -> Finding | None:
    """The finding that positions extend otherwise than the nominal ones [unit], with the remedy."""
    ratio = spread(rows.x) / max(nominal, 1e-300)
    low, high = DIAGNOSIS.usual_size
    hint = unit_hint(ratio, rows.unit).removeprefix("; ")
    if not hint or low < ratio < high:
        return None
    as_it_is = distance_left(rows.q)
    for q, finding in _units(rows.q, rows.revolute):
        if distance_left(q) < DIAGNOSIS.far_better * as_it_is:
            words = f"the log fits the robot only if {finding.words}"
            return replace(finding, words=words)
    words = (
        f"the positions extend over {ratio:.4g} times what the robot's links allow, "
        f"in {rows.unit}"
    )
    return Finding("unit", words, hint, "unit", rows.unit)


def _other_reading(
    distance_left: Callable[..., float], rows: Samples
) -> Finding | None:
    """The simplest other reading of the joints that fits far better than the log as it stands."""
    size = spread(rows.x)
    as_it_is = distance_left(rows.q)
    if as_it_is <= DIAGNOSIS.small * size:
        return None
    names = rows.joint_names
    any_order = (
        as_it_is > DIAGNOSIS.good * size
        and len(names) <= DIAGNOSIS.most_ordered
    )
    for others in readings(rows.q, names, rows.revolute, any_order=any_order):
        # a tool of unknown size explains what a mirror does: by the place alone
        far_better = {
            distance_left(other, tool=False): finding
            for other, finding in others
            if distance_left(other) < DIAGNOSIS.far_better * as_it_is
        }
        if far_better:
            best = far_better[min(far_better)]
            words = f"the log fits the robot only if {best.words}"
            return replace(best, words=words)
    return None


def refuse_mistakes(
    findings: Sequence[Finding], label: str = "the log"
) -> list[str]:
    """Refuse a log for the first finding that is a mistake; return the others as notes.

    Raises LogError.
    """
    notes = []
    for finding in findings:
        words = f"{label}: {finding.words}"
        hint = finding.hint
        if finding.mistake:
            raise LogError(
                words,
                hint=hint or None,
                parameter=finding.parameter,
                value=finding.value,
            )
        notes.append(f"{words}; {hint}" if hint else words)
    return notes


def readings(
    q: Array, names: Sequence[str], revolute: Sequence[bool], *, any_order: bool
) -> tuple[Iterator[_Reading], ...]:
    """Other readings of joint values (n, dof): their unit, their order, one sign, two signs.

    any_order : whether columns are tried in all orders, not only with two exchanged
    """
    return (
        _units(q, revolute),
        _orders(q, names, any_order),
        _signs(q, names, 1),
        _signs(q, names, 2),
    )


def _units(q: Array, revolute: Sequence[bool]) -> Iterator[_Reading]:
    for unit, convert, hint in (
        ("degrees", np.deg2rad, "give `degrees=True`"),
        ("radians", np.rad2deg, "leave out `degrees`"),
    ):
        words = f"its joint values are {unit}"
        finding = Finding("degrees", words, hint, "degrees", unit == "radians")
        yield np.where(revolute, convert(q), q), finding


def _orders(
    q: Array, names: Sequence[str], any_order: bool
) -> Iterator[_Reading]:
    for order in itertools.permutations(range(len(names))):
        column_of = {names[k]: names[j] for k, j in enumerate(order) if k != j}
        if len(column_of) == 2 or (column_of and any_order):
            holds = listing(
                f"{column} holds {name}" for name, column in column_of.items()
            )
            words = f"columns are exchanged ({holds})"
            hint = f"give `columns={column_of}`, or correct the header"
            value = list(column_of)
            finding = Finding("exchanged", words, hint, "columns", value)
            yield q[:, list(order)], finding


def _signs(q: Array, names: Sequence[str], count: int) -> Iterator[_Reading]:
    if count >= len(names):  # all of them turned are a mirror
        return
    hint = "its encoder or servo is reversed: change the sign of its column"
    for joints in itertools.combinations(range(len(names)), count):
        turned = q.copy()
        turned[:, joints] *= -1.0
        reversed_names = [names[k] for k in joints]
        words = f"{' and '.join(reversed_names)} counts the other way"
        yield turned, Finding("reversed", words, hint, "joints", reversed_names)


def unit_hint(ratio: float, unit: str) -> str:
    """Return what a log's scale against its model's says of its unit, as the end of a message.

    ratio : of the log's positions to the model's, both taken to be in `unit`
    """
    per_metre = ratio * METRES.get(unit, 1.0)
    for name, factor in METRES.items():
        if name != unit and abs(per_metre / factor - 1.0) < DIAGNOSIS.same_unit:
            return f"; if they are in {name}, give `unit={name!r}`"
    if ratio > DIAGNOSIS.pixels_ratio:
        mixed = "if some rows are in another unit, convert them"
        return f"; if they are pixels, give `unit='px'`; {mixed}"
    return ""


def spread(x: Array) -> float:
    """Median distance of rows (n, m) from their middle: one wrong row does not move it."""
    x = x[finite_rows(x)]
    return median_length(x - np.median(x, axis=0))


def still_columns(q: Array, x: Array, names: Sequence[str]) -> list[Finding]:
    """Findings of columns that never move.

    In space a coordinate may be still: a sensor may see the points of a plane.
    """
    findings = []
    if len(q) < 2:
        words = "one usable row; learning needs two or more"
        findings.append(Finding("still", words))
    columns = dict(zip(names, q.T, strict=True))
    if x.shape[1] == 2:
        columns |= dict(zip("xy", x.T, strict=True))
    for name, column in columns.items():
        if not np.ptp(column):
            words = f"{name} is {column[0]:g} in every row; what does not move cannot be learned"
            hint = "leave it out of `joints`" if name in names else ""
            findings.append(Finding("still", words, hint, "joints", name))
    return findings


def _wrong_turns(
    place: Array, nominal: Array, x: Array, turns: Array
) -> Finding | None:
    """The finding that quaternions `turns` (n, 4) are written otherwise than this reads them.

    place, nominal : positions (n, 3) and quaternions (n, 4) that the joints predict
    """
    answered = finite_rows(np.hstack([place, nominal]))
    if answered.sum() < DIAGNOSIS.fewest_rows:
        return None
    place = place[answered]
    drawn = matrix_of(nominal[answered])
    x = x[answered]
    seen = matrix_of(turns[answered])
    frame = similarity(place, align(place, x))[0]

    def angle(seen: Array) -> float:
        """Median turn [rad] that the best tool leaves."""
        between = (np.swapaxes(drawn, 1, 2) @ frame.T @ seen).sum(axis=0)
        expected = frame @ drawn @ nearest_rotation(between)
        off = logarithm(seen @ np.swapaxes(expected, 1, 2))
        return median_length(off)

    as_it_is = angle(seen)
    if as_it_is <= DIAGNOSIS.turned:
        return None
    order = "{'qx': 'qy', 'qy': 'qz', 'qz': 'qw', 'qw': 'qx'}"
    others = (
        (
            matrix_of(turns[answered][:, [1, 2, 3, 0]]),
            "qx, qy, qz, qw are in the order w, x, y, z",
            f"give `columns={order}`",
        ),
        (
            np.swapaxes(seen, 1, 2),
            "the orientations are inverted: of the sensor in the tool's frame",
            "conjugate the quaternions: change the signs of qx, qy and qz",
        ),
    )
    for turn, words, hint in others:
        if angle(turn) < DIAGNOSIS.far_better * as_it_is:
            return Finding("turns", words, hint, "columns")
    return None


def rows_behind(predict: Predict, q: Array, x: Array) -> int:
    """Return by how many rows positions follow the joints, 0 where no shift fits far better.

    Rows along a path fit nearly as well a row later; poses in any order fit not at all.
    """
    n = len(q)
    predicted = predict(q)
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


def misfit(a: Array, b: Array, *, affine: bool = False) -> float:
    """Median distance of `b` (n, m) from `a` (n, k) after `align`."""
    off = b - align(a, b, affine=affine)
    return median_length(off)


def align(a: Array, b: Array, *, affine: bool = False) -> Array:
    """`a` (n, k), turned, shifted and scaled to `b` (n, m), whatever a few rows contradict.

    Where `affine`, or the one has more coordinates, by the best affine map instead.  No reflection:
    a mirrored sensor is to be seen as a misfit.
    """
    affine = affine or a.shape[1] != b.shape[1]
    features = np.column_stack([a, np.ones(len(a))])
    # spreads about the median: single wrong rows decide nothing
    away = row_lengths(b - np.median(b, axis=0))
    agree = away <= 5.0 * np.median(away) + 1e-300
    for _ in range(4):
        if affine:
            moved = features @ solve_least_squares(features[agree], b[agree])
        else:
            turn, shift, scale = similarity(a[agree], b[agree])
            moved = scale * a @ turn.T + shift
        away = row_lengths(b - moved)
        agree = away <= 3.0 * np.median(away) + 1e-300
    return np.asarray(moved)
