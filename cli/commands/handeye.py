"""Find camera and board from pictures of a board that the arm took, or held.

The arm's own errors are found with them. Positions have 95 % intervals. Exit code 3 if --eye is
doubtful, or the model of -o contradicts its own bound.
"""

from __future__ import annotations

from typing import Annotated

from typer import Argument

import calib
from calib.common.choices import EYES, ROTATIONS
from calib.use import assessment

from .. import options as opt
from ..logs import Selection
from ..output import Outcome, as_typed, note, say
from ..parsing import BadOption, check_file, refuse
from ..pictures import need_joints

UNITS = {
    "position": "m",
    "rotation": "rad",
    "reprojection": "px",
    "held_out": "px",
    "square": "m",
}


def handeye(
    names: Annotated[
        list[str],
        Argument(
            metavar="[ROBOT] PICTURES",
            help="A URDF or a bundled robot, unless --poses-file is given; then a folder or "
            "pattern, a folder with a folder for each camera, or a LeRobotDataset.",
        ),
    ],
    board: Annotated[str, opt.value("--board BOARD", opt.BOARD)],
    eye: Annotated[
        str,
        opt.value(
            "--eye hand|base",
            "hand: the camera is on the arm; base: it stands still; of several cameras "
            "left=hand,right=base.",
        ),
    ],
    joints_file: opt.JointsFile = None,
    poses_file: Annotated[
        str | None,
        opt.value(
            "--poses-file FILE", "Flange poses of a controller, as it has them."
        ),
    ] = None,
    camera: opt.DatasetCamera = None,
    joints: opt.JointNames = None,
    tip: opt.Tip = None,
    lock: opt.Lock = None,
    lens: Annotated[
        str | None,
        opt.value(
            "--lens SHOTS|FILE",
            "Pictures of the board, a file of calib, ROS or OpenCV, or a model (default: "
            "fitted).",
        ),
    ] = None,
    output: Annotated[
        str | None,
        opt.value(
            "--output -o MODEL", "Write the rig, or with joints a model."
        ),
    ] = None,
    transform: Annotated[
        str | None,
        opt.value("--transform FILE", "Write all places as static transforms."),
    ] = None,
    degrees: opt.Degrees = False,
    unit: Annotated[
        str | None,
        opt.value("--unit m|mm|..", "Unit of the poses (default: found)."),
    ] = None,
    rotation: Annotated[
        str | None,
        opt.value(
            "--rotation KIND",
            f"Kind of rotations: {', '.join(ROTATIONS)}, or axes such as ZYZ (default: found).",
        ),
    ] = None,
) -> Outcome:
    from calib.recording.board import parse_board
    from calib.recording.lens import load_lens

    check_file(output, (".calib",), option="-o")
    check_file(transform, (".json",), option="--transform")
    pictures = names[-1]
    arm = None
    if poses_file is not None:
        if len(names) != 1:
            raise BadOption("--poses-file takes PICTURES alone: no ROBOT")
        of_robot = {
            "joints_file": joints_file,
            "joints": joints,
            "tip": tip,
            "lock": lock,
        }
        refuse(of_robot, "is of ROBOT, which --poses-file replaces")
    else:
        if len(names) != 2:
            raise BadOption(
                f"{len(names)} names: expected ROBOT PICTURES, or PICTURES with --poses-file"
            )
        refuse({"unit": unit, "rotation": rotation}, "is of --poses-file")
        selection = Selection(joints, tip, lock=lock, degrees=degrees)
        arm = selection.load(names[0])
        need_joints(pictures, joints_file)
    known_lens = None
    if lens is not None:
        known_lens, notes = load_lens(lens, parse_board(board))
        say(notes)
    rig = calib.handeye(
        arm,
        pictures,
        joints_file,
        board,
        _eyes(eye),
        poses=poses_file,
        lens=known_lens,
        degrees=degrees if arm is not None else degrees or None,
        camera=camera,
        unit=unit,
        rotation=rotation,
    )
    doubts = [rig.eye_doubt] if rig.eye_is_doubtful else []
    say(words for words in rig.notes if words not in doubts)
    warnings = [] if output is None else _save(rig, output)
    warnings += map(as_typed, doubts)
    if transform is not None:
        _write_transforms(rig, transform)
    document = {**rig.to_json(), "units": UNITS}
    return Outcome(document, rig.lines(), warnings=warnings)


def _write_transforms(rig: calib.HandEye, path: str) -> None:
    """Write where cameras and board are, for ROS and for people."""
    from calib.common.atomic import atomic_write
    from calib.recording.rig import transform_files

    for file, text in transform_files(rig, path).items():
        atomic_write(file, text.encode())
        note(f"where all is stands in {file}")


def _save(rig: calib.HandEye, path: str) -> list[str]:
    """Write a rig, or the model of its joints; return what contradicts the model's bound."""
    if rig.poses is None:
        rig.save(path)
        return []
    model = calib.train(rig.poses)
    model.save(path)
    return assessment.bound_warnings(model.about)


def _eyes(text: str) -> str | dict[str, str]:
    """Return where the camera is, or each of several."""
    if "=" in text:
        pairs = [pair.partition("=") for pair in text.split(",")]
        return {name.strip(): eye.strip() for name, _, eye in pairs}
    if text not in EYES:
        raise BadOption(f"--eye {text!r}: expected {' or '.join(EYES)}")
    return text
