"""Errors of small models, to be compared between versions of Python and of the libraries.

    python benchmarks/versions.py --write          after training was changed on purpose
    python3.13 benchmarks/versions.py              how far this interpreter is from what is kept

Bytes agree on one machine only: another NumPy may sum in another order, and a winner that is
nearly tied may change. Means agree to 1e-6, maxima, which hang on single samples, to 5 %; what
is exact up to rounding agrees to 1e-9 m or rad.
"""

import json
import platform
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from tables import typed

import calib

KEPT = Path(__file__).parents[1] / "tests" / "data" / "errors.json"
MEANS, MAXIMA, ROUNDING = 1e-6, 0.05, 1e-9


def errors() -> dict[str, Any]:
    """Errors of two arms, with exact and with noisy samples, per readout."""
    return {
        f"{robot}, noise {noise:g} m": calib.train(
            calib.babble(calib.load_arm(robot), 2000, seed=0, noise=noise), size=size, seed=0
        ).about.errors
        for robot, size in (("two_link", 15), ("three_link", 7))
        for noise in (0.0, 1e-3)
    }


def leaves(tree: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], float]]:
    """Every number of a tree of dicts, with its keys."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield from leaves(value, (*path, key))
    else:
        yield path, float(tree)


def differences(found: Any, kept: Any) -> list[str]:
    """One line for each number that is further from the kept one than it may be."""
    wanted, lines = dict(leaves(kept)), []
    if wanted.keys() != dict(leaves(found)).keys():
        return ["other arms, readouts or joints"]
    for path, value in leaves(found):
        allowed = ROUNDING + (MEANS if path[-1] == "mean" else MAXIMA) * abs(wanted[path])
        if not abs(value - wanted[path]) <= allowed:
            lines.append(f"{', '.join(path)}: {value:.9g}, kept {wanted[path]:.9g}")
    return lines


def main() -> None:
    """Write the errors, or compare them with those that are kept."""
    options = typed(__doc__, write=False)
    found = errors()
    if options.write:
        KEPT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        return
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    lines = differences(found, kept)
    print(
        f"Python {platform.python_version()}, NumPy {np.__version__}, SciPy {scipy.__version__}: "
        f"{len(lines)} beyond their bounds"
    )
    print(*lines, sep="\n", end="\n" if lines else "")
    sys.exit(1 if lines else 0)


if __name__ == "__main__":
    main()
