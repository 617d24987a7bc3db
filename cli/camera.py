"""Options for pictures and videos, and the log that is made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from calib.common.choices import DICTIONARY, PICTURES, VIDEOS, Eye

from . import options as opt
from .boards import record_board
from .options import Text, flag, option
from .output import say
from .parsing import BadOption

if TYPE_CHECKING:
    from calib.recording.setting import Setup
    from calib.samples.recorded import Recorded


@dataclass(frozen=True, kw_only=True)
class Shooting:
    """Pictures or a video, and what is in them, as typed."""

    joints_file: Annotated[Text, option("--joints-file FILE", "Joints by picture or time.")] = None
    tag: Annotated[int | None, Option("--tag", metavar="ID", min=0, help="The tip's tag.")] = None
    dictionary: opt.Dictionary = DICTIONARY
    board: opt.BoardSpec = None
    tags_at: Annotated[Text, option("--tags-at FILE", "Table of desk tags: tag, x, y [m].")] = None
    lens: Annotated[Text, option("--lens SHOTS|lens.json", "Pictures of a board, or a model.")] = (
        None
    )
    tag_size: Annotated[Text, option("--tag-size 40mm", "Of the tip's tag, for --pose.")] = None
    tag_height: Annotated[Text, option("--tag-height 25mm", "Of the tip's, above the desk.")] = None
    pose: Annotated[bool, Option("--pose", help="z and the quaternion too, in space.")] = False
    picture: Annotated[Text, option("--picture seen.png", "Draw what was seen on a photo.")] = None
    camera: opt.DatasetCamera = None
    eye: Annotated[Eye | None, flag("--eye", "Of a board: in the hand, or standing.")] = None

    def given(self) -> bool:
        """Whether any of what only pictures have was typed."""
        typed = (self.joints_file, self.tag, self.board, self.tags_at, self.lens, self.eye)
        return any(value is not None for value in (*typed, self.picture, self.camera))

    def setting(self, output: str) -> Setup:
        """Make the setting; a lens that is calibrated is written beside the log."""
        from calib.recording.board import Board, parse_length
        from calib.recording.lens import load_lens
        from calib.recording.reference import MarkLayout
        from calib.recording.setting import Setup

        if self.tag is None or self.joints_file is None:
            missing = "--tag ID" if self.tag is None else "--joints-file FILE"
            raise BadOption(f"{missing} is missing: pictures and videos need both")
        board = Board.parse(self.board) if self.board is not None else None
        lens = None
        if self.lens is not None:
            folder = Path() if output == "-" else Path(output).parent
            lens, said = load_lens(self.lens, board, folder / "lens.json")
            say(said)
        if lens is not None and self.tags_at is not None:
            board = None  # it served the lens alone
        return Setup(
            tag=self.tag,
            dictionary=self.dictionary,
            board=board,
            tags_at=MarkLayout.read(self.tags_at) if self.tags_at is not None else None,
            lens=lens,
            tag_size=parse_length(self.tag_size, "`tag_size`") if self.tag_size else None,
            tag_height=parse_length(self.tag_height or "0", "`tag_height`", signed=True),
            pose=self.pose,
        )

    def record(
        self,
        sources: Sequence[str],
        output: str,
        joints: Sequence[str] | None,
        degrees: bool,
        prismatic: Sequence[str],
        max_gap: float,
        still: float | None,
        time_offset: float | None,
    ) -> Recorded:
        """Make a log of pictures or a video, and draw what was seen if that is wanted."""
        first, source = Path(sources[0]), sources[0] if len(sources) == 1 else sources
        film = first.is_file() and first.suffix.lower() not in PICTURES
        if len(sources) > 1 and (film or self.eye is not None):
            raise BadOption(f"{len(sources)} names: expected one video or dataset, or pictures")
        if not film and (still is not None or time_offset is not None):
            raise BadOption("--still and --time-offset are for videos and bags, not pictures")
        if self.eye is not None:
            return record_board(
                sources[0], self.board, self.eye, self.lens, self.joints_file, self.camera, joints,
                degrees=degrees, prismatic=prismatic,
            )  # fmt: skip
        from calib.recording.from_pictures import log_pictures
        from calib.recording.from_video import log_video
        from calib.recording.joint_table import read_joints
        from calib.recording.photo import read_photo, write_seen
        from calib.recording.pictures import list_pictures

        setting = self.setting(output)
        table = read_joints(str(self.joints_file), joints, degrees=degrees, prismatic=prismatic)
        path = first
        if film:
            made = log_video(
                first, table, setting, time_offset=time_offset, still=still, max_gap=max_gap,
                revolute=[name not in prismatic for name in table.names],
            )  # fmt: skip
        else:
            made = log_pictures(source, table, setting)
            named = {each.name: each for each in list_pictures(source)}
            path = named[(made.pictures or ())[len(made) // 2]]
        say(made.notes)
        folder = Path(output).resolve().parent
        if output != "-" and path.resolve().is_relative_to(folder):
            # named in the log, so that train can draw the map over it
            name = path.resolve().relative_to(folder).as_posix()
            made = replace(made, source={**made.source, "photo": name})
        if self.picture is not None:
            write_seen(self.picture, read_photo(path), setting, made.pixels)
        return made


def is_picture(path: str) -> bool:
    """Whether a name is that of pictures or a video, not of a recording of ROS."""
    return Path(path).suffix.lower() in VIDEOS + PICTURES or any(mark in path for mark in "*?[")
