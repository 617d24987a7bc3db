"""The command `calib babble`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from typer import Option

from .. import options as opt
from ..output import Outcome
from ..parsing import TABLES, check_file
from ..samples import Babbling, Selection
from ..samples import babbled_samples as babbled

if TYPE_CHECKING:
    pass


def babble(
    robot: opt.RobotFile,
    output: Annotated[
        str,
        Option(
            "--output",
            "-o",
            metavar="LOG",
            help="CSV, or Parquet by its name (- stdout).",
        ),
    ],
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
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Write a log of simulated babbling [rad, m]."""
    selection = Selection(
        joints=joints, tip=tip, planar=planar, lock=lock, ranges=ranges, degrees=degrees
    )
    babbling = Babbling(samples=samples, noise=noise, change=change)
    import calib

    check_file(output, TABLES, stream=True)
    log = babbled(robot, selection, babbling, seed)
    calib.write_log(log, output)
    turning = zip(log.joint_names, log.revolute, strict=True)
    document = {
        "log": output,
        "robot": log.arm.name if log.arm else None,
        "joints": log.joint_names,
        "samples": len(log),
        "seed": seed,
        "noise": babbling.noise or 0.0,
        "changes": babbling.change or [],
        "unit": log.unit,
        "units": {
            "joints": {name: "rad" if turns else "m" for name, turns in turning},
            "positions": log.unit,
        },
    }
    line = f"{len(log)} rows of {', '.join([*log.joint_names, *log.axes])} [rad, m]"
    return Outcome(document, [f"{output}: {line}"])
