"""Joint values that bring the tip to a position; exit code 3 if it is out of reach."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from typer import Argument

from ... import options as opt
from ... import parsing
from ...output import NO, Outcome, note
from ...parsing import BadOption

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calib import Model
    from calib.common.arrays import Array

    from ...query import Query

NUMBERS = True
_FAR = 10.0  # extents of the workspace: so far off, positions in mm were typed as m


class Search(NamedTuple):
    """Which answers are looked for."""

    near: Array | None  # (dof,) or (n, dof) [rad or m]
    turn: Array | None  # (4,) or (n, 4), orientation that is wanted
    readout: str | None
    every: bool  # whether all branches are wanted
    keep: bool  # whether the tool shall keep its orientation at `near`
    free: str | None  # axis of the tool about which it may turn


def inverse(
    model: opt.ModelFile,
    target: Annotated[
        list[float] | None,
        Argument(metavar="X Y [Z]", parser=parsing.number, help="A position."),
    ] = None,
    near: Annotated[
        parsing.Numbers | None,
        opt.value(
            "--near", "Q1,Q2", "The branch nearest to these.", parsing.reals
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
            "--quaternion", "QX,QY,QZ,QW", "Orientation.", parsing.quaternion
        ),
    ] = None,
    rpy: Annotated[
        parsing.Numbers | None,
        opt.value(
            "--rpy", "R,P,Y", "Roll, pitch, yaw as in a URDF.", parsing.angles
        ),
    ] = None,
    keep: Annotated[
        bool,
        opt.option("--keep-orientation", "Turn the tool little from --near."),
    ] = False,
    free: Annotated[
        Literal["x", "y", "z"] | None,
        opt.option("--free", "Of a pose: the tool may turn about."),
    ] = None,
    on: Annotated[
        parsing.OfJoint | None,
        opt.value(
            "--on",
            "z=H",
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
    if every and readout:
        raise BadOption(
            "--all answers by the default readout: expected no --readout"
        )
    if input_ and (posed or keep or on):
        raise BadOption(
            "--input has a column for each number: expected no other target"
        )
    if keep and (posed or near is None):
        raise BadOption("--keep-orientation: expected --near beside it alone")
    if free and not (posed or input_):
        raise BadOption("--free: expected --quaternion or --rpy beside it")
    if quaternion and rpy:
        raise BadOption(
            "--quaternion and --rpy are given: expected one of them"
        )
    query = Query(
        model,
        input_,
        columns,
        output,
        unit,
        degrees,
        "base" if on else frame,
        target,
    )
    anchor = query.joints.one_each("--near", near)
    if anchor is not None:
        beyond = query.joints.beyond(query.model, anchor)
        if beyond is not None:
            raise BadOption(f"--near {beyond}")
    turn = None
    if quaternion is not None:
        turn = np.array(quaternion) / math.hypot(*quaternion)
    elif rpy is not None:
        from calib.samples.roles import from_angles

        angles = np.array([rpy])
        turn = from_angles(np.radians(angles) if degrees else angles)[0]
    search = Search(
        None if anchor is None else np.array(anchor),
        turn,
        readout,
        every,
        keep,
        free,
    )
    if input_ is not None:
        return _table(query, search)
    return _single(query, search, target or (), None if on is None else on.low)


def _single(
    query: Query, search: Search, typed: Sequence[float], height: float | None
) -> Outcome:
    """Answer one question, which may be a pixel on a plane of that height [m]."""
    from calib.model.space import Space

    from ...query import note_size

    joints = query.joints
    base = query.frame == "base"
    posed = search.turn is not None
    in_space = base or posed or search.keep
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
    wide = search._replace(every=search.every or in_space)
    answers = _answers(query, x[None], wide)
    count = len(answers["q"]) if search.every else 1
    q = answers.pop("q")[:count]
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
    if base:
        note_size(answers)
        if not Space.of(query.model).sees(x).all():
            note("the camera's picture does not show the target")
    document |= query.meaning
    shown = ["distance", *(["turned"] if posed else []), *query.bounds]
    quantities = {name: answers[name][:count] for name in shown}
    missed = (
        ""
        if reachable
        else f"nearest attainable {'pose' if posed else 'point'}"
    )
    table = query.table(q, answers["position"][:count], quantities, missed)
    if reachable:
        alone = [" ".join(joints.cells(row)) for row in q.tolist()]
        return Outcome(document, [table], result=alone)
    readout = f" of readout '{search.readout}'" if search.readout else ""
    away = _away(query, answers, posed)
    note(f"out of reach{readout}: the {missed} is {away}")
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


def _away(query: Query, answers: dict[str, NDArray[Any]], posed: bool) -> str:
    """Say how far the nearest answer is from what was asked."""
    distance = float(answers["distance"].min())
    words = query.words(distance)
    if posed:
        words += f" and {math.degrees(float(answers['turned'][0])):.3g} deg"
    extent = float(query.model.sensory.scale.span.max())
    if query.shown == "mm" and distance > _FAR * extent:
        return f"{words} away; positions are typed in m, or give --unit mm"
    return f"{words} away"


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
    by_name = dict(zip(batch.names, batch.values[valid].T, strict=True))
    posed = bool(turns) and "qw" in by_name
    if posed:
        turn = np.stack([by_name[name] for name in TURN], axis=1)
        search = search._replace(turn=turn)
    if nearby[0] in by_name:
        near = np.stack([by_name[name] for name in nearby], axis=1)
        search = search._replace(near=near / query.joints.typed)
    answers = _answers(query, batch.values[valid, : len(axes)], search)
    # with every branch a target has several answers
    rows = np.flatnonzero(valid)[answers.pop("target")]
    reachable = answers["reachable"]
    q = answers.pop("q") * query.joints.typed
    q[~reachable] = np.nan
    for name in ("position", "quaternion"):
        answers.pop(name, None)
    if not posed:
        answers.pop("turned", None)
    added = {**dict(zip(names, q.T, strict=True)), **answers}
    missed = (np.unique(rows[~reachable]) + 1).tolist()
    failures = {"out_of_reach": (missed, "out of reach")}
    if not search.every:
        return query.answer(batch, beside(batch, valid, added), failures)
    # rows without numbers stand where they stood, between the answers of the others
    index = np.sort(np.concatenate([rows, np.flatnonzero(~valid)]))
    columns = beside(batch.take(index), valid[index], added)
    return query.answer(batch, {**columns, "row": index + 1}, failures)


def _answers(query: Query, x: Array, search: Search) -> dict[str, NDArray[Any]]:
    """Return the answers to targets (n, m), by quantity, and the "target" that each is of."""
    import numpy as np

    model = query.model
    near = search.near
    if query.frame == "base" or search.turn is not None or search.keep:
        return _answers_in_space(query, x, search)
    if not search.every:
        answer = model.solve(x, near, search.readout)._asdict()
        return {"target": np.arange(len(x)), **answer}
    branches = model.solve_all(x)
    target = np.repeat(
        np.arange(len(x)), [len(answer.q) for answer in branches]
    )
    answers: dict[str, NDArray[Any]] = {"target": target}
    for name, *parts in zip(branches[0]._fields, *branches, strict=True):
        answers[name] = np.concatenate(parts)
    if near is None:
        return answers
    scale = model.motor.scale
    wish = np.atleast_2d(near)[target if near.ndim > 1 else [0]]
    gap = scale.difference(scale.to_unit(answers["q"]), scale.to_unit(wish))
    order = np.lexsort(
        (np.linalg.norm(gap, axis=1), target)
    )  # the nearest first
    return {name: column[order] for name, column in answers.items()}


def _answers_in_space(
    query: Query, x: Array, search: Search
) -> dict[str, NDArray[Any]]:
    """Return the answers to positions (n, 3) of an arm in space, or to poses."""
    from calib.errors import QueryError
    from calib.model.poses import solve_poses
    from calib.model.space import Space

    from ...query import up_to_scale

    if search.readout is not None:
        raise BadOption(
            "--readout is for positions in the sensor's frame alone"
        )
    if query.frame != "base" and Space.of(query.model).camera:
        raise QueryError(
            "a pixel alone is no position in space; give --on z=H or --in base"
        )
    answers = solve_poses(
        query.model,
        x,
        search.turn,
        search.near,
        frame=query.frame,
        every=search.every,
        keep=search.keep,
        free=search.free,
    )._asdict()
    if query.frame == "base":
        answers |= up_to_scale(query.model, answers["q"])
    return answers
