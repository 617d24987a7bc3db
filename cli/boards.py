"""Pictures of a board for commands, and the log that is made of them."""

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


def need_joints(source: str, joints_file: str | None) -> None:
    """Refuse pictures without their joints; a LeRobotDataset brings them."""
    from calib.recording.lerobot import is_dataset

    if joints_file is None and not is_dataset(source):
        raise BadOption("--joints-file FILE is missing: pictures need the joints beside them")


def record_board(
    source: str,
    board: str | None,
    eye: str,
    lens: Any,
    joints_file: str | None,
    camera: str | None,
    joints: Sequence[str] | None,
    **of_joints: Any,
) -> Recorded:
    """Make a log of pictures of a board; `lens` is a lens, its file or its pictures, or None."""
    import calib
    from calib.recording.board_pictures import find_board
    from calib.recording.lens import load_lens

    if board is None:
        raise BadOption("--eye needs --board COLSxROWS:SQUARE:MARKER:DICT, which is seen")
    need_joints(source, joints_file)
    shots = find_board(source, joints_file, board, joints, camera=camera, **of_joints)
    if isinstance(lens, str) and lens.endswith(".calib"):
        lens = _lens_of(calib.load(lens))
    elif isinstance(lens, str):
        lens, told = load_lens(lens, shots.board)
        say(told)
    lens, doubts = shots.lens(lens)
    made = shots.log(lens, eye == "hand")
    say([*made.notes, *doubts])
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
    known, kinds = about.options["board"], zip(about.joint_names, about.revolute, strict=True)
    sliding = [name for name, turns in kinds if not turns]
    made = record_board(
        source, known["board"], known["eye"], lens, joints_file, camera, about.joint_names,
        degrees=about.degrees if degrees is None else degrees,
        prismatic=sliding,
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
