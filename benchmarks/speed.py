"""Speed beside peers: training of maps, queries, whole commands; tables of docs/performance.md.

    python benchmarks/speed.py [--quick] [--only SECTION ...] [--peers PEER ...] [--sides N ...]

SECTION: maps (training of self-organizing maps to a quality, beside other libraries), queries
(beside nearest neighbours and solvers of kinematics), processes (whole commands).  Peers that are
not installed are left out, aloud.  The least training that reaches a quality is searched for each
peer first, up to an hour for all of `map_peers.PEERS`.
"""

import argparse
import sys
from typing import Any

from map_peers import PEERS
from map_race import QUICK, RACES, area, area_by_chance, race, search
from measure import interval, machine
from process_race import processes
from query_race import queries
from tables import table

FASTEST = ("calib", "sparse-som", "numbasom")


def maps(quick: bool, names: list[str], sides: list[int]) -> None:
    """Peers' trainings in turn with ours, each at the least training that gets there."""
    import calib

    arm = calib.load_arm("two_link")
    value, deviation = area_by_chance(arm)
    print(f"area {area(arm):.5f} m2, by a million random points {value:.5f} +- {deviation:.5f}")
    races = QUICK if quick else tuple(r for r in RACES if r.side in sides)
    found = search(races, [p.name for p in PEERS if p.version() and p.name in names])
    rows = race(races, found)
    for side, goal in dict.fromkeys((r["side"], r["goal"]) for r in rows):
        some = [r for r in rows if (r["side"], r["goal"]) == (side, goal)]
        ours = [r["cpu"]["median"] for r in some if r["peer"] == "calib"]
        table(
            f"{side}x{side} nodes, to {goal} of the bound",
            [{"library": r["peer"], "training": r["setting"], "time [s]": interval(r["seconds"]),
              "processor time [s]": interval(r["cpu"]),
              "times calib's": r["cpu"]["median"] / ours[0] if ours else "",
              "ratio": f"{r['ratio']['median']:.3f}",
              "missed": f"{r['seconds']['runs'] - r['reached']} of {r['seconds']['runs']}",
              "topographic error [%]": 100 * r["topographic"]["median"],
              "memory [MB]": r["peak_mb"]["most"], "first call [s]": r["first_s"]}
             for r in sorted(some, key=lambda r: r["cpu"]["median"])],
        )  # fmt: skip
    for row in found:
        for goal, best in row["best"].items():
            if best is None:
                print(f"- {row['peer']}, {row['side']}x{row['side']}: {goal} was not reached, "
                      f"{row['closest']:.3f} was.")  # fmt: skip


def main() -> None:
    """Run the sections."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="tiny sizes: does it all run?")
    sections = ("maps", "queries", "processes")
    parser.add_argument("--only", nargs="+", choices=sections, default=sections)
    parser.add_argument("--peers", nargs="+", default=list(FASTEST), metavar="PEER")
    parser.add_argument("--sides", nargs="+", type=int, default=[30, 70])
    options = parser.parse_args()
    for peer in PEERS:
        print(f"{peer.name}: {peer.version() or 'not installed, left out'}", file=sys.stderr)
    print(machine())
    if "maps" in options.only:
        maps(options.quick, options.peers, options.sides)
    if "queries" in options.only:
        found: dict[str, Any] = queries(options.quick)
        table("Queries of a 70x70 model, one core", found["rows"])
        print(f"\nModel file {found['file_mb']:.2f} MB, loaded in {found['load_ms']:.1f} ms.")
        print("Left out:", ", ".join(found["left_out"]) or "none")
    if "processes" in options.only:
        rows, stages = processes(options.quick)
        table("Whole commands", rows)
        table("Stages of `calib train two_link` [s]", [stages])


if __name__ == "__main__":
    main()
