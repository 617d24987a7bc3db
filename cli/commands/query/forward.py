"""The command `calib query forward`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument

from ... import options as opt
from ... import parsing
from ...asking import Asking
from ...output import NO, Outcome, TextTable, fixed, note

if TYPE_CHECKING:
    from calib.common.arrays import Array

    from ...answers import Query


CONTEXT_SETTINGS = {"ignore_unknown_options": True}  # -0.1 is a number, not an option


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
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Position of the tip for joint values; exit code 3 outside of what was learned."""
    asking = Asking(
        input_=input_, columns=columns, output=output, unit=unit, degrees=degrees
    )
    import numpy as np

    from ...answers import TURN, Query, beside, say_size

    query = Query(model, asking, frame, values or ())
    joints = query.joints
    about = query.model.about
    if asking.input_ is not None:
        from calib.errors import QueryError
        from calib.samples.joint_values import check_joint_values

        batch, valid = query.read(joints.names)
        q = batch.values / np.array(joints.typed)
        ranges = (about.joint_names, about.lower, about.upper, about.revolute)
        check_joint_values(q, *ranges, degrees=asking.degrees, error=QueryError)
        answers = beside(batch, valid, _told(query, q[valid], readout))
        unknown = np.flatnonzero(valid & np.isnan(answers["x"])) + 1
        failures = {"out_of_reach": (unknown.tolist(), "outside of what was learned")}
        return query.answer(batch, answers, failures)
    one = joints.one_each("Q1 Q2", values or ()) or []
    told: dict[str, Any] = {
        name: column[0].item()
        for name, column in _told(query, np.array([one]), readout).items()
    }
    parts = {"position": query.axes, "quaternion": TURN if "qw" in told else ()}
    quantities = {
        name: [told.pop(axis) for axis in axes] for name, axes in parts.items() if axes
    }
    document = query.document(one, **quantities, **told) | query.meaning
    if (outside := query.model.outside(one)) is not None:
        note(f"no answer: {joints.beyond(query.model, one) or outside}")
        return Outcome(document, code=NO)
    lines: list[str | TextTable] = [query.table([document], query.bounds)]
    if "quaternion" in document:
        lines.append(
            "quaternion " + " ".join(fixed(v, 6) for v in document["quaternion"])
        )
    say_size(told)
    alone = " ".join(fixed(v * query.positions.factor, 4) for v in document["position"])
    return Outcome(document, lines, result=[alone])


def _told(query: Query, q: Array, readout: str | None) -> dict[str, Array]:
    """Return what is told of joints (n, dof), by column of a table."""
    import numpy as np

    from calib.model.prediction import predict
    from calib.samples.motion import Motion

    from ...answers import BOUNDS, TURN, up_to_scale

    model = query.model
    if query.frame == "base":
        from calib.model.space import Space

        space = Space.of(model)
        position, turns = space.forward(q)
        bound = space.bound(q)
        bounds = {**up_to_scale(model, q), **dict.fromkeys(BOUNDS, bound)}
        known = np.isfinite(position[:, 0])
        told = dict(zip("xyz", position.T, strict=True)) | dict(
            zip(TURN, turns.T, strict=True)
        )
        return told | {
            name: np.where(known, value, np.nan) for name, value in bounds.items()
        }
    x = model.forward(q, readout)
    told = dict(zip(model.axes, x.T, strict=True))
    if len(model.axes) == 3:
        from calib.body.belief import knows_orientation

        if knows_orientation(model.body):
            told |= dict(zip(TURN, model.pose(q)[1].T, strict=True))
    prediction = predict(model, Motion(q))
    apart = prediction.apart(readout or model.default_readout)
    with_distance = (prediction.bound + apart, prediction.true_bound + apart)
    return told | dict(zip(BOUNDS, with_distance, strict=True))
