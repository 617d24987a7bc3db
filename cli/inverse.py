"""Inverse queries: joint values for one position or pose, or for a table of them.

It needs NumPy: the command imports it when it runs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.common.arrays import Array
from calib.common.wording import by_name
from calib.errors import QueryError
from calib.model.answers import Answer
from calib.model.poses import solve_poses
from calib.model.space import Space
from calib.samples.batch import Batch
from calib.samples.roles import QUATERNION, from_angles

from .output import NO, Outcome, note
from .parsing import BadOption
from .query import Query, with_answers

Answers = dict[str, NDArray[Any]]
"""Quantities of all answers by name, and the index of the "target" that each is of."""

COLUMNS = (
    *("target", "q", "position", "quaternion", "distance", "turned"),
    *("expected_error", "model_error", "reachable"),
)
"""Quantities of an answer, in the order in which they are printed."""


@dataclass(frozen=True, eq=False)
class Search:
    """Which answers are looked for."""

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
        return np.asarray(np.array(quaternion) / math.hypot(*quaternion))
    if rpy is None:
        return None
    angles = np.radians([rpy]) if degrees else np.array([rpy])
    return np.asarray(from_angles(angles)[0])


def answer_one(
    query: Query, search: Search, typed: Sequence[float], height: float | None
) -> Outcome:
    """Answer one question, which may be a pixel on a plane of that height [m]."""
    joints = query.joints
    is_pose = search.orientation is not None
    x, document = _question(query, search, typed, height)
    # in space all branches are looked for, so that the nearest is found
    every = search.all_branches or search.in_space(query)
    answers = _answers(query, x[None], replace(search, all_branches=every))
    if not search.all_branches:
        answers = {name: column[:1] for name, column in answers.items()}
    q = answers.pop("q")
    del answers["target"]
    reachable = bool(answers.pop("reachable").any())
    document["reachable"] = reachable
    document["solutions"] = [
        {
            "joints": by_name(joints.names, values),
            **{name: column[k] for name, column in answers.items()},
        }
        for k, values in enumerate(q.tolist())
    ]
    if query.frame == "base" and not Space.of(query.model).sees(x).all():
        note("the camera's picture does not show the target")
    document |= query.meaning
    shown = by_name(query.axes, answers["position"].T)
    shown["distance"] = answers["distance"]
    if is_pose:
        shown["turned"] = answers["turned"]
    for name in query.bounds:
        shown[name] = answers[name]
    if reachable:
        alone = [" ".join(joints.cells(row)) for row in q.tolist()]
        return Outcome(document, [query.table(q, shown)], result=alone)
    missed = f"nearest attainable {'pose' if is_pose else 'point'}"
    distance = query.positions.words(float(answers["distance"].min()))
    if is_pose:
        distance += f" and {math.degrees(answers['turned'][0]):.3g} deg"
    note(f"out of reach: the {missed} is {distance} away")
    table = query.table(q, shown, missed)
    return Outcome(document, [table], result=(), code=NO)


def _question(
    query: Query, search: Search, typed: Sequence[float], height: float | None
) -> tuple[Array, dict[str, object]]:
    """Return the target (m,) of what was typed, and the question as JSON."""
    x = _target(query, typed, height)
    document: dict[str, object] = {"target": x}
    if search.in_space(query):
        document["frame"] = query.frame
    if height is not None:
        x = _on_plane(query, x, height)
        document["on_plane"] = {"z": height, "position": x, "unit": "m"}
    if search.orientation is not None:
        document["quaternion"] = search.orientation
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
        raise BadOption(f"{len(typed)} coordinates: {expected}")
    factor = query.positions.to_typed if height is None else 1.0
    return np.array(typed) / factor


def _on_plane(query: Query, pixel: Array, height: float) -> Array:
    """Return the point (3,) [m] of the base frame that a pixel shows, and say it."""
    x: Array = Space.of(query.model).pixels_on_plane(pixel, height)[0]
    coordinates = ", ".join(f"{1e3 * value:.2f}" for value in x.tolist())
    note(f"the pixel shows ({coordinates}) mm of the base frame")
    return x


def answer_table(query: Query, search: Search) -> Outcome:
    """Answer a table; columns near_JOINT choose the branch, qx to qw ask for an orientation."""
    names = query.joints.names
    axes = query.axes
    nearby = [f"near_{name}" for name in names]
    # fewer than six joints reach almost no pose that is given: its columns go along unread
    least = 6 if search.free is None else 5
    quaternion = QUATERNION if len(names) >= least and len(axes) == 3 else ()
    batch, valid = query.read(axes, (nearby, quaternion))
    values = batch.values[valid]
    if "qw" in batch.names and quaternion:
        search = replace(
            search, orientation=_columns(batch, values, QUATERNION)
        )
    if nearby[0] in batch.names:
        near = _columns(batch, values, nearby) / query.joints.to_typed
        search = replace(search, near=near)
    answers = _answers(query, values[:, : len(axes)], search)
    # with every branch a target has several answers
    rows = np.flatnonzero(valid)[answers.pop("target")]
    reachable = answers["reachable"]
    q = answers.pop("q") * query.joints.to_typed
    q[~reachable] = np.nan
    added = by_name(names, q.T)
    for name, column in answers.items():
        is_wanted = name != "turned" or search.orientation is not None
        if column.ndim == 1 and is_wanted:
            added[name] = column
    missed = np.unique(rows[~reachable])
    failures = {"out_of_reach": (missed, "out of reach")}
    if not search.all_branches:
        columns = with_answers(batch, added)
        return query.write(batch, columns, failures)
    # rows without numbers stand where they stood, between the answers of the others
    index = np.sort(np.concatenate([rows, np.flatnonzero(~valid)]))
    columns = {**with_answers(batch.take(index), added), "row": index + 1}
    return query.write(batch, columns, failures)


def _columns(batch: Batch, values: Array, names: Sequence[str]) -> Array:
    """Return columns of a table's rows (n, ...) by their names, (n, k)."""
    return values[:, [batch.names.index(name) for name in names]]


def _answers(query: Query, x: Array, search: Search) -> Answers:
    """Return the answers to targets (n, m), by quantity, and the "target" that each is of."""
    model = query.model
    if search.in_space(query):
        return _answers_in_space(query, x, search)
    if not search.all_branches:
        return _columns_of([model.solve(x, search.near, search.readout)])
    return _columns_of(model.solve_all(x))


def _columns_of(answers: Sequence[Answer]) -> Answers:
    """Return the columns of answers, one after another, in the order of tables."""
    columns: Answers = {}
    for name in COLUMNS:
        parts = [getattr(answer, name) for answer in answers]
        if parts[0] is not None:
            columns[name] = np.concatenate(parts)
    return columns


def _answers_in_space(query: Query, x: Array, search: Search) -> Answers:
    """Return the answers to positions (n, 3) of an arm in space, or to poses."""
    if search.readout is not None:
        raise BadOption(
            "--readout is for positions in the sensor's frame alone"
        )
    if query.frame != "base" and Space.of(query.model).camera:
        raise QueryError(
            "a pixel alone is no position in space; give --on z=H or --in base"
        )
    answer = solve_poses(
        query.model,
        x,
        search.orientation,
        search.near,
        frame=query.frame,
        every=search.all_branches,
        keep=search.keep_orientation,
        free=search.free,
    )
    return _columns_of([answer])
