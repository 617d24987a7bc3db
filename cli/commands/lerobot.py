"""Correct the zeros of a LeRobot arm's motors from pictures of a board.

The drawing's geometry is trusted: horns that sit a few degrees off are what is found. Joints
that are shares of their motors' ranges are read by the calibration. Exit code 3 if what was
learned contradicts its own bound.
"""

from __future__ import annotations

import math
from typing import Annotated

from typer import Argument

import calib
from calib.common.wording import error_size
from calib.use import assessment

from .. import options as opt
from ..logs import Selection
from ..output import Outcome, TextTable, say, with_decimals
from ..parsing import check_file


def lerobot(
    dataset: Annotated[
        str,
        Argument(
            metavar="DATASET",
            help="The folder of a LeRobotDataset with a board in it.",
        ),
    ],
    calibration: Annotated[
        str,
        opt.value(
            "--calibration FILE", "LeRobot's calibration.json of this arm."
        ),
    ],
    board: Annotated[
        str, opt.value("--board BOARD", "Such as 7x5:24mm:18mm:5x5_100.")
    ],
    output: Annotated[
        str, opt.value("--output -o NEW.json", "The corrected calibration.")
    ],
    eye: opt.OneEye = "hand",
    robot: Annotated[
        str | None,
        opt.value("--robot ROBOT", "Default: the kind of the data set."),
    ] = None,
    camera: opt.DatasetCamera = None,
    model: Annotated[
        str | None, opt.value("--model MODEL", "Keep what was learned, too.")
    ] = None,
) -> Outcome:
    from calib.common.atomic import atomic_write
    from calib.recording.handeye import best_rig
    from calib.recording.lerobot import Dataset, Motors, read_dataset
    from calib.use.lerobot import RANGES_MOVE, with_corrected_zeros, zeros_of

    check_file(output, (".json",))
    check_file(model, (".calib",), option="--model")
    kind = Dataset.read(dataset).robot
    arm = Selection().load(robot or kind.split("_")[0] or None)
    motors = Motors.read(calibration)
    tables, frames, notes = read_dataset(
        dataset, arm.joint_names, camera, motors
    )
    say(notes)
    unit, rig = best_rig(arm, frames, tables, board, eye)
    say([f"joints are read as {unit}", *rig.notes])
    assert rig.poses is not None  # noqa: S101 - of joints there is a log
    learned = calib.train(rig.poses)
    zeros = zeros_of(learned)
    text, ticks = with_corrected_zeros(calibration, zeros)
    if model is not None:
        learned.save(model)
    atomic_write(output, text.encode())
    say([RANGES_MOVE])
    document = {
        "output": output,
        "offsets": {
            name: {"offset": zero.value, "interval": zero.interval}
            for name, zero in zeros.items()
        },
        "ticks": ticks,
        "hand": rig.hand,
        "base": rig.base,
        "units": {"offsets": "rad", "position": "m", "rotation": "rad"},
    }
    rows = []
    for name, zero in zeros.items():
        old = int(motors.document[name]["homing_offset"])
        offset = with_decimals(math.degrees(zero.value), 2)
        interval = error_size(math.degrees(zero.interval))
        rows.append([name, offset, interval, str(old), str(old + ticks[name])])
    header = ["joint", "zero is off by [deg]", "+-", "homing offset was", "is"]
    line = f"{output}: {len(zeros)} zeros corrected"
    unknown = [name for name in arm.joint_names if name not in zeros]
    if unknown:
        line += f"; {' and '.join(unknown)} stay, since no picture shows theirs"
    warnings = assessment.bound_warnings(learned.about)
    table = TextTable(header, rows)
    return Outcome(document, [line, table], warnings=warnings)
