"""Find which of several models fits the arm. Exit code 3 if none fits."""

from typing import Annotated

from typer import Argument

import calib
from calib.common.wording import error_size, for_people

from .. import options as opt
from ..logs import ANY_SENSOR, LogFormat, log_for
from ..output import EXIT_ACT, Outcome, TextTable
from ..units import units_of


def recognise(
    models: Annotated[
        list[str],
        Argument(metavar="MODEL..", help="A model for each state of the arm."),
    ],
    data: opt.NewLog,
    sensor: opt.OfSensor = ANY_SENSOR,
) -> Outcome:
    loaded = [calib.load(path) for path in models]
    log = log_for(loaded[0], data, LogFormat(), sensor)
    result = calib.recognise(loaded, log)
    name = None if result.index is None else models[result.index]
    about = loaded[0].by(log.sensor).about
    factor, shown = for_people(about.unit)
    fits = []
    rows = []
    for fit in result.fits:
        fits.append({"model": models[fit.index], **vars(fit)})
        sizes = error_size(fit.score), error_size(factor * fit.distance)
        rows.append([models[fit.index], *sizes, "fits" if fit.fits else ""])
    header = ["model", "score", f"rms distance [{shown}]", ""]
    table = TextTable(header, rows, f"{result.samples} samples of {data}")
    verdict = f"{name} fits" if name else "none of the models fits"
    alike = sum(fit.fits for fit in result.fits) - 1
    if alike > 0:
        verdict += f" best, but these rows do not contradict {alike} more"
    document = {
        "model": name,
        "samples": result.samples,
        "fits": fits,
        "unit": about.unit,
        "units": units_of(about),
    }
    return Outcome(document, [verdict, table], code=0 if name else EXIT_ACT)
