"""Write a tag for the arm's tip, or a board for the desk, to print at its true size (SVG)."""

from __future__ import annotations

from typing import Annotated

from typer import Argument

from calib.common.choices import DICTIONARY

from .. import options as opt
from ..output import Outcome
from ..parsing import BadOption, check_file, whole


def tag(
    output: Annotated[
        str, opt.value("--output -o FILE.svg", "The page to print.")
    ],
    number: Annotated[
        int | None,
        Argument(metavar="ID", parser=whole(0), help="Number of the tag."),
    ] = None,
    size: Annotated[
        str, opt.value("--size 40mm", "Side of the black square.")
    ] = "40mm",
    dictionary: opt.Dictionary = DICTIONARY,
    board: opt.BoardSpec = None,
) -> Outcome:
    from calib.common.atomic import atomic_write
    from calib.recording.board import parse_board, parse_length
    from calib.recording.printing import print_board, print_tag

    if (number is None) == (board is None):
        raise BadOption("expected the ID of a tag, or --board, and not both")
    check_file(output, (".svg",), stream=True)
    if board is not None:
        pattern = parse_board(board)
        page = print_board(pattern)
        width, height = (1e3 * side for side in pattern.size)
        what = f"a board of {width:g} x {height:g} mm"
    else:
        side = parse_length(size, "`size`")
        page = print_tag(int(number or 0), side, dictionary)
        what = f"tag {number} of {dictionary}, {1e3 * side:g} mm"
    line = f"{output}: {what}; print it at 100 % and check the line of 100 mm"
    if output == "-":
        print(page, end="")
    else:
        atomic_write(output, page.encode())
    return Outcome({"output": output, "what": what}, [line])
