"""Measure how many samples a calibration takes, and write the table into its page.

python docs/make_samples.py             # docs/howto/own-camera.md; some three minutes
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import calib

PAGE = Path(__file__).parent / "howto" / "own-camera.md"
BEGIN, END = "<!-- samples: written by docs/make_samples.py -->\n", "<!-- samples end -->\n"
ROWS = (30, 100, 300, 1000)
SIZE = 20  # nodes along each axis: enough for the trend, and quick
CASES = {
    "0.1 mm": (1e-4, ()),
    "1 mm": (1e-3, ()),
    "1 mm, 5 % wrong": (1e-3, ("sensor.outliers=0.05",)),
    "3 mm": (3e-3, ()),
}
SEEDS = range(2)


def errors(rows: int, noise: float, changes: tuple[str, ...], seed: int) -> tuple[float, float]:
    """Return the mean distance to the truth and the mean stated bound [m], for a log of rows."""
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, rows, seed=seed, noise=noise, changes=changes)
    model = calib.train(replace(log, simulation=None), size=SIZE)  # as if measured
    q = np.random.default_rng(100).uniform(arm.lower, arm.upper, (5000, 2))
    found, bound = model.forward(q), model.expected_error(q)
    distance = np.linalg.norm(found - arm.forward(q), axis=1)
    return float(np.nanmean(distance)), float(np.nanmean(bound))


def table() -> str:
    """Measure all cells: mean error, and in brackets the mean stated bound."""
    lines = ["| rows | " + " | ".join(CASES) + " |", "|---:|" + "---:|" * len(CASES)]
    for rows in ROWS:
        cells = []
        for noise, changes in CASES.values():
            means = np.mean([errors(rows, noise, changes, seed) for seed in SEEDS], axis=0)
            cells.append("{:.2g} ({:.2g})".format(*(1e3 * means)))
        lines.append(f"| {rows:,} | " + " | ".join(cells) + " |")
        print(lines[-1], flush=True)
    return "\n".join(lines) + "\n"


def main() -> None:
    """Replace what stands between the two marks."""
    text = PAGE.read_text(encoding="utf-8")
    head, rest = text.split(BEGIN)
    tail = rest.split(END)[1]
    PAGE.write_text(f"{head}{BEGIN}\n{table()}\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    main()
