"""Which arm of a robot is chosen, and what is told where none can be."""

import numpy as np
import pytest
from chains import NO_TIP, SLIDE, branching, chain_urdf, turning

from calib.arm.description import parse_robot
from calib.arm.finding import find_tip
from calib.arm.loading import arm_from_urdf, load_arm
from calib.errors import CalibError, OptionError, RobotError


def test_the_order_of_the_joints_does_not_matter():
    arm = load_arm("three_link", ["wrist", "shoulder", "elbow"])
    assert arm.joint_names == ("shoulder", "elbow", "wrist")
    assert load_arm("three_link", "elbow,shoulder").joint_names == ("shoulder", "elbow")


def test_other_joints_are_locked_at_neutral_or_where_told():
    arm = load_arm("three_link", ["shoulder", "wrist"])
    assert arm.locked == {"elbow": pytest.approx(np.deg2rad(15))}  # 0 clipped into its limits
    assert any("elbow=0.2618" in note for note in arm.notes)
    told = load_arm("three_link", ["shoulder", "wrist"], lock={"elbow": 1.0})
    assert told.locked == {"elbow": 1.0}
    full = load_arm("three_link")
    expected = full.forward([0.3, 1.0, -0.2])
    np.testing.assert_allclose(told.forward([0.3, -0.2]), expected, atol=1e-15)


def test_a_follower_is_held_where_its_leader_is():
    mimic = '<mimic joint="j2" multiplier="-2" offset="0.1"/>'
    text = chain_urdf(turning(), turning(), turning(more=mimic), turning())
    arm = arm_from_urdf(text, ["j1", "j4"], lock={"j2": 0.2})
    assert arm.locked == {"j2": 0.2, "j3": pytest.approx(-0.3)}


def test_two_slides_make_a_plane():
    arm = arm_from_urdf(chain_urdf(turning(axis="1 0 0") + SLIDE, turning(axis="0 2 0") + SLIDE))
    assert arm.revolute == (False, False)
    np.testing.assert_allclose(arm.forward([0.1, 0.2]), [0.6 + 0.2 + 0.1, 0.2], atol=1e-15)
    np.testing.assert_allclose(arm.jacobian([0.1, 0.2]), np.eye(2), atol=1e-15)


def test_what_had_to_be_chosen_is_said_aloud():
    text = chain_urdf(turning(), turning(), turning(axis="0 1 0"))
    assert arm_from_urdf(text, ["j1", "j2"]).notes == (
        "locked at neutral: j3=0 (`lock` changes it)",
    )
    assert arm_from_urdf(text, ["j1", "j2"], "tip", lock={"j3": 9}).notes == (
        "`lock={'j3': 9}` lies outside the joint's limits -1:1 [rad]",
    )
    assert load_arm("two_link", ["shoulder", "elbow"]).notes == ()


def test_a_tip_may_be_named_by_its_joint():
    assert load_arm("two_link", tip="tip_mount").tip == "tip"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"joints": ["sholder", "elbow"]}, ["'sholder'", "did you mean shoulder?"]),
        ({"joints": ["shoulder", "tip_mount"]}, ["'tip_mount' is fixed", "shoulder, elbow"]),
        ({"joints": ["elbow"]}, ["two or more"]),
        ({"joints": ["elbow", "elbow"]}, ["'elbow', 'elbow'", "each once"]),
        ({"tip": "tp"}, ["'tp'", "did you mean tip?"]),
        ({"joints": ["shoulder", "elbow"], "tip": "upper_arm"}, ["'elbow'", "'upper_arm'"]),
        ({"joints": ["shoulder", "elbow"], "tip": "forearm"}, ["'elbow'", "'forearm'", "axis"]),
        ({"lock": {"nope": 1}}, ["`lock`", "'nope'"]),
        (
            {"lock": {"elbow": 1.0}, "joints": ["shoulder", "elbow"]},
            ["on their own", "each once: 'shoulder'"],
        ),
        ({"lock": {"elbow": 1.0}}, ["no arm", "free: shoulder"]),
    ],
)
def test_joints_and_tips_that_cannot_be_are_told_in_one_line(options, words):
    with pytest.raises(CalibError) as caught:
        load_arm("two_link", **options)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


STUCK_CHAIN = chain_urdf(turning(lower="0", upper="0"), turning())


SIDE_BY_SIDE = (
    '<robot name="r"><link name="o"/><link name="l"/><link name="m"/>'
    f'<joint name="a" type="revolute"><parent link="o"/><child link="l"/>{turning()}</joint>'
    f'<joint name="b" type="revolute"><parent link="o"/><child link="m"/>{turning()}</joint>'
    "</robot>"
)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        # two joints, but whatever the last one carries lies on its axis
        (NO_TIP, {}, ["'j2'", "lies on its axis", "add a tip link"]),
        (NO_TIP, {"tip": "tip"}, ["'tip'", "lies on its axis", "add a tip link"]),
        (
            chain_urdf(turning(), turning()),
            {"tip": "l2"},
            ["'l2'", "lies on its axis", "another tip"],
        ),
        # two joints side by side
        (SIDE_BY_SIDE, {}, ["in one chain", "a, b"]),
        # limits that leave no room: named only where they are the reason
        (STUCK_CHAIN, {}, ["j1", "0 to 0 rad are unusable", "`ranges={'j1': (LOWER, UPPER)}`"]),
        (STUCK_CHAIN, {"lock": {"j2": 0.0}}, ["in one chain", "free: (none)"]),
    ],
)
def test_the_reason_for_finding_no_arm_is_the_true_one(text, options, words):
    with pytest.raises(RobotError) as caught:
        arm_from_urdf(text, **options)
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_arm_that_is_not_planar_is_refused_naming_the_joint_and_its_axis():
    text = chain_urdf(turning(), turning(axis="0 1 0"), turning())
    with pytest.raises(RobotError, match=r"not planar: joint 'j2' has the axis \(0, 1, 0\)"):
        arm_from_urdf(text, ["j1", "j2", "j3"], planar=True)
    sliding = chain_urdf(turning(), turning() + SLIDE)
    with pytest.raises(RobotError, match=r"'j2' has the axis \(0, 0, 1\).*perpendicular"):
        arm_from_urdf(sliding, ["j1", "j2"], planar=True)
    in_line = chain_urdf(turning() + SLIDE, turning() + SLIDE)
    with pytest.raises(RobotError, match="all slide along"):
        arm_from_urdf(in_line, ["j1", "j2"])


@pytest.mark.parametrize(("angle", "planar"), [(0.9e-4, True), (1.1e-4, False)])
def test_axes_may_differ_by_a_ten_thousandth(angle, planar):
    text = chain_urdf(turning(), turning(axis=f"{np.sin(angle)} 0 {-np.cos(angle)}"))
    if planar:
        assert arm_from_urdf(text, ["j1", "j2"]).joint_names == ("j1", "j2")
    else:
        assert arm_from_urdf(text, ["j1", "j2"]).outputs == 3
        with pytest.raises(RobotError, match="not planar"):
            arm_from_urdf(text, ["j1", "j2"], planar=True)


def test_an_active_follower_or_leader_is_refused():
    mimic = '<mimic joint="j2"/>'
    text = chain_urdf(turning(), turning(), turning(more=mimic))
    with pytest.raises(OptionError, match=r"'j1', 'j3'.*on their own.*'j1', 'j2'$"):
        arm_from_urdf(text, ["j1", "j3"])
    for joints in (["j1", "j2"], None):
        with pytest.raises(RobotError, match=r"'j3' mimics the active 'j2'"):
            arm_from_urdf(text, joints, planar=True)


USUAL = ("tool0", "tcp", "tool", "tip", "ee_link", "ee", "end_effector", "gripper_frame_link")


@pytest.mark.parametrize("name", [form for n in USUAL for form in (n, f"left_{n.upper()}")])
def test_every_usual_name_of_a_tip_is_followed(name):
    text = branching('<origin xyz="0.1 0 0"/>', "camera", kind="fixed").replace('"tip"', '"lamp"')
    for order in (("camera_link", name), ("lamp", name)):
        assert find_tip(parse_robot(text.replace(*order)), "l0") == name
