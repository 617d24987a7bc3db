"""Calibrate an arm with FIGAROH (Nguyen et al., Humanoids 2023): a peer of `spatial_peer.py`.

    PYTHON peer_figaroh.py ROWS.npz ANSWER.npz

PYTHON is that of an environment with figaroh 1.0.2; calib is not imported. ROWS holds the URDF,
where its root stands in the sensor's frame, rows, and joints to predict at.
"""

import contextlib
import json
import logging
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pinocchio
import yaml
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm


class Arm:
    """What FIGAROH asks of a robot: a model, its data and a neutral posture."""

    def __init__(self, urdf: str) -> None:
        self.model = pinocchio.buildModelFromXML(urdf)
        self.data = self.model.createData()
        self.q0 = pinocchio.neutral(self.model)


class Calibration(BaseCalibration):
    """Positions alone, unweighted."""

    def cost_function(self, var: np.ndarray) -> np.ndarray:
        """Residuals of the rows [m]."""
        return self.PEE_measured - self.at(var, self.q_measured)

    def at(self, var: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Positions (3 n,) [m] at joints (n, 6)."""
        self.calib_config["NbSample"] = len(q)
        return calc_updated_fkm(self.model, self.data, var, q, self.calib_config)


def settings(rows: str, tip: str, base: list[float]) -> dict[str, object]:
    """Its configuration: every joint origin, base and tool, a tracker that sees positions."""
    measured = {"measurable_dof": [True, True, True, False, False, False]}
    task = {
        "kinematics": {"base_frame": "universe", "tool_frame": tip},
        "parameters": {"calibration_level": "full_params"},
        "measurements": {
            "markers": [measured],
            "poses": {"base_pose": base, "tool_pose": [0.0] * 6},
        },
        "data": {"source_file": rows},
    }
    return {"schema_version": "1.0", "robot": {"name": "arm"}, "tasks": {"calibration": task}}


def main() -> None:
    """Read rows, calibrate, write predictions and print what the search did."""
    warnings.simplefilter("ignore")
    logging.disable()
    rows, folder = np.load(sys.argv[1]), Path(sys.argv[2]).parent
    arm = Arm(str(rows["urdf"]))
    table, made = folder / "rows.csv", folder / "figaroh.yaml"
    head = ",".join([*list(arm.model.names)[1:], "x1", "y1", "z1"])
    np.savetxt(table, np.hstack([rows["q"], rows["z"]]), delimiter=",", header=head, comments="")
    made.write_text(yaml.safe_dump(settings(str(table), str(rows["tip"]), rows["base"].tolist())))
    began = time.process_time()
    with contextlib.redirect_stdout(sys.stderr):
        peer = Calibration(arm, str(made))
        peer.calib_config |= {"known_baseframe": False, "known_tipframe": False}
        peer.initialize()
        result = peer.solve(enable_logging=False)
    seconds = time.process_time() - began
    np.savez(sys.argv[2], found=peer.at(result.x, rows["asked"]).reshape(3, -1).T)
    print(json.dumps({"converged": bool(result.success), "seconds": round(seconds, 1)}))


if __name__ == "__main__":
    main()
