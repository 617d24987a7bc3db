"""Pictures of a board for commands: a folder, a LeRobotDataset, or the log of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from .output import say
from .parsing import BadOption

if TYPE_CHECKING:
    from calib.model.model import Model
    from calib.recording.lens import Lens
    from calib.samples.recorded import Recorded


@contextmanager
def pictures_of(source: str, joints_file: str | None, camera: str | None) -> Iterator[list[str]]:
    """Pictures and their joints: as typed, or still frames of a LeRobotDataset."""
    from calib.recording.lerobot import JOINTS, is_dataset, unpack

    if not is_dataset(source):
        if joints_file is None:
            raise BadOption("--joints-file FILE is missing: pictures need the joints beside them")
        yield [source, joints_file]
        return
    with TemporaryDirectory() as folder:
        say(unpack(source, folder, camera))
        yield [folder, str(Path(folder) / JOINTS)]


def record_board(
    source: str,
    board: str | None,
    eye: str,
    lens: Any,
    joints_file: str | None = None,
    camera: str | None = None,
    joints: Sequence[str] | None = None,
    degrees: bool = False,
    prismatic: Sequence[str] = (),
) -> Recorded:
    """Make a log of pictures of a board; `lens` is a lens, its file or its pictures, or None."""
    from calib.recording.board import Board
    from calib.recording.board_pictures import log_board
    from calib.recording.joint_table import read_joints
    from calib.recording.setting import load_lens

    if board is None:
        raise BadOption("--eye needs --board COLSxROWS:SQUARE:MARKER:DICT, which is seen")
    printed = Board.parse(board)
    if isinstance(lens, str) and lens.endswith(".calib"):
        import calib

        lens = _lens_of(calib.load(lens))
    elif isinstance(lens, str):
        lens, told = load_lens(lens, printed)
        say(told)
    with pictures_of(source, joints_file, camera) as (pictures, file):
        degrees = degrees and file == joints_file  # those of a dataset are converted
        table = read_joints(file, joints, degrees=degrees, prismatic=prismatic)
        made = log_board(pictures, table, printed, eye, lens)
    say(made.notes)
    return made


@contextmanager
def log_of_pictures(
    model: Model, source: str, joints_file: str | None, camera: str | None, degrees: bool | None
) -> Iterator[str]:
    """A log as typed; or one of pictures, read as the model's own were."""
    if joints_file is None and not Path(source).is_dir():
        yield source
        return
    about, lens = model.about, _lens_of(model)
    known = about.options["board"]
    sliding = [n for n, turns in zip(about.joint_names, about.revolute, strict=True) if not turns]
    made = record_board(
        source, known["board"], known["eye"], lens, joints_file, camera,
        about.joint_names, about.degrees if degrees is None else degrees, sliding,
    )  # fmt: skip
    with TemporaryDirectory() as folder:
        path = str(Path(folder) / f"{Path(source).name}.csv")
        made.write(path)
        yield path


def _lens_of(model: Model) -> Lens:
    """The lens that a model of pictures of a board was made with."""
    from calib.recording.lens import Lens

    known: Any = model.about.options.get("board")
    try:
        return Lens.from_json(known["lens"])
    except (KeyError, TypeError, ValueError):
        raise BadOption(
            "the model is not of pictures of a board: make a log of these by calib log --eye"
        ) from None
