"""Train on every robot of PyPI's example-robot-data and write down what happened.

python docs/make_robots.py              # writes docs/robots.md; some five minutes
"""

from __future__ import annotations

import io
import json
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pinocchio
from calib_cli.app import app

import calib

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from reference import pinocchio_forward, random_joints

PAGE = Path(__file__).parent / "robots.md"
PACKAGE = "example-robot-data"
ROBOTS = Path(pinocchio.__file__).parents[4] / "share" / PACKAGE / "robots"
SIZE, SAMPLES, POSES = 20, 2000, 200
ARM = re.compile(r"--joints (\S+) --tip ([^\s;]+)")
RANGE = re.compile(r"--range (\S+)=LOWER:UPPER")
BAR = 1e-9  # largest distance to Pinocchio [m]

INTRODUCTION = """\
# Real robots

Written by `python docs/make_robots.py`; edit that, not this page.

What `calib train FILE --size {size} --samples {samples}` does with each of the {files} URDF files
of [{package}](https://github.com/Gepetto/example-robot-data) {version} (PyPI; meshes are not
needed). Nothing is said about joints or tip: where there is one arm that reaches further than
the others it is taken and said aloud, an arm before its fingers. Where several reach alike (two
arms, four legs) the command lists them, ends with exit code 1 and trains nothing; the table then
gives the first of the list, trained with the options that the list prints. `calib train` has
{trained} files trained at once, {listed} after choosing from its list, {refused} refused.

*Error* is the mean forward error on 10,000 fresh exact samples, *Pinocchio* the largest distance
over {poses} random poses to the frame placements that Pinocchio computes from the same file: at
most {worst:.1e} m, the bar is {bar:.0e} m. The maps are small and the samples without noise, so the
errors say that the trend can represent the arm, and nothing about a real one. Locked joints are at
neutral, `--lock` moves them; which joints share a plane depends on it.
"""


@dataclass(frozen=True)
class Outcome:
    """What became of one file; `error` and `gap` are NaN and [m] where nothing was trained."""

    name: str
    said: str
    joints: tuple[str, ...] = ()
    tip: str = ""
    error: float = np.nan
    gap: float = np.nan

    @property
    def trained(self) -> bool:
        """Whether a model came of it, at once or after choosing."""
        return bool(self.joints)


def calib_train(path: Path, *options: str) -> tuple[dict[str, object] | None, str]:
    """Return the document of `calib train`, or None, and what it said on standard error."""
    out, err = io.StringIO(), io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        words = ["train", str(path), "--size", str(SIZE), "--samples", str(SAMPLES), *options]
        with redirect_stdout(out), redirect_stderr(err):
            code = app([*words, "-o", f"{folder}/m.calib", "--json"], standalone_mode=False)
    document = json.loads(out.getvalue()) if code == 0 else None
    lines = [line for line in err.getvalue().splitlines() if line.startswith("error: ")]
    if (document is None) != (len(lines) == 1):
        raise SystemExit(f"{path.name}: expected a model or one line, got {err.getvalue()!r}")
    return document, lines[0].removeprefix(f"error: {path.name}: ") if lines else ""


def exercise(path: Path) -> Outcome:
    """Train on a file as it is, or as its refusal says."""
    name = str(path.relative_to(ROBOTS))
    document, said = calib_train(path)
    first = ARM.search(said)
    if document is None and first:
        document, _ = calib_train(path, "--joints", first[1], "--tip", first[2])
    elif document is None and (asked := RANGE.findall(said)):
        ranges = [word for joint in asked for word in ("--range", f"{joint}=-1:1")]
        document, _ = calib_train(path, *ranges)
    if document is None:
        return Outcome(name, said)
    joints, tip = tuple(document["joints"]), str(document["tip"])
    ranges = {joint: (-1.0, 1.0) for joint in RANGE.findall(said)}
    arm = calib.load_arm(path, joints, tip, ranges=ranges)
    q = random_joints(arm, POSES)
    gap = float(np.abs(arm.forward(q) - pinocchio_forward(arm, q)).max())
    error = document["errors"]["local"]["forward"]["distance"]["mean"]
    return Outcome(name, said, joints, tip, float(error), gap)


def short(said: str) -> str:
    """Say in a few words why nothing was trained at once."""
    several = re.match(r"the robot has (\d+) planar arms", said)
    if several:
        return f"{several[1]} arms, listed"
    return "no room to move" if RANGE.search(said) else "refused" if said else "trained"


def rows(outcomes: list[Outcome]) -> Iterator[str]:
    """Yield the table, a row for each file."""
    yield "| file | at once | joints | tip | error [mm] | Pinocchio [m] |"
    yield "|---|---|---|---|---:|---:|"
    for found in outcomes:
        name, first = f"`{found.name}`", f"{short(found.said)}"
        if not found.trained:
            yield f"| {name} | {first} | | | | |"
            continue
        joints = ", ".join(f"`{joint}`" for joint in found.joints)
        error = "< 1e-6" if found.error < 1e-9 else f"{1e3 * found.error:.2g}"
        yield f"| {name} | {first} | {joints} | `{found.tip}` | {error} | {found.gap:.1e} |"


def page(outcomes: list[Outcome]) -> str:
    """Return the whole page."""
    trained = [found for found in outcomes if found.trained]
    told = [found for found in outcomes if found.said]
    head = INTRODUCTION.format(
        size=SIZE,
        samples=f"{SAMPLES}",
        package=PACKAGE,
        version=version(PACKAGE),
        files=len(outcomes),
        trained=sum(not found.said for found in outcomes),
        listed=sum(bool(found.said) for found in trained),
        refused=len(outcomes) - len(trained),
        poses=POSES,
        worst=max(found.gap for found in trained),
        bar=BAR,
    )
    lines = [f"- `{found.name}`: {found.said}" for found in told]
    # the option names in these lines are long: one item per file
    said = "\n".join(lines)
    return "\n".join(
        [head, *rows(outcomes), "", "## What was said", "",
         "The one line of each file that was not trained at once, after its name.", "", said, ""]
    )  # fmt: skip


def main() -> None:
    """Go through all files, hold the bar, write the page."""
    files = sorted(ROBOTS.rglob("*.urdf"))
    if not files:
        raise SystemExit(f"no robots in {ROBOTS}: pip install {PACKAGE}")
    outcomes = []
    for path in files:
        outcomes.append(exercise(path))
        print(outcomes[-1], flush=True)
    far = [found.name for found in outcomes if found.gap > BAR]
    if far:
        raise SystemExit(f"further than {BAR} m from Pinocchio: {', '.join(far)}")
    PAGE.write_text(page(outcomes), encoding="utf-8")


if __name__ == "__main__":
    main()
