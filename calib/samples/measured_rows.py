"""Measured rows: those of a log that miss nothing, and what was left out and why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.checks import LARGEST
from ..errors import LogError
from .columns import Source, read_rows
from .log_ranges import LoggedJoint
from .roles import QUATERNION, ROUNDING, Roles
from .settings import MOST_WRONG, UNSURE
from .wrong_rows import rows_in_words

HELD_ROWS = 200_000
"""Rows of a log that are held in memory; of a longer one so many are drawn."""


def measured_rows(
    source: Source, roles: Roles, joints: Sequence[LoggedJoint], most: int, seed: int
) -> tuple[Array, NDArray[np.intp], int, int, list[str]]:
    """Read the rows of a log in which nothing is missing, seen by the sensor, in chosen ranges.

    Returns values : (n, columns) of `roles`, angles of the joints in rad
    Returns rows : (n,), their numbers in the file, and how many missed a value, and saw nothing
    Returns notes : what was left out and why
    Raises LogError if no row is left, or a column has no number in any row.
    """
    label, dof, axes = source.label, len(roles.joints), len(roles.axes)
    values, rows, total = read_rows(source, roles.columns, most=most, seed=seed)
    if not total:
        raise LogError(f"{label} has a header and no rows")
    notes, given = [], len(values)
    if given < total:
        notes.append(
            f"{total:,} rows: {given:,} of them, drawn evenly, are held; other counts are of these"
        )
    finite = np.abs(values) < LARGEST
    for k, name in enumerate(roles.columns):
        if not finite[:, k].any():
            raise LogError(f"{label}: column {name!r} has no finite value in any row")
    whole = finite.all(axis=1)
    dropped = int((~whole).sum())
    if dropped == given:
        raise LogError(f"{label}: each of the {dropped} rows misses a value")
    if dropped:
        row = int(np.argmin(whole))
        notes.append(
            f"{dropped} of {given} rows dropped: a value is missing, not finite or beyond "
            f"{LARGEST:g} (the first is row {rows[row]}, column "
            f"{roles.columns[int(np.argmin(finite[row]))]!r})"
        )
    values, rows = values[whole], rows[whole]
    inside = np.ones(len(values), dtype=bool)
    for k, joint in enumerate(joints):
        if joint.revolute and joint.degrees:
            values[:, k] = np.deg2rad(values[:, k])
        if not joint.chosen:
            continue
        here, shown = joint.holds(values[:, k]), joint.show(joint.limits)
        if not here.any():
            raise LogError(f"{label}: no value of {joint.name!r} lies in the range {shown}")
        if not here.all():
            outside = f"{joint.name} outside of the range {shown}"
            notes.append(f"{int((~here).sum())} rows dropped: {outside}")
        inside &= here
    values, rows = values[inside], rows[inside]
    zero = (values[:, dof : dof + axes] == 0.0).all(axis=1)
    # a single row, or one place of the joints, may be the origin of the sensor
    if zero.sum() < 2 or zero.all() or not np.ptp(values[zero, :dof], axis=0).any():
        zero[:] = False
    kinds, lost = [(zero, "hold zeros for a position, as where a sensor saw nothing")], zero
    if roles.turns == QUATERNION:
        quaternions = values[:, dof + axes : dof + axes + 4]
        length = np.linalg.norm(quaternions, axis=1)
        unturned = ~lost & (np.abs(length - 1) > ROUNDING)
        if unturned.mean() > MOST_WRONG:
            row = int(np.argmax(unturned))
            shown = ", ".join(f"{value:.4g}" for value in quaternions[row])
            raise LogError(
                f"{label}: {int(unturned.sum()):,} of {len(values):,} rows hold no orientation, "
                f"the first (row {rows[row]}) has qx, qy, qz, qw = {shown} of length "
                f"{length[row]:.4g}, expected 1; check which columns are named"
            )
        kinds.append((unturned, "hold no orientation: a quaternion whose length is not 1"))
        lost = lost | unturned
    if roles.spread:
        variance = values[:, [-21, -15, -10]].sum(axis=1)  # of x, y and z
        unsure = ~lost & (variance > UNSURE**2 * np.median(np.abs(variance)))
        kinds.append((unsure, f"have a covariance over {UNSURE:g} times as wide as usual"))
        lost = lost | unsure
    notes += [
        f"{int(wrong.sum()):,} of {len(values):,} rows {why}; left out: "
        f"{rows_in_words(rows[wrong])}"
        for wrong, why in kinds
        if wrong.any()
    ]
    return values[~lost], rows[~lost], dropped, int(lost.sum()), notes


def check_values(label: str, values: Array, names: Sequence[str], axes: Sequence[str]) -> None:
    """Refuse columns that do not move, or are copies of each other."""
    if len(values) < 2:
        raise LogError(f"{label} has one usable row; learning needs two or more")
    still = np.ptp(values, axis=0) == 0.0
    for k, name in enumerate(names):
        if still[k]:
            raise LogError(
                f"{label}: joint {name!r} is {values[0, k]:g} in every row; a joint that does not "
                "move cannot be learned",
                hint="leave it out of `joints`",
                parameter="joints",
                value=name,
            )
        for other in range(k):
            if np.array_equal(values[:, k], values[:, other]):
                raise LogError(
                    f"{label}: joints {names[other]!r} and {name!r} have the same "
                    "values in every row; one of the columns is a copy"
                )
    for k, name in enumerate(axes if len(axes) == 2 else (), start=len(names)):
        if still[k]:
            raise LogError(
                f"{label}: {name} is {values[0, k]:g} in every row; the sensor saw no motion "
                "along it"
            )
