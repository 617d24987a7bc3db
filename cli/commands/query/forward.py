"""Position of the tip for joint values; exit code 3 outside of what was learned."""

from typing import Annotated

from typer import Argument

from ... import options as opt
from ... import parsing
from ...output import Outcome

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
    from ...forward import answer_one, answer_table
    from ...query import Files, Query

    files = Files(input_, columns, output, values)
    query = Query.of(model, files, unit, degrees, frame)
    if input_ is not None:
        return answer_table(query, readout)
    return answer_one(query, values or (), readout)
