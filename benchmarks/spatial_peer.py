"""Compare with other calibration tools on the same rows, for `benchmarks/spatial.py`.

Each runs in an environment of its own, since neither shares calib's NumPy and Pinocchio:

    python -m venv one; one/bin/pip install "numpy<2" robotkinecal==0.1.0
    python -m venv two; two/bin/pip install figaroh==1.0.2
    python benchmarks/spatial.py --data FOLDER --part peer
        --peer robotkinecal=one/bin/python --peer figaroh=two/bin/python

robotkinecal moves the joints' screws and the tool (Li et al., IEEE T-RO 32, 2016), FIGAROH six
numbers at each joint origin, of which a QR keeps those that can be told: geometry without a prior.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from spatial_simulated import Row, UpTo, fit

from calib.body.spatial import SpatialStructure

HERE = Path(__file__).parent


def peer(text: str) -> tuple[str, Path]:
    """A tool and the Python that has it, of NAME=PYTHON."""
    name, _, python = text.partition("=")
    if not (HERE / f"peer_{name}.py").exists() or not Path(python).exists():
        raise argparse.ArgumentTypeError(f"{text!r}: expected robotkinecal=PYTHON, figaroh=PYTHON")
    return name, Path(python)


def nominal(structure: SpatialStructure, q: np.ndarray, z: np.ndarray) -> dict[str, Any]:
    """The nominal arm in the frame that fits rows best, from which such tools start.

    Axes, points and the tip's pose at zero in the sensor's frame [m], and the pose of the root.
    """
    beta = fit(UpTo.of(structure, "frame"), q, z).body.beta
    motion, view = structure.seen(np.zeros((1, structure.dof)), beta)
    zero, turn, shift = np.eye(4), view.sensor.rotation, view.sensor.shift
    zero[:3, :3], zero[:3, 3] = turn @ motion.rotation[:, :, 0], view.values[0]
    angles = Rotation.from_matrix(turn).as_euler("xyz")
    return {
        "axes": motion.axes[:, :, 0] @ turn.T,
        "points": motion.origins[:, :, 0] @ turn.T + shift,
        "zero": zero,
        "base": np.concatenate([shift, angles]),
    }


def against(
    tool: tuple[str, Path],
    arm: Any,
    structure: SpatialStructure,
    rows: tuple[np.ndarray, np.ndarray],
    asked: np.ndarray,
) -> tuple[np.ndarray, Row]:
    """Positions (n, 3) [m] that a tool predicts at `asked` (n, 6), and what it says.

    rows : joints (n, 6) and positions (n, 3) [m] to learn from
    """
    known = {"urdf": arm.urdf, "tip": arm.tip, **nominal(structure, *rows)}
    name, python = tool
    with tempfile.TemporaryDirectory() as folder:
        given, answer = Path(folder) / "given.npz", Path(folder) / "answer.npz"
        np.savez(given, q=rows[0], z=rows[1], asked=asked, **known)
        done = subprocess.run(
            [python, HERE / f"peer_{name}.py", given, answer],
            check=True,
            capture_output=True,
            text=True,
        )
        return np.load(answer)["found"], json.loads(done.stdout.splitlines()[-1])
