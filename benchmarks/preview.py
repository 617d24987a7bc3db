"""Measure preview and report: time to build, size, frames per second of a rotation.

    python benchmarks/preview.py [--size 70] [--json FILE]

Frames are drawn one after the other by a headless Chromium with software rendering, 900x700
pixels, each read back so that it is finished before the next begins.
"""

import argparse
import json
import re
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import calib
from calib.model.model import Model

RUNS = 3
FRAMES = 90
ROTATION = """
<script>
window.addEventListener("load", () => {
  const { viewer } = calib;
  const gl = viewer.renderer.getContext();
  const pixel = new Uint8Array(4);
  const up = new MeshCat.THREE.Vector3(0, 1, 0);
  const times = [];
  viewer.animator.pause();
  viewer.set_3d_pane_size(900, 700);
  viewer.controls.dispatchEvent({ type: "start" });  // as when a hand turns it
  for (let k = 0; k < FRAMES; k += 1) {
    const start = performance.now();
    viewer.camera.position.sub(viewer.controls.target).applyAxisAngle(up, 0.03)
      .add(viewer.controls.target);
    viewer.render();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    times.push(performance.now() - start);
  }
  times.sort((a, b) => a - b);
  document.title = `median ${times[FRAMES / 2]} slow ${times[Math.floor(0.9 * FRAMES)]} ms `
    + `${viewer.renderer.domElement.width}x${viewer.renderer.domElement.height}`;
});
</script>
""".replace("FRAMES", str(FRAMES))


def train(size: int) -> Model:
    """Train two_link with 1 mm of noise, so that errors have a structure to draw."""
    samples = calib.babble(calib.load_arm("two_link"), max(20_000, 5 * size**2), noise=1e-3)
    return calib.train(samples, size=size)


def timed(work: Any) -> tuple[float, Any]:
    """Return the median time [s] of some runs, and the result of the last."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - start)
    return statistics.median(times), result


def build(model: Model, what: Any = calib.preview) -> str:
    """Build the page of a preview or of a report."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        what(model, path)
        return path.read_text(encoding="utf-8")


def rotate(page: str) -> dict[str, float] | None:
    """Frames per second of a rotation, None where there is no Chromium."""
    names = ("chromium", "chromium-browser", "google-chrome", "chrome")
    browser = next((path for name in names if (path := shutil.which(name))), None)
    if browser is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        path.write_text(page.replace("</body>", ROTATION + "</body>"), encoding="utf-8")
        options = [
            "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
            "--disable-background-networking", "--use-gl=angle", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader", "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--user-data-dir={folder}/profile", "--window-size=900,700", "--dump-dom",
        ]  # fmt: skip
        done = subprocess.run(
            [browser, *options, path.as_uri()],
            capture_output=True, text=True, check=False, timeout=300,
        )  # fmt: skip
    found = re.search(r"<title>median ([\d.]+) slow ([\d.]+) ms (\d+)x(\d+)", done.stdout)
    if found is None:
        raise SystemExit(f"the page did not draw: {done.stderr[-500:]}")
    median, slow = float(found[1]), float(found[2])
    return {
        "width": int(found[3]), "height": int(found[4]),
        "fps_median": 1e3 / median, "fps_slowest_tenth": 1e3 / slow,
    }  # fmt: skip


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=70, help="nodes along each side")
    parser.add_argument("--json", metavar="FILE", help="write the figures, too")
    arguments = parser.parse_args()
    model = train(arguments.size)
    start = time.perf_counter()
    first = build(model)
    cold = time.perf_counter() - start
    seconds, page = timed(lambda: build(model))
    assert page == first
    start = time.perf_counter()
    told = build(model, calib.report)
    report_cold = time.perf_counter() - start
    result = {
        "size": arguments.size,
        "preview_first_s": cold,
        "preview_s": seconds,
        "preview_mb": len(page.encode()) / 1e6,
        "rotation": rotate(page),
        "report_first_s": report_cold,
        "report_s": timed(lambda: build(model, calib.report))[0],
        "report_mb": len(told.encode()) / 1e6,
    }
    print(json.dumps(result, indent=2))
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
