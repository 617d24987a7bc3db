"""The commands of cameras and recordings: `calib log`, `calib handeye` and `calib tag`."""

from __future__ import annotations

from typing import Annotated, Any

from typer import Argument

from calib.common.choices import DICTIONARY, EYES, ROTATIONS
from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..camera import Shooting, need_joints
from ..options import Text, option
from ..output import Outcome, note, say
from ..parsing import TABLES, BadOption, above_zero, check_file
from ..samples import Selection, refuse


def log(
    bag: Annotated[
        list[str],
        Argument(
            metavar="BAG|PICTURES|VIDEO|DATASET",
            help="A ROS bag, a folder or files, a video; with --eye a LeRobotDataset.",
        ),
    ],
    *,
    output: Annotated[str, option("--output -o LOG", "The log: CSV or Parquet.")],
    joints_topic: Annotated[Text, option("--joints-topic TOPIC", "JointState, if several.")] = None,
    tip_topic: Annotated[Text, option("--tip-topic TOPIC", "Points, poses, tf if several.")] = None,
    frames: Annotated[Any, option("--frames SENSOR,TIP", "Of tf, if many.", parsing.names)] = None,
    joints: opt.JointNames = None,
    max_gap: Annotated[float, option("--max-gap S", "Between joint states [s].", above_zero)] = 0.1,
    still: Annotated[
        Any, option("--still V", "Drop rows that move faster [rad/s].", above_zero)
    ] = None,
    time_offset: opt.TimeOffset = None,
    shooting: Shooting,
    degrees: opt.Degrees = False,
    prismatic: opt.Prismatic = None,
) -> Outcome:
    """Turn a ROS bag, pictures or a video into a log of joints and positions.

    Exit code 3 if no clock offset, or more than one, fits a video to its joints.
    """
    from calib.samples.logs import write_log
    from calib.samples.roles import log_columns

    check_file(output, TABLES, stream=True)
    slides = prismatic or ()
    bags: dict[str, Any] = {"joints_topic": joints_topic, "tip_topic": tip_topic, "frames": frames}
    timed: dict[str, Any] = {"max_gap": max_gap, "still": still, "time_offset": time_offset}
    if shooting.taken(bag):
        refuse(bags, "is for bags, not for pictures and videos")
        made = shooting.record(bag, output, joints, timed, degrees=degrees, prismatic=slides)
        factor, shown = for_people(made.unit)
        kinds = f"[rad, {made.unit}]"
        noise = factor * float(made.source["noise"])
        kinds += f", noise {noise:.2g} {shown}" if noise else ""
    else:
        from calib.recording.bags import read_bag

        if len(bag) > 1:
            raise BadOption(f"{len(bag)} names are for pictures: expected one bag")
        if frames is not None and len(frames) != 2:
            raise BadOption("--frames names two frames: expected SENSOR,TIP")
        made = read_bag(bag[0], **bags, **timed, joints=joints)
        say(made.notes)
        kinds = "[rad, m, s]"
    write_log(made, output)
    names = made.joint_names
    units = {name: "m" if name in slides else "rad" for name in names}
    document = {"log": output, "joints": names, "samples": len(made), "unit": made.unit}
    document |= made.source
    document["units"] = {"joints": units, "positions": made.unit, "time": "s"}
    line = f"{len(made)} rows of {', '.join(log_columns(made))} {kinds}"
    return Outcome(document, [f"{output}: {line}"])


def handeye(
    names: Annotated[
        list[str],
        Argument(
            metavar="[ROBOT] PICTURES",
            help="A URDF or a bundled robot, unless --poses-file is given; a folder or pattern, a "
            "folder with a folder for each camera, or a LeRobotDataset.",
        ),
    ],
    *,
    board: Annotated[str, option("--board BOARD", opt.BOARD)],
    eye: Annotated[
        str, option("--eye hand|base", "Where the camera is; of several: left=hand,right=base.")
    ],
    joints_file: opt.JointsFile = None,
    poses_file: Annotated[
        Text, option("--poses-file FILE", "Flange poses of a controller, in any convention.")
    ] = None,
    camera: opt.DatasetCamera = None,
    joints: opt.JointNames = None,
    tip: opt.Tip = None,
    lock: opt.Lock = None,
    lens: Annotated[Text, option("--lens SHOTS|FILE", opt.LENS)] = None,
    output: Annotated[Text, option("--output -o MODEL", "Learn a model, too.")] = None,
    transform: Annotated[Text, option("--transform FILE", "All as static transforms.")] = None,
    degrees: opt.Degrees = False,
    unit: Annotated[Text, option("--unit m|mm|..", "Of the poses (default found).")] = None,
    rotation: Annotated[
        Text, option("--rotation KIND", f"Of the poses: {', '.join(ROTATIONS)} (default found).")
    ] = None,
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
        arm = Selection(joints=joints, tip=tip, lock=lock, degrees=degrees).load(names[0])
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
    tip_name = "the flange" if arm is None else arm.tip
    if transform is not None:
        from calib.arm.urdf import parse_urdf
        from calib.common.atomic import atomic_write
        from calib.recording.transforms import transform_files

        frames = ("base", "flange") if arm is None else (parse_urdf(arm.urdf).root, arm.tip)
        for path, text in transform_files(rig, *frames, transform).items():
            atomic_write(path, text.encode())
            note(f"where all is stands in {path}")
    document: Any = rig.to_json()
    document["units"] = {
        "position": "m", "rotation": "rad", "reprojection": "px", "held_out": "px", "square": "m"
    }  # fmt: skip
    return Outcome(document, rig.lines(tip_name))


def _eyes(text: str) -> str | dict[str, str]:
    """Where the camera is, or each of several."""
    if "=" not in text:
        if text not in EYES:
            raise BadOption(f"--eye {text!r}: expected {' or '.join(EYES)}")
        return text
    pairs = [pair.partition("=") for pair in text.split(",")]
    return {name.strip(): eye.strip() for name, _, eye in pairs}


def tag(
    number: Annotated[int | None, Argument(metavar="ID", min=0, help="Number of the tag.")] = None,
    *,
    output: Annotated[str, option("--output -o FILE.svg", "The page to print.")],
    size: Annotated[str, option("--size 40mm", "Side of the black square.")] = "40mm",
    dictionary: opt.Dictionary = DICTIONARY,
    board: opt.BoardSpec = None,
) -> Outcome:
    """Write a tag for the arm's tip, or a board for the desk, to print at its true size (SVG)."""
    from calib.common.atomic import atomic_write
    from calib.recording.board import parse_board, parse_length, print_board, print_tag

    if (number is None) == (board is None):
        raise BadOption("expected the ID of a tag, or --board, and not both")
    check_file(output, (".svg",), stream=True)
    if board is not None:
        made = parse_board(board)
        page = print_board(made)
        width, height = (1e3 * side for side in made.size)
        what = f"a board of {width:g} x {height:g} mm"
    else:
        side = parse_length(size, "`size`")
        page = print_tag(int(number or 0), side, dictionary)
        what = f"tag {number} of {dictionary}, {1e3 * side:g} mm"
    line = f"{output}: {what}; print it at 100 % and check the line of 100 mm"
    if output == "-":
        print(page, end="")
    else:
        atomic_write(output, page.encode())
    return Outcome({"output": output, "what": what}, [line])
