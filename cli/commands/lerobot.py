"""The command `calib lerobot`."""

from __future__ import annotations

import math
from typing import Annotated, Any

from typer import Argument, Option

from calib.common.choices import EYES, Eye

from .. import options as opt
from ..output import Outcome, TextTable, fixed, number, say
from ..parsing import check_file
from ..samples import Selection


def lerobot(
    dataset: Annotated[
        str,
        Argument(
            metavar="DATASET", help="The folder of a LeRobotDataset with a board in it."
        ),
    ],
    calibration: Annotated[
        str,
        Option(
            "--calibration",
            metavar="FILE",
            help="LeRobot's calibration.json of this arm.",
        ),
    ],
    board: Annotated[
        str, Option("--board", metavar="BOARD", help="Such as 7x5:24mm:18mm:5x5_100.")
    ],
    output: Annotated[
        str,
        Option("--output", "-o", metavar="NEW.json", help="The corrected calibration."),
    ],
    eye: Annotated[
        Eye,
        opt.word(
            "--eye", EYES, "hand: the camera is on the arm; base: it stands still."
        ),
    ] = "hand",
    robot: Annotated[
        str | None,
        Option("--robot", metavar="ROBOT", help="Default: the kind of the data set."),
    ] = None,
    camera: opt.DatasetCamera = None,
    model: Annotated[
        str | None,
        Option("--model", metavar="MODEL", help="Keep what was learned, too."),
    ] = None,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Correct the zeros of a LeRobot arm's motors from pictures of a board.

    The drawing's geometry is trusted: horns that sit a few degrees off are what is found. Joints
    that are shares of their motors' ranges are read by the calibration.
    """
    check_file(output, (".json",))
    check_file(model, (".calib",), option="--model")
    import calib
    from calib.common.atomic import atomic_write
    from calib.recording.lerobot import Dataset, read_dataset
    from calib.recording.motors import Motors
    from calib.use.lerobot import homed, zeros

    kind = Dataset.read(dataset).robot
    arm = Selection().load(robot or kind.split("_")[0] or None)
    motors = Motors.read(calibration)
    table, frames, notes = read_dataset(dataset, arm.joint_names, camera, motors)
    say(notes)
    rig = calib.handeye(arm, frames, table, board, eye)
    say(rig.notes)
    assert rig.poses is not None  # noqa: S101 - of joints there is a log
    learned = calib.train(rig.poses)
    offsets = zeros(learned)
    text, ticks = homed(
        calibration, {name: zero.offset for name, zero in offsets.items()}
    )
    if model is not None:
        learned.save(model)
    atomic_write(output, text.encode())
    say(
        [
            "the ends of the motors' ranges move with their zeros: drive to them with care"
        ]
    )
    document: dict[str, Any] = {
        "output": output,
        "offsets": {name: zero.to_json() for name, zero in offsets.items()},
        "ticks": ticks,
        "hand": rig.hand,
        "base": rig.base,
        "units": {"offsets": "rad", "position": "m", "rotation": "rad"},
    }
    rows = []
    for name, zero in offsets.items():
        old = motors.motors[name].homing_offset
        deviation = number(math.degrees(zero.interval))
        size = fixed(math.degrees(zero.offset), 2)
        rows.append([name, size, deviation, str(old), str(old + ticks[name])])
    header = ["joint", "zero is off by [deg]", "+-", "homing offset was", "is"]
    free = [name for name in arm.joint_names if name not in offsets]
    line = f"{output}: {len(offsets)} zeros corrected"
    if free:
        line += f"; {' and '.join(free)} stay, since no picture tells theirs"
    return Outcome(document, [line, TextTable(header, rows, left=1)])
