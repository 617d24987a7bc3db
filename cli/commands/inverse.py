"""The command `calib query inverse`: joint values for positions, or for poses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from .. import options as opt
from ..options import option
from ..output import NO, Outcome, note
from ..parsing import BadOption, any_number, check_count, height, reader, reals

if TYPE_CHECKING:
    from ..answers import Query

_TOGETHER = 0.05  # of the largest share: joints that move less are not named
_TURN = ("qx", "qy", "qz", "qw")
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
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    frame: opt.InFrame = "sensor",
    quaternion: Annotated[
        Any, option("--quaternion QX,QY,QZ,QW", "The orientation wanted, in space.", _quaternion)
    ] = None,
    rpy: Annotated[Any, option("--rpy R,P,Y", "Roll, pitch, yaw as in a URDF.", _angles)] = None,
    keep: Annotated[
        bool, Option("--keep-orientation", help="Turn the tool little from --near.")
    ] = False,
    on: Annotated[Any, option("--on z=H", "The pixel X Y lies on this plane [m].", height)] = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
) -> Outcome:
    """Joint values that bring the tip to a position; exit code 3 if it is out of reach."""
    from ..answers import Query

    typed = target or []
    turned = quaternion is not None or rpy is not None
    if every and readout is not None:
        raise BadOption(f"--all answers by the default readout: expected no --readout {readout}")
    if input_ is not None and (turned or keep or on is not None):
        raise BadOption("--input has a column for each number: expected no other target")
    if keep and (turned or near is None):
        raise BadOption("--keep-orientation keeps that of --near: expected --near alone beside it")
    if quaternion is not None and rpy is not None:
        raise BadOption("--quaternion and --rpy are given: expected one of them")
    shown = "base" if on is not None else frame
    query = Query(model, degrees, shown, unit, typed, input_, columns, output)
    asked, joints = query.model, query.joints
    anchor = joints.one_each("--near", near)
    if anchor is not None and (beyond := joints.beyond(asked, anchor)):
        raise BadOption(f"--near {beyond}")
    question = _Question(query, anchor, readout, shown == "base" or turned or keep, keep)
    if input_ is not None:
        return _batch(question, input_, columns, output, every)
    x: Any = [value / query.positions.typed for value in typed] if on is None else typed
    told: dict[str, Any] = {"target": x}
    if on is None:
        check_count(typed, "xyz" if frame == "base" else asked.axes, "coordinate")
    if not question.in_space:
        return _answer(replace(question, x=x), told, every)
    import numpy as np

    from calib.errors import QueryError
    from calib.model.space import Space
    from calib.samples.roles import from_angles

    told["frame"] = shown
    if on is not None:
        check_count(typed, "uv", "coordinate")
        x = Space.of(asked).pixels_on_plane(typed, on[1])[0]
        place = ", ".join(f"{1e3 * value:.2f}" for value in x)
        note(f"the pixel shows ({place}) mm of the base frame")
        told["on_plane"] = {"z": on[1], "position": x, "unit": "m"}
    elif Space.of(asked).camera and frame != "base":
        raise QueryError("a pixel alone is no position in space; give --on z=H or --in base")
    turn = None
    if quaternion is not None:  # typed numbers are rounded
        turn = np.array(quaternion) / math.hypot(*quaternion)
    elif rpy is not None:
        turn = from_angles(np.array([rpy]) * (math.radians(1.0) if degrees else 1.0))[0]
    if turn is not None:
        told["quaternion"] = turn
    return _answer(replace(question, x=x, turn=turn), told, every)


@dataclass(frozen=True)
class _Question:
    """One target, or many."""

    query: Query
    near: Any  # (dof,) or (n, dof) [rad or m], or None
    readout: str | None
    in_space: bool  # whether the chain of an arm in space answers rather than the model itself
    keep: bool = False  # whether the orientation at `near` is kept
    x: Any = None  # (2,), (3,) or (n, 2), (n, 3), positions in the frame
    turn: Any = None  # (4,) or (n, 4), orientations wanted as quaternions

    def answer(self, every: bool) -> dict[str, Any]:
        """Return what an `Answer` or `PoseAnswers` holds, by name, for each answer."""
        model, frame = self.query.model, self.query.frame
        if not self.in_space:
            if not every:
                return {**model.solve(self.x, self.near, self.readout)._asdict()}
            (answer,) = model.solve_all([self.x])
            if self.near is not None:  # those near the anchor first
                import numpy as np

                scale = model.motor.scale
                gaps = scale.difference(
                    scale.to_unit(answer.q), scale.to_unit(np.array([self.near]))
                )
                answer = answer.take(np.argsort(np.linalg.norm(gaps, axis=1), kind="stable"))
            return {**answer._asdict()}
        if self.readout is not None:
            raise BadOption("--readout is for positions in the sensor's frame alone")
        from calib.model.poses import solve_poses

        from ..answers import up_to_scale

        ways = {"every": every, "keep": self.keep}
        found = solve_poses(model, self.x, self.turn, self.near, frame=frame, **ways)
        scaled = up_to_scale(model, found.q) if frame == "base" else {}
        return {**found._asdict(), **scaled}


def _answer(asked: _Question, told: dict[str, Any], every: bool) -> Outcome:
    """Answer one question; `told` begins its document."""
    query, posed = asked.query, asked.turn is not None
    model, joints = query.model, query.joints
    # of a pose all branches are looked for, so that the nearest is found
    found = asked.answer(every or asked.in_space)
    found.pop("target", None)
    q, reachable = found.pop("q"), bool(found.pop("reachable").any())
    solutions = query.documents(q, **found)[: None if every else 1]
    document = told | {"reachable": reachable, "solutions": solutions}
    if asked.in_space or (reachable and model.body is not None and len(model.axes) == 3):
        free = _free(asked, q[0]) if reachable else []
        if asked.in_space:
            document["free"] = [dict(zip(joints.names, row, strict=True)) for row in free]
    document |= query.meaning
    other = asked.readout is not None and asked.readout != model.default_readout
    missed = f"nearest attainable {'pose' if posed else 'point'}"
    missed = f"the answer of readout '{asked.readout}'" if other else missed
    shown = ["distance", *(["turned"] if posed else []), *query.bounds]
    title = "" if reachable or posed else missed
    table = query.table(solutions, "xyz" if asked.in_space else model.axes, shown, title)
    if query.frame == "base":
        from calib.model.space import Space

        from ..answers import UP_TO_SCALE, say_size

        say_size(float(found[UP_TO_SCALE][0]) if UP_TO_SCALE in found else None)
        if not Space.of(model).sees(asked.x).all():
            note("the camera's picture does not show the target")
    if reachable:
        alone = [" ".join(joints.cells(list(each["joints"].values()))) for each in solutions]
        return Outcome(document, [table], result=alone)
    away, hint = query.positions.said(float(found["distance"].min())), _slip(asked)
    if posed:
        away += f" and {math.degrees(float(found['turned'][0])):.3g} deg"
        few = "; so few joints reach few poses, ask for a position alone"
        hint = few if len(joints.names) < 6 else hint
    # a coarser readout can miss a target that the arm reaches
    note(f"{'missed:' if other else 'out of reach: the'} {missed} is {away} away{hint}")
    return Outcome(document, [table], result=(), code=NO)


def _free(asked: _Question, q: Any) -> Any:
    """Tell directions (k, dof) of the joints that leave the answer q (dof,) where it is."""
    import numpy as np

    from calib.inverse.families import free_directions
    from calib.model.space import Space

    model, names = asked.query.model, asked.query.joints.names
    if asked.in_space:
        found = Space.of(model).free(q, 3 if asked.turn is None else 6)[:9]
    else:
        scale = model.motor.scale
        # the slope by joints: u = (q - lower) / span, so dx/dq = (dx/du) / span
        slope = model.predictor.value_and_slope(scale.to_unit(q[None]))[1][0] / scale.span
        found = free_directions(slope)
    told = []
    for row in found:
        # each direction is scaled so that one joint moves by 1: it names the direction
        own = int(np.argmin(np.abs(row - 1.0)))
        order = [k for k in np.argsort(-np.abs(row)) if abs(row[k]) > _TOGETHER and k != own]
        others = ", ".join(f"{names[k]} {row[k]:+.2f}" for k in order)
        told.append(f"{names[own]} with {others}" if others else f"{names[own]} alone")
    if told:
        ways = "the middle of the ranges, --near chooses another"
        nearest = ways if asked.near is None else "--near"
        note(f"free: {'; '.join(told)}; the answer is the one nearest to {nearest}")
    return found


def _slip(asked: _Question) -> str:
    """Return a hint where a target in m is far off and would be near in mm."""
    import numpy as np

    positions = asked.query.positions
    if positions.unit != "m" or positions.typed != 1.0 or asked.in_space:
        return ""
    scale = asked.query.model.sensory.scale
    middle = scale.lower + scale.span / 2
    far = np.abs(asked.x - middle).max() > 10 * scale.span.max()
    inside = np.abs(np.array(asked.x) / 1e3 - middle) <= scale.span
    return "; in mm it is near: give --unit mm" if far and inside.all() else ""


def _batch(
    asked: _Question,
    source: str,
    called: Mapping[str, str] | None,
    output: str | None,
    every: bool,
) -> Outcome:
    """Answer a table; columns near_JOINT choose the branch, qx to qw ask for an orientation."""
    import numpy as np

    from ..answers import over_all_rows

    query, joints = asked.query, asked.query.joints
    axes = "xyz" if asked.in_space else query.model.axes
    beside = [f"near_{name}" for name in joints.names]
    # fewer than six joints reach almost no pose that is given: its columns go along unread
    turns = _TURN if len(joints.names) >= 6 and len(axes) == 3 else ()
    batch = query.read(source, axes, called, (beside, turns))
    posed = bool(turns) and "qw" in batch.names
    if every and not posed:
        raise BadOption("--all of many targets is for poses: expected columns qx, qy, qz, qw")
    n = len(batch.values)
    valid: Any = np.isfinite(batch.values).all(axis=1)
    given = dict(zip(batch.names, batch.values[valid].T, strict=True))
    asked = replace(asked, x=batch.values[valid, : len(axes)], in_space=posed or asked.in_space)
    if beside[0] in given:
        near = np.stack([given[name] for name in beside], axis=1) / joints.typed
        asked = replace(asked, near=near)
    if posed:
        asked = replace(asked, turn=np.stack([given[name] for name in _TURN], axis=1))
    found = asked.answer(every)
    # with every branch a target has several answers
    rows = np.flatnonzero(valid)[found.pop("target", slice(None))]
    reachable, q = found["reachable"], found.pop("q")
    q = np.where(reachable[:, None], q * joints.typed, np.nan)
    for name in ("position", "quaternion", *([] if posed else ["turned"])):
        found.pop(name, None)
    # rows without numbers stand where they stood, between the answers of the others
    index = np.sort(np.concatenate([rows, np.flatnonzero(~valid)]))
    answers = over_all_rows(valid[index], {**dict(zip(joints.names, q.T, strict=True)), **found})
    if every:
        answers, batch = {"row": index + 1, **answers}, batch.take(index)
    return query.answer(batch, answers, (rows[~reachable] + 1).tolist(), "out of reach", output, n)
