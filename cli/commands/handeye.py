"""The command `calib handeye`."""

from __future__ import annotations

import math
from typing import Annotated, Any

from typer import Argument, Option

from calib.common.choices import EYES, Eye

from .. import options as opt
from ..camera import need_joints
from ..output import Outcome, note, say
from ..parsing import check_file
from ..samples import Selection


def handeye(
    robot: opt.RobotFile,
    pictures: Annotated[str, Argument(metavar="PICTURES", help="Folder, pattern, LeRobotDataset.")],
    board: Annotated[
        str,
        Option(
            "--board", metavar="COLSxROWS:SQUARE:MARKER:DICT", help="Such as 7x5:24mm:18mm:5x5_100."
        ),
    ],
    eye: Annotated[
        Eye, opt.word("--eye", EYES, "hand: the camera is on the arm; base: it stands still.")
    ],
    joints_file: opt.JointsFile = None,
    camera: opt.DatasetCamera = None,
    joints: opt.JointNames = None,
    tip: opt.Tip = None,
    lock: opt.Lock = None,
    lens: Annotated[
        str | None, Option("--lens", metavar="SHOTS|lens.json", help="Default: fitted.")
    ] = None,
    output: Annotated[
        str | None, Option("--output", "-o", metavar="MODEL", help="Learn a model, too.")
    ] = None,
    transform: Annotated[
        str | None, Option("--transform", metavar="FILE", help="Both as static transforms.")
    ] = None,
    degrees: opt.Degrees = False,
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
    from calib.recording.board import Board
    from calib.recording.lens import load_lens

    arm = Selection(joints=joints, tip=tip, lock=lock, degrees=degrees).load(robot)
    need_joints(pictures, joints_file)
    known = None
    if lens is not None:
        known, said = load_lens(lens, Board.parse(board))
        say(said)
    found = calib.handeye(
        arm, pictures, joints_file, board, eye, lens=known, degrees=degrees, camera=camera
    )
    say(found.notes)
    carried, standing = ("camera", "board") if eye == "hand" else ("board", "camera")
    if output is not None:
        calib.train(found.poses).save(output)
    if transform is not None:
        from calib.common.atomic import atomic_write
        from calib.use.formats import hand_eye_transforms

        text = hand_eye_transforms(arm.urdf, arm.tip, eye, found.hand, found.base)
        atomic_write(transform, text.encode())
        note(f"where {carried} and {standing} are is in {transform}")
    reprojection = found.reprojection
    lines = [
        _place(f"{carried} in the frame of {arm.tip}", found.hand),
        _place(f"{standing} in the base frame", found.base),
        f"corners are predicted to {reprojection['mean']:.2g} px (largest "
        f"{reprojection['max']:.2g}); {found.used} of {found.pictures} pictures",
        f"lens: focal length {found.lens['focal']:.1f} ± {found.lens['focal_95']:.2g} px",
        f"limited by {found.limited_by}",
    ]
    document: Any = found.to_json()
    document["units"] = {"position": "m", "rotation": "rad", "reprojection": "px"}
    return Outcome(document, lines)


def _place(what: str, found: dict[str, Any]) -> str:
    at = ", ".join(
        f"{1e3 * value:.2f} ± {1e3 * half:.2g}"
        for value, half in zip(found["position"], found["position_95_up_to_gauge"], strict=True)
    )
    quaternion = ", ".join(f"{value:.5f}" for value in found["quaternion"])
    turn = math.degrees(max(found["rotation_95_up_to_gauge"]))
    return f"{what}: ({at}) mm, quaternion ({quaternion}) ± {turn:.2g} deg"
