"""The command `calib babble`: write a log of simulated babbling [rad, m]."""

from __future__ import annotations

from typing import Annotated

from .. import options as opt
from ..options import option
from ..output import Outcome
from ..parsing import TABLES, check_file
from ..samples import Babbling, Selection, babbled_samples


def babble(
    robot: opt.RobotFile,
    *,
    output: Annotated[str, option("--output -o LOG", "CSV, or Parquet by its name (- stdout).")],
    babbling: Babbling,
    selection: Selection,
    seed: opt.Seed = 0,
) -> Outcome:
    """Write a log of simulated babbling [rad, m]."""
    import calib

    check_file(output, TABLES, stream=True)
    log = babbled_samples(robot, selection, babbling, seed)
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
