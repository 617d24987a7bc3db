"""The motion of a log: the side from which joints came, and rows that stand at one pose."""

import numpy as np

from calib import Samples

Q = np.array([[0.0, 1.0], [0.5, 1.0], [0.5, 0.2], [0.0, 1.0], [0.0, 1.0 + 1e-9]])
SAMPLES = Samples(Q, np.arange(10.0).reshape(5, 2), ("one", "two"))


def test_each_joint_came_from_the_side_of_its_last_motion():
    side = SAMPLES.motion.side
    assert side[:, 0].tolist() == [0, 1, 1, -1, -1]
    assert side[:, 1].tolist() == [0, 0, -1, 1, 1]


def test_rows_at_one_pose_share_its_number():
    assert SAMPLES.pose_index.tolist() == [0, 1, 2, 0, 0]
