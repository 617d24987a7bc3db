"""Pictures and videos for commands: logs that are made of them, and photos that are drawn over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import calib
from calib.common.choices import PICTURES, VIDEOS

from .logs import ANY_SENSOR, FOR_LOGS, LogFormat, log_of, sensor_of_log
from .output import say
from .parsing import BadOption

if TYPE_CHECKING:
    from calib.recording.motion_tables import JointTable
    from calib.recording.tag_scene import TagScene


def is_of_camera(name: str) -> bool:
    """Whether a name is that of pictures or a video."""
    is_pattern = bool(set("*?[") & set(name))
    return is_pattern or name.lower().endswith(VIDEOS + PICTURES)


def is_film(names: Sequence[str]) -> bool:
    """Whether the first of some names is a video."""
    first = Path(names[0])
    return first.is_file() and first.suffix.lower() not in PICTURES


def read_tag_scene(
    output: str,
    *,
    tag: int | None,
    dictionary: str,
    board: str | None,
    tags_at: str | None,
    lens: str | None,
    tag_size: str | None,
    tag_height: str | None,
) -> TagScene:
    """What is in pictures of a tag; a lens that is calibrated is written next to the log."""
    from calib.recording.board import CharucoPattern, parse_board, parse_length
    from calib.recording.lens import load_lens
    from calib.recording.reference import MarkLayout
    from calib.recording.tag_scene import TagScene

    if tag is None:
        raise BadOption(
            "--tag ID is missing: pictures and videos need it and --joints-file"
        )
    pattern = None if board is None else parse_board(board)
    marks = None if tags_at is None else MarkLayout.read(tags_at)
    known_lens = None
    if lens is not None:
        folder = Path() if output == "-" else Path(output).parent
        known_lens, notes = load_lens(lens, pattern, folder / "lens.json")
        say(notes)
        if marks is not None:
            pattern = None  # it served the lens alone
    if not isinstance(pattern, CharucoPattern | None):
        raise BadOption(
            f"--board {board}: on the desk expected a ChArUco board such as 7x5:24mm:18mm:5x5_100, "
            "of which each corner is known from the others"
        )
    return TagScene(
        tag,
        dictionary,
        pattern,
        marks,
        known_lens,
        None if tag_size is None else parse_length(tag_size, "`tag_size`"),
        parse_length(tag_height or "0mm", "`tag_height`", signed=True),
    )


def with_seen_picture(
    log: calib.Samples,
    sources: Sequence[str],
    output: str,
    scene: TagScene,
    picture: str | None,
) -> calib.Samples:
    """Draw what was seen in pictures or a video; a log in pixels names the photo next to it."""
    from calib.recording.pictures import list_pictures, read_photo
    from calib.recording.tag_scene import write_overlay

    path = Path(sources[0])
    if log.pictures is not None:
        paths = {path.name: path for path in list_pictures(sources)}
        path = paths[log.pictures[len(log) // 2]]
    if picture is not None and log.pixels is not None:
        write_overlay(picture, read_photo(path), scene, log.pixels)
    folder = Path(output).resolve().parent
    is_beside = output != "-" and path.resolve().is_relative_to(folder)
    if not is_beside or log.unit != "px":
        return log
    # named in the log, so that train can draw the map over it
    name = path.resolve().relative_to(folder).as_posix()
    return replace(log, source={**log.source, "photo": name})


def need_joints(source: str, joints: object) -> None:
    """Refuse pictures without their joints; a LeRobotDataset brings them."""
    from calib.recording.lerobot import is_dataset

    if joints is None and not is_dataset(source):
        raise BadOption(
            "--joints-file FILE is missing: pictures need the arm's joints"
        )


def record_board(
    source: str,
    joints: JointTable | None,
    names: Sequence[str] | None,
    board: str | None,
    eye: str,
    lens: str | None,
    camera: str | None,
) -> calib.Samples:
    """Make a log of pictures of a board.

    names : of a dataset's joints
    lens : its file or its pictures; fitted where there is none
    """
    from calib.recording.board_pictures import find_board
    from calib.recording.lens import load_lens

    if board is None:
        raise BadOption(
            "--eye needs --board COLSxROWS:SQUARE:MARKER:DICT, which is seen"
        )
    need_joints(source, joints)
    board_pictures = find_board(
        source, joints, board, camera=camera, names=names
    )
    known_lens = None
    if lens is not None:
        known_lens, notes = load_lens(lens, board_pictures.board)
        say(notes)
    log = board_pictures.log(known_lens or board_pictures.lens(), eye)
    say(log.notes)
    return log


def log_of_pictures(
    model: calib.Model,
    source: str,
    joints_file: str | None,
    camera: str | None,
    degrees: bool | None,
    sensor: str,
) -> calib.Samples:
    """Make a log of pictures, read as those of the model were.

    sensor : that took them, as typed
    """
    from calib.recording.board_pictures import find_board
    from calib.recording.lens import lens_of_model

    sensor = sensor_of_log(model, source, (), sensor)
    model = model.by(sensor)
    about = model.about
    board: Mapping[str, str] | None = about.board
    if board is None:
        raise BadOption(
            "the model was not made of pictures: expected --data of a log, and no --joints-file"
        )
    need_joints(source, joints_file)
    in_degrees = about.degrees if degrees is None else degrees
    board_pictures = find_board(
        source, joints_file, board["board"], about, camera, degrees=in_degrees
    )
    log = board_pictures.log(lens_of_model(model), board["eye"])
    say(log.notes)
    return replace(log, sensor=sensor)


def photo_of_log(
    model: calib.Model, log: calib.Samples, data: str
) -> calib.Model:
    """Return a model with the picture that its log names, if it lies next to or below the log."""
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
    sensor: str,
    photo: str | None,
    no_photo: bool,
) -> tuple[calib.Model | calib.HandEye, calib.Samples | None]:
    """Load a model or a rig as it is to be drawn, and a log of its own arm where one is given.

    sensor : that measured the log, as typed
    """
    from calib.recording.rig import is_rig, load_rig

    if data is None and sensor != ANY_SENSOR:
        raise BadOption(f"--in {FOR_LOGS}")
    if is_rig(path):
        if data is not None or photo is not None:
            raise BadOption(
                "a rig has no joints: expected neither --data nor --photo"
            )
        return load_rig(path), None
    model = calib.load(path)
    log = log_of(model, data, LogFormat(), sensor)
    if photo is not None:
        model = with_photo(model, photo, log)
    elif no_photo:
        model = replace(model, photo=None)
    return model, log


def with_photo(
    model: calib.Model, path: str, log: calib.Samples | None
) -> calib.Model:
    """Return a model with a photo, by the camera of the log."""
    from calib.recording.pictures import take_photo

    source = None if log is None else log.source
    unit = model.about.unit
    return replace(
        model, photo=take_photo(path, model.sensory.weights, unit, source)
    )


def size_of_page(path: str) -> str:
    """Return in one line what was written for a browser."""
    return f"{path}: {Path(path).stat().st_size / 1e6:.2f} MB, open it in a browser"
