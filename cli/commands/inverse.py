"""The command `calib query inverse`: joint values for positions, or for poses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from .. import options as opt
from ..options import option
from ..output import NO, Outcome, note
from ..parsing import BadOption, any_number, height, reader, reals

if TYPE_CHECKING:
    from ..answers import Query

_TOGETHER = 0.05  # of the largest share: joints that move less are not named
_FAR = 10.0  # extents of the workspace: so far off, positions in mm were typed as m
_quaternion = reader(
    "4 numbers of length 1, qx,qy,qz,qw",
    reals,
    lambda q: len(q) == 4 and abs(math.hypot(*q) - 1.0) <= 0.01,
)
_angles = reader("3 numbers: roll, pitch and yaw", reals, lambda angles: len(angles) == 3)


def inverse(
    model: opt.ModelFile,
    target: Annotated[
        list[float] | None,
        Argument(
            metavar="X Y [Z]", parser=any_number, help="Position [m, sensor's unit or --unit]."
        ),
    ] = None,
    *,
    near: Annotated[Any, option("--near Q1,Q2", "The branch nearest to these.", reals)] = None,
    every: Annotated[bool, Option("--all", help="Answer with every branch.")] = False,
    readout: opt.ReadoutKind = None,
    frame: opt.InFrame = "sensor",
    quaternion: Annotated[
        Any, option("--quaternion QX,QY,QZ,QW", "The orientation wanted, in space.", _quaternion)
    ] = None,
    rpy: Annotated[Any, option("--rpy R,P,Y", "Roll, pitch, yaw as in a URDF.", _angles)] = None,
    keep: Annotated[
        bool, Option("--keep-orientation", help="Turn the tool little from --near.")
    ] = False,
    on: Annotated[Any, option("--on z=H", "The pixel X Y lies on this plane [m].", height)] = None,
    asking: opt.Asking,
) -> Outcome:
    """Joint values that bring the tip to a position; exit code 3 if it is out of reach."""
    import numpy as np

    from ..answers import Query

    turned = quaternion is not None or rpy is not None
    other = turned or keep or on is not None
    for wrong, told in (
        (every and readout, "--all answers by the default readout: expected no --readout"),
        (other and asking.input_, "--input has a column for each number: expected no other target"),
        (keep and (turned or near is None), "--keep-orientation: expected --near beside it alone"),
        (quaternion and rpy, "--quaternion and --rpy are given: expected one of them"),
    ):
        if wrong:
            raise BadOption(told)
    query = Query(model, asking, "base" if on is not None else frame, target or ())
    anchor = query.joints.one_each("--near", near)
    if anchor is not None and (beyond := query.joints.beyond(query.model, anchor)):
        raise BadOption(f"--near {beyond}")
    in_space = query.frame == "base" or turned or keep
    how = {"readout": readout, "every": every, "keep": keep}
    if asking.input_ is not None:
        return _batch(query, anchor, in_space, how)
    typed, wanted = target or [], query.axes if on is None else ("u", "v")
    if len(typed) != len(wanted):
        expected = f"expected {len(wanted)}, one each for {', '.join(wanted)}"
        raise BadOption(f"{len(typed)} coordinates: {expected}")
    x = typed if on is not None else [value / query.positions.typed for value in typed]
    document: dict[str, Any] = {"target": x}
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

        turn = from_angles(np.array([rpy]) * (math.radians(1.0) if asking.degrees else 1.0))[0]
    if turn is not None:
        document["quaternion"] = turn
    return _single(query, x, turn, anchor, in_space, how, document)


def _solve(
    query: Query, x: Any, turn: Any, near: Any, in_space: bool, how: dict[str, Any]
) -> dict[str, Any]:
    """Return what is told of each answer to targets (n, m), by name, and the "target" it is of."""
    import numpy as np

    model, readout, every = query.model, how["readout"], how["every"]
    if in_space:
        from calib.errors import QueryError
        from calib.model.poses import solve_poses
        from calib.model.space import Space

        from ..answers import up_to_scale

        if readout is not None:
            raise BadOption("--readout is for positions in the sensor's frame alone")
        if query.frame != "base" and Space.of(model).camera:
            raise QueryError("a pixel alone is no position in space; give --on z=H or --in base")
        ways = {"every": every, "keep": how["keep"]}
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
    turn: Any,
    near: Any,
    in_space: bool,
    how: dict[str, Any],
    document: dict[str, Any],
) -> Outcome:
    """Answer one question; what `document` has begins what is told of it."""
    from ..answers import say_size

    model, joints, posed = query.model, query.joints, turn is not None
    every, readout = how["every"], how["readout"]
    # of a pose all branches are looked for, so that the nearest is found
    found = _solve(query, [x], turn, near, in_space, {**how, "every": every or in_space})
    del found["target"]
    q, reachable = found.pop("q"), bool(found.pop("reachable").any())
    rows = zip(q, *found.values(), strict=True)
    solutions = [query.document(one, **dict(zip(found, row, strict=True))) for one, *row in rows]
    solutions = solutions if every else solutions[:1]
    document |= {"reachable": reachable, "solutions": solutions}
    if in_space or (reachable and model.body is not None and len(model.axes) == 3):
        free = _free(query, q[0], posed, near, in_space) if reachable else []
        if in_space:
            document["free"] = [dict(zip(joints.names, row, strict=True)) for row in free]
    document |= query.meaning
    if query.frame == "base":
        from calib.model.space import Space

        say_size(solutions[0])
        if not Space.of(model).sees(x).all():
            note("the camera's picture does not show the target")
    other = readout is not None and readout != model.default_readout
    missed = f"nearest attainable {'pose' if posed else 'point'}"
    missed = f"the answer of readout '{readout}'" if other else missed
    shown = ["distance", *(["turned"] if posed else []), *query.bounds]
    table = query.table(solutions, shown, "" if reachable or posed else missed)
    if reachable:
        alone = [" ".join(joints.cells(list(each["joints"].values()))) for each in solutions]
        return Outcome(document, [table], result=alone)
    away, hint = float(found["distance"].min()), ""
    if query.positions.shown == "mm" and away > _FAR * model.sensory.scale.span.max():
        hint = "; positions are typed in m, or give --unit mm"
    told = query.positions.said(away)
    if posed:
        told += f" and {math.degrees(float(found['turned'][0])):.3g} deg"
        few = "; so few joints reach few poses, ask for a position alone"
        hint = few if len(joints.names) < 6 else hint
    # a coarser readout can miss a target that the arm reaches
    note(f"{'missed:' if other else 'out of reach: the'} {missed} is {told} away{hint}")
    return Outcome(document, [table], result=(), code=NO)


def _free(query: Query, q: Any, posed: bool, near: Any, in_space: bool) -> Any:
    """Tell directions (k, dof) of the joints that leave the answer q (dof,) where it is."""
    import numpy as np

    from calib.inverse.solver import free_directions
    from calib.model.space import Space

    model, names, told = query.model, query.joints.names, []
    if in_space:
        found = Space.of(model).free(q, 6 if posed else 3)[:9]
    else:
        scale = model.motor.scale
        # the slope by joints: u = (q - lower) / span, so dx/dq = (dx/du) / span
        found = free_directions(
            model.predictor.value_and_slope(scale.to_unit(q[None]))[1][0] / scale.span
        )
    for row in found:
        # each direction is scaled so that one joint moves by 1: it names the direction
        own = int(np.argmin(np.abs(row - 1.0)))
        order = [k for k in np.argsort(-np.abs(row)) if abs(row[k]) > _TOGETHER and k != own]
        others = ", ".join(f"{names[k]} {row[k]:+.2f}" for k in order)
        told.append(f"{names[own]} with {others}" if others else f"{names[own]} alone")
    if told:
        nearest = "the middle of the ranges, --near chooses another" if near is None else "--near"
        note(f"free: {'; '.join(told)}; the answer is the one nearest to {nearest}")
    return found


def _batch(query: Query, near: Any, in_space: bool, how: dict[str, Any]) -> Outcome:
    """Answer a table; columns near_JOINT choose the branch, qx to qw ask for an orientation."""
    import numpy as np

    from ..answers import TURN, over_all_rows

    joints, axes = query.joints, query.axes
    beside = [f"near_{name}" for name in joints.names]
    # fewer than six joints reach almost no pose that is given: its columns go along unread
    turns = TURN if len(joints.names) >= 6 and len(axes) == 3 else ()
    batch = query.read(axes, (beside, turns))
    posed = bool(turns) and "qw" in batch.names
    n = len(batch.values)
    valid: Any = np.isfinite(batch.values).all(axis=1)
    given = dict(zip(batch.names, batch.values[valid].T, strict=True))
    turn = np.stack([given[name] for name in TURN], axis=1) if posed else None
    if beside[0] in given:
        near = np.stack([given[name] for name in beside], axis=1) / joints.typed
    found = _solve(query, batch.values[valid, : len(axes)], turn, near, in_space or posed, how)
    # with every branch a target has several answers
    rows = np.flatnonzero(valid)[found.pop("target")]
    reachable, q = found["reachable"], found.pop("q")
    q = np.where(reachable[:, None], q * joints.typed, np.nan)
    for name in ("position", "quaternion", *([] if posed else ["turned"])):
        found.pop(name, None)
    # rows without numbers stand where they stood, between the answers of the others
    index = np.sort(np.concatenate([rows, np.flatnonzero(~valid)]))
    answers = over_all_rows(valid[index], {**dict(zip(joints.names, q.T, strict=True)), **found})
    if how["every"]:
        answers, batch = {"row": index + 1, **answers}, batch.take(index)
    missed = np.unique(rows[~reachable] + 1).tolist()
    return query.answer(batch, answers, missed, "out of reach", n)
