"""Take the README's pictures of the preview and of the report, with a headless Chromium.

python docs/make_screenshots.py         # writes docs/img/preview.png and docs/img/report.png
"""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

import calib
from calib.model.model import Model

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
    """Train two arms with 1 mm of noise, show them, write both pictures."""
    out = Path(__file__).parent / "img"
    out.mkdir(exist_ok=True)
    full, paper = (train(robot) for robot in ("two_link_full", "two_link"))
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        calib.preview(full, page)
        save(photograph(page, 1200, 680), out / "preview.png")
        calib.report(paper, page)
        save(photograph(page, 900, 1190), out / "report.png")


def save(picture: Image.Image, path: Path) -> None:
    """Write a picture with 256 colours, which keeps it small."""
    picture.quantize(256, method=Image.Quantize.MEDIANCUT).save(path, optimize=True)


def train(robot: str) -> Model:
    """Train a bundled robot."""
    samples = calib.babble(calib.load_arm(robot), 20_000, seed=0, noise=1e-3)
    return calib.train(samples, size=70)


if __name__ == "__main__":
    main()
