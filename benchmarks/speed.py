"""Speed beside peers; writes docs/performance.md and .json.

    python benchmarks/speed.py [--quick] [--only SECTION ...] [--search [PEER ...]]
                               [--peers PEER ...] [--sides N ...] [--out FOLDER]

SECTION: maps (training of self-organizing maps beside other libraries), queries (beside
nearest neighbours and solvers of kinematics), processes (whole commands, imports, stages),
limits (what k-d tree queries and copies alone take, and which functions take the rest).
Sections are merged into the page, so each can be run alone.  Peers that are not installed
are left out, aloud.  The best amount of training of each is that of docs/performance.json;
where it does not say, it is searched, which takes up to an hour for all; --search does so
again for these peers, or all.  --peers and --sides race some of them alone, on some of the
lattices.  --quick writes nothing unless --out is given.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from limits import limits
from map_peers import PEERS
from map_race import QUICK, RACES, area, area_by_chance, race, search
from measure import ROOT, machine
from performance_page import finish, read
from process_race import processes
from query_race import queries

SECTIONS = ("maps", "queries", "processes", "limits")


def maps(
    quick: bool, names: list[str], sides: list[int], again: list[str], known: list[dict[str, Any]]
) -> dict[str, Any]:
    """Peers' trainings in turn with ours, at the settings `known` or found `again`."""
    import calib

    arm = calib.load_arm("two_link")
    value, deviation = area_by_chance(arm)
    races = QUICK if quick else tuple(r for r in RACES if r.side in sides)
    there = [p.name for p in PEERS if p.version() and p.name in names]
    if quick:
        found = search(races, [n for n in there if n in ("calib", "sparse-som")])
    else:
        kept = [r for r in known if r["peer"] not in again or r["side"] not in sides]
        found = search(races, there, kept)
    return {
        "area_m2": area(arm),
        "area_by_chance_m2": [value, deviation],
        "search": found,
        "race": race(races, [row for row in found if row["peer"] in there]),
        "peers": [{"name": p.name, "package": p.package, "version": p.version(), "note": p.note}
                  for p in PEERS],
    }  # fmt: skip


def main() -> None:
    """Run the sections and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="tiny sizes: does it all run?")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=SECTIONS)
    parser.add_argument("--search", nargs="*", choices=[p.name for p in PEERS],
                        help="find these peers' settings again")  # fmt: skip
    parser.add_argument("--peers", nargs="+", default=[p.name for p in PEERS], metavar="PEER")
    parser.add_argument("--sides", nargs="+", type=int, default=[r.side for r in RACES])
    parser.add_argument("--out", type=Path, help="folder of the page (default docs)")
    options = parser.parse_args()
    for peer in PEERS:
        print(f"{peer.name}: {peer.version() or 'not installed, left out'}", file=sys.stderr)
    again = options.search or ([] if options.search is None else [p.name for p in PEERS])
    new: dict[str, Any] = {"machine": machine()}
    if "maps" in options.only:
        known = read(options.out or ROOT / "docs").get("maps", {}).get("search", [])
        new["maps"] = maps(options.quick, options.peers, options.sides, again, known)
    if "queries" in options.only:
        new["queries"] = queries(options.quick)
        for row in new["queries"]["rows"]:
            print(f"{row['name']}: {1e6 / row['us']:,.0f} a second", file=sys.stderr)
    if "processes" in options.only:
        new["processes"] = processes(options.quick)
    if "limits" in options.only:
        new["limits"] = limits(options.quick)
    finish(options.out, new, options.quick)


if __name__ == "__main__":
    main()
