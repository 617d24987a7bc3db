"""Pictures and videos for commands: logs that are made of them, and photos that are drawn over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calib.common.choices import DICTIONARY, PICTURES, VIDEOS, Eye

from .logs import Reading, log_of
from .output import say
from .parsing import BadOption

if TYPE_CHECKING:
    from calib.model.model import Model
    from calib.recording.lens import Lens
    from calib.recording.rig import HandEye
    from calib.recording.setting import Setup
    from calib.samples.samples import Samples


@dataclass(frozen=True, kw_only=True)
class Shooting:
    """Pictures or a video, and what is in them, as typed."""

    joints_file: str | None = None
    tag: int | None = None
    dictionary: str = DICTIONARY
    board: str | None = None
    tags_at: str | None = None
    lens: str | None = None
    tag_size: str | None = None
    tag_height: str | None = None
    pose: bool = False
    picture: str | None = None
    camera: str | None = None
    eye: Eye | None = None

    def is_meant(self, names: Sequence[str]) -> bool:
        """Whether names are of pictures or a video, or what only these have was typed."""
        if self != Shooting():
            return True
        return any(
            name.lower().endswith(VIDEOS + PICTURES) or set("*?[") & set(name)
            for name in names
        )

    def setting(self, output: str) -> Setup:
        """Make the setting; a lens that is calibrated is written beside the log."""
        from calib.recording.board import Board, parse_length
        from calib.recording.lens import load_lens
        from calib.recording.reference import MarkLayout
        from calib.recording.setting import Setup

        if self.tag is None or self.joints_file is None:
            missing = "--tag ID" if self.tag is None else "--joints-file FILE"
            raise BadOption(
                f"{missing} is missing: pictures and videos need both"
            )
        board = None if self.board is None else Board.parse(self.board)
        lens = None
        if self.lens is not None:
            folder = Path() if output == "-" else Path(output).parent
            lens, notes = load_lens(self.lens, board, folder / "lens.json")
            say(notes)
        size = self.tag_size
        height = self.tag_height or "0mm"
        marks = None if self.tags_at is None else MarkLayout.read(self.tags_at)
        if lens is not None and marks is not None:
            board = None  # it served the lens alone
        return Setup(
            tag=self.tag,
            dictionary=self.dictionary,
            board=board,
            tags_at=marks,
            lens=lens,
            tag_size=None if size is None else parse_length(size, "`tag_size`"),
            tag_height=parse_length(height, "`tag_height`", signed=True),
            pose=self.pose,
        )

    def record(
        self,
        sources: Sequence[str],
        output: str,
        joints: Sequence[str] | None,
        *,
        degrees: bool,
        prismatic: Sequence[str],
        max_gap: float,
        still: float | None,
        time_offset: float | None,
    ) -> Samples:
        """Make a log of pictures or a video, and draw what was seen if that is wanted."""
        first = Path(sources[0])
        source = sources[0] if len(sources) == 1 else sources
        film = first.is_file() and first.suffix.lower() not in PICTURES
        if len(sources) > 1 and (film or self.eye is not None):
            raise BadOption(
                f"{len(sources)} names: expected one video or dataset, or pictures"
            )
        if not film and (still is not None or time_offset is not None):
            raise BadOption(
                "--still and --time-offset are for videos and bags, not pictures"
            )
        if self.eye is not None:
            return record_board(
                sources[0],
                self.board,
                self.eye,
                self.lens,
                self.joints_file,
                self.camera,
                joints,
                degrees=degrees,
                prismatic=prismatic,
            )
        from calib.recording.joint_table import read_joints
        from calib.recording.photo import read_photo, write_seen
        from calib.recording.pictures import list_pictures
        from calib.recording.tag_logs import log_pictures, log_video

        setting = self.setting(output)
        table = read_joints(
            str(self.joints_file), joints, degrees=degrees, prismatic=prismatic
        )
        path = first
        if film:
            log = log_video(
                first,
                table,
                setting,
                revolute=[name not in prismatic for name in table.names],
                max_gap=max_gap,
                still=still,
                time_offset=time_offset,
            )
        else:
            log = log_pictures(source, table, setting)
            paths = {picture.name: picture for picture in list_pictures(source)}
            assert log.pictures is not None  # noqa: S101 - of pictures
            path = paths[log.pictures[len(log) // 2]]
        say(log.notes)
        folder = Path(output).resolve().parent
        if output != "-" and path.resolve().is_relative_to(folder):
            # named in the log, so that train can draw the map over it
            name = path.resolve().relative_to(folder).as_posix()
            log = replace(log, source={**log.source, "photo": name})
        if self.picture is not None and log.pixels is not None:
            write_seen(self.picture, read_photo(path), setting, log.pixels)
        return log


def need_joints(source: str, joints_file: str | None) -> None:
    """Refuse pictures without their joints; a LeRobotDataset brings them."""
    from calib.recording.lerobot import is_dataset

    if joints_file is None and not is_dataset(source):
        raise BadOption(
            "--joints-file FILE is missing: pictures need the joints beside them"
        )


def record_board(
    source: str,
    board: str | None,
    eye: str,
    lens: Lens | str | None,
    joints_file: str | None,
    camera: str | None,
    joints: Sequence[str] | None,
    *,
    degrees: bool,
    prismatic: Sequence[str],
) -> Samples:
    """Make a log of pictures of a board; `lens` is a lens, its file or its pictures, or None."""
    from calib.recording.board_pictures import find_board
    from calib.recording.lens import load_lens

    if board is None:
        raise BadOption(
            "--eye needs --board COLSxROWS:SQUARE:MARKER:DICT, which is seen"
        )
    need_joints(source, joints_file)
    shots = find_board(
        source,
        joints_file,
        board,
        camera=camera,
        names=joints,
        degrees=degrees,
        prismatic=prismatic,
    )
    if isinstance(lens, str):
        lens, notes = load_lens(lens, shots.board)
        say(notes)
    lens, doubts = shots.lens(lens)
    log = shots.log(lens, eye == "hand")
    say([*log.notes, *doubts])
    return log


def log_of_pictures(
    model: Model,
    source: str,
    joints_file: str | None,
    camera: str | None,
    degrees: bool | None,
) -> Samples:
    """Make a log of pictures, read as those of the model were."""
    from calib.recording.lens import lens_of_model

    about = model.about
    board: Mapping[str, str] | None = about.options.get("board")
    if board is None:
        raise BadOption(
            "the model was not made of pictures: expected --data of a log, and no --joints-file"
        )
    joints = zip(about.joint_names, about.revolute, strict=True)
    return record_board(
        source,
        board["board"],
        board["eye"],
        lens_of_model(model),
        joints_file,
        camera,
        about.joint_names,
        degrees=about.degrees if degrees is None else degrees,
        prismatic=[name for name, turns in joints if not turns],
    )


def photo_of_log(model: Model, log: Samples, data: str) -> Model:
    """Return a model with the picture that its log names, if it lies beside or below the log."""
    from calib.errors import CalibError

    name = log.source.get("photo")
    if not isinstance(name, str) or data == "-":
        return model
    folder = Path(data).resolve().parent
    # a log may come from a stranger: it must not bring files from elsewhere into a model
    try:
        path = (folder / name).resolve()
        if not (path.is_relative_to(folder) and path.is_file()):
            return model
        model = with_photo(model, str(path), log)
    except (OSError, ValueError):  # no name of a file
        return model
    except CalibError as error:
        say([f"no photo is kept in the model: {error}"])
        return model
    text = f"{path.name} is kept in the model as its photo"
    say([f"{text}; --no-photo leaves it out"])
    return model


def load_drawn(
    path: str,
    data: str | None,
    photo: str | None,
    no_photo: bool,
    reading: Reading,
) -> tuple[Model | HandEye, Samples | None]:
    """Load a model or a rig as it is to be drawn, and a log of its own arm where one is given."""
    import calib
    from calib.recording.rig_file import is_rig, load_rig

    if is_rig(path):
        if data is not None or photo is not None:
            raise BadOption(
                "a rig has no joints: expected neither --data nor --photo"
            )
        return load_rig(path), None
    model = calib.load(path)
    log = log_of(model, data, reading)
    if photo is not None:
        model = with_photo(model, photo, log)
    elif no_photo:
        model = replace(model, photo=None)
    return model, log


def with_photo(model: Model, path: str, log: Samples | None) -> Model:
    """Return a model with a photo; for metres `log` says where its camera was."""
    from calib.recording.photo import take_photo

    source = None if log is None else log.source
    unit = model.about.unit
    return replace(
        model, photo=take_photo(path, model.sensory.weights, unit, source)
    )


def size_of_page(path: str) -> str:
    """Return in one line what was written for a browser."""
    return f"{path}: {Path(path).stat().st_size / 1e6:.2f} MB, open it in a browser"
