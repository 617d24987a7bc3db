"""Options for pictures and videos, and the log that is made of them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calib.common.choices import DICTIONARY, PICTURES, VIDEOS

from .output import note, say
from .parsing import BadOption, expects, finite_number

if TYPE_CHECKING:
    from calib.recording.setting import Setup
    from calib.samples.recorded import Recorded


@dataclass(frozen=True)
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
    since: str | None = None
    picture: str | None = None
    camera: str | None = None

    def given(self) -> bool:
        """Whether any of what only pictures have was typed."""
        typed = (self.joints_file, self.tag, self.board, self.tags_at, self.lens)
        return any(value is not None for value in (*typed, self.picture, self.camera))

    def setting(self, output: str) -> Setup:
        """Make the setting; a lens that is calibrated is written beside the log."""
        from calib.recording.board import Board, parse_length
        from calib.recording.setting import Setup, load_lens
        from calib.recording.watch import read_layout

        if self.camera is not None and self.joints_file is not None:
            raise BadOption("--camera reads joints from standard input, not from --joints-file")
        if self.tag is None or (self.joints_file is None and self.camera is None):
            missing = "--tag ID" if self.tag is None else "--joints-file FILE"
            raise BadOption(f"{missing} is missing: pictures and videos need both")
        board = Board.parse(self.board) if self.board is not None else None
        lens = None
        if self.lens is not None:
            folder = Path() if output == "-" else Path(output).parent
            lens, said = load_lens(self.lens, board, folder / "lens.json")
            say(said)
        if board is not None and lens is not None and self.tags_at is not None:
            board = None  # it served the lens alone
        layout = read_layout(self.tags_at) if self.tags_at is not None else None
        return Setup(
            tag=self.tag,
            dictionary=self.dictionary,
            board=board,
            tags_at=layout,
            lens=lens,
            tag_size=parse_length(self.tag_size, "`tag_size`") if self.tag_size else None,
            tag_height=parse_length(self.tag_height or "0", "`tag_height`", signed=True),
            pose=self.pose,
        )


def is_picture(path: str) -> bool:
    """Whether a name is that of pictures or a video, not of a recording of ROS."""
    suffix = Path(path).suffix.lower()
    return suffix in VIDEOS + PICTURES or any(mark in path for mark in "*?[")


@expects("a number of seconds, or auto")
def offset_or_auto(text: str) -> float | None:
    """Read a number of seconds, or `auto`, which is None."""
    return None if text.strip() == "auto" else finite_number(text)


def record(
    source: str,
    output: str,
    shooting: Shooting,
    *,
    joints: Sequence[str] | None,
    degrees: bool,
    prismatic: Sequence[str],
    time_offset: float | None,
    still: float | None,
    max_gap: float,
) -> Recorded:
    """Make a log of pictures or a video, and draw what was seen if that is wanted."""
    from calib.recording.from_pictures import log_pictures
    from calib.recording.from_video import log_video
    from calib.recording.joint_table import read_joints
    from calib.recording.photo import read_photo, write_seen
    from calib.recording.pictures import list_pictures
    from calib.samples.tables import read_about

    setting, file = shooting.setting(output), str(shooting.joints_file)
    if shooting.camera is not None:
        from calib.recording.live import record_live

        file = str(record_live(shooting.camera, sys.stdin, Path(source), setting, note))
    chosen = list(joints) if joints else None
    table = read_joints(file, chosen, degrees=degrees, prismatic=prismatic)
    earlier = read_about(shooting.since) if shooting.since is not None else None
    if Path(source).is_file() and Path(source).suffix.lower() not in PICTURES:
        turns = tuple(name not in prismatic for name in table.names)
        ways: dict[str, Any] = {"time_offset": time_offset, "still": still, "max_gap": max_gap}
        made = log_video(source, table, setting, **ways, revolute=turns, since=earlier)
    else:
        if still is not None or time_offset is not None:
            raise BadOption("--still and --time-offset are for videos and bags, not for pictures")
        made = log_pictures(source, table, setting, since=earlier)
    say(made.notes)
    # named in the log, so that train can draw the map over it
    path = Path(source)
    if made.pictures is not None:
        named = {each.name: each for each in list_pictures(source)}
        path = named[made.pictures[len(made) // 2]]
    folder = Path(output).resolve().parent
    if output != "-" and path.resolve().is_relative_to(folder):
        name = path.resolve().relative_to(folder).as_posix()  # train finds it there
        made = replace(made, source={**made.source, "photo": name})
    if shooting.picture is not None:
        write_seen(shooting.picture, read_photo(path), setting, made.pixels)
    return made
