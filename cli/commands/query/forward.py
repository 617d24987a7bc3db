"""Position of the tip for joint values; exit code 3 outside of what was learned."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from typer import Argument

from ... import options as opt
from ... import parsing
from ...output import NO, Outcome, TextTable, note, with_decimals

if TYPE_CHECKING:
    from calib.common.arrays import Array

    from ...query import Query

NUMBERS = True


def forward(
    model: opt.ModelFile,
    values: Annotated[
        list[float] | None,
        Argument(metavar="Q1 Q2", parser=parsing.number, help="Joint values."),
    ] = None,
    readout: opt.ReadoutKind = None,
    frame: opt.InFrame = "sensor",
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
) -> Outcome:
    import numpy as np

    from ...query import TURN, Query

    query = Query(model, input_, columns, output, unit, degrees, frame, values)
    joints = query.joints
    if input_ is not None:
        return _table(query, readout)
    q = np.array([joints.one_each("Q1 Q2", values or ())])
    answers = _answers(query, q, readout)
    numbers = {name: float(column[0]) for name, column in answers.items()}
    position = [numbers.pop(axis) for axis in query.axes]
    document: dict[str, object] = {
        "joints": dict(zip(joints.names, q[0].tolist(), strict=True)),
        "position": position,
    }
    shown = {name: answers[name] for name in (*query.axes, *query.bounds)}
    lines: list[str | TextTable] = [query.table(q, shown)]
    if "qw" in answers:
        turn = [numbers.pop(name) for name in TURN]
        document["quaternion"] = turn
        lines.append(
            "quaternion " + " ".join(with_decimals(value, 6) for value in turn)
        )
    document |= numbers | query.meaning
    outside = joints.beyond(query.model, q[0].tolist())
    outside = outside or query.model.outside(q[0])
    if outside is not None:
        note(f"no answer: {outside}")
        return Outcome(document, code=NO)
    alone = " ".join(
        with_decimals(query.factor * value, 4) for value in position
    )
    return Outcome(document, lines, result=[alone])


def _table(query: Query, readout: str | None) -> Outcome:
    """Answer every row of a table."""
    import numpy as np

    from calib.errors import QueryError
    from calib.samples.joint_values import check_joint_values

    from ...query import beside

    about = query.model.about
    batch, valid = query.read(query.joints.names)
    q = batch.values / np.array(query.joints.typed)
    ranges = (about.joint_names, about.lower, about.upper, about.revolute)
    check_joint_values(
        q,
        *ranges,
        degrees=query.degrees,
        label=str(query.input),
        error=QueryError,
    )
    answers = beside(batch, valid, _answers(query, q[valid], readout))
    unanswered = np.flatnonzero(valid & np.isnan(np.asarray(answers["x"])))
    rows = (unanswered + 1).tolist()
    failures = {"out_of_reach": (rows, "outside of what was learned")}
    return query.answer(batch, answers, failures)


def _answers(query: Query, q: Array, readout: str | None) -> dict[str, Array]:
    """Return position, orientation and bounds at joints (n, dof), by column of a table."""
    import numpy as np

    from calib.body.belief import knows_orientation
    from calib.model.prediction import predict
    from calib.model.space import Space
    from calib.samples.motion import Motion

    from ...query import BOUNDS, TURN

    model = query.model
    if query.frame == "base":
        space = Space.of(model)
        position, turn = space.forward(q)
        bound = np.where(np.isfinite(position[:, 0]), space.bound(q), np.nan)
        columns = [*position.T, *turn.T, bound, bound]
        return dict(zip((*query.axes, *TURN, *BOUNDS), columns, strict=True))
    answers = dict(zip(model.axes, model.forward(q, readout).T, strict=True))
    if len(model.axes) == 3 and knows_orientation(model.body):
        answers |= dict(zip(TURN, model.pose(q)[1].T, strict=True))
    prediction = predict(model, Motion(q))
    apart = prediction.apart(readout or model.default_readout)
    bounds = (prediction.bound + apart, prediction.true_bound + apart)
    return answers | dict(zip(BOUNDS, bounds, strict=True))
