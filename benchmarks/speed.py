"""Speed beside peers: training of maps, whole commands; tables of docs/performance.md.

    python benchmarks/speed.py [--quick] [--only SECTION ...] [--peers PEER ...] [--sides N ...]

SECTION: maps (training of self-organizing maps to a quality, beside other libraries), processes
(whole commands); queries are those of inverse.py and realtime.py.  Peers that are not installed are
left out, aloud.  The quality of a map is the mean distance of fresh samples to their winners over
the bound 0.377 sqrt(A / N) of a perfect hexagonal lattice of N nodes on the area A.  The least
training that reaches it is searched for each peer first, up to an hour for all of
`map_peers.PEERS`; every training runs in a process of its own, after a tiny one that loads and
compiles what there is.
"""

import argparse
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import map_peers
import numpy as np
from map_peers import OURS, PEERS, Peer, Setting
from tables import number, table

ROOT = Path(__file__).parents[1]
FASTEST = ("calib", "sparse-som", "numbasom")
BOUND = 0.377
NEAR = 0.02  # within so much of a goal the median of three seeds decides
SEEDS = 5
CAP = 20.0  # [s] of the longest training


@dataclass(frozen=True)
class Race:
    """One lattice: nodes along a side, samples at hand, qualities to be reached."""

    side: int
    rows: int
    goals: tuple[float, ...]


RACES = (Race(30, 100_000, (1.10, 1.06)), Race(70, 100_000, (1.10, 1.06)),
         Race(200, 200_000, (1.08,)))  # fmt: skip
QUICK = (Race(10, 4000, (1.20,)),)

# peer: radii (start over the side, end), the better ones of several tried on 30x30
_RADII = {
    "sparse-som": ((0.5, 0.3), (0.5, 0.5)),
    "sparse-som batch": ((0.5, 0.3),),
    "MiniSom": ((0.5, 0.5), (0.5, 0.3)),
}
_STEPS = (5, 6, 7, 8, 10, 12, 14, 17, 20, 24, 28, 34, 40, 48, 56, 68, 80, 96, 110)  # per node
_PASSES = (7, 10, 14, 20, 28, 40)
_ROWS = (5, 10, 20)  # per node, of the peers' batch maps
_OURS = (2, 2.5, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20)


def grid(peer: Peer, race: Race) -> list[Setting]:
    """Settings to try, the cheapest first."""
    nodes = race.side**2
    if peer == OURS:
        return [Setting(round(k * nodes)) for k in _OURS if k * nodes <= race.rows]
    radii = [(a * race.side, b) for a, b in _RADII.get(peer.name, ((0.0, 0.0),))]
    if peer.online:
        settings = [Setting(race.rows, k * nodes, *r) for r in radii for k in _STEPS]
    else:
        rows = {min(race.rows, k * nodes) for k in _ROWS}
        settings = [Setting(n, k, *r) for r in radii for n in rows for k in _PASSES]
    return sorted(settings, key=lambda s: s.rounds if peer.online else s.rows * max(1, s.rounds))


def area(arm: Any) -> float:
    """Area of two_link's positions [m^2]: the integral of a b sin(elbow), each reached once."""
    a, b = arm.link_lengths.values()
    turn = arm.upper[0] - arm.lower[0]
    return float(a * b * turn * (np.cos(arm.lower[1]) - np.cos(arm.upper[1])))


def one(task: dict[str, Any]) -> dict[str, Any]:
    """One training, in this process: its time, its memory and how good the map is."""
    from scipy.spatial import cKDTree

    peer, setting = map_peers.by_name(task["peer"]), Setting(**task["setting"])
    u, fresh = np.load(task["samples"]), np.load(task["fresh"])
    side, seed = task["side"], task["seed"]
    few = Setting(200) if peer == OURS else Setting(200, 50 if peer.online else 2, 2.0, 0.5)
    prepared, _ = spent(lambda: map_peers.train(peer, u[:200], 5, few, seed))
    before = peak_mb()
    cpu, weights = spent(lambda: map_peers.train(peer, u, side, setting, seed))
    memory = peak_mb()
    distance, index = cKDTree(weights).query(fresh, k=2)
    steps = np.abs(np.subtract(*(np.stack(np.divmod(i, side)) for i in index.T))).max(axis=0)
    return {
        "cpu": cpu, "first_s": prepared, "peak_mb": memory, "before_mb": before,
        "ratio": float(distance[:, 0].mean()) / task["bound"],
        "topographic": float(np.mean(steps > 1)),
    }  # fmt: skip


class Course:
    """The samples of one race as files, and trainings on them."""

    def __init__(self, race: Race, folder: Path) -> None:
        import calib

        arm = calib.load_arm("two_link")
        x = calib.babble(arm, race.rows + 20_000, seed=1).x
        span = np.ptp(x, axis=0)
        u = (x - x.min(axis=0)) / span
        self.race, self.folder = race, folder
        self.bound = BOUND * float(np.sqrt(area(arm) / span.prod() / race.side**2))
        for name, values in (("samples", u[: race.rows]), ("fresh", u[race.rows :])):
            np.save(folder / f"{name}{race.side}.npy", values)

    def run(self, peer: Peer, setting: Setting, seed: int = 0) -> dict[str, Any] | None:
        """Train once, in a fresh process; None where it fails or takes too long."""
        side = self.race.side
        task = {"peer": peer.name, "setting": asdict(setting), "side": side, "seed": seed}
        task |= {n: str(self.folder / f"{n}{side}.npy") for n in ("samples", "fresh")}
        command = [sys.executable, __file__, "--child", json.dumps(task | {"bound": self.bound})]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=18 * CAP, check=True
            )
        except (subprocess.TimeoutExpired, subprocess.CalledProcessError) as error:
            print(f"  failed or too long: {peer.name}, {setting}: {error}", file=sys.stderr)
            return None
        return dict(json.loads(done.stdout.splitlines()[-1]))

    def cheapest(self, peer: Peer) -> tuple[dict[float, Setting], float]:
        """The cheapest setting for each goal that is reached, and how close the peer came."""
        best: dict[float, Setting] = {}
        closest = np.inf
        for setting in grid(peer, self.race):
            done = self.run(peer, setting)
            if done is None or done["cpu"] > CAP:
                break
            near = done["ratio"] <= max(self.race.goals) + NEAR
            seeds = range(1, SEEDS if peer == OURS else 3) if near else ()
            others = [self.run(peer, setting, seed) for seed in seeds]
            ratios = [done["ratio"], *(o["ratio"] for o in others if o)]
            # the median of three seeds; of ours all five have to be there
            ratio = max(ratios) if peer == OURS else statistics.median(ratios)
            closest = min(closest, ratio)
            for goal in self.race.goals:
                if ratio <= goal:
                    best.setdefault(goal, setting)
            if len(best) == len(self.race.goals):
                break
        return best, float(closest)


def maps(quick: bool, names: list[str], sides: list[int]) -> None:
    """Peers' trainings in turn with ours, each at the least training that gets there."""
    import calib

    arm = calib.load_arm("two_link")
    print(f"area {area(arm):.5f} m2")
    peers = [p for p in PEERS if p.version() and p.name in names]
    for race in QUICK if quick else tuple(r for r in RACES if r.side in sides):
        with tempfile.TemporaryDirectory() as folder:
            course = Course(race, Path(folder))
            found = {peer: course.cheapest(peer) for peer in peers}
            for goal in race.goals:
                entries = [(peer, best[goal]) for peer, (best, _) in found.items() if goal in best]
                runs: dict[str, list[dict[str, Any]]] = {peer.name: [] for peer, _ in entries}
                for seed in range(SEEDS):
                    for peer, setting in entries:
                        if (done := course.run(peer, setting, seed)) is not None:
                            runs[peer.name].append(done)
                ours = statistics.median(d["cpu"] for d in runs["calib"])
                rows = [_row(peer, setting, runs[peer.name], goal, ours)
                        for peer, setting in entries]  # fmt: skip
                table(f"{race.side}x{race.side} nodes, to {goal} of the bound", rows)
                for peer, (best, closest) in found.items():
                    if goal not in best:
                        print(f"- {peer.name} did not reach it: it came to {closest:.3f}.")


def _row(
    peer: Peer, setting: Setting, done: list[dict[str, Any]], goal: float, ours: float
) -> dict[str, Any]:
    cpu, ratio = ([d[key] for d in done] for key in ("cpu", "ratio"))
    return {
        "library": peer.name, "training": setting.words(peer.online),
        "processor time [s]": interval(cpu), "times calib's": statistics.median(cpu) / ours,
        "ratio": f"{statistics.median(ratio):.3f}",
        "missed": f"{sum(r > goal for r in ratio)} of {len(done)}",
        "topographic error [%]": 100 * statistics.median(d["topographic"] for d in done),
        "memory [MB]": max(d["peak_mb"] for d in done),
        "before [MB]": done[0]["before_mb"], "first call [s]": done[0]["first_s"],
    }  # fmt: skip


YARDSTICK = "import numpy, scipy.spatial"
_PROBE = """
import json, resource, subprocess, sys, time
start = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
wall = time.perf_counter() - start
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([wall, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))
"""


def processes(quick: bool) -> None:
    """Whole commands, each in turn with an import, so that a drifting machine hits all alike."""
    with tempfile.TemporaryDirectory() as name:
        model = str(Path(name) / "two_link.calib")
        cli = [sys.executable, "-m", "calib_cli"]
        few = ["--size", "20", "--samples", "2000"] if quick else []
        commands = {
            "calib train two_link": [*cli, "train", "two_link", "-o", model, *few],
            "calib query inverse": [*cli, "query", "inverse", model, "0.3", "0.3"],
            "calib --help": [*cli, "--help"],
            YARDSTICK: [sys.executable, "-c", YARDSTICK],
        }
        # bytecode as an installer has it: compiling the sources anew took a quarter of a command
        kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        kept |= {"PYTHONPATH": str(ROOT), "PYTHONPYCACHEPREFIX": str(Path(name) / "bytecode")}

        def process(command: list[str]) -> list[float]:
            # a small process starts it: memory is told as that of the larger of the two
            probe = [sys.executable, "-S", "-c", _PROBE, *command]
            done = subprocess.run(probe, cwd=name, check=True, capture_output=True, env=kept)
            return list(json.loads(done.stdout))

        for command in commands.values():  # a model to ask, and bytecode
            process(command)
        turns = [{key: process(c) for key, c in commands.items()} for _ in range(2 if quick else 7)]
    rows = []
    for key in commands:
        wall, cpu, memory = zip(*(turn[key] for turn in turns), strict=True)
        ratio = [turn[key][1] / turn[YARDSTICK][1] for turn in turns]  # pair by pair: it drifts
        rows.append({
            "process": key, "wall time [s]": interval(wall), "processor time [s]": interval(cpu),
            "times the import": statistics.median(ratio), "peak memory [MB]": max(memory),
        })  # fmt: skip
    table("Whole commands", rows)


def peak_mb() -> float:
    """Most memory that this process has held so far [MB]."""
    status = Path("/proc/self/status")
    if status.exists():
        # unlike ru_maxrss it knows nothing of the parent that started this process
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def spent(run: Callable[[], Any]) -> tuple[float, Any]:
    """Processor seconds and result of a call."""
    start = time.process_time()
    result = run()
    return time.process_time() - start, result


def interval(values: Sequence[float]) -> str:
    """Median, and the least and most."""
    return f"{number(statistics.median(values))} ({number(min(values))}–{number(max(values))})"


def main() -> None:
    """Run the sections."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="tiny sizes: does it all run?")
    sections = ("maps", "processes")
    parser.add_argument("--only", nargs="+", choices=sections, default=sections)
    parser.add_argument("--peers", nargs="+", default=list(FASTEST), metavar="PEER")
    parser.add_argument("--sides", nargs="+", type=int, default=[30, 70])
    parser.add_argument("--child", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        print(json.dumps(one(options.child)))
        return
    for peer in PEERS:
        print(f"{peer.name}: {peer.version() or 'not installed, left out'}", file=sys.stderr)
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, "
          f"Python {platform.python_version()}, load {os.getloadavg()[0]:.1f}")  # fmt: skip
    if "maps" in options.only:
        maps(options.quick, options.peers, options.sides)
    if "processes" in options.only:
        processes(options.quick)


if __name__ == "__main__":
    main()
