"""Logs: joint values and measured positions in a file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.plane import Plane, fit_plane
from ..arm.urdf import Range
from ..common.arrays import Array, Index, Mask
from ..common.rows import LARGEST, whole
from ..common.wording import listed, vector
from ..errors import LogError, OptionError
from . import settings
from .camera import camera_of
from .delays import with_offset
from .diagnosis import diagnose, refuse_mistakes
from .joint_values import LoggedJoint, check_ranges, wrap
from .roles import (
    FURTHER,
    PIXELS,
    QUATERNION,
    ROUNDING,
    Roles,
    covariances,
    find_roles,
    from_angles,
    log_columns,
)
from .samples import POSITION, Samples
from .tables import Source, open_source, write_table
from .touches import read_touches
from .wrong_rows import rows_in_words


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
    most: int = settings.HELD_ROWS,
    seed: int = 0,
    usual: Mapping[str, str] | None = None,
    outputs: int | None = None,
    lens: Mapping[str, Any] | None = None,
    time_offset: float | None = None,
) -> Samples:
    """Read a measured log: one column for each joint, and x, y or x, y, z.

    Further columns are ignored. Rows with a value that is missing, not finite or beyond 1e15
    are left out, counted in `Samples.dropped` and described in `Samples.notes`. Positions may be
    in the sensor's own unit and axes; of x, y, z the plane is fitted. A log may be of any length:
    of one with more than `most` rows so many are drawn at random. Rows stay in the order of the
    file.

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
    columns = {k: v for k, v in (usual or {}).items() if v in source.header} | dict(
        columns or {}
    )
    given = {*source.header} - {*(arm.joint_names if arm else joints or ())}
    if not {*POSITION} & {*source.header, *columns} and {*PIXELS.values()} <= given:
        columns |= PIXELS
        unit = unit or "px"
    if unit is not None and source.unit not in (None, unit):
        raise LogError(
            f"{source.label} states that its positions are in {source.unit}, not in {unit}",
            hint="leave out `unit`, or correct the line above the header",
            parameter="unit",
            value=unit,
        )
    unit = unit or source.unit or "m"
    if "point" in source.header or "point" in columns:
        return read_touches(source, arm, joints, columns, degrees=degrees, unit=unit)
    roles, read = find_roles(source, arm, joints, columns)
    outputs = arm.outputs if arm is not None and outputs is None else outputs
    if not {*source.header, *columns} & {*POSITION}:
        raise LogError(
            f"{source.label} has no positions: expected columns x, y and z [m] of a tracker, "
            "u and v of a camera, or point of sockets that the tip touched",
            hint="if they have other names, give `columns={'x': 'OTHER', 'y': ..}`",
            parameter="columns",
        )
    if len(roles.axes) < (outputs or 2) and unit != "px":  # a camera sees two
        raise LogError(
            f"{source.label} has x and y alone, expected x, y and z of an arm in space",
            hint="for a planar part of the arm name its joints, or give `planar=True`",
            parameter="planar",
        )
    names = roles.joints
    ranges = dict(ranges or {})
    revolute = tuple(
        arm.revolute if arm is not None else (n not in prismatic for n in names)
    )
    if arm is None and not {*prismatic} <= {*names}:
        words = f"{listed(prismatic)} named as sliding: expected some of the joints"
        raise OptionError(f"{words} {listed(names)}", parameter="prismatic")
    check_ranges(ranges, dict(zip(names, revolute, strict=True)))

    drawn, total = source.drawn(most, seed)
    further = [name for name in FURTHER if name in source.header and name not in read]
    values, numbers = drawn.numbers([*read, *further])
    values, facts = np.split(values, [len(read)], axis=1)
    turning = np.flatnonzero(revolute) if degrees else slice(0)
    values[:, turning] = np.deg2rad(values[:, turning])
    held = f"{total:,} rows: {most:,} of them, drawn evenly, are held; other counts are of these"
    kept, dropped, left_out, told = _sound(
        source.label, values, numbers, roles, revolute, ranges
    )
    notes = [held] * (total > most) + told
    values = values[kept]
    facts = facts[kept]
    numbers = numbers[kept]
    q, x, turns, spread = np.split(
        values, np.cumsum([len(some) for some in roles[:3]]), axis=1
    )
    lower, upper = np.empty((2, len(names)))
    for k, name in enumerate(names):
        own = None if arm is None else (float(arm.lower[k]), float(arm.upper[k]))
        joint = LoggedJoint(
            source.label, name, revolute[k], ranges.get(name, own), degrees
        )
        q[:, k], (lower[k], upper[k]), told = joint.settle(q[:, k], numbers)
        notes += told
    x, plane, told = _in_plane(source.label, x, numbers, unit, arm, outputs)
    notes += told
    camera = None
    if arm is not None and arm.outputs == 3 and len(roles.axes) == 2:
        camera = camera_of(source.about if lens is None else {"lens": lens}, x)
        notes += [camera.note] if camera.note else []
    elif lens is not None:
        raise OptionError(
            "`lens` is for pixels of an arm in space: expected columns u and v"
        )
    size = float(np.ptp(x, axis=0).max())
    if arm is None and unit == "m" and size > settings.LARGEST_ARM:
        notes.append(
            f"the positions extend over {size:.4g} m; if they are in mm, give `unit='mm'`"
        )
    if roles.turns == QUATERNION:
        turns = turns / np.linalg.norm(turns, axis=1)[:, None]
        turns = np.where(turns[:, 3:] < 0, -turns, turns)
    elif roles.turns:
        turns = from_angles(np.deg2rad(turns) if degrees else turns)
    orientation = turns if roles.turns and plane is None else None
    # what can be nothing but a mistake is refused, what may be intended told
    refuse_mistakes(diagnose(None, q, x, names, revolute), source.label)
    if arm is not None:
        found = diagnose(
            arm.forward,
            q,
            x,
            names,
            revolute,
            unit=unit,
            turns=orientation,
            pose=arm.pose if isinstance(arm, SpatialArm) else None,
            left_handed=plane is not None,
        )
        notes += refuse_mistakes(found, source.label)
    samples = Samples(
        q,
        x,
        names,
        lower,
        upper,
        revolute,
        unit,
        dropped=dropped,
        arm=replace(arm, lower=lower, upper=upper) if arm else None,
        notes=tuple(notes),
        plane=plane,
        orientation=orientation,
        covariance=covariances(spread, source.label)
        if roles.spread and plane is None
        else None,
        columns=columns,
        degrees=degrees and any(revolute),
        camera=camera,
        source=source.about,
        rows=numbers,
        **{
            name: fact
            for name, fact in zip(further, facts.T, strict=True)
            if _whole(fact)
        },
        left_out=left_out,
    )
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
        words = (
            f"expected samples first and then the path, not {type(samples).__name__}"
        )
        raise OptionError(f"write_log: {words}", parameter="samples")
    about = {**samples.source, "unit": samples.unit} if samples.source else None
    write_table(path, log_columns(samples), about=about)


def _sound(
    label: str,
    values: Array,
    numbers: Index,
    roles: Roles,
    revolute: Sequence[bool],
    chosen: Mapping[str, Range],
) -> tuple[Index, int, int, list[str]]:
    """Rows that are whole, seen and in range; how many missed a value, saw nothing; notes."""
    kept: Mask = np.ones(len(values), dtype=bool)
    notes: list[str] = []

    def leave_out(wrong: Mask, words: str) -> int:
        wrong = wrong & kept
        if not (kept & ~wrong).any():
            raise LogError(
                f"{label}: no row is left: {wrong.sum()} of {len(kept)} rows {words}"
            )
        if wrong.any():
            shown = rows_in_words(numbers[wrong])
            notes.append(
                f"{wrong.sum():,} of {len(kept):,} rows {words}; left out: {shown}"
            )
        np.logical_and(kept, ~wrong, out=kept)
        return int(wrong.sum())

    finite = np.abs(values) < LARGEST
    names = np.array([name for some in roles for name in some])
    words = (
        f"miss a finite number (2.5, not 2,5) of {listed(names[~finite.all(axis=0)])}"
    )
    dropped = leave_out(np.asarray(~finite.all(axis=1)), words)
    values[~kept] = 0.0
    for k in (k for k, name in enumerate(roles.joints) if name in chosen):
        low, high = chosen[roles.joints[k]]
        edge = settings.ROUNDED * (high - low)
        column = values[:, k]
        column = wrap(column, low, high) if revolute[k] else column
        away = (column < low - edge) | (column > high + edge)
        leave_out(away, f"have {roles.joints[k]} outside of the chosen range")
        values[:, k] = np.clip(column, low, high)
    q, x, turns, spread = np.split(
        values, np.cumsum([len(some) for some in roles[:3]]), axis=1
    )
    zero: Mask = kept & (x == 0.0).all(axis=1)
    left_out = 0
    # a single row, or one place of the joints, may be the origin of the sensor
    if zero.sum() > 1 and np.ptp(q[zero], axis=0).any() and not zero[kept].all():
        left_out += leave_out(
            zero, "hold zeros for a position, as where a sensor saw nothing"
        )
    if roles.turns == QUATERNION:
        length = np.linalg.norm(turns, axis=1)
        unturned = kept & (np.abs(length - 1) > ROUNDING)
        words = f"hold no orientation: qx, qy, qz, qw of length {length[np.argmax(unturned)]:.4g}"
        left_out += leave_out(unturned, f"{words}, expected 1")
    if roles.spread:
        variance = spread[:, [0, 6, 11]].sum(axis=1)  # of x, y and z
        unsure = variance > settings.UNSURE**2 * np.median(np.abs(variance[kept]))
        left_out += leave_out(unsure, "have a covariance far wider than usual")
    return np.flatnonzero(kept), dropped, left_out, notes


def _whole(fact: Array) -> bool:
    """Whether a column that is no measurement (n,) has a number in each row."""
    return bool(np.isfinite(fact).all())


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
    if share > settings.OUT_OF_PLANE and outputs is None:
        return x, None, []
    if share > settings.OUT_OF_PLANE and arm is not None:
        away = np.abs(plane.distances(x))
        raise LogError(
            f"{label}: x, y, z leave their plane by {rms:.4g} {unit} rms, {100 * share:.2g} % of "
            f"the extent; row {numbers[np.argmax(away)]} by {away.max():.4g} {unit}",
            hint="other joints moved the tip: name all that moved in `joints`, or leave out the "
            "rows in which they did",
            parameter="joints",
        )
    told = (
        f"plane fitted to x, y, z: x along {vector(plane.x)}, y along {vector(plane.y)}, origin "
        f"{vector(plane.origin)}, out-of-plane rms {rms:.4g} {unit}"
    )
    return plane.project(x), plane, [told]
