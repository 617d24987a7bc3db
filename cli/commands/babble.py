"""The command `calib babble`: write a log of simulated babbling [rad, m]."""

from __future__ import annotations

from ..options import takes
from ..output import Notes, conclude
from ..samples import Babbling, Selection, babbled_samples
from ..usage import one_document, option


@takes(
    output=option("--output -o LOG", "CSV, or Parquet by its name (- standard output)."),
)
def babble(
    *,
    robot: str,
    output: str,
    babbling: Babbling,
    selection: Selection,
    seed: int = 0,
    as_json: bool = False,
) -> None:
    """Write a log of simulated babbling [rad, m]."""
    import calib

    one_document(output, as_json)
    log = babbled_samples(robot, selection, babbling, seed, Notes())
    calib.write_log(log, output)
    turning = zip(log.joint_names, log.revolute, strict=True)
    units = {"joints": {name: "rad" if turns else "m" for name, turns in turning}}
    document = {
        "log": output,
        "robot": log.arm.name if log.arm else None,
        "joints": log.joint_names,
        "samples": len(log),
        "seed": seed,
        "noise": babbling.noise or 0.0,
        "changes": babbling.change or [],
        "unit": log.unit,
        "units": {**units, "positions": log.unit},
    }
    columns = ", ".join([*log.joint_names, *log.axes])
    line = f"{len(log)} rows of {columns} [rad, m]"
    conclude(output, line, (), document if as_json else None)
