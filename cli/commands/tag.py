"""The command `calib tag`: write a tag for the arm's tip, or a board for the desk."""

from __future__ import annotations

from calib.common.choices import DICTIONARY

from .. import parsing
from ..camera import PRINTED
from ..options import takes
from ..output import tell
from ..usage import BadOption, argument, option


@takes(
    output=option("--output -o FILE.svg", "The page to print."),
    number=argument("ID", "Number of the tag.", parsing.integer(0)),
    size=option("--size 40mm", "Side of the black square."),
    **PRINTED,
)
def tag(
    output: str,
    number: int | None = None,
    size: str = "40mm",
    dictionary: str = DICTIONARY,
    board: str | None = None,
) -> None:
    """Write a tag for the arm's tip, or a board for the desk, to print at its true size (SVG)."""
    from calib.common.atomic import atomic_write
    from calib.recording.board import Board, parse_length
    from calib.recording.printing import print_board, print_tag

    if (number is None) == (board is None):
        raise BadOption("expected the ID of a tag, or --board, and not both")
    if board is not None:
        made = Board.parse(board)
        page = print_board(made)
        width, height = (1e3 * side for side in made.size)
        what = f"a board of {width:g} x {height:g} mm"
    else:
        side = parse_length(size, "`size`")
        page = print_tag(int(number or 0), side, dictionary)
        what = f"tag {number} of {dictionary}, {1e3 * side:g} mm"
    if output == "-":
        print(page, end="")
        return
    atomic_write(output, page.encode())
    tell(f"{output}: {what}; print it at 100 % and check the line of 100 mm")
