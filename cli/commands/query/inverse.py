"""Joint values that bring the tip to a position; exit code 3 if it is out of reach."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument

from ... import options as opt
from ... import parsing
from ...output import NO, Outcome, note
from ...parsing import BadOption

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calib import Model
    from calib.common.arrays import Array
    from calib.samples.tables import Batch

    from ...query import Query

NUMBERS = True


@dataclass(frozen=True, eq=False)
class Search:
    """Which answers are looked for."""

    readout: str | None
    every: bool  # whether all branches are wanted
    keep: bool  # whether the tool shall keep its orientation at `near`
    free: str | None  # axis of the tool about which it may turn
    near: Array | None = None  # (dof,) or (n, dof) [rad or m]
    turn: Array | None = None  # (4,) or (n, 4), orientation that is wanted

    def in_space(self, query: Query) -> bool:
        """Whether a pose is looked for, or a position in the base frame."""
        return query.frame == "base" or self.turn is not None or self.keep


def inverse(
    model: opt.ModelFile,
    target: Annotated[
        list[float] | None,
        Argument(metavar="X Y [Z]", parser=parsing.number, help="A position."),
    ] = None,
    near: Annotated[
        parsing.Numbers | None,
        opt.value(
            "--near Q1,Q2", "The branch nearest to these.", parsing.reals
        ),
    ] = None,
    every: Annotated[
        bool, opt.option("--all", "Answer with every branch.")
    ] = False,
    readout: opt.ReadoutKind = None,
    frame: opt.InFrame = "sensor",
    quaternion: Annotated[
        parsing.Numbers | None,
        opt.value(
            "--quaternion QX,QY,QZ,QW", "Orientation.", parsing.quaternion
        ),
    ] = None,
    rpy: Annotated[
        parsing.Numbers | None,
        opt.value(
            "--rpy R,P,Y", "Roll, pitch, yaw as in a URDF.", parsing.angles
        ),
    ] = None,
    keep: Annotated[
        bool,
        opt.option("--keep-orientation", "Turn the tool little from --near."),
    ] = False,
    free: Annotated[
        Literal["x", "y", "z"] | None,
        opt.option("--free", "Tool's axis that a pose may turn about."),
    ] = None,
    on: Annotated[
        parsing.OfJoint | None,
        opt.value(
            "--on z=H",
            "The pixel X Y lies on this plane [m].",
            parsing.height,
        ),
    ] = None,
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
) -> Outcome:
    import numpy as np

    from ...query import Query

    posed = quaternion is not None or rpy is not None
    for is_wrong, why in (
        (
            every and readout,
            "--all is of the default readout alone: no --readout",
        ),
        (
            input_ and (posed or keep or on),
            "--input has a column for each number: expected no other target",
        ),
        (
            keep and (posed or near is None),
            "--keep-orientation: expected --near beside it alone",
        ),
        (
            free and not (posed or input_),
            "--free: expected --quaternion or --rpy beside it",
        ),
        (
            quaternion and rpy,
            "--quaternion and --rpy are given: expected one of them",
        ),
    ):
        if is_wrong:
            raise BadOption(why)
    frame = "base" if on else frame
    query = Query(model, input_, columns, output, unit, degrees, frame, target)
    anchor = query.within_range("--near", near)
    turn = None
    if quaternion is not None:
        turn = np.array(quaternion) / math.hypot(*quaternion)
    elif rpy is not None:
        from calib.samples.roles import from_angles

        angles = np.radians([rpy]) if degrees else np.array([rpy])
        turn = from_angles(angles)[0]
    nearby = None if anchor is None else np.array(anchor)
    search = Search(readout, every, keep, free, nearby, turn)
    if input_ is not None:
        return _table(query, search)
    return _single(query, search, target or (), None if on is None else on.low)


def _single(
    query: Query, search: Search, typed: Sequence[float], height: float | None
) -> Outcome:
    """Answer one question, which may be a pixel on a plane of that height [m]."""
    from calib.model.space import Space

    joints = query.joints
    posed = search.turn is not None
    in_space = search.in_space(query)
    x = _target(query, typed, height)
    document: dict[str, object] = {"target": x}
    if in_space:
        document["frame"] = query.frame
    if height is not None:
        x = _on_plane(query.model, x, height)
        document["on_plane"] = {"z": height, "position": x, "unit": "m"}
    if posed:
        document["quaternion"] = search.turn
    # in space all branches are looked for, so that the nearest is found
    wide = replace(search, every=search.every or in_space)
    answers = _answers(query, x[None], wide)
    if not search.every:
        answers = {name: column[:1] for name, column in answers.items()}
    q = answers.pop("q")
    del answers["target"]
    reachable = bool(answers.pop("reachable").any())
    document["reachable"] = reachable
    document["solutions"] = [
        {
            "joints": dict(zip(joints.names, one, strict=True)),
            **{name: column[k] for name, column in answers.items()},
        }
        for k, one in enumerate(q.tolist())
    ]
    if in_space:
        axis = None if search.free is None else "xyz".index(search.free)
        ways = Space.of(query.model).free(q[0], posed=posed, axis=axis).tolist()
        free = [dict(zip(joints.names, way, strict=True)) for way in ways[:9]]
        document["free"] = free if reachable else []
    if query.frame == "base" and not Space.of(query.model).sees(x).all():
        note("the camera's picture does not show the target")
    document |= query.meaning
    shown = dict(zip(query.axes, answers["position"].T, strict=True))
    for name in ("distance", *(["turned"] if posed else []), *query.bounds):
        shown[name] = answers[name]
    if reachable:
        alone = [" ".join(joints.cells(row)) for row in q.tolist()]
        return Outcome(document, [query.table(q, shown)], result=alone)
    missed = f"nearest attainable {'pose' if posed else 'point'}"
    away = query.words(float(answers["distance"].min()))
    if posed:
        away += f" and {math.degrees(answers['turned'][0]):.3g} deg"
    note(f"out of reach: the {missed} is {away} away")
    table = query.table(q, shown, missed)
    return Outcome(document, [table], result=(), code=NO)


def _target(
    query: Query, typed: Sequence[float], height: float | None
) -> Array:
    """Return what was typed, a position in the model's unit or a pixel of a plane."""
    import numpy as np

    axes = query.axes if height is None else ("u", "v")
    if len(typed) != len(axes):
        expected = f"expected {len(axes)}, one each for {', '.join(axes)}"
        if len(typed) == 3 and query.model.about.unit == "px":
            expected += "; --in base takes x, y, z of the robot's root frame"
        raise BadOption(f"{len(typed)} coordinates: {expected}")
    return np.array(typed) / (query.typed if height is None else 1.0)


def _on_plane(model: Model, pixel: Array, height: float) -> Array:
    """Return the point (3,) [m] of the base frame that a pixel shows, and say it."""
    from calib.model.space import Space

    x: Array = Space.of(model).pixels_on_plane(pixel, height)[0]
    place = ", ".join(f"{1e3 * value:.2f}" for value in x.tolist())
    note(f"the pixel shows ({place}) mm of the base frame")
    return x


def _table(query: Query, search: Search) -> Outcome:
    """Answer a table; columns near_JOINT choose the branch, qx to qw ask for an orientation."""
    import numpy as np

    from ...query import TURN, beside

    names = query.joints.names
    axes = query.axes
    nearby = [f"near_{name}" for name in names]
    # fewer than six joints reach almost no pose that is given: its columns go along unread
    least = 6 if search.free is None else 5
    turns = TURN if len(names) >= least and len(axes) == 3 else ()
    batch, valid = query.read(axes, (nearby, turns))
    values = batch.values[valid]
    if "qw" in batch.names and turns:
        search = replace(search, turn=_columns(batch, values, TURN))
    if nearby[0] in batch.names:
        near = _columns(batch, values, nearby) / query.joints.typed
        search = replace(search, near=near)
    answers = _answers(query, values[:, : len(axes)], search)
    # with every branch a target has several answers
    rows = np.flatnonzero(valid)[answers.pop("target")]
    reachable = answers["reachable"]
    q = answers.pop("q") * query.joints.typed
    q[~reachable] = np.nan
    added = dict(zip(names, q.T, strict=True))
    for name, column in answers.items():
        is_turn = name == "turned" and search.turn is None
        if column.ndim == 1 and not is_turn:
            added[name] = column
    missed = (np.unique(rows[~reachable]) + 1).tolist()
    failures = {"out_of_reach": (missed, "out of reach")}
    if not search.every:
        return query.answer(batch, beside(batch, valid, added), failures)
    # rows without numbers stand where they stood, between the answers of the others
    index = np.sort(np.concatenate([rows, np.flatnonzero(~valid)]))
    columns = beside(batch.take(index), valid[index], added)
    return query.answer(batch, {**columns, "row": index + 1}, failures)


def _columns(batch: Batch, values: Array, names: Sequence[str]) -> Array:
    """Return columns of a table's rows (n, ...) by their names, (n, k)."""
    return values[:, [batch.names.index(name) for name in names]]


def _answers(query: Query, x: Array, search: Search) -> dict[str, NDArray[Any]]:
    """Return the answers to targets (n, m), by quantity, and the "target" that each is of."""
    import numpy as np

    model = query.model
    near = search.near
    if search.in_space(query):
        return _answers_in_space(query, x, search)
    if not search.every:
        answer = model.solve(x, near, search.readout)._asdict()
        return {"target": np.arange(len(x)), **answer}
    branches = model.solve_all(x)
    counts = [len(answer.q) for answer in branches]
    target = np.repeat(np.arange(len(x)), counts)
    answers: dict[str, NDArray[Any]] = {"target": target}
    for name, *parts in zip(branches[0]._fields, *branches, strict=True):
        answers[name] = np.concatenate(parts)
    if near is None:
        return answers
    scale = model.motor.scale
    wish = np.atleast_2d(near)[target if near.ndim > 1 else [0]]
    gap = scale.difference(scale.to_unit(answers["q"]), scale.to_unit(wish))
    # the nearest first
    order = np.lexsort((np.linalg.norm(gap, axis=1), target))
    return {name: column[order] for name, column in answers.items()}


def _answers_in_space(
    query: Query, x: Array, search: Search
) -> dict[str, NDArray[Any]]:
    """Return the answers to positions (n, 3) of an arm in space, or to poses."""
    from calib.errors import QueryError
    from calib.model.poses import solve_poses
    from calib.model.space import Space

    if search.readout is not None:
        raise BadOption(
            "--readout is for positions in the sensor's frame alone"
        )
    if query.frame != "base" and Space.of(query.model).camera:
        raise QueryError(
            "a pixel alone is no position in space; give --on z=H or --in base"
        )
    return solve_poses(
        query.model,
        x,
        search.turn,
        search.near,
        frame=query.frame,
        every=search.every,
        keep=search.keep,
        free=search.free,
    )._asdict()
