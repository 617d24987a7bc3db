"""Inverse queries: joint values for one position or pose, or for a table of them.

It needs NumPy: the command imports it when it runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from calib.arm.rotations import QUATERNION
from calib.common.arrays import Array
from calib.common.wording import by_name
from calib.errors import QueryError
from calib.model.answers import Answer, every_branch
from calib.model.space import Space

from .output import EXIT_ACT, Outcome, note
from .parsing import BadOption
from .query import BOUNDS, Query, with_answers

if TYPE_CHECKING:
    from calib.samples.batch import Batch

DETAILS = (
    *("position", "quaternion", "distance", "turned"),
    *("expected_error", "model_error"),
)
"""Quantities of an answer besides its joints, in the order in which they are printed."""


@dataclass(frozen=True, eq=False)
class InverseOptions:
    """Which answers of an inverse query are wanted."""

    readout: str | None
    all_branches: bool
    keep_orientation: bool  # that which the tool has at `near`
    free: str | None  # axis of the tool about which it may turn
    near: Array | None = None  # (dof,) or (n, dof) [rad or m]
    orientation: Array | None = None  # (4,) or (n, 4), quaternion

    def in_space(self, query: Query) -> bool:
        """Whether a pose is looked for, or a position in the base frame."""
        return (
            query.frame == "base"
            or self.orientation is not None
            or self.keep_orientation
        )


def orientation_of(
    quaternion: Sequence[float] | None,
    rpy: Sequence[float] | None,
    degrees: bool,
) -> Array | None:
    """Return the orientation (4,) that was typed, None where none was."""
    if quaternion is not None:
        return np.array(quaternion) / math.hypot(*quaternion)
    if rpy is None:
        return None
    from calib.samples.roles import from_angles

    angles = np.radians([rpy]) if degrees else np.array([rpy])
    return np.asarray(from_angles(angles)[0])


def answer_one(
    query: Query,
    options: InverseOptions,
    typed: Sequence[float],
    height: float | None,
) -> Outcome:
    """Answer one question, which may be a pixel on a plane of that height [m]."""
    joints = query.joints
    x, document = _question(query, options, typed, height)
    # in space all branches are looked for, so that the nearest is found
    every = options.all_branches or options.in_space(query)
    answer = _answer(query, x[None], replace(options, all_branches=every))
    if not options.all_branches:
        answer = answer.rows(slice(1))
    reachable = bool(answer.reachable.any())
    solutions: list[dict[str, object]] = [
        {"joints": by_name(joints.names, q)} for q in answer.q.tolist()
    ]
    for name in DETAILS:
        values = getattr(answer, name)
        if values is not None:
            for solution, value in zip(solutions, values, strict=True):
                solution[name] = value
    document |= {"reachable": reachable, "solutions": solutions}
    if query.frame == "base" and not Space.of(query.model).sees(x).all():
        note("the camera's picture does not show the target")
    document |= query.explain()
    shown = by_name(query.axes, answer.position.T)
    shown |= _numbers(answer, options, query.bounds)
    if reachable:
        alone = [" ".join(joints.cells(row)) for row in answer.q.tolist()]
        return Outcome(document, [query.table(answer.q, shown)], result=alone)
    missed = "nearest attainable point"
    distance = query.positions.words(float(answer.distance.min()))
    if options.orientation is not None:
        missed = "nearest attainable pose"
        distance += f" and {math.degrees(shown['turned'][0]):.3g} deg"
    note(f"out of reach: the {missed} is {distance} away")
    table = query.table(answer.q, shown, missed)
    return Outcome(document, [table], result=(), code=EXIT_ACT)


def _numbers(
    answer: Answer, options: InverseOptions, bounds: Sequence[str]
) -> dict[str, Array]:
    """Return how far answers are off, and their bounds, by column of a table."""
    names = ["distance", *bounds]
    if options.orientation is not None:
        names.insert(1, "turned")
    return {name: getattr(answer, name) for name in names}


def _question(
    query: Query,
    options: InverseOptions,
    typed: Sequence[float],
    height: float | None,
) -> tuple[Array, dict[str, object]]:
    """Return the target (m,) of what was typed, and the question as JSON."""
    x = _target(query, typed, height)
    document: dict[str, object] = {"target": x}
    if options.in_space(query):
        document["frame"] = query.frame
    if height is not None:
        x = _on_plane(query, x, height)
        document["on_plane"] = {"z": height, "position": x, "unit": "m"}
    if options.orientation is not None:
        document["quaternion"] = options.orientation
    return x, document


def _target(
    query: Query, typed: Sequence[float], height: float | None
) -> Array:
    """Return what was typed, a position in the model's unit or a pixel of a plane."""
    axes = query.axes if height is None else ("u", "v")
    if len(typed) != len(axes):
        expected = f"expected {len(axes)}, one each for {', '.join(axes)}"
        if len(typed) == 3 and query.model.about.unit == "px":
            expected += "; --in base takes x, y, z of the robot's root frame"
        raise BadOption(f"coordinates: {len(typed)}, {expected}")
    factor = query.positions.to_typed if height is None else 1.0
    return np.array(typed) / factor


def _on_plane(query: Query, pixel: Array, height: float) -> Array:
    """Return the point (3,) [m] of the base frame that a pixel shows, and report it."""
    x: Array = Space.of(query.model).pixels_on_plane(pixel, height)[0]
    coordinates = ", ".join(f"{1e3 * value:.2f}" for value in x.tolist())
    note(f"the pixel shows ({coordinates}) mm of the base frame")
    return x


def answer_table(query: Query, options: InverseOptions) -> Outcome:
    """Answer a table; columns near_JOINT choose the branch, qx to qw ask for an orientation."""
    names = query.joints.names
    axes = query.axes
    nearby = [f"near_{name}" for name in names]
    # fewer than six joints reach almost no pose that is given: its columns go along unread
    least = 6 if options.free is None else 5
    quaternion = QUATERNION if len(names) >= least and len(axes) == 3 else ()
    batch, valid = query.read(axes, (nearby, quaternion))
    values = batch.values[valid]
    if "qw" in batch.names and quaternion:
        options = replace(
            options, orientation=_columns(batch, values, QUATERNION)
        )
    if nearby[0] in batch.names:
        near = _columns(batch, values, nearby) / query.joints.to_typed
        options = replace(options, near=near)
    answer = _answer(query, values[:, : len(axes)], options)
    # with every branch a target has several answers
    rows = np.flatnonzero(valid)[answer.target]
    q = answer.q * query.joints.to_typed
    q[~answer.reachable] = np.nan
    added: dict[str, ArrayLike] = {**by_name(names, q.T)}
    added |= _numbers(answer, options, BOUNDS)
    added["reachable"] = answer.reachable
    missed = np.unique(rows[~answer.reachable])
    failures = {"out_of_reach": (missed, "out of reach")}
    if not options.all_branches:
        columns = with_answers(batch, added)
        return query.write(batch, columns, failures)
    # rows without numbers keep their place between the answers of the others
    index = np.sort(np.concatenate([rows, np.flatnonzero(~valid)]))
    columns = {**with_answers(batch.take(index), added), "row": index + 1}
    return query.write(batch, columns, failures)


def _columns(batch: Batch, values: Array, names: Sequence[str]) -> Array:
    """Return columns of a table's rows (n, ...) by their names, (n, k)."""
    return values[:, [batch.names.index(name) for name in names]]


def _answer(query: Query, x: Array, options: InverseOptions) -> Answer:
    """Return the answers to targets (n, m), positions or poses."""
    model = query.model
    if not options.in_space(query):
        if options.all_branches:
            return every_branch(model, x)
        return model.solve(x, options.near, options.readout)
    if options.readout is not None:
        raise BadOption(
            "--readout is for positions in the sensor's frame alone"
        )
    if query.frame != "base" and Space.of(model).camera:
        raise QueryError(
            "a pixel alone is no position in space; give --on z=H or --in base"
        )
    from calib.model.poses import solve_poses

    return solve_poses(
        model,
        x,
        options.orientation,
        options.near,
        frame=query.frame,
        every=options.all_branches,
        keep=options.keep_orientation,
        free=options.free,
    )
