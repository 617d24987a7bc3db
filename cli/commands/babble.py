"""Write a log of simulated babbling [rad, m]."""

import calib
from calib.common.wording import by_name

from .. import options as opt
from ..logs import Selection, babble_log
from ..output import Outcome
from ..parsing import TABLES, check_file


def babble(
    robot: opt.RobotFile,
    output: opt.NewTable,
    samples: opt.Number = None,
    noise: opt.Noise = None,
    change: opt.Changes = None,
    joints: opt.JointNames = None,
    tip: opt.Tip = None,
    planar: opt.Planar = False,
    lock: opt.Lock = None,
    ranges: opt.Ranges = None,
    degrees: opt.Degrees = False,
    seed: opt.Seed = 0,
) -> Outcome:
    selection = Selection(joints, tip, planar, lock, ranges, degrees)
    check_file(output, TABLES, stream=True)
    log = babble_log(robot, selection, samples, noise, change, seed)
    calib.write_log(log, output)
    names = log.joint_names
    units = ["rad" if turns else "m" for turns in log.revolute]
    document = {
        "log": output,
        "robot": log.arm.name if log.arm else None,
        "joints": names,
        "samples": len(log),
        "seed": seed,
        "noise": noise or 0.0,
        "changes": change or [],
        "unit": log.unit,
        "units": {"joints": by_name(names, units), "positions": log.unit},
    }
    line = f"{len(log)} rows of {', '.join([*names, *log.axes])} [rad, m]"
    return Outcome(document, [f"{output}: {line}"])
