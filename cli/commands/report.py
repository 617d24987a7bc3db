"""Write how accurate a calibration is, what is off, where and why, as one page.

Exit code 3, with the page written, if the model's own rows contradict its bound.
"""

from pathlib import Path
from typing import Annotated

import calib
from calib.use import assessment

from .. import options as opt
from ..logs import ANY_SENSOR
from ..output import Outcome, progress
from ..parsing import BadOption, bad_value, check_file
from ..pictures import load_drawn, size_of_page


def report(
    model: opt.ModelFile,
    output: Annotated[
        str | None, opt.value("--output -o FILE.html", "One file.")
    ] = None,
    png: Annotated[
        str | None, opt.value("--png DIR", "Its figures as PNG.")
    ] = None,
    figures: Annotated[
        str | None, opt.value("--figures FOLDER", "Its figures as SVG.")
    ] = None,
    data: opt.Data = None,
    sensor: opt.OfSensor = ANY_SENSOR,
    photo: opt.PhotoFile = None,
    no_photo: opt.NoPhoto = False,
) -> Outcome:
    from calib.common.atomic import atomic_write
    from calib.show.report.drawing import to_file

    if output is None and png is None and figures is None:
        raise BadOption(
            "nothing to write: expected -o FILE.html, --figures FOLDER or --png DIR"
        )
    check_file(output, (".html", ".htm"))
    for option, folder in (("--png", png), ("--figures", figures)):
        if folder is not None and Path(folder).is_file():
            raise bad_value(folder, "a folder", option)
    loaded, log = load_drawn(model, data, sensor, photo, no_photo)
    warnings = []
    if isinstance(loaded, calib.Model):
        warnings = assessment.bound_warnings(loaded.about)
    lines: list[str] = []
    if output is not None:
        lines.append(calib.report(loaded, output, log, progress=progress))
        lines.append(size_of_page(output))
    for kind, folder in (("png", png), ("svg", figures)):
        if folder is None:
            continue
        Path(folder).mkdir(parents=True, exist_ok=True)
        for name, figure in calib.figures(loaded, log).items():
            path = Path(folder) / f"{name}.{kind}"
            atomic_write(path, to_file(figure, kind))
            lines.append(str(path))
    document = {"output": output, "png": png, "figures": figures}
    return Outcome(document, lines, warnings=warnings)
