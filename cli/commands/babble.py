"""The command `calib babble`."""

from __future__ import annotations

from ..options import takes
from ..output import Notes, note, show_json, tell
from ..parsing import JointRange, JointValue, Names
from ..samples import Selection, babbled
from ..usage import choice, one_document, option

STRATEGIES = ("uniform", "goal")


@takes(
    output=option("--output -o LOG", "CSV, or Parquet by its name (- standard output)."),
    strategy=choice(
        "--strategy",
        STRATEGIES,
        "Next joints at random, or next targets where the map's own error is largest.",
    ),
)
def babble(
    robot: str,
    output: str,
    samples: int | None = None,
    joints: Names | None = None,
    tip: str | None = None,
    planar: bool = False,
    lock: list[JointValue] | None = None,
    ranges: list[JointRange] | None = None,
    noise: float | None = None,
    seed: int = 0,
    motion: str | None = None,
    change: list[str] | None = None,
    strategy: str = "uniform",
    degrees: bool = False,
    as_json: bool = False,
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
