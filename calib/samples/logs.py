"""Logs: joint values and measured positions in a file."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.plane import fit_plane
from ..arm.ranges import Range
from ..common.scale import TURN
from ..common.wording import vector
from ..errors import LogError, OptionError
from .camera import camera_of
from .columns import Source, open_source, read_columns
from .delays import with_offset
from .diagnosis import diagnose, refuse_mistakes
from .log_ranges import UNKNOWN_RANGE, LoggedJoint
from .measured_rows import HELD_ROWS, check_values, measured_rows
from .roles import (
    PIXELS,
    QUATERNION,
    check_names,
    covariances,
    find_roles,
    from_angles,
    log_columns,
    sees_pixels,
)
from .samples import Samples
from .settings import LARGEST_ARM, OUT_OF_PLANE
from .tables import read_about, stated_unit, write_table
from .touches import read_touches

if TYPE_CHECKING:
    from ..arm.arm import Arm

_THICK = 0.02
"""Out-of-plane share of the positions' spread from which on an unknown arm moves in space."""


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
    most: int = HELD_ROWS,
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
    columns : other names of columns, ``{"x": "cam_u", "elbow": "joint_2"}``; of a Parquet file's
        lists one element, counted from 0, ``{"elbow": "observation.state[1]"}``
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
    if isinstance(most, bool) or not isinstance(most, (int, np.integer)) or most < 2:
        raise OptionError(f"most is {most!r}, expected a whole number of rows, 2 or more")
    source = open_source(path)
    there = {k: name for k, name in (usual or {}).items() if name in source}
    columns = {**there, **(columns or {})}
    about = read_about(source)
    if sees_pixels(source.header, columns, arm.joint_names if arm else joints or ()):
        columns |= PIXELS
        unit = unit or "px"
    if unit is not None and isinstance(about.get("unit"), str) and about["unit"] != unit:
        raise LogError(
            f"{source.label} states that its positions are in {about['unit']}, not in {unit}",
            hint="leave out `unit`, or correct the line above the header",
            parameter="unit",
            value=unit,
        )
    unit = unit or stated_unit(about)
    if "point" in {*source.header, *columns}:
        names = arm.joint_names if arm is not None else tuple(joints or ())
        kinds = arm.revolute if arm is not None else (True,) * len(names)
        return read_touches(source, names, arm, columns, revolute=kinds, degrees=degrees, unit=unit)
    roles = find_roles(source, arm, joints, columns)
    names, axes = roles.joints, roles.axes
    wanted = arm.outputs if arm is not None and outputs is None else outputs
    if len(axes) < (wanted or 2) and not (outputs is None and unit == "px"):  # a camera sees two
        raise LogError(
            f"{source.label} has x and y alone, expected x, y and z of an arm in space",
            hint="for a planar part of the arm name its joints, or give `planar=True`",
            parameter="planar",
        )
    known = _joints(source.label, arm, names, prismatic, degrees, ranges or {})
    values, rows, dropped, left_out, notes = measured_rows(source, roles, known, most, seed)
    check_values(source.label, values, names, axes)
    revolute = tuple(joint.revolute for joint in known)
    in_degrees = degrees and any(revolute)
    # values of a few degrees at most are doubted
    if in_degrees and np.abs(values[:, np.flatnonzero(revolute)]).max() <= math.radians(TURN):
        notes.append("no joint goes beyond 6.3 degrees; if the log is in rad, leave out `degrees`")
    settled = [joint.settle(values[:, k], rows) for k, joint in enumerate(known)]
    q = np.stack([column for column, *_ in settled], axis=1)
    lower, upper = np.array([limits for _, limits, _ in settled]).T
    notes += [note for *_, more in settled for note in more]
    x = np.ascontiguousarray(values[:, len(names) : len(names) + len(axes)])
    first = len(names) + len(axes)
    last = first + len(roles.turns)
    orientation = None
    if roles.turns == QUATERNION:
        orientation = values[:, first:last] / np.linalg.norm(values[:, first:last], axis=1)[:, None]
        orientation = np.where(orientation[:, 3:] < 0, -orientation, orientation)
    elif roles.turns:
        orientation = from_angles(
            np.deg2rad(values[:, first:last]) if degrees else values[:, first:last]
        )
    covariance = (
        covariances(values[:, last:], source.label, rows.tolist()) if roles.spread else None
    )
    plane = rms = None
    spread = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    flat = len(spread) < 3 or bool(spread[2] <= _THICK * spread[0])
    if len(axes) == 3 and wanted != 3 and (wanted is not None or flat):
        plane, rms = fit_plane(x)
        share = rms / max(float(np.sqrt(x.var(axis=0).sum())), 1e-300)
        if arm is not None and share > OUT_OF_PLANE:
            away = np.abs(plane.distances(x))
            raise LogError(
                f"{source.label}: x, y, z leave their plane by {rms:.4g} {unit} rms, "
                f"{100 * share:.2g} % of the extent (at most {100 * OUT_OF_PLANE:g} %); row "
                f"{rows[np.argmax(away)]} by {away.max():.4g} {unit}",
                hint="other joints moved the tip: name all that moved in `joints`, or leave out "
                "the rows in which they did",
                parameter="joints",
                value=share,
            )
        x = plane.project(x)
        notes.append(
            f"plane fitted to x, y, z: x along {vector(plane.x)}, y along {vector(plane.y)}, "
            f"origin {vector(plane.origin)}, out-of-plane rms {rms:.4g} {unit}"
        )
    camera = None
    if arm is not None and arm.outputs == 3 and len(axes) == 2:
        camera = camera_of(about if lens is None else {"lens": lens}, x)
        notes += [camera.note] if camera.note else []
    elif lens is not None:
        raise OptionError("`lens` is for pixels of an arm in space: expected columns u and v")
    if arm is None and unit == "m" and (size := float(np.ptp(x, axis=0).max())) > LARGEST_ARM:
        notes.append(
            f"the positions extend over {size:.4g} m, as those of an arm of that size; if they are "
            "in mm, give `unit='mm'`"
        )
    time = None
    if "time" in source.header and "time" not in names:
        time = read_columns(source, ["time"], lenient=True)[rows - 1, 0]
        time = time if np.isfinite(time).all() else None
    samples = Samples(
        q=q,
        x=x,
        joint_names=names,
        lower=lower,
        upper=upper,
        revolute=revolute,
        unit=unit,
        dropped=dropped,
        arm=replace(arm, lower=lower, upper=upper) if arm else None,
        notes=tuple(notes),
        plane=plane,
        out_of_plane_rms=rms,
        orientation=None if plane is not None else orientation,
        covariance=covariance if plane is None else None,
        columns=columns,
        degrees=in_degrees,
        camera=camera,
        source=about,
        rows=rows,
        time=time,
        left_out=left_out,
    )
    samples = samples if time_offset is None else with_offset(samples, time_offset)
    if arm is None:
        return samples
    # what the kinematics show to be a mistake is refused, what may be intended is told
    findings = diagnose(
        arm.forward, samples.q, samples.x, samples.joint_names, samples.revolute,
        unit=samples.unit, turns=samples.orientation, left_handed=samples.plane is not None,
        pose=arm.pose if isinstance(arm, SpatialArm) else None,
    )  # fmt: skip
    told = refuse_mistakes(findings, source.label)
    return replace(samples, notes=(*samples.notes, *told))


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
    check_names(samples.joint_names)
    about = samples.orientation, samples.covariance
    write_table(path, log_columns(samples.joint_names, samples.q, samples.x, *about))


def _joints(
    label: str,
    arm: Arm | None,
    names: Sequence[str],
    prismatic: Sequence[str],
    degrees: bool,
    ranges: Mapping[str, Range],
) -> list[LoggedJoint]:
    """What is known of the joints, of the arm where there is one."""
    for name in prismatic if arm is None else ():
        if name not in names:
            raise OptionError(
                f"{name!r} is named as sliding but is not a joint; joints: {', '.join(names)}",
                parameter="prismatic",
                value=name,
            )
    joints = []
    for k, name in enumerate(names):
        turns = arm.revolute[k] if arm is not None else name not in prismatic
        limits = (float(arm.lower[k]), float(arm.upper[k])) if arm is not None else UNKNOWN_RANGE
        joint = LoggedJoint(label, name, turns, limits, degrees)
        joints.append(joint.with_range(ranges[name]) if name in ranges else joint)
    return joints
