"""Logs: joint values and measured positions in a file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.plane import Plane, fit_plane
from ..arm.urdf import Range
from ..common.arrays import Array, Index, Mask
from ..common.rows import LARGEST, row_lengths, whole
from ..common.scale import METRES
from ..common.wording import listed, vector
from ..errors import LogError, OptionError
from .camera import Camera, camera_of
from .delays import with_offset
from .diagnosis import diagnose, refuse_mistakes, unmoved
from .joint_values import JointColumn, check_ranges, wrap
from .motion import directions
from .roles import (
    FURTHER,
    QUATERNION,
    ROUNDING,
    SOCKET,
    Roles,
    find_roles,
    log_columns,
    quaternions,
)
from .samples import Samples
from .settings import READING
from .sockets import Touches
from .tables import Document, Source, open_source, rows_in_words, write_table


def read_log(
    path: str | os.PathLike[str] | Source,
    arm: Arm | None = None,
    *,
    joints: Sequence[str] | None = None,
    columns: Mapping[str, str] | None = None,
    degrees: bool = False,
    unit: str | None = None,
    ranges: Mapping[str, Range] | None = None,
    prismatic: Sequence[str] = (),
    most: int = READING.most_rows,
    seed: int = 0,
    usual: Mapping[str, str] | None = None,
    outputs: int | None = None,
    lens: Document | None = None,
    time_offset: float | None = None,
) -> Samples:
    """Read a measured log: one column for each joint, and x, y or x, y, z.

    Further columns are ignored. Rows with a value that is missing, not finite or beyond 1e15
    are left out, counted in `Samples.dropped` and described in `Samples.notes`. Positions may be
    in the sensor's own unit and axes; of x, y, z the plane is fitted. A log may be of any length:
    of one with more than `most` rows so many are drawn at random. Rows stay in the order of the
    file.  A column `point`, and optionally `setup`, says which socket the tip touched: x, y, z
    are known coordinates of it in its fixture's frame, and in a row without a point what a sensor
    measured.

    path : CSV or Parquet; `-` reads CSV from standard input
    arm : gives the joints' names and limits; its kinematics tell other units, exchanged columns and
        a lag, and are never learned from
    joints : without an arm, the joints' columns, from base to tip
    columns : other names of columns, ``{"x": "cam_u", "elbow": "joint_2"}``
    degrees : whether joints that turn are logged in degrees; `ranges` are in rad still
    unit : of the positions; what the log says of itself if not given, else m
    ranges : the range of a joint [rad or m], before the arm's limits; rows outside are left out
    prismatic : without an arm, the joints that slide
    most, seed : rows of a long log that are held; which they are depends on the seed alone
    usual : names that columns have in other logs of this arm; those that this one lacks are passed
        over
    outputs : coordinates that a position has, as a model of this arm has them; without it, and
        without an arm, x, y, z that lie in a plane become two
    lens : the calibrated lens of a camera that sees an arm in space, as lens.json holds it
    time_offset : [s], added to the times of the positions, by the column `time`; without it
        training estimates how late they are
    Raises LogError or OptionError if the log cannot be used; one line with the row, the column and
    the remedy.

    Notes
    -----
    Values beyond the arm's limits by up to 5 % of the range widen it, with a note; beyond that
    they are an error, which names `degrees` if the log fits as degrees. A joint that
    can turn all the way round, or without an arm one that went further than a turn, has
    a range of one turn: about 0, or where the log says otherwise about the log's values.
    """
    most = whole("most", most, 2, 2**31)
    source = open_source(path)
    label = source.label
    usual = {k: v for k, v in (usual or {}).items() if v in source.header}
    roles = find_roles(source, arm, joints, {**usual, **(columns or {})})
    unit = _unit(source, "px" if roles.pixels and not unit else unit)
    names = roles.joints
    ranges = ranges or {}
    if arm is not None:
        revolute = tuple(arm.revolute)
        bounds = zip(arm.lower, arm.upper, strict=True)
        limits = dict(zip(names, bounds, strict=True)) | {**ranges}
        outputs = outputs or arm.outputs
    else:
        revolute = tuple(name not in prismatic for name in names)
        limits = {**ranges}
        if not {*prismatic} <= {*names}:
            raise OptionError(
                f"{listed(prismatic)} named as sliding: expected some of the joints "
                f"{listed(names)}",
                parameter="prismatic",
            )
    turning = dict(zip(names, revolute, strict=True))
    check_ranges(ranges, turning)
    if roles.touched:
        _check_touches(label, unit if roles.axes else "m", outputs)
    elif len(roles.axes) < (outputs or 2) and unit != "px":  # a camera sees two
        raise LogError(
            f"{label} has x and y alone, expected x, y and z of an arm in space",
            hint="for a planar part of the arm name its joints, or give `planar=True`",
            parameter="planar",
        )

    drawn, total = source.drawn(most, seed)
    if not total:
        raise LogError(f"{label} has no rows below its header")
    read = roles.columns(roles.names)
    further = [
        name for name in FURTHER if name in source.header and name not in read
    ]
    table, numbers = drawn.numbers([*read, *further])
    values, facts = np.split(table, [len(read)], axis=1)
    if degrees:
        turned = np.flatnonzero(revolute)
        values[:, turned] = np.deg2rad(values[:, turned])
    notes = []
    q = values[:, : len(names)]
    side = directions(q) if np.isfinite(q).all() else None
    if total > most:
        notes.append(
            f"{total:,} rows: {most:,} of them, drawn evenly, are held; other counts are of these"
        )
        side = np.zeros(q.shape)  # nobody knows where joints were before
    points = np.full((len(q), 2), "", dtype=object)
    if roles.touched:
        for k, column in enumerate(roles.columns(SOCKET)):
            if column in source.header:
                points[:, k] = drawn.texts(column)
    touched = points[:, 1] != ""
    rows = sound_rows(label, values, numbers, roles, ranges, turning, touched)
    sound = rows.sound
    notes += rows.notes
    numbers = numbers[sound]
    q, x, turns = roles.split(values[sound])
    lower, upper = np.empty((2, len(names)))
    for k, name in enumerate(names):
        limit = limits.get(name)
        if limit and roles.touched:  # wherever a hand has moved the arm
            limit = (min(limit[0], q[:, k].min()), max(limit[1], q[:, k].max()))
        joint = JointColumn(label, name, revolute[k], limit, degrees)
        q[:, k], (lower[k], upper[k]), words = joint.settle(q[:, k], numbers)
        notes += words
    touch = None
    plane = None
    camera = None
    orientation = None
    if roles.touched:
        x = x / METRES[unit] if roles.axes else np.full((len(q), 3), np.nan)
        touch = Touches.of(points[sound], x)
        drawn_x = np.zeros_like(x) if arm is None else arm.forward(q)
        x = touch.placed(x, touch.means(drawn_x))
        unit = "m"
    else:
        x, plane, words = _in_plane(label, x, numbers, unit, arm, outputs)
        notes += words
        camera = _camera(source, arm, x, lens)
        if camera is not None and camera.note:
            notes.append(camera.note)
        if roles.turns and plane is None:
            orientation = quaternions(turns, degrees=degrees)
        size = float(np.ptp(x, axis=0).max())
        if arm is None and unit == "m" and size > READING.largest_arm:
            notes.append(
                f"the positions extend over {size:.4g} m; if they are in mm, give `unit='mm'`"
            )
        # what can be nothing but a mistake is refused, what may be intended told
        refuse_mistakes(unmoved(q, x, names), label)
    whole_facts: dict[str, Array] = {}
    for name, fact in zip(further, facts[sound].T, strict=True):
        gaps = numbers[~np.isfinite(fact)]
        if len(gaps):
            notes.append(
                f"the column {name} is not used, it has no number in {len(gaps):,} rows: "
                f"{rows_in_words(gaps)}"
            )
        else:
            whole_facts[name] = fact
    samples = Samples(
        q,
        x,
        names,
        lower,
        upper,
        revolute,
        unit=unit,
        arm=arm and replace(arm, lower=lower, upper=upper),
        side=None if side is None else side[sound],
        time=whole_facts.get("time"),
        episode=whole_facts.get("episode"),
        plane=plane,
        camera=camera,
        orientation=orientation,
        touch=touch,
        rows=numbers,
        columns=roles.column_of,
        degrees=degrees and any(revolute),
        source=source.about,
        dropped=rows.dropped,
        left_out=rows.left_out,
    )
    if arm is not None and touch is None:
        pose = arm.pose if isinstance(arm, SpatialArm) else None
        findings = diagnose(samples, arm.forward, pose)
        notes += refuse_mistakes(findings, label)
    samples = replace(samples, notes=tuple(notes))
    return samples if time_offset is None else with_offset(samples, time_offset)


def write_log(samples: Samples, path: str | os.PathLike[str]) -> None:
    """Write samples as a log that `read_log` reads back to the last bit.

    In rad, m and the unit of the positions; to a path as of `write_table`.

    Examples
    --------
    >>> import calib
    >>> arm = calib.load_arm("two_link")
    >>> samples = calib.babble(arm, 100)
    >>> calib.write_log(samples, "log.csv")
    >>> bool((calib.read_log("log.csv", arm).q == samples.q).all())
    True
    """
    if not isinstance(samples, Samples):
        words = f"expected samples first and then the path, not {type(samples).__name__}"
        raise OptionError(f"write_log: {words}", parameter="samples")
    about = {**samples.source, "unit": samples.unit} if samples.source else None
    write_table(path, log_columns(samples), about=about)


def _unit(source: Source, unit: str | None) -> str:
    """Return the unit of the positions: as typed, or what the log says of itself."""
    if unit is not None and source.unit not in (None, unit):
        raise LogError(
            f"{source.label} states that its positions are in {source.unit}, not in {unit}",
            hint="leave out `unit`, or correct the line above the header",
            parameter="unit",
            value=unit,
        )
    return unit or source.unit or "m"


def _check_touches(label: str, unit: str, outputs: int | None) -> None:
    """Raise LogError for touches of an arm that moves in a plane, or in no length."""
    if outputs == 2:
        raise LogError(
            f"{label} holds touches: expected a robot that moves in space"
        )
    if unit not in METRES:
        raise LogError(
            f"{label}: x, y, z of touches in {unit}, expected {listed(METRES)}"
        )


def _camera(
    source: Source,
    arm: Arm | None,
    x: Array,
    lens: Document | None,
) -> Camera | None:
    """Return the camera of pixels (n, 2) of an arm in space; None of other readings."""
    if arm is not None and arm.outputs == 3 and x.shape[1] == 2:
        about = source.about if lens is None else {"lens": lens}
        return camera_of(about, x)
    if lens is not None:
        raise OptionError(
            "`lens` is for pixels of an arm in space: expected columns u and v"
        )
    return None


def _in_plane(
    label: str,
    x: Array,
    numbers: Index,
    unit: str,
    arm: Arm | None,
    outputs: int | None,
) -> tuple[Array, Plane | None, list[str]]:
    """Positions (n, 3) of a planar arm, or without any that lie in a plane, in it (n, 2)."""
    x = np.ascontiguousarray(x)
    if x.shape[1] == 2 or outputs == 3:
        return x, None, []
    plane, rms = fit_plane(x)
    share = rms / max(float(np.sqrt(x.var(axis=0).sum())), 1e-300)
    if share > READING.out_of_plane and outputs is None:
        return x, None, []
    if share > READING.out_of_plane and arm is not None:
        away = np.abs(plane.distances(x))
        raise LogError(
            f"{label}: x, y, z leave their plane by {rms:.4g} {unit} rms, {100 * share:.2g} % of "
            f"the extent; row {numbers[np.argmax(away)]} by {away.max():.4g} {unit}",
            hint="other joints moved the tip: name all that moved in `joints`, or leave out the "
            "rows in which they did",
            parameter="joints",
        )
    words = (
        f"plane fitted to x, y, z: x along {vector(plane.x)}, y along {vector(plane.y)}, origin "
        f"{vector(plane.origin)}, out-of-plane rms {rms:.4g} {unit}"
    )
    return plane.project(x), plane, [words]


@dataclass(eq=False)
class SoundRows:
    """Rows that are left of a log, and what is said of the others."""

    label: str
    numbers: Index  # (n,), of the rows in the file
    sound: Mask  # (n,)
    notes: list[str] = field(default_factory=list)
    dropped: int = 0  # rows that miss a number
    left_out: int = 0  # rows in which a sensor saw nothing

    def leave_out(self, wrong: Mask, words: str) -> int:
        """Leave out rows (n,), and return how many.  Raises LogError if nothing is left."""
        wrong = wrong & self.sound
        self.sound = self.sound & ~wrong
        count = int(wrong.sum())
        of_all = f"{count:,} of {len(wrong):,} rows {words}"
        if not self.sound.any():
            raise LogError(f"{self.label}: no row is left: {of_all}")
        if count:
            rows = rows_in_words(self.numbers[wrong])
            self.notes.append(f"{of_all}; left out: {rows}")
        return count


def sound_rows(
    label: str,
    values: Array,
    numbers: Index,
    roles: Roles,
    ranges: Mapping[str, Range],
    turning: Mapping[str, bool],
    touched: Mask,
) -> SoundRows:
    """Return which rows of a log are sound.

    values : (n, names), of `roles`; wrong ones and those beyond a turn change
    numbers : (n,), of the rows in the file
    ranges : limits of some joints [rad or m]; rows outside are left out
    turning : which joints turn
    touched : (n,), rows without a measured position
    """
    rows = SoundRows(label, numbers, np.ones(len(values), dtype=bool))
    finite = np.abs(values) < LARGEST
    _, has_position, _ = roles.split(finite)
    has_position[touched] = True
    if roles.touched and not roles.axes:
        finite &= touched[:, None]
    columns = listed(np.array(roles.names)[~finite.all(axis=0)])
    words = f"miss a finite number (2.5, not 2,5) of {columns}"
    rows.dropped = rows.leave_out(np.asarray(~finite.all(axis=1)), words)
    values[~rows.sound] = 0.0
    for name, (low, high) in ranges.items():
        column = values[:, roles.joints.index(name)]
        if turning[name]:
            column[:] = wrap(column, low, high)
        edge = READING.rounded * (high - low)
        away = (column < low - edge) | (column > high + edge)
        rows.leave_out(away, f"have {name} outside of the chosen range")
        np.clip(column, low, high, out=column)
    q, x, turns = roles.split(values)
    zero = rows.sound & (x == 0.0).all(axis=1) & ~touched
    # a single row, or one place of the joints, may be the origin of the sensor
    several = zero.sum() > 1 and np.ptp(q[zero], axis=0).any()
    if several and not zero[rows.sound].all():
        words = "hold zeros for a position, as where a sensor saw nothing"
        rows.left_out = rows.leave_out(zero, words)
    if roles.turns == QUATERNION:
        length = row_lengths(turns)
        wrong = rows.sound & (np.abs(length - 1) > ROUNDING)
        words = f"qx, qy, qz, qw of length {length[np.argmax(wrong)]:.4g}, expected 1"
        rows.left_out += rows.leave_out(wrong, f"hold no orientation: {words}")
    return rows
