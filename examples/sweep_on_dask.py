"""Find a map's size and kind with a Dask cluster, here one of two workers on this machine.

    python examples/sweep_on_dask.py

With a cluster of your own, replace `LocalCluster(...)` by the address of its scheduler; its
workers need calib.
"""

from __future__ import annotations

import calib

GRID = {"size": [8, 12], "map": ["som", "vdsom"], "samples": [600]}


def main() -> None:
    """Train on every combination, twice, and show what the winner readout does."""
    try:
        import joblib
        from distributed import Client, LocalCluster
    except ImportError:
        print("Dask is not installed (pip install distributed): without it, on 1 core")
        show(calib.sweep("two_link", GRID, seeds=2, jobs=1))
        return
    cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with cluster, Client(cluster), joblib.parallel_config("dask"):
        show(calib.sweep("two_link", GRID, seeds=2))


def show(found: calib.Sweep) -> None:
    """Print a line for each training."""
    for row in found.rows:
        error = row.distance("winner", "forward", "mean")
        print(f"{dict(row.options)}, seed {row.seed}: {1e3 * error:.1f} mm")
    print(f"{len(found.rows)} trainings, {len(found.failed)} failed")


if __name__ == "__main__":
    main()
