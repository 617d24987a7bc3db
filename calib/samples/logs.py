"""Logs: joint values and measured positions in a file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.plane import Plane, fit_plane
from ..common.arrays import Array, Document, Range
from ..common.scale import METRES
from ..common.wording import by_name, listing, vector
from ..errors import LogError, OptionError
from .camera import Camera
from .cells import Cells, sound_cells
from .column_units import common_unit
from .delays import with_offset
from .diagnosis import diagnose
from .findings import Finding, refuse_mistakes, still_columns
from .joint_values import JointColumn, columns_of_joints, into_ranges
from .roles import Roles, find_roles, log_columns, quaternions
from .samples import Readings, Samples
from .settings import READING
from .sockets import Touches
from .tables import (
    Source,
    names_of_sensors,
    open_source,
    write_table,
)


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
    outputs: int | None = None,
    lens: Document | None = None,
    time_offset: float | None = None,
) -> Samples:
    """Read a measured log: one column for each joint, and x, y or x, y, z.

    Further columns are ignored. Rows with a value that is missing, not finite or beyond 1e15
    are left out, counted in `Samples.dropped` and described in `Samples.notes`. Positions may be
    in the sensor's own unit and axes; to x, y, z a plane is fitted. Of a log with more than 200,000
    rows that many, evenly spread, are read. Rows stay in the order of the file.  A column `point`,
    and optionally `setup`, names the socket that the tip touched: then x, y, z are its known
    coordinates in its fixture's frame, and in a row without a point what a sensor measured.  A
    column `sensor` names the sensor.

    path : CSV or Parquet; `-` reads CSV from standard input
    arm : gives the joints' names and limits; its kinematics show other units, exchanged columns and
        a lag, and are never learned from
    joints : without an arm, the joints' columns, from base to tip
    columns : other names of columns, ``{"x": "cam_u", "elbow": "joint_2"}``
    degrees : whether joints that turn are logged in degrees; `ranges` are in rad still
    unit : of the positions; if not given what the log declares, else m
    ranges : the range of a joint [rad or m], before the arm's limits; rows outside are left out
    prismatic : without an arm, the joints that slide
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
    source = open_source(path)
    label = source.label
    ranges = ranges or {}
    if arm is not None:
        outputs = outputs or arm.outputs
    roles = find_roles(source, arm, joints, columns or {})
    unit = _unit(source, roles, unit)
    sensor = _sensor(source)
    _check_axes(label, roles, unit, arm, outputs)
    names = by_name(roles.joints, roles.columns(roles.joints))
    joint_columns = columns_of_joints(
        label, names, arm, ranges, prismatic, degrees=degrees
    )

    cells = sound_cells(source, roles, joint_columns, ranges)
    q, lower, upper, joint_notes = into_ranges(
        joint_columns, cells.q, cells.numbers, anywhere=roles.touched
    )
    notes = [*cells.notes, *joint_notes]
    if roles.touched:
        readings = _touches(cells, q, unit, arm)
    else:
        readings, words = _positions(cells, roles, unit, arm, outputs, degrees)
        notes += words
        refuse_mistakes(still_columns(q, readings.x, roles.joints), label)

    about = source.about if lens is None else {**source.about, "lens": lens}
    cells = replace(cells, q=q)
    samples = _samples(
        cells, roles, joint_columns, (lower, upper), readings, arm, about
    )
    notes += _camera_notes(samples.camera, lens)
    if arm is not None and not roles.touched:
        notes += refuse_mistakes(_diagnosis(samples, arm), label)
    samples = replace(samples, notes=tuple(notes), sensor=sensor)
    return samples if time_offset is None else with_offset(samples, time_offset)


def _samples(
    cells: Cells,
    roles: Roles,
    joints: Sequence[JointColumn],
    limits: tuple[Array, Array],
    readings: Readings,
    arm: Arm | None,
    about: Document,
) -> Samples:
    """The samples of a log's cells, with joints in their ranges, and what the sensor read.

    limits : lower and upper ends (dof,) of these ranges [rad or m];  about : see `Source.about`
    """
    lower, upper = limits
    turning = [joint.degrees for joint in joints if joint.revolute]
    return Samples(
        cells.q,
        joint_names=roles.joints,
        lower=lower,
        upper=upper,
        revolute=tuple(joint.revolute for joint in joints),
        arm=arm and replace(arm, lower=lower, upper=upper),
        side=cells.side,
        time=cells.time,
        episode=cells.episode,
        rows=cells.numbers,
        columns=roles.column_of,
        degrees=any(turning) and all(turning),
        source=about,
        dropped=cells.dropped,
        left_out=cells.left_out,
        **vars(readings),
    )


def _camera_notes(camera: Camera | None, lens: Document | None) -> list[str]:
    """Return what was assumed of a log's camera; OptionError for a lens of no camera."""
    if camera is None and lens is not None:
        raise OptionError(
            "`lens` is for pixels of an arm in space: expected columns u and v"
        )
    return [camera.note] if camera is not None and camera.note else []


def _diagnosis(samples: Samples, arm: Arm) -> list[Finding]:
    """What the kinematics of an arm find wrong with a log of it."""
    pose = arm.pose if isinstance(arm, SpatialArm) else None
    scale = METRES.get(samples.unit, 1.0)

    def nominal(q: Array) -> Array:
        return np.asarray(scale * arm.forward(q))

    return diagnose(samples, nominal, pose)


def _positions(
    cells: Cells,
    roles: Roles,
    unit: str,
    arm: Arm | None,
    outputs: int | None,
    degrees: bool,
) -> tuple[Readings, list[str]]:
    """Return what a sensor measured in the rows of a log, and notes."""
    x, plane, notes = _in_plane(cells, unit, arm, outputs)
    orientation = None
    if roles.orientation and plane is None:
        stated = common_unit(roles.columns(roles.orientation))
        in_degrees = degrees if stated is None else stated != "rad"
        orientation = quaternions(cells.orientation, degrees=in_degrees)
    size = float(np.ptp(x, axis=0).max())
    if arm is None and unit == "m" and size > READING.largest_arm:
        notes.append(
            f"the positions extend over {size:.4g} m; if they are in mm or cm, say so, as by "
            "`unit='mm'`"
        )
    return Readings(x, unit=unit, plane=plane, orientation=orientation), notes


def _touches(cells: Cells, q: Array, unit: str, arm: Arm | None) -> Readings:
    """Return touches, with the sockets where the drawing has them.

    Positions of the rows are known coordinates of the points, or what a sensor measured.
    """
    x = np.full((len(q), 3), np.nan)
    if cells.x.shape[1]:
        x = cells.x / METRES[unit]
    touch = Touches.of(cells.points, x)
    tips = np.zeros_like(x) if arm is None else arm.forward(q)
    return Readings(touch.positions(x, touch.means(tips)), touch=touch)


def write_log(samples: Samples, path: str | os.PathLike[str]) -> None:
    """Write samples as a log that `read_log` reads back to the last bit.

    It is in rad, m and the unit of the positions; for the path see `write_table`.

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


def _unit(source: Source, roles: Roles, unit: str | None) -> str:
    """Return the unit of the positions: as typed, or as the log declares."""
    stated = common_unit(roles.columns(roles.axes)) or source.unit
    if unit is not None and stated not in (None, unit):
        raise LogError(
            f"{source.label} states that its positions are in {stated}, not in {unit}",
            hint="leave out `unit`, or correct what the log says",
            parameter="unit",
            value=unit,
        )
    return unit or stated or ("px" if roles.pixels else "m")


def _sensor(source: Source) -> str:
    """Name of the sensor in the column `sensor`, "" where there is none.

    Raises LogError for the rows of several sensors.
    """
    sensors = names_of_sensors(source)
    if len(sensors) > 1:
        raise LogError(
            f"{source.label} has rows of several sensors, {listing(sensors)}: expected a log of "
            "one; write the rows of each to a file of its own"
        )
    return "".join(sensors)


def _check_axes(
    label: str,
    roles: Roles,
    unit: str,
    arm: Arm | None,
    outputs: int | None,
) -> None:
    """Raise LogError for positions that have too few axes, and for touches that are none in space.

    outputs : coordinates that a position of the arm has
    """
    if not roles.touched:
        # a camera sees two
        if unit == "px" or len(roles.axes) >= (outputs or 2):
            return
        if arm is None:
            words = f"{label} has two coordinates, and the model x, y and z"
            hint = "is it a log of another arm, or sensor? a log bears its sensor's name"
            raise LogError(words, hint=hint)
        raise LogError(
            f"{label} has x and y alone, expected x, y and z of an arm in space",
            hint="name a camera's pixels u and v; for a planar part of the arm name its joints, or "
            "give `planar=True`",
            parameter="planar",
        )
    if outputs == 2:
        raise LogError(
            f"{label} holds touches: expected a robot that moves in space"
        )
    if roles.axes and unit not in METRES:
        raise LogError(
            f"{label}: x, y, z of touches in {unit}, expected {listing(METRES)}"
        )


def _in_plane(
    cells: Cells, unit: str, arm: Arm | None, outputs: int | None
) -> tuple[Array, Plane | None, list[str]]:
    """Positions in their plane (n, 2), the plane and a note; without one as they are (n, m)."""
    x = np.ascontiguousarray(cells.x)
    if x.shape[1] == 2 or outputs == 3:
        return x, None, []
    plane, rms = fit_plane(x)
    share = rms / max(float(np.sqrt(x.var(axis=0).sum())), 1e-300)
    if share > READING.out_of_plane and outputs is None:
        return x, None, []
    if share > READING.out_of_plane and arm is not None:
        distance = np.abs(plane.distances(x))
        raise LogError(
            f"{cells.label}: x, y, z leave their plane by {rms:.4g} {unit} rms, "
            f"{100 * share:.2g} % of the extent; row {cells.numbers[np.argmax(distance)]} by "
            f"{distance.max():.4g} {unit}",
            hint="other joints moved the tip: name all that moved in `joints`, or leave out the "
            "rows in which they did",
            parameter="joints",
        )
    words = (
        f"plane fitted to x, y, z: x along {vector(plane.x)}, y along {vector(plane.y)}, origin "
        f"{vector(plane.origin)}, out-of-plane rms {rms:.4g} {unit}"
    )
    return plane.project(x), plane, [words]
