"""Take the README's pictures of the preview and of the report, with a headless Chromium.

python docs/make_screenshots.py         # writes docs/img/preview.png and docs/img/report.png
"""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

from PIL import Image

import calib
from calib.model.model import Model

CHANGES = (
    "shoulder_lift.offset=0.0075",
    "elbow.offset=-0.0098",
    "wrist_1.offset=0.005",
    "elbow.length=+0.2%",
    "shoulder_lift.gear=1.001",
)
"""How the arm of the report differs from its drawing."""

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--hide-scrollbars",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--force-prefers-reduced-motion",
    "--blink-settings=preferredColorScheme=1",
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--virtual-time-budget=8000",
)


def photograph(source: Path, width: int, height: int) -> Image.Image:
    """Return what a browser shows of a page."""
    browser = next((path for name in NAMES if (path := shutil.which(name))), None)
    if browser is None:
        raise SystemExit("no Chromium here: apt-get install chromium")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "seen.png"
        subprocess.run(  # noqa: S603 - a browser found on this computer, no shell
            [
                browser,
                *OPTIONS,
                f"--user-data-dir={folder}/profile",
                f"--window-size={width},{height}",
                f"--screenshot={target}",
                source.as_uri(),
            ],
            check=True,
            capture_output=True,
            timeout=180,
        )
        return Image.open(io.BytesIO(target.read_bytes())).convert("RGB")


def main() -> None:
    """Train two arms, show one and report on the other, write both pictures."""
    out = Path(__file__).parent / "img"
    out.mkdir(exist_ok=True)
    babbled = calib.babble(calib.load_arm("two_link_full"), 20_000, seed=0, noise=1e-3)
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        calib.preview(calib.train(babbled, size=70), page)
        save(photograph(page, 1200, 680), out / "preview.png")
        calib.report(as_built(), page)
        save(photograph(page, 900, 560), out / "report.png")


def save(picture: Image.Image, path: Path) -> None:
    """Write a picture with 256 colours, which keeps it small."""
    picture.quantize(256, method=Image.Quantize.MEDIANCUT).save(path, optimize=True)


def as_built() -> Model:
    """A model of 300 rows of a six-joint arm that differs from its drawing, with 0.1 mm noise."""
    rows = calib.babble(calib.load_arm("six_axis"), 300, seed=0, noise=1e-4, changes=list(CHANGES))
    return calib.train(replace(rows, simulation=None))


if __name__ == "__main__":
    main()
