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
from ..common.arrays import Array, Index
from ..common.rows import whole
from ..common.wording import listed, vector
from ..errors import LogError, OptionError
from .camera import Camera, camera_of
from .delays import with_offset
from .diagnosis import diagnose, refuse_mistakes
from .joint_values import JointColumn, check_ranges
from .motion import directions
from .roles import (
    FURTHER,
    PIXELS,
    QUATERNION,
    find_roles,
    from_angles,
    log_columns,
    unit_quaternions,
)
from .samples import POSITION, Samples
from .settings import READING
from .sound_values import sound_rows
from .tables import Source, open_source, write_table
from .touches import read_touches


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
    label = source.label
    column_of = {
        name: column
        for name, column in (usual or {}).items()
        if column in source.header
    }
    column_of |= columns or {}
    there = {*source.header, *column_of}
    others = there - {*(arm.joint_names if arm else joints or ())}
    if not {*POSITION} & there and {*PIXELS.values()} <= others:
        column_of |= PIXELS
        there |= {*PIXELS}
        unit = unit or "px"
    unit = _unit(source, unit)
    if "point" in there:
        return read_touches(
            source, arm, joints, column_of, degrees=degrees, unit=unit
        )
    roles = find_roles(source, arm, joints, column_of)
    if arm is not None and outputs is None:
        outputs = arm.outputs
    _check_positions(there, label, roles.axes, unit, outputs)
    names = roles.joints
    ranges = ranges or {}
    limits = dict(ranges)
    if arm is not None:
        revolute = tuple(arm.revolute)
        bounds = zip(arm.lower, arm.upper, strict=True)
        limits = dict(zip(names, bounds, strict=True)) | limits
    else:
        _check_prismatic(prismatic, names)
        revolute = tuple(name not in prismatic for name in names)
    turning = dict(zip(names, revolute, strict=True))
    check_ranges(ranges, turning)

    drawn, total = source.drawn(most, seed)
    read = [column_of.get(name, name) for name in roles.names]
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
    chosen = {
        name: (ranges[name], turns)
        for name, turns in turning.items()
        if name in ranges
    }
    rows = sound_rows(label, values, numbers, roles, chosen)
    notes += rows.notes
    numbers = numbers[rows.sound]
    q, x, turns = roles.split(values[rows.sound])
    lower, upper = np.empty((2, len(names)))
    for k, name in enumerate(names):
        joint = JointColumn(label, name, revolute[k], limits.get(name), degrees)
        q[:, k], (lower[k], upper[k]), words = joint.settle(q[:, k], numbers)
        notes += words
    x, plane, words = _in_plane(label, x, numbers, unit, arm, outputs)
    notes += words
    camera = _camera(source, arm, x if len(roles.axes) == 2 else None, lens)
    if camera is not None and camera.note:
        notes.append(camera.note)
    size = float(np.ptp(x, axis=0).max())
    if arm is None and unit == "m" and size > READING.largest_arm:
        notes.append(
            f"the positions extend over {size:.4g} m; if they are in mm, give `unit='mm'`"
        )
    orientation = None
    if roles.turns == QUATERNION and plane is None:
        orientation = unit_quaternions(turns)
    elif roles.turns and plane is None:
        orientation = from_angles(np.deg2rad(turns) if degrees else turns)
    # what can be nothing but a mistake is refused, what may be intended told
    refuse_mistakes(diagnose(None, q, x, names, revolute), label)
    if arm is not None:
        findings = diagnose(
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
        notes += refuse_mistakes(findings, label)
        arm = replace(arm, lower=lower, upper=upper)
    whole_facts = {
        name: fact
        for name, fact in zip(further, facts[rows.sound].T, strict=True)
        if np.isfinite(fact).all()
    }
    samples = Samples(
        q,
        x,
        names,
        lower,
        upper,
        revolute,
        unit,
        arm=arm,
        side=None if side is None else side[rows.sound],
        plane=plane,
        camera=camera,
        orientation=orientation,
        rows=numbers,
        columns=column_of,
        degrees=degrees and any(revolute),
        source=source.about,
        dropped=rows.dropped,
        left_out=rows.left_out,
        notes=tuple(notes),
        **whole_facts,
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


def _check_positions(
    there: set[str],
    label: str,
    axes: tuple[str, ...],
    unit: str,
    outputs: int | None,
) -> None:
    """Raise LogError for a log without positions, or with too few coordinates."""
    if not there & {*POSITION}:
        raise LogError(
            f"{label} has no positions: expected columns x, y and z [m] of a tracker, "
            "u and v of a camera, or point of sockets that the tip touched",
            hint="if they have other names, give `columns={'x': 'OTHER', 'y': ..}`",
            parameter="columns",
        )
    if len(axes) < (outputs or 2) and unit != "px":  # a camera sees two
        raise LogError(
            f"{label} has x and y alone, expected x, y and z of an arm in space",
            hint="for a planar part of the arm name its joints, or give `planar=True`",
            parameter="planar",
        )


def _check_prismatic(prismatic: Sequence[str], names: Sequence[str]) -> None:
    """Raise OptionError for a sliding joint that is none."""
    if not {*prismatic} <= {*names}:
        words = (
            f"{listed(prismatic)} named as sliding: expected some of the joints"
        )
        raise OptionError(f"{words} {listed(names)}", parameter="prismatic")


def _camera(
    source: Source,
    arm: Arm | None,
    pixels: Array | None,
    lens: Mapping[str, Any] | None,
) -> Camera | None:
    """Return the camera of pixels (n, 2) of an arm in space; None of other readings."""
    if arm is not None and arm.outputs == 3 and pixels is not None:
        about = source.about if lens is None else {"lens": lens}
        return camera_of(about, pixels)
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
