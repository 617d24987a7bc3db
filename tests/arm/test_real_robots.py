"""Real robots from example-robot-data (PyPI): they load as they are, or say why not."""

import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from calib_cli.output import as_typed
from reference import ROBOTS, needs_robots, pinocchio_forward, random_joints

from calib import RobotError, load_arm

FILES = sorted(ROBOTS.rglob("*.urdf"))
pytestmark = needs_robots
PLANAR = {  # of a description: the joints and the tip that are found
    "ur_description/urdf/ur5_robot": "shoulder_lift_joint,elbow_joint,wrist_1_joint tool0",
    "panda_description/urdf/panda": "panda_joint2,panda_joint4,panda_joint6 panda_hand_tcp",
    "so_arm_description/urdf/so101": "shoulder_lift,elbow_flex,wrist_flex gripper_frame_link",
    "asr_twodof_description/urdf/TwoDofs": "J1,J2 Tip",
}
PAGE = (Path(__file__).parents[2] / "docs/robots.md").read_text(encoding="utf-8")
TABLE = re.findall(r"^\| `(\S+)` \|", PAGE, re.MULTILINE)
SAID = dict(reversed(re.findall(r"^- `(\S+)`: (.*)$", PAGE, re.MULTILINE)))
"""What docs/robots.md says first of each file that is not trained at once."""


def miss(arm, q):
    """Largest distance to Pinocchio, as a share of the arm's reach or of a metre."""
    return np.abs(arm.forward(q) - pinocchio_forward(arm, q)).max() / max(arm.chain.reach, 1.0)


@pytest.mark.parametrize("file", PLANAR)
def test_the_planar_arm_is_found_and_not_its_fingers(file):
    arm = load_arm(ROBOTS / f"{file}.urdf", planar=True)
    assert f"{','.join(arm.joint_names)} {arm.tip}" == PLANAR[file]


def test_the_page_counts_every_file_and_lists_those_that_are_not_trained_at_once():
    assert f"each of the {len(FILES)}\n" in PAGE
    assert f"Of the files {len(FILES) - len(TABLE)} were\ntrained at once" in PAGE
    assert sorted(TABLE) == sorted(SAID)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_file_loads_truly_or_is_refused_in_one_line(path):
    """A refusal that lists choices lists choices that work."""
    try:
        arms = [load_arm(path, planar=True)]
    except RobotError as error:
        message = as_typed(as_typed(str(error)))
        choices = re.findall(r"--joints (\S+) --tip ([^\s;]+)", message)
        arms = [load_or_give_ranges(path, joints.split(","), tip) for joints, tip in choices]
    else:
        message = ""
    assert "\n" not in message
    assert arms or re.search("no links|no arm|lies on its axis|give --range|not planar", message)
    for arm in arms:
        assert 2 <= arm.dof <= 3
        assert np.isfinite([arm.lower, arm.upper]).all()
        assert (arm.lower < arm.upper).all()
        assert miss(arm, random_joints(arm, 20)) <= 1e-12


def load_or_give_ranges(path, joints, tip):
    """Load an arm; where a joint states no limits, do as the message says."""
    ranges: dict[str, tuple[float, float]] = {}
    while True:
        try:
            return load_arm(path, joints, tip, ranges=ranges)
        except RobotError as error:
            asked = re.search(r"--range (\S+)=LOWER:UPPER", as_typed(str(error)))
            if asked is None or asked[1] in ranges:
                raise
            ranges[asked[1]] = (-1, 1)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_whole_arm_agrees_with_pinocchio_and_with_the_page(path):
    listed = SAID.get(str(path.relative_to(ROBOTS)))
    try:
        arm = load_arm(path)
    except RobotError as error:
        message = as_typed(as_typed(str(error)))
        assert "\n" not in message
        assert listed == message.removeprefix(f"{path.name}: ")
        return
    assert listed is None
    assert 2 <= arm.dof <= 7
    with suppress(ValueError):  # Pinocchio's own parser refuses its mimic joints
        assert miss(arm, random_joints(arm, 10)) <= 1e-12
