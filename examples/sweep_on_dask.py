"""Find a map's size and kind with a Dask cluster, here one of two workers on this machine.

    python examples/sweep_on_dask.py

With a cluster of your own, replace `LocalCluster(...)` by the address of its scheduler; its
workers need calib.  On the command line it is `DASK_SCHEDULER_ADDRESS=tcp://host:8786 calib
sweep two_link --size 8,12 --map som,vdsom --backend dask`.
"""

from __future__ import annotations

import math

import calib

GRID = {"size": [8, 12], "map": ["som", "vdsom"], "samples": [600]}


def main() -> None:
    """Train on every combination, twice, and show what the winner readout does."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        print("Dask is not installed (pip install distributed): without it, on 1 core")
        show(calib.sweep("two_link", GRID, seeds=2, jobs=1))
        return
    cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with cluster, Client(cluster):
        show(calib.sweep("two_link", GRID, seeds=2, backend="dask"))


def show(found: calib.Sweep) -> None:
    """Print a line for each combination of options."""
    for part in found.combinations():
        errors = [row.distance("winner", "forward", "mean") for row in part]
        mean = math.fsum(errors) / len(errors)
        print(f"{part[0].options}: {1e3 * mean:.1f} mm, mean of {len(part)} seeds")
    print(f"{len(found)} trainings, {len(found.failed)} failed")


if __name__ == "__main__":
    main()
