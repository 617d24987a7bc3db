"""The command `calib query inverse`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from ... import options as opt
from ...asking import Asking
from ...output import NO, Outcome, note
from ...parsing import BadOption, height, number, parser, reals

if TYPE_CHECKING:
    from ...answers import Query


_FAR = 10.0  # extents of the workspace: so far off, positions in mm were typed as m


_turn = parser(
    "4 numbers of length 1, qx,qy,qz,qw",
    reals,
    lambda q: len(q) == 4 and abs(math.hypot(*q) - 1.0) <= 0.01,
)


_angles = parser(
    "3 numbers: roll, pitch and yaw", reals, lambda angles: len(angles) == 3
)


CONTEXT_SETTINGS = {"ignore_unknown_options": True}  # -0.1 is a number, not an option


def inverse(
    model: opt.ModelFile,
    target: Annotated[
        list[float] | None,
        Argument(metavar="X Y [Z]", parser=number, help="A position."),
    ] = None,
    near: Annotated[
        Any,
        Option(
            "--near", metavar="Q1,Q2", parser=reals, help="The branch nearest to these."
        ),
    ] = None,
    every: Annotated[bool, Option("--all", help="Answer with every branch.")] = False,
    readout: opt.ReadoutKind = None,
    frame: opt.InFrame = "sensor",
    quaternion: Annotated[
        Any,
        Option(
            "--quaternion", metavar="QX,QY,QZ,QW", parser=_turn, help="Orientation."
        ),
    ] = None,
    rpy: Annotated[
        Any,
        Option(
            "--rpy",
            metavar="R,P,Y",
            parser=_angles,
            help="Roll, pitch, yaw as in a URDF.",
        ),
    ] = None,
    keep: Annotated[
        bool, Option("--keep-orientation", help="Turn the tool little from --near.")
    ] = False,
    free: Annotated[
        Literal["x", "y", "z"] | None,
        Option("--free", help="Of a pose: the tool may turn about."),
    ] = None,
    on: Annotated[
        Any,
        Option(
            "--on",
            metavar="z=H",
            parser=height,
            help="The pixel X Y lies on this plane [m].",
        ),
    ] = None,
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Joint values that bring the tip to a position; exit code 3 if it is out of reach."""
    asking = Asking(
        input_=input_, columns=columns, output=output, unit=unit, degrees=degrees
    )
    import numpy as np

    from ...answers import Query

    turned = quaternion is not None or rpy is not None
    other = turned or keep or on is not None
    for wrong, told in (
        (
            every and readout,
            "--all answers by the default readout: expected no --readout",
        ),
        (
            other and asking.input_,
            "--input has a column for each number: expected no other target",
        ),
        (
            keep and (turned or near is None),
            "--keep-orientation: expected --near beside it alone",
        ),
        (
            free and not (turned or asking.input_),
            "--free: expected --quaternion or --rpy beside it",
        ),
        (quaternion and rpy, "--quaternion and --rpy are given: expected one of them"),
    ):
        if wrong:
            raise BadOption(told)
    query = Query(model, asking, "base" if on is not None else frame, target or ())
    anchor = query.joints.one_each("--near", near)
    if anchor is not None and (beyond := query.joints.beyond(query.model, anchor)):
        raise BadOption(f"--near {beyond}")
    how = {
        "near": anchor,
        "readout": readout,
        "every": every,
        "keep": keep,
        "free": free,
    }
    if asking.input_ is not None:
        return _batch(query, query.frame == "base" or keep, how)
    typed = target or []
    wanted = query.axes if on is None else ("u", "v")
    if len(typed) != len(wanted):
        expected = f"expected {len(wanted)}, one each for {', '.join(wanted)}"
        raise BadOption(f"{len(typed)} coordinates: {expected}")
    x = typed if on is not None else [value / query.positions.typed for value in typed]
    document: dict[str, Any] = {"target": x}
    in_space = query.frame == "base" or turned or keep
    if in_space:
        document["frame"] = query.frame
    if on is not None:
        from calib.model.space import Space

        x = Space.of(query.model).pixels_on_plane(typed, on[1])[0].tolist()
        place = ", ".join(f"{1e3 * value:.2f}" for value in x)
        note(f"the pixel shows ({place}) mm of the base frame")
        document["on_plane"] = {"z": on[1], "position": x, "unit": "m"}
    turn = None
    if quaternion is not None:  # typed numbers are rounded
        turn = np.array(quaternion) / math.hypot(*quaternion)
    elif rpy is not None:
        from calib.samples.roles import from_angles

        turn = from_angles(
            np.array([rpy]) * (math.radians(1.0) if asking.degrees else 1.0)
        )[0]
    if turn is not None:
        document["quaternion"] = turn
    # in space all branches are looked for, so that the nearest is found
    found = _solve(query, [x], turn, in_space, {**how, "every": every or in_space})
    whose = f" of readout '{readout}'" * bool(readout)
    axis = None if free is None else "xyz".index(free)
    return _single(query, x, found, document, every, whose, axis)


def _solve(
    query: Query, x: Any, turn: Any, in_space: bool, how: dict[str, Any]
) -> dict[str, Any]:
    """Return what is told of each answer to targets (n, m), by name, and the "target" it is of."""
    import numpy as np

    model = query.model
    near = how["near"]
    readout = how["readout"]
    every = how["every"]
    if in_space:
        from calib.errors import QueryError
        from calib.model.poses import solve_poses
        from calib.model.space import Space

        from ...answers import up_to_scale

        if readout is not None:
            raise BadOption("--readout is for positions in the sensor's frame alone")
        if query.frame != "base" and Space.of(model).camera:
            raise QueryError(
                "a pixel alone is no position in space; give --on z=H or --in base"
            )
        ways = {"every": every, "keep": how["keep"], "free": how["free"]}
        found = solve_poses(model, x, turn, near, frame=query.frame, **ways)._asdict()
        return found | (up_to_scale(model, found["q"]) if query.frame == "base" else {})
    if not every:
        return {"target": np.arange(len(x)), **model.solve(x, near, readout)._asdict()}
    each = model.solve_all(x)
    target = np.repeat(np.arange(len(each)), [len(answer.q) for answer in each])
    parts = zip(each[0]._fields, zip(*each, strict=True), strict=True)
    found = {"target": target} | {name: np.concatenate(part) for name, part in parts}
    if near is not None:  # those near the anchor first
        scale = model.motor.scale
        at = np.atleast_2d(near)[target if np.ndim(near) > 1 else [0]]
        gap = scale.difference(scale.to_unit(found["q"]), scale.to_unit(at))
        order = np.lexsort((np.linalg.norm(gap, axis=1), target))
        found = {name: part[order] for name, part in found.items()}
    return found


def _single(
    query: Query,
    x: list[float],
    found: dict[str, Any],
    document: dict[str, Any],
    every: bool,
    whose: str,
    axis: int | None,
) -> Outcome:
    """Tell the answers to one question; what `document` has begins what is told of it."""
    model = query.model
    joints = query.joints
    posed = "quaternion" in document
    del found["target"]
    q = found.pop("q")
    reachable = bool(found.pop("reachable").any())
    rows = zip(q, *found.values(), strict=True)
    solutions = [
        query.document(one, **dict(zip(found, row, strict=True))) for one, *row in rows
    ]
    solutions = solutions if every else solutions[:1]
    document |= {"reachable": reachable, "solutions": solutions}
    if "frame" in document:
        from calib.model.space import Space

        from ...answers import say_size

        space = Space.of(model)
        say = query.frame == "base"
        free: Any = space.free(q[0], posed=posed, axis=axis)[:9] if reachable else []
        document["free"] = [dict(zip(joints.names, row, strict=True)) for row in free]
        if say:
            say_size(solutions[0])
        if say and not space.sees(x).all():
            note("the camera's picture does not show the target")
    document |= query.meaning
    shown = ["distance", *(["turned"] if posed else []), *query.bounds]
    missed = f"nearest attainable {'pose' if posed else 'point'}"
    table = query.table(solutions, shown, "" if reachable else missed)
    if reachable:
        alone = [
            " ".join(joints.cells(list(each["joints"].values()))) for each in solutions
        ]
        return Outcome(document, [table], result=alone)
    away = float(found["distance"].min())
    hint = ""
    if query.positions.shown == "mm" and away > _FAR * model.sensory.scale.span.max():
        hint = "; positions are typed in m, or give --unit mm"
    told = query.positions.said(away)
    if posed:
        told += f" and {math.degrees(float(found['turned'][0])):.3g} deg"
    note(f"out of reach{whose}: the {missed} is {told} away{hint}")
    return Outcome(document, [table], result=(), code=NO)


def _batch(query: Query, in_space: bool, how: dict[str, Any]) -> Outcome:
    """Answer a table; columns near_JOINT choose the branch, qx to qw ask for an orientation."""
    import numpy as np

    from ...answers import TURN, beside

    joints = query.joints
    axes = query.axes
    nearby = [f"near_{name}" for name in joints.names]
    # fewer than six joints reach almost no pose that is given: its columns go along unread
    least = 6 if how["free"] is None else 5
    turns = TURN if len(joints.names) >= least and len(axes) == 3 else ()
    batch, valid = query.read(axes, (nearby, turns))
    given = dict(zip(batch.names, batch.values[valid].T, strict=True))
    posed = bool(turns) and "qw" in given
    turn = np.stack([given[name] for name in TURN], axis=1) if posed else None
    if nearby[0] in given:
        near = np.stack([given[name] for name in nearby], axis=1) / joints.typed
        how = {**how, "near": near}
    found = _solve(
        query, batch.values[valid, : len(axes)], turn, in_space or posed, how
    )
    # with every branch a target has several answers
    rows = np.flatnonzero(valid)[found.pop("target")]
    reachable = found["reachable"]
    q = found.pop("q")
    q = np.where(reachable[:, None], q * joints.typed, np.nan)
    for name in ("position", "quaternion", *([] if posed else ["turned"])):
        found.pop(name, None)
    # rows without numbers stand where they stood, between the answers of the others
    index = np.sort(np.concatenate([rows, np.flatnonzero(~valid)]))
    added = dict(zip(joints.names, q.T, strict=True)) | found
    every = how["every"]
    columns = beside(batch.take(index) if every else batch, valid[index], added)
    columns |= {"row": index + 1} if every else {}
    missed = np.unique(rows[~reachable] + 1).tolist()
    failures = {"out_of_reach": (missed, "out of reach")}
    return query.answer(batch, columns, failures)
