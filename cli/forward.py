"""Forward queries: positions of the tip for one row of joint values, or for a table of them.

It needs NumPy: the command imports it when it runs.
"""

from collections.abc import Sequence

import numpy as np

from calib.arm.rotations import QUATERNION
from calib.body.belief import knows_orientation
from calib.common.arrays import Array
from calib.common.wording import by_name
from calib.errors import QueryError
from calib.model.prediction import Prediction
from calib.model.space import Space
from calib.samples.joint_values import check_joint_values
from calib.samples.motion import Motion

from .output import EXIT_ACT, Outcome, TextTable, note, with_decimals
from .query import BOUNDS, Query, with_answers


def answer_one(
    query: Query, typed: Sequence[float], readout: str | None
) -> Outcome:
    """Answer one question, joint values as they were typed."""
    joints = query.joints
    q = np.array([joints.one_each("Q1 Q2", typed)])
    answers = _answers(query, q, readout)
    numbers = {name: float(column[0]) for name, column in answers.items()}
    position = [numbers.pop(axis) for axis in query.axes]
    document: dict[str, object] = {
        "joints": by_name(joints.names, q[0].tolist()),
        "position": position,
    }
    shown = {name: answers[name] for name in (*query.axes, *query.bounds)}
    lines: list[str | TextTable] = [query.table(q, shown)]
    if "qw" in answers:
        quaternion = [numbers.pop(name) for name in QUATERNION]
        document["quaternion"] = quaternion
        lines.append(
            "quaternion "
            + " ".join(with_decimals(value, 6) for value in quaternion)
        )
    document |= numbers | query.explain()
    outside = query.model.outside(q[0], degrees=joints.degrees)
    if outside is not None:
        note(f"no answer: {outside}")
        return Outcome(document, code=EXIT_ACT)
    printed = query.positions.to_printed * np.array(position)
    alone = " ".join(with_decimals(value, 4) for value in printed.tolist())
    return Outcome(document, lines, result=[alone])


def answer_table(query: Query, readout: str | None) -> Outcome:
    """Answer every row of a table."""
    about = query.model.about
    batch, valid = query.read(query.joints.names)
    q = batch.values / query.joints.to_typed
    ranges = (about.joint_names, about.lower, about.upper, about.revolute)
    check_joint_values(
        q,
        *ranges,
        degrees=query.joints.degrees,
        label=str(query.files.input),
        error=QueryError,
    )
    answers = with_answers(batch, _answers(query, q[valid], readout))
    unanswered = np.flatnonzero(valid & np.isnan(np.asarray(answers["x"])))
    failures = {"out_of_reach": (unanswered, "outside of what was learned")}
    return query.write(batch, answers, failures)


def _answers(query: Query, q: Array, readout: str | None) -> dict[str, Array]:
    """Return position, orientation and bounds at joints (n, dof), by column of a table."""
    model = query.model
    if query.frame == "base":
        space = Space.of(model)
        position, quaternion = space.forward(q)
        bound = np.where(np.isfinite(position[:, 0]), space.bound(q), np.nan)
        columns = [*position.T, *quaternion.T, bound, bound]
        return by_name((*query.axes, *QUATERNION, *BOUNDS), columns)
    answers = by_name(model.axes, model.forward(q, readout).T)
    if len(model.axes) == 3 and knows_orientation(model.body):
        answers |= by_name(QUATERNION, model.pose(q)[1].T)
    prediction = Prediction(model, Motion(q))
    disagreement = prediction.apart(readout or model.default_readout)
    bounds = (
        prediction.reading_bound + disagreement,
        prediction.position_bound + disagreement,
    )
    return answers | by_name(BOUNDS, bounds)
