"""Joint values that bring the tip to a position; exit code 3 if it is out of reach."""

from typing import Annotated, Literal

from typer import Argument

from ... import options as opt
from ... import parsing
from ...output import Outcome
from ...parsing import BadOption

NUMBERS = True


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
    all_branches: Annotated[
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
            "--on z=H", "The pixel X Y lies on this plane [m].", parsing.height
        ),
    ] = None,
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
) -> Outcome:
    from ...inverse import (
        InverseOptions,
        answer_one,
        answer_table,
        orientation_of,
    )
    from ...query import Files, Query

    is_pose = quaternion is not None or rpy is not None
    why = ""
    if all_branches and readout:
        why = "--all is of the default readout alone: no --readout"
    elif input_ and (is_pose or keep or on):
        why = "--input has a column for each number: expected no other target"
    elif keep and (is_pose or near is None):
        why = "--keep-orientation: expected --near beside it alone"
    elif free and not (is_pose or input_):
        why = "--free: expected --quaternion or --rpy beside it"
    elif quaternion and rpy:
        why = "--quaternion and --rpy are given: expected one of them"
    if why:
        raise BadOption(why)
    files = Files(input_, columns, output, target)
    query = Query.of(model, files, unit, degrees, frame, of_pixel=bool(on))
    near_q = query.within_range("--near", near)
    orientation = orientation_of(quaternion, rpy, degrees)
    options = InverseOptions(
        readout, all_branches, keep, free, near_q, orientation
    )
    if input_ is not None:
        return answer_table(query, options)
    height = None if on is None else on.low
    return answer_one(query, options, target or (), height)
