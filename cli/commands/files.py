"""The commands that write a model or show it: `urdf`, `export`, `report` and `preview`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from calib.common.wording import for_people

from .. import options as opt
from ..camera import Drawn
from ..options import Text, flag, option
from ..output import NO, Outcome, TextTable, fixed, note, number, say, sized
from ..parsing import BadOption, check_file
from ..units import units_of

if TYPE_CHECKING:
    from calib.use.geometry import Geometry

_ENDINGS = {
    "output": (".h", ".hpp"),
    "camera": (".yaml", ".yml"),
    "transform": (".json",),
    "ur": (".yaml", ".yml"),
    "mjcf": (".xml",),
}


def urdf(
    model: opt.ModelFile,
    *,
    output: Annotated[str, option("--output -o URDF", "The corrected description.")],
    view: opt.LogView = "auto",
    cause: opt.FrameOrJoints = "sensor",
    move_base: Annotated[bool, flag("--move-base", "Fit the first joint's place.")] = False,
    move_tip: Annotated[bool, flag("--move-tip", "The tip is sensed, no probe.")] = False,
) -> Outcome:
    """Write a copy of the URDF with the joint offsets and link placements that fit the model best.

    Only the numbers that change are rewritten. Exit code 3 if offsets and placements do not
    describe the model; then nothing is written.
    """
    import calib
    from calib.common.atomic import atomic_write
    from calib.use.frames import frame_notes
    from calib.use.geometry import fit_geometry
    from calib.use.urdf import MOST_UNEXPLAINED, check_output, corrected_urdf

    check_file(output, (".urdf", ".xml"))
    loaded = calib.load(model)
    check_output(output, loaded.about.urdf)
    geometry = fit_geometry(loaded, view=view, cause=cause, move_base=move_base, move_tip=move_tip)
    explained = geometry.residual <= MOST_UNEXPLAINED * geometry.reach
    if explained:
        atomic_write(output, corrected_urdf(geometry).encode())
    document = {
        "urdf": output if explained else None,
        **geometry.to_json(),
        "unit": geometry.unit,
        "units": {**units_of(loaded.about), "positions": geometry.unit},
    }
    if geometry.free:
        say(frame_notes(loaded, cause))
    share = 100.0 * geometry.residual / geometry.reach
    rms = f"{sized(geometry.residual, geometry.unit)} rms ({share:.3g} % of the reach)"
    if not explained:
        note(
            f"offsets and placements leave {rms} unexplained, more than {MOST_UNEXPLAINED:.0%}: "
            "nothing was written; check the joints, the tip and the unit of the log, and --view"
        )
        return Outcome(document, [_table(geometry)], code=NO)
    before = sized(geometry.before, geometry.unit)
    line = f"{output}: residual {rms}, with the nominal URDF {before}"
    return Outcome(document, [line, _table(geometry)])


def _table(geometry: Geometry) -> TextTable:
    import numpy as np

    told, arm = geometry.to_json(), geometry.arm
    found = [
        (name, "offset", kind, told["offsets"][name])
        for name, kind in zip(arm.joint_names, arm.units_of_joints, strict=True)
    ]
    ways = told.get("moved", {})
    found += [(name, "far end of its link, along {}", "m", each) for name, each in ways.items()]
    places = dict(told.get("places", {}))
    if "tip" in told:
        written = "" if told["tip"]["written"] else ", not written"
        places[f"sensed point{written}"] = told["tip"]
    for name, each in places.items():
        found += [(name, "origin along {}", "m", each["shift"])]
        found += [(name, "origin about {}", "rad", each["turn"])]
    found += [("base", "along {}", "m", told["base"])] if "base" in told else []
    rows = []
    for name, what, kind, each in found:
        factor, unit = for_people(kind)
        values, widths = np.ravel(each["value"]), np.ravel(each["interval"])
        for axis, value, width in zip("xyz", values.tolist(), widths.tolist(), strict=False):
            if width:  # what was fitted
                shown = fixed(factor * value, 4), number(factor * width)
                rows.append([name, what.format(axis), unit, *shown])
    return TextTable(["joint", "change of", "unit", "value", "+-"], rows, "against the URDF", 3)


def export(
    model: opt.ModelFile,
    *,
    output: Annotated[Text, option("--output -o FILE", "C header; JSON of --lerobot.")] = None,
    single: Annotated[bool, flag("--float", "Single precision.")] = False,
    prefix: Annotated[str, option("--prefix NAME", "Prefix of every name in C.")] = "calib_",
    camera: Annotated[Text, option("--camera FILE.yaml", "The lens as ROS camera_info.")] = None,
    transform: Annotated[Text, option("--transform FILE.json", "The sensor in the base.")] = None,
    lerobot: Annotated[Text, option("--lerobot OLD.json", "LeRobot's: -o has new zeros.")] = None,
    ur: Annotated[Text, option("--ur FILE.yaml", "Kinematics of a UR, as ROS reads them.")] = None,
    mjcf: Annotated[Text, option("--mjcf FILE.xml", "Bodies, joints, tip for MuJoCo.")] = None,
) -> Outcome:
    """Write a model as one C99 header for controllers, or files for ROS, LeRobot and MuJoCo."""
    import calib
    from calib.common.atomic import atomic_write

    wanted = {"output": output, "camera": camera, "transform": transform, "ur": ur, "mjcf": mjcf}
    paths = {name: path for name, path in wanted.items() if path is not None}
    if not paths:
        raise BadOption(
            "nothing to write: expected -o FILE.h, --camera, --transform, --ur or --mjcf FILE"
        )
    endings = _ENDINGS if lerobot is None else {**_ENDINGS, "output": (".json",)}
    for name, path in paths.items():
        check_file(path, endings[name], option=f"--{name}")
    from calib.use import formats
    from calib.use.lerobot import homed
    from calib.use.ur import ur_kinematics

    loaded, document = calib.load(model), dict[str, Any](model=model)
    made: dict[str, tuple[str, str]] = {}  # text, and what it is; all before anything is written
    if lerobot is not None and output is None:
        raise BadOption("--lerobot needs -o NEW.json, where the corrected calibration goes")
    if {lerobot, ur, mjcf} != {None}:
        corrected, document["offsets"] = formats.corrected_arm(loaded)
        if ur is not None:
            made["ur"] = ur_kinematics(corrected, loaded.about.tip), "kinematics of a UR"
        if mjcf is not None:
            made["mjcf"] = formats.mjcf_text(corrected, loaded.about.tip), "bodies for MuJoCo"
        if lerobot is not None:
            text, document["ticks"] = homed(lerobot, document["offsets"])
            made["output"] = text, f"homing offsets moved by {document['ticks']} ticks"
            say(["the ends of the motors' ranges move with their zeros: drive to them with care"])
    if output is not None and lerobot is None:
        text, tables = formats.c_header(loaded, prefix=prefix, single=single)
        document |= {"bytes": len(text), "table_bytes": tables}
        size = f"tables of {tables / 1024:.1f} kB, {len(text) / 1e3:.0f} kB text"
        made["output"] = text, f"{'float' if single else 'double'}, {size}"
    if camera is not None:
        made["camera"] = formats.camera_info(loaded), "camera_info"
    if transform is not None:
        made["transform"] = formats.static_transform(loaded), "static transform"
    for name, (text, _) in made.items():
        # names of joints may hold any letter, a C99 compiler need not take them in comments
        ascii_alone = name == "output" and lerobot is None
        atomic_write(paths[name], text.encode(*(("ascii", "replace") if ascii_alone else ())))
    lines = [f"{path}: {made[name][1]}" for name, path in paths.items()]
    return Outcome(document | paths, lines)


def report(
    model: opt.ModelFile,
    *,
    output: Annotated[Text, option("--output -o FILE.html", "One file.")] = None,
    png: Annotated[Text, option("--png DIR", "Its figures as PNG.")] = None,
    drawn: Drawn,
) -> Outcome:
    """Write figures and tables that explain a calibration."""
    if output is None and png is None:
        raise BadOption("nothing to write: expected -o FILE.html, or --png DIR, or both")
    check_file(output, (".html", ".htm"))
    loaded, log = drawn.load(model)
    import calib
    from calib.common.atomic import atomic_write
    from calib.show.report.figures import to_png

    lines = []
    if output is not None:
        calib.report(loaded, output, log)
        lines.append(_page(output))
    if png is not None:
        folder = Path(png)
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in calib.figures(loaded, log).items():
            path = folder / f"{name}.png"
            atomic_write(path, to_png(figure))
            lines.append(str(path))
    return Outcome({"output": output, "png": png}, lines)


def preview(
    model: opt.ModelFile,
    *,
    html: Annotated[Text, option("--html FILE", "Write the page for any browser.")] = None,
    drawn: Drawn,
    port: Annotated[int, option("--port N", "Of the page (0: any).", min=0, max=65535)] = 0,
    no_open: Annotated[bool, flag("--no-open", "Print the address alone.")] = False,
    live: Annotated[bool, flag("--live", "Drag a target, see all its solutions.")] = False,
) -> Outcome:
    """Show the arm and its learned maps in a browser, with meshcat."""
    import calib

    if live and html is not None:
        raise BadOption("--live needs a running preview: expected it without --html")
    check_file(html, (".html", ".htm"), option="--html")
    loaded, log = drawn.load(model)
    how: dict[str, Any] = {"live": live, "port": port, "browse": not no_open}
    with calib.preview(loaded, html, log, **how) as shown:
        say(shown.notes)
        if html is not None:
            return Outcome({"html": html, "bytes": Path(html).stat().st_size}, [_page(html)])
        try:
            print(shown.url, flush=True)
            note("showing the preview; Ctrl-C ends it")
            while True:
                time.sleep(0.2)  # so often it looks whether it shall end [s]
        except KeyboardInterrupt:
            note("ended")
    return Outcome({"url": shown.url})


def _page(path: str) -> str:
    return f"{path}: {Path(path).stat().st_size / 1e6:.2f} MB, open it in a browser"
