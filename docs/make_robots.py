"""Train on every robot of PyPI's example-robot-data and write down what happened.

python docs/make_robots.py              # writes docs/robots.md; some ten minutes
"""

from __future__ import annotations

import io
import json
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pinocchio
from calib_cli.app import run

import calib

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from reference import pinocchio_forward, random_joints

PAGE = Path(__file__).parent / "robots.md"
PACKAGE = "example-robot-data"
ROBOTS = Path(pinocchio.__file__).parents[4] / "share" / PACKAGE / "robots"
POSES = 200
ARM = re.compile(r"--joints (\S+) --tip ([^\s;]+)")
RANGE = re.compile(r"--range (\S+)=LOWER:UPPER")
BAR = 1e-12  # largest distance to Pinocchio [m], of arms of a metre

INTRODUCTION = """\
# Real robots

Written by `python docs/make_robots.py`; edit that, not this page.

This page is for users who wonder whether calib reads their URDF. It shows the result of
`calib train FILE`, without further options, for each of the {files}
URDF files of [{package}](https://github.com/Gepetto/example-robot-data) {version} (PyPI, without
meshes). If limits are missing, the command asks for ranges and ends with exit code 1; the table
then gives the result with ranges from -1 to 1. Of the files {trained} were
trained at once, {listed} with ranges, and {refused} were refused. {spatial} of the arms are
spatial, {planar} planar.

The largest distance to the positions that Pinocchio computes from the same files, over {poses}
random poses, is {worst:.1e} m (at most {bar:.0e} m is accepted). The largest mean forward error on
10,000 new exact samples is {error} mm: the body can represent these arms. The slowest command took
{slowest:.0f} s of processor time, half of them less than {median:.1f} s.
"""

SAID = """\
## Messages

These are the messages for the files that were not trained at once. The six refusals are right: the
two pendulums have no frame beyond `link2`, whose origin is on the axis of `joint2`; the four rotors
of `iris` are in parallel; `iris_simple` and `quadrotor_base` have no movable joints; `ur3.urdf` is
the empty result of a macro.
"""


ARMS = """\
## Each arm

Processor time of the command [s], and mean error on new exact samples [mm]:
"""


@dataclass(frozen=True)
class Outcome:
    """What became of one file, and each line that said what to add to the command.

    Where nothing was trained, `error` and `gap` are NaN [m].
    """

    name: str
    said: tuple[str, ...]
    joints: tuple[str, ...] = ()
    tip: str = ""
    error: float = np.nan
    gap: float = np.nan
    spatial: bool = False
    seconds: float = np.nan

    @property
    def trained(self) -> bool:
        """Whether a model came of it, at once or after doing as was said."""
        return bool(self.joints)


def calib_train(path: Path, *options: str) -> tuple[dict[str, object] | None, str]:
    """Return the document of `calib train`, or None, and what it said on standard error."""
    out, err = io.StringIO(), io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        words = ["train", str(path), *options]
        with redirect_stdout(out), redirect_stderr(err):
            code = run([*words, "-o", f"{folder}/m.calib", "--json"])
    document = json.loads(out.getvalue()) if code in (0, 3) else None
    lines = [line for line in err.getvalue().splitlines() if line.startswith("error: ")]
    if (document is None) != (len(lines) == 1):
        raise SystemExit(f"{path.name}: expected a model or one line, got {err.getvalue()!r}")
    return document, lines[0].removeprefix(f"error: {path.name}: ") if lines else ""


def exercise(path: Path) -> Outcome:
    """Train on a file as it is, or by doing as its refusals say."""
    name = str(path.relative_to(ROBOTS))
    said: list[str] = []
    options: list[str] = []
    while True:
        begun = time.process_time()
        document, line = calib_train(path, *options)
        seconds = time.process_time() - begun
        if document is not None:
            break
        said.append(line)
        added = obeyed(line)
        if not added or len(said) > 3:
            return Outcome(name, tuple(said))
        options += added
    joints, tip = tuple(document["joints"]), str(document["tip"])
    ranges = dict.fromkeys(RANGE.findall(" ".join(said)), (-1.0, 1.0))
    arm = calib.load_arm(path, joints, tip, ranges=ranges)
    q = random_joints(arm, POSES)
    gap = float(np.abs(arm.forward(q) - pinocchio_forward(arm, q)).max())
    error = document["errors"]["local"]["forward"]["distance"]["mean"]
    gap /= max(1.0, arm.chain.reach)
    return Outcome(name, tuple(said), joints, tip, float(error), gap, arm.outputs == 3, seconds)


def obeyed(line: str) -> list[str]:
    """Return the options that a refusal asks for: the first arm, ranges from -1 to 1."""
    arm = ARM.search(line)
    if arm:
        return ["--joints", arm[1], "--tip", arm[2]]
    return [word for joint in RANGE.findall(line) for word in ("--range", f"{joint}=-1:1")]


def short(said: tuple[str, ...]) -> str:
    """Say in a few words why nothing was trained at once."""
    words = []
    for line in said:
        several = re.match(r"the robot has (\d+) planar arms", line)
        words.append(
            f"{several[1]} arms, listed"
            if several
            else "asks for ranges"
            if RANGE.search(line)
            else "refused"
        )
    return "; ".join(words) or "trained"


def rows(outcomes: list[Outcome]) -> Iterator[str]:
    """Yield the table, a row for each file that was not trained at once."""
    yield "| file | at once | in | joints | tip |"
    yield "|---|---|---|---:|---|"
    for found in (found for found in outcomes if found.said):
        name, first = f"`{found.name}`", f"{short(found.said)}"
        if not found.trained:
            yield f"| {name} | {first} | | | |"
            continue
        joints = str(len(found.joints))
        where = "space" if found.spatial else "plane"
        yield f"| {name} | {first} | {where} | {joints} | `{found.tip}` |"


def page(outcomes: list[Outcome]) -> str:
    """Return the whole page."""
    trained = [found for found in outcomes if found.trained]
    told = [found for found in outcomes if found.said]
    largest = max(1e3 * found.error for found in trained)  # [mm]
    head = INTRODUCTION.format(
        package=PACKAGE,
        version=version(PACKAGE),
        files=len(outcomes),
        trained=sum(not found.said for found in outcomes),
        listed=sum(bool(found.said) for found in trained),
        refused=len(outcomes) - len(trained),
        spatial=sum(found.spatial for found in trained),
        planar=sum(not found.spatial for found in trained),
        poses=POSES,
        worst=max(found.gap for found in trained),
        bar=BAR,
        error="below 1e-6" if largest < 1e-6 else f"{largest:.2g}",
        slowest=max(found.seconds for found in trained),
        median=float(np.median([found.seconds for found in trained])),
    )
    width = max(len(found.name) for found in trained)
    arms = [
        f"{found.name:<{width}} {found.seconds:5.1f} {1e3 * found.error:8.1e}" for found in trained
    ]
    said = [f"- `{found.name}`: {line}" for found in told for line in found.said]
    table = rows(outcomes)
    return "\n".join([head, *table, "", SAID, *said, "", ARMS, "```text", *arms, "```", ""])


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
