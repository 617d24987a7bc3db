"""The command `calib handeye`."""

from __future__ import annotations

from typing import Annotated, Any

from typer import Argument, Option

from calib.common.choices import EYES, ROTATIONS

from .. import options as opt
from ..camera import need_joints
from ..output import Outcome, note, say
from ..parsing import BadOption, check_file
from ..samples import Selection


def handeye(
    names: Annotated[
        list[str],
        Argument(
            metavar="[ROBOT] PICTURES",
            help="A URDF or a bundled robot, unless --poses-file is given; then a folder or "
            "pattern, a folder with a folder for each camera, or a LeRobotDataset.",
        ),
    ],
    board: Annotated[str, Option("--board", metavar="BOARD", help=opt.BOARD)],
    eye: Annotated[
        str,
        Option(
            "--eye",
            metavar="hand|base",
            help="hand: the camera is on the arm; base: it stands still; of several cameras "
            "left=hand,right=base.",
        ),
    ],
    joints_file: opt.JointsFile = None,
    poses_file: Annotated[
        str | None,
        Option(
            "--poses-file",
            metavar="FILE",
            help="Flange poses of a controller, as it has them.",
        ),
    ] = None,
    camera: opt.DatasetCamera = None,
    joints: opt.JointNames = None,
    tip: opt.Tip = None,
    lock: opt.Lock = None,
    lens: Annotated[
        str | None,
        Option(
            "--lens",
            metavar="SHOTS|FILE",
            help="Pictures of the board, a file of calib, ROS or OpenCV, or a model (default: "
            "fitted).",
        ),
    ] = None,
    output: Annotated[
        str | None,
        Option("--output", "-o", metavar="MODEL", help="Learn a model, too."),
    ] = None,
    transform: Annotated[
        str | None,
        Option("--transform", metavar="FILE", help="All as static transforms."),
    ] = None,
    degrees: opt.Degrees = False,
    unit: Annotated[
        str | None,
        Option("--unit", metavar="m|mm|..", help="Of the poses (default: found)."),
    ] = None,
    rotation: Annotated[
        str | None,
        Option(
            "--rotation",
            metavar="KIND",
            help=f"Of the poses: {', '.join(ROTATIONS)}, or axes such as ZYZ (default: found).",
        ),
    ] = None,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Find camera and board from pictures of a board that the arm took, or held.

    The arm's own errors are found with them. Positions have 95 % intervals.
    """
    check_file(output, (".calib",), option="-o")
    check_file(transform, (".json",), option="--transform")
    import calib
    from calib.recording.board import parse_board
    from calib.recording.lens import load_lens

    arm = None
    pictures = names[-1]
    if poses_file is not None:
        if len(names) != 1 or joints_file is not None or output is not None:
            raise BadOption(
                "--poses-file takes PICTURES alone: no ROBOT, no --joints-file, and no -o, since a "
                "model needs joints"
            )
    else:
        if len(names) != 2:
            raise BadOption(
                f"{len(names)} names: expected ROBOT PICTURES, or PICTURES with --poses-file"
            )
        arm = Selection(joints=joints, tip=tip, lock=lock, degrees=degrees).load(
            names[0]
        )
        need_joints(pictures, joints_file)
    known = None
    if lens is not None:
        known, notes = load_lens(lens, parse_board(board))
        say(notes)
    rig = calib.handeye(
        arm,
        pictures,
        joints_file,
        board,
        _eyes(eye),
        poses=poses_file,
        lens=known,
        degrees=degrees if arm is not None else degrees or None,
        camera=camera,
        unit=unit,
        rotation=rotation,
    )
    say(rig.notes)
    if output is not None and rig.poses is not None:
        calib.train(rig.poses).save(output)
    if transform is not None:
        from calib.common.atomic import atomic_write
        from calib.recording.transforms import transform_files

        for path, text in transform_files(rig, transform).items():
            atomic_write(path, text.encode())
            note(f"where all is stands in {path}")
    document: Any = rig.to_json()
    document["units"] = {
        "position": "m",
        "rotation": "rad",
        "reprojection": "px",
        "held_out": "px",
        "square": "m",
    }
    return Outcome(document, rig.lines())


def _eyes(text: str) -> str | dict[str, str]:
    """Where the camera is, or each of several."""
    if "=" not in text:
        if text not in EYES:
            raise BadOption(f"--eye {text!r}: expected {' or '.join(EYES)}")
        return text
    pairs = [pair.partition("=") for pair in text.split(",")]
    return {name.strip(): eye.strip() for name, _, eye in pairs}
