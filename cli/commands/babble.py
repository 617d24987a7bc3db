"""The command `calib babble`."""

from __future__ import annotations

from typing import Annotated

from .. import options as o
from ..output import Notes, note, show_json, tell
from ..samples import Selection, babbled
from ..usage import choice, one_document, option

STRATEGIES = ("uniform", "goal")


def babble(
    robot: o.RobotArgument,
    output: Annotated[
        str, option("--output -o LOG", "CSV, or Parquet by its name (- standard output).")
    ],
    samples: o.SamplesOption = None,
    joints: o.JointsOption = None,
    tip: o.TipOption = None,
    planar: o.PlanarOption = False,
    lock: o.LockOption = None,
    ranges: o.RangeOption = None,
    noise: o.NoiseOption = None,
    seed: o.SeedOption = 0,
    motion: o.MotionOption = None,
    change: o.ChangeOption = None,
    strategy: Annotated[
        str,
        choice(
            "--strategy",
            STRATEGIES,
            "Next joints at random, or next targets where the map's own error is largest.",
        ),
    ] = "uniform",
    degrees: o.DegreesOption = False,
    as_json: o.JsonOption = False,
) -> None:
    """Write a log of simulated babbling [rad, m]."""
    import calib

    one_document(output, as_json)
    log = babbled(
        Selection(robot, joints, tip, lock or (), ranges or (), degrees, planar),
        samples=samples,
        noise=noise,
        motion=motion,
        changes=change or (),
        seed=seed,
        notes=Notes(),
        strategy=strategy,
    )
    calib.write_log(log, output)
    if as_json:
        turning = zip(log.joint_names, log.revolute, strict=True)
        kinds = {name: "rad" if turns else "m" for name, turns in turning}
        show_json(
            {
                "log": output,
                "robot": log.arm.name if log.arm else None,
                "joints": log.joint_names,
                "samples": len(log),
                "seed": seed,
                "noise": noise or 0.0,
                "changes": change or [],
                "unit": log.unit,
                "units": {"joints": kinds, "positions": log.unit},
            }
        )
        return
    columns = ", ".join([*log.joint_names, *log.axes])
    line = f"{len(log)} rows of {columns} [rad, m]"
    if output == "-":
        note(line)
    else:
        tell(f"{output}: {line}")
