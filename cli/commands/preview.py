"""Show the arm and its learned maps in a browser, with meshcat."""

import time
from pathlib import Path
from typing import Annotated

import calib

from .. import options as opt
from ..logs import ANY_SENSOR
from ..output import PRINT_MODE, Outcome, note
from ..parsing import check_file, whole
from ..pictures import load_drawn, size_of_page


def preview(
    model: opt.ModelFile,
    html: Annotated[
        str | None, opt.value("--html FILE", "Write the page for any browser.")
    ] = None,
    data: opt.Data = None,
    sensor: opt.OfSensor = ANY_SENSOR,
    photo: opt.PhotoFile = None,
    no_photo: opt.NoPhoto = False,
    port: Annotated[
        int, opt.value("--port N", "Of the page (0: any).", whole(0, 65535))
    ] = 0,
    no_open: Annotated[
        bool, opt.option("--no-open", "Print the address alone.")
    ] = False,
) -> Outcome:
    check_file(html, (".html", ".htm"), option="--html")
    loaded, log = load_drawn(model, data, sensor, photo, no_photo)
    browse = not no_open
    with calib.preview(loaded, html, log, port=port, browse=browse) as page:
        if html is not None:
            document = {"html": html, "bytes": Path(html).stat().st_size}
            return Outcome(document, [size_of_page(html)])
        try:
            # a document follows at the end
            if not PRINT_MODE.as_json:
                print(page.url, flush=True)
            note(f"showing the preview at {page.url}; Ctrl-C ends it")
            while True:
                time.sleep(0.2)  # so often it looks whether it shall end [s]
        except KeyboardInterrupt:
            note("ended")
    return Outcome({"url": page.url})
