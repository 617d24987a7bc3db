"""Kill real commands at random moments: afterwards the older file or the new one is whole.

    python benchmarks/kills.py --n 200

Each of `calib train`, `adapt`, `babble` and `report` overwrites a good older file and is ended
by SIGKILL. Half of the kills are spread evenly over the whole run; the other half strike while
the result is written: a few microseconds to milliseconds after the temporary file appears.
Afterwards the target has to be the older or the new file, byte for byte, and to load.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import calib
from calib.common.atomic import atomic_write

_LEFTOVERS = ".calib-*.tmp"


@dataclass(frozen=True)
class Victim:
    """A command that overwrites a file.

    Attributes
    ----------
    name : str
        What the command is called.
    command : list of str
        Its words.
    target : Path
        The file that it writes.
    old, new : bytes
        What the file is before and after a run that nobody disturbs.
    seconds : float
        How long such a run takes.
    loads : callable
        Raises if a file is not whole.
    """

    name: str
    command: list[str]
    target: Path
    old: bytes
    new: bytes
    seconds: float
    loads: Callable[[Path], object]


def run(command: list[str]) -> None:
    """Run a command line to its end."""
    subprocess.run([sys.executable, "-m", "calib_cli", *command], check=True, capture_output=True)


def prepare(folder: Path) -> list[Victim]:
    """Make the older files, and learn what the new ones are and how long they take."""
    size = ["--size", "20", "-n", "2000"]
    base = folder / "base.calib"
    run(["train", "two_link", *size, "-o", str(base)])
    log = folder / "changed.csv"
    run(["babble", "two_link", "-n", "60", "--change", "elbow.length=+5%", "-o", str(log)])

    def page(path: Path) -> None:
        text = path.read_text(encoding="utf-8")
        if not text.lstrip().startswith("<!") or not text.rstrip().endswith("</html>"):
            raise ValueError(f"{path}: not a whole page")

    arm = calib.load_arm("two_link")
    model = ["-o", "{}"]
    plans = {
        "train": (["train", "two_link", *size, *model], "m.calib", calib.load, ["--seed", "1"]),
        "adapt": (["adapt", str(base), "--data", str(log), *model], "a.calib", calib.load, None),
        "babble": (
            ["babble", "two_link", "-n", "50000", *model],
            "log.csv",
            lambda path: calib.read_log(path, arm),
            ["--seed", "1"],
        ),
        "report": (["report", str(base), *model], "r.html", page, None),
    }
    victims = []
    for name, (words, file, loads, other) in plans.items():
        target = folder / name / file
        target.parent.mkdir()
        command = [word.replace("{}", str(target)) for word in words]
        started = time.perf_counter()
        run(command)
        seconds = time.perf_counter() - started
        new = target.read_bytes()
        if other is not None:
            run([*command, *other])
            old = target.read_bytes()
        elif name == "adapt":
            old = base.read_bytes()
        else:  # a page that is whole and another one
            old = new.replace(b"</html>", b"<!-- older --></html>")
        if old == new:
            raise ValueError(f"{name}: the older file and the new one are the same")
        victims.append(Victim(name, command, target, old, new, seconds, loads))
    return victims


def kill(victim: Victim, delay: float | None, after: float) -> str:
    """Kill one run and return what became of the file.

    Parameters
    ----------
    victim : Victim
        What to run.
    delay : float or None
        When to kill [s]; None waits for the temporary file.
    after : float
        How long after that [s].
    """
    folder = victim.target.parent
    victim.target.write_bytes(victim.old)
    with subprocess.Popen(
        [sys.executable, "-m", "calib_cli", *victim.command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as process:
        if delay is not None:
            time.sleep(delay)
        else:
            known = set(folder.glob(_LEFTOVERS))
            while process.poll() is None and not set(folder.glob(_LEFTOVERS)) - known:
                time.sleep(1e-4)
        until = time.perf_counter() + after
        while time.perf_counter() < until:
            pass
        process.kill()
        code = process.wait()
    content = victim.target.read_bytes()
    if content not in (victim.old, victim.new):
        return "DAMAGED"
    victim.loads(victim.target)
    left = any(folder.glob(_LEFTOVERS))
    state = "new" if content == victim.new else "old"
    return f"{'done' if code == 0 else 'killed'}, {state}{', leftover' if left else ''}"


def main() -> None:
    """Kill, count, and print what became of the files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=200, help="kills")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    counts: dict[str, Counter[str]] = {}
    swept = 0
    with tempfile.TemporaryDirectory() as name:
        victims = prepare(Path(name))
        seconds = {victim.name: victim.seconds for victim in victims}
        killed = 0
        while killed < options.n:
            victim = victims[killed % len(victims)]
            spread = killed % (2 * len(victims)) < len(victims)
            delay = rng.uniform(0.0, seconds[victim.name]) if spread else None
            after = 0.0 if spread else 10 ** rng.uniform(-6.0, -1.5)
            outcome = kill(victim, delay, after)
            if spread and outcome.startswith("done"):  # the machine has less to do than before
                seconds[victim.name] = delay or 0.0
            phase = "any moment" if spread else "while writing"
            counts.setdefault(f"{victim.name}, {phase}", Counter())[outcome] += 1
            killed += not outcome.startswith("done")
            print(f"\r{killed} of {options.n}", end="", file=sys.stderr)
            # the next write into the folder tidies up
            atomic_write(victim.target.parent / "next", b"")
            swept += "leftover" in outcome
            if any(victim.target.parent.glob(_LEFTOVERS)):
                counts[f"{victim.name}, {phase}"]["LEFTOVER STAYED"] += 1
    print(file=sys.stderr)
    total = sum(counts.values(), Counter())
    bad = total["DAMAGED"] + total["LEFTOVER STAYED"]
    if options.json:
        print(json.dumps({"kills": killed, "bad": bad, "outcomes": counts}, indent=2))
    else:
        for place, outcomes in counts.items():
            print(f"{place:24}", ", ".join(f"{n} x {what}" for what, n in outcomes.most_common()))
        print(f"{killed} kills: {bad} damaged files; {swept} leftovers, all removed by the next")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
