"""Calibrate an arm with robotkinecal (Nadeau 2024): a peer of `spatial_peer.py`.

    PYTHON peer_robotkinecal.py ROWS.npz ANSWER.npz

PYTHON is that of an environment with robotkinecal 0.1.0, which needs numpy < 2; calib is not
imported. ROWS holds the nominal screws in the sensor's frame, rows, and joints to predict at.
"""

import json
import sys
import time

import numpy as np
from roboticstoolbox import PoERevolute, PoERobot
from robotkinecal import SerialRobotKineCal
from spatialmath import SE3


def main() -> None:
    """Read rows, calibrate, write predictions and print what the search did."""
    rows = np.load(sys.argv[1])
    links = [PoERevolute(*each) for each in zip(rows["axes"], rows["points"], strict=True)]
    peer = SerialRobotKineCal(PoERobot(links, SE3(rows["zero"])))
    # The toolbox wraps the links in a base and a tip, which robotkinecal 0.1.0 counts as joints.
    # Its other way in, a URDF, takes every joint to turn about z, which a UR10's do not.
    peer.joint_screw_axis, peer.joints = peer.joint_screw_axis[1:-1], peer.joints[1:-1]
    peer.N_JOINTS = len(peer.joints)
    began = time.process_time()
    peer.set_observations(list(rows["q"]), list(rows["z"]))
    result = peer.solve()
    seconds = time.process_time() - began
    found = [peer.forward_kinematics(peer.N_JOINTS + 1, q).t for q in rows["asked"]]
    np.savez(sys.argv[2], found=np.array(found))
    print(json.dumps({"converged": bool(result.has_converged), "seconds": round(seconds, 1)}))


if __name__ == "__main__":
    main()
