"""Joint values along straight lines through waypoints, on one branch where possible.

Exit code 3 if the joints have to jump between branches or a point is out of reach.
"""

from typing import Annotated

from calib.common.wording import by_name

from ... import options as opt
from ...output import Outcome
from ...parsing import length


def path(
    model: opt.ModelFile,
    start: opt.StartJoints = None,
    step: Annotated[
        float | None,
        opt.value(
            "--step S",
            "Between rows at most, or inf (1 % of the extent).",
            length,
        ),
    ] = None,
    frame: opt.InFrame = "sensor",
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
) -> Outcome:
    import numpy as np

    from ...query import Files, Query, note_rows

    files = Files(input_, columns, output)
    query = Query.of(model, files, unit, degrees, frame)
    axes = query.axes
    joints = query.joints
    batch, answered = query.read(axes)
    valid = np.flatnonzero(answered)
    longest = None if step is None else step / query.positions.to_typed
    first = query.within_range("--from", start)
    result = query.model.path(
        batch.values[valid], first, longest, frame=query.frame
    )
    fast = (result.fast_turns + 1).tolist()
    note_rows(
        fast,
        len(result.q),
        "joints turn fast here, beside an axis or a stretched pose: go slowly",
    )
    table = {
        "waypoint": valid[result.waypoint] + 1,
        **by_name(axes, result.target.T),
        **by_name(joints.names, (result.q * joints.to_typed).T),
        "distance": result.distance,
        "expected_error": result.expected_error,
        "model_error": result.model_error,
        "reachable": result.reachable.astype(np.int64),
        "jump": np.isin(np.arange(len(result.q)), result.jumps).astype(
            np.int64
        ),
    }
    missed = ~result.reachable
    largest = float(result.distance[missed].max(initial=0.0))
    furthest = query.positions.words(largest)
    failures = {
        "jumps": (
            result.jumps,
            "a jump cannot be avoided, the branch ends before",
        ),
        "left_out": (
            np.flatnonzero(result.left_out),
            "left out, far beyond all that the arm reaches: the joints stay",
        ),
        "out_of_reach": (
            np.flatnonzero(missed),
            f"out of reach, by {furthest} at most: attainable points close by",
        ),
    }
    return query.write(
        batch,
        table,
        failures,
        count=len(result.q),
        key="path",
        facts={"fast_turns": fast},
    )
