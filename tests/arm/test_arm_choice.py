"""Which arm of a robot is chosen and what is told of it; what is none, refused in one line."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from chains import ENDLESS, NO_TIP, SLIDE, chain_urdf, element, joint, robot, turning
from conftest import refused
from hypothesis import given
from hypothesis import strategies as st

from calib import CalibError, RobotError, load_arm
from calib.arm.loading import arm_from_urdf

CASES = [  # of a bundled robot: options, joints, tip
    ("three_link", {"joints": ["wrist", "shoulder", "elbow"]}, "shoulder elbow wrist", "tip"),
    ("three_link", {"joints": "elbow,shoulder"}, "shoulder elbow", "tip"),
    ("two_link", {"tip": "tip_mount"}, "shoulder elbow", "tip"),  # named by its joint
    ("six_axis", {"planar": True}, "shoulder_lift elbow wrist_1", None),
    ("six_axis", {"joints": ["elbow", "shoulder_lift"], "tip": "wrist_1"}, "shoulder_lift elbow",
     None),
    ("six_axis", {"columns": ["shoulder_pan", "shoulder_lift", "elbow", "x", "y", "z"]},
     "shoulder_pan shoulder_lift elbow", None),
]  # fmt: skip
TWO = chain_urdf(turning(), turning())
USUAL = ("tool0", "tcp", "tool", "tip", "ee_link", "ee", "end_effector", "gripper_frame_link")
GOOD = load_arm("two_link").urdf
ELBOW = '<joint name="elbow" type="revolute">'
AXIS = '<axis xyz="0 0 1"/>'
SECOND_PARENT = element("extra", "base", "forearm", "", "fixed") + "</robot>"
LOOP = element("back", "tip", "base", "", "fixed") + "</robot>"
FLOATING = ELBOW.replace("revolute", "floating")
NAMES = [(f"j{k}", f"l{k}", f"l{k + 1}") for k in range(1_001)]
MANY = robot(*[joint(*names, "0 0 0", "0 0 1", "fixed") for names in NAMES])
STUCK = chain_urdf(turning(lower="0", upper="0"), turning())
SIDE_BY_SIDE = robot(*[joint(a, "o", b, "0.3 0 0", "0 0 1") for a, b in ("al", "bm")])
BENT = chain_urdf(turning(), turning(axis="0 1 0"), turning())
FOLLOWED = chain_urdf(turning(), turning(), turning(more='<mimic joint="j2"/>'))
NINE = robot(*[joint(*names, "0.1 0 0.05", "0 1 0") for names in NAMES[:9]])
BODY = '<mujoco><worldbody><body name="a">{}</body></worldbody></mujoco>'
UPPER_ARM = '<parent link="upper_arm"/>'


@pytest.mark.parametrize(("name", "options", "joints", "tip"), CASES)
def test_joints_and_tips_are_chosen(name, options, joints, tip):
    arm = load_arm(name, **options)
    assert arm.joint_names == tuple(joints.split())
    assert tip in (None, arm.tip)
    assert arm.outputs == (3 if "columns" in options else 2)


def test_other_joints_are_locked_at_neutral_or_where_told():
    arm = load_arm("three_link", ["shoulder", "wrist"])
    assert arm.locked == {"elbow": pytest.approx(np.deg2rad(15))}  # 0 clipped into its limits
    assert any("elbow=0.2618" in note for note in arm.notes)
    told = load_arm("three_link", ["shoulder", "wrist"], lock={"elbow": 1.0})
    assert told.locked == {"elbow": 1.0}
    expected = load_arm("three_link").forward([0.3, 1.0, -0.2])
    np.testing.assert_allclose(told.forward([0.3, -0.2]), expected, atol=1e-15)
    mimic = '<mimic joint="j2" multiplier="-2" offset="0.1"/>'
    text = chain_urdf(turning(), turning(), turning(more=mimic), turning())
    arm = arm_from_urdf(text, ["j1", "j4"], lock={"j2": 0.2})
    assert arm.locked == {"j2": 0.2, "j3": pytest.approx(-0.3)}
    arm = load_arm("six_axis", columns=["shoulder_lift", "elbow", "x", "y"], planar=True)
    assert any("the log has no columns for them" in note for note in arm.notes)


@pytest.mark.parametrize(("angle", "outputs"), [(0.9e-4, 2), (1.1e-4, 3)])
def test_axes_may_differ_by_a_ten_thousandth(angle, outputs):
    text = chain_urdf(turning(), turning(axis=f"{np.sin(angle)} 0 {-np.cos(angle)}"))
    assert arm_from_urdf(text, ["j1", "j2"]).outputs == outputs


@pytest.mark.parametrize("name", [form for n in USUAL for form in (n, f"left_{n.upper()}")])
def test_every_usual_name_of_a_tip_is_followed(name):
    camera = joint("camera", "l2", "camera_link", "0.1 0 0", "0 0 1", "fixed")
    text = TWO.replace("</robot>", f'<link name="camera_link"/>{camera}</robot>')
    text = text.replace('"tip"', '"lamp"')
    for order in (("camera_link", name), ("lamp", name)):
        assert arm_from_urdf(text.replace(*order)).tip == name


def two_arms(length, kind="revolute"):
    return robot(
        joint("l1", "base", "la", "0 0.1 0", "0 0 1"),
        joint("l2", "la", "lb", "0.3 0 0", "0 1 0", kind),
        joint("l3", "lb", "left", "0.3 0 0", "1 0 0", "fixed"),
        joint("r1", "base", "ra", "0 -0.1 0", "0 0 1"),
        joint("r2", "ra", "rb", "0.3 0 0", "0 1 0"),
        joint("r3", "rb", "right", f"{length} 0 0", "1 0 0", "fixed"),
    )


def test_equal_arms_are_told_and_a_log_must_choose():
    arm = arm_from_urdf(two_arms(0.3))
    assert arm.joint_names == ("l1", "l2")
    assert any("'r1', 'r2'" in note for note in arm.notes)
    with pytest.raises(RobotError, match=r"'l1', 'l2'.*'left'.*'r1', 'r2'.*'right'"):
        arm_from_urdf(two_arms(0.3), columns=["l1", "l2", "r1", "r2"])
    assert arm_from_urdf(two_arms(0.3), columns=["r1", "r2"]).joint_names == ("r1", "r2")
    assert arm_from_urdf(two_arms(0.4)).joint_names == ("r1", "r2")
    # what slides reaches further
    assert arm_from_urdf(two_arms(0.4, "prismatic")).joint_names == ("l1", "l2")


def test_what_a_file_misses_is_mended_aloud_and_giant_links_are_told():
    arm = arm_from_urdf(chain_urdf(turning(), turning(), turning(more='<mimic joint="no"/>')))
    assert any("'no', which does not exist" in note for note in arm.notes)
    text = TWO.replace('<axis xyz="0 0 1"/>', "")
    arm = arm_from_urdf(text.replace("0.2 0 0", "0.2 0.1 0"))
    assert any("no <axis>" in note for note in arm.notes)
    assert pin.buildModelFromXML(text).joints[1].shortname() == "JointModelRX"
    assert arm.chain.axes[0] == pytest.approx([1, 0, 0])
    # giant links may be in millimetres
    notes = arm_from_urdf(chain_urdf(turning(), turning("0 0 1", "300 0 0"))).notes
    assert any(note.startswith("links of 300") and "in mm" in note for note in notes)


def test_a_byte_order_mark_a_namespace_and_what_a_comment_says_are_no_obstacle(tmp_path):
    path = tmp_path / "bom.urdf"
    xacro = TWO.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    start = b'\xef\xbb\xbf<?xml version="1.0" encoding="utf-8"?><!-- no <!DOCTYPE here -->'
    path.write_bytes(start + xacro.encode())
    q = [[0.1, 0.2]]
    np.testing.assert_array_equal(load_arm(path).forward(q), arm_from_urdf(TWO).forward(q))


def test_a_range_narrows_a_joint_within_its_limits_and_mends_those_that_are_none():
    arm = load_arm("two_link", ranges={"elbow": (0.5, 1.0), "shoulder": (0, 1.5708)})
    np.testing.assert_array_equal([arm.lower, arm.upper], [[0, 0.5], [np.pi / 2, 1.0]])
    again = arm.with_range({"elbow": (0.3, 2.0)})  # limits are the joint's, not the last range
    assert again.lower[1] == 0.3
    text = chain_urdf(turning(), turning(lower="2", upper="-2"))
    refused(RobotError, r"2 to -2 rad are unusable.*ranges=.*j2", arm_from_urdf, text)
    assert arm_from_urdf(text, ranges={"j2": (-2, 2)}).upper[1] == 2
    text = chain_urdf(*[turning().split("<limit")[0]] * 2)
    refused(RobotError, r"j1' .*no limits.*j2' .*no limits", arm_from_urdf, text)
    arm = arm_from_urdf(text, ranges={"j1": (-1, 1), "j2": (0, 1)})
    np.testing.assert_array_equal([arm.lower, arm.upper], [[-1, 0], [1, 1]])


@pytest.mark.parametrize(
    "limits", [("-6.3", "6.3"), ("0", "1", ENDLESS), ("-1e16", "INF"), ("-90", "90")]
)
def test_more_than_one_turn_becomes_one_turn_said_aloud(limits):
    arm = arm_from_urdf(chain_urdf(turning("0 0 1", "0.3 0 0", *limits), turning()))
    assert (arm.lower[0], arm.upper[0]) == (-np.pi, np.pi)
    (note,) = [note for note in arm.notes if "'j1'" in note and "turn" in note]
    assert ("if they are in degrees" in note) is ("90" in limits)
    # another turn than the one around 0 may be asked for
    other = arm.with_range({"j1": (3.0, 3.0 + np.pi)})
    assert other.upper[0] - other.lower[0] == pytest.approx(np.pi)


@given(st.floats(-50, 50), st.floats(2e-3, 50))
def test_one_turn_lies_within_its_range_as_near_to_zero_as_it_can(lower, excess):
    upper = lower + 2 * np.pi + excess
    arm = arm_from_urdf(chain_urdf(turning(lower=repr(lower), upper=repr(upper)), turning()))
    first, last = arm.lower[0], arm.upper[0]
    assert last - first == pytest.approx(2 * np.pi)
    assert lower - 1e-9 <= first < last <= upper + 1e-9
    nearest = np.clip(0.0, lower + np.pi, upper - np.pi)
    assert (first + last) / 2 == pytest.approx(nearest, abs=1e-9)


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


LAUGHS = changed("<robot", '<!DOCTYPE r [<!ENTITY a "aaa">]>\n<robot')
REFUSED = [  # a text or a bundled robot, what is asked of it, and what the line says
    # descriptions
    (GOOD[:-40], {}, "well-formed truncated line"),
    (LAUGHS, {}, "<!DOCTYPE remove"),
    ("<?a <!-- ?>" + LAUGHS + "<?b --> ?>", {}, "<!DOCTYPE remove"),  # no comment hides it
    (changed("</robot>", '<xacro:include filename="x"/></robot>'), {}, "xacro expand"),
    (changed("0.25 0 0", "${length} 0 0"), {}, "${length} expand"),
    ('<sdf version="1.7"><model name="m"/></sdf>', {}, "<sdf> <robot> <mujoco> convert"),
    (changed(ELBOW, FLOATING), {}, "'elbow' floating supported fixed"),
    (changed("</robot>", SECOND_PARENT), {}, "tree another parent elbow remove"),
    (changed("</robot>", LOOP), {}, "tree loop back remove"),
    (changed(UPPER_ARM, '<parent link="uper"/>'), {}, "'elbow' 'uper' upper_arm?"),
    (changed(AXIS, '<axis xyz="0 0 0"/>'), {}, "'shoulder' 0 0 0 direction"),
    (changed(AXIS, '<axis xyz="0 0 -1e308"/>'), {}, "'shoulder' -1e+308"),
    (changed("0.3 0 0", "nan 0 0"), {}, "'elbow' origin xyz 'nan"),
    (changed("0.3 0 0", "1e308 0 0"), {}, "'elbow' 1e+308 metres"),
    (MANY, {}, "1001 joints 1000"),
    # MuJoCo's
    ('<mujoco><include file="arm.xml"/></mujoco>', {}, "include arm.xml"),
    ('<mujoco><worldbody><frame pos="0 0 1"/></worldbody></mujoco>', {}, "frame mj_saveLastXML"),
    (BODY.format('<freejoint name="loose"/>'), {}, "loose free"),
    (BODY.format('<joint name="hip" type="ball"/>'), {}, "hip ball"),
    (BODY.format('<joint name="j" axis="0 0 0"/>'), {}, "'j' axis"),
    (BODY.format('<joint name="j" class="fast"/>'), {}, "class 'fast'"),
    (BODY.format('<joint name="j" pos="1 2"/>'), {}, "'j': pos 3 numbers"),
    (BODY.format('<body euler="0 0 0" quat="1 0 0 0"/>'), {}, "one orientation"),
    ("<mujoco><worldbody/></mujoco>", {}, "bodies"),
    # robots, joints and tips
    ("two_lnk", {}, "'two_lnk' two_link?"),
    ("robots/nowhere.urdf", {}, "'robots/nowhere.urdf' scara three_link"),
    ("x" * 5_000, {}, "xxx... polar"),
    ("two\nlines", {}, r"'two\nlines' polar"),
    ("two_link", {"joints": ["sholder", "elbow"]}, "'sholder' shoulder?"),
    ("two_link", {"joints": ["shoulder", "tip_mount"]}, "'tip_mount' fixed shoulder, elbow"),
    ("two_link", {"joints": ["elbow"]}, "two or more"),
    ("two_link", {"joints": ["elbow", "elbow"]}, "'elbow', 'elbow' each once"),
    ("two_link", {"tip": "tp"}, "'tp' tip?"),
    ("two_link", {"joints": ["shoulder", "elbow"], "tip": "upper_arm"}, "'elbow' 'upper_arm'"),
    ("two_link", {"joints": ["shoulder", "elbow"], "tip": "forearm"}, "'elbow' 'forearm' axis"),
    ("two_link", {"lock": {"nope": 1}}, "`lock` 'nope'"),
    ("two_link", {"lock": {"elbow": 1.0}, "joints": ["shoulder", "elbow"]}, "own once: 'shoulder'"),
    ("two_link", {"lock": {"elbow": 1.0}}, "no arm free: shoulder"),
    ("two_link", {"columns": ["0.5", "1"]}, "no arm columns of the log: (none)"),
    (NO_TIP, {}, "'j2' lies on its axis tip link"),
    (NO_TIP, {"tip": "tip"}, "'tip' lies on its axis tip link"),
    (TWO, {"tip": "l2"}, "'l2' lies on its axis another tip"),
    (SIDE_BY_SIDE, {}, "in one chain a, b"),
    (chain_urdf(turning()), {}, "two joints free: j1"),
    # limits that leave no room: named only where they are the reason
    (STUCK, {}, "j1 0 to 0 rad are unusable `ranges={'j1': (LOWER, UPPER)}`"),
    (STUCK, {"lock": {"j2": 0.0}}, "in one chain free: (none)"),
    (BENT, {"joints": ["j1", "j2", "j3"], "planar": True}, "planar: 'j2' axis (0, 1, 0)"),
    (chain_urdf(turning(), turning() + SLIDE), {"joints": ["j1", "j2"], "planar": True},
     "'j2' (0, 0, 1) perpendicular"),
    (chain_urdf(turning() + SLIDE, turning() + SLIDE), {"joints": ["j1", "j2"]}, "all slide along"),
    (FOLLOWED, {"joints": ["j1", "j3"]}, "'j1', 'j3' own 'j1', 'j2'"),
    (FOLLOWED, {"planar": True}, "'j3' mimics active 'j2'"),
    (NINE, {"joints": [f"j{k}" for k in range(8)]}, "2 to 7"),
    # ranges
    ("two_link", {"ranges": {"elbow": (0, 1)}}, "'elbow': (0, 1) 0.261799:2.61799"),
    ("two_link", {"ranges": {"elbow": (1, 0.5)}}, "(1, 0.5) lower one first"),
    ("two_link", {"ranges": {"elbow": (1, 1)}}, "(1, 1)"),
    ("two_link", {"ranges": {"elbow": (np.nan, 1)}}, "nan"),
    ("two_link", {"ranges": {"elbw": (0, 1)}}, "'elbw' elbow?"),
]  # fmt: skip


@pytest.mark.parametrize(("robot", "options", "words"), REFUSED)
def test_what_is_no_arm_is_refused_in_one_line(robot, options, words):
    loader = arm_from_urdf if "<" in robot else load_arm
    message = str(refused(CalibError, None, loader, robot, **options))
    assert [word for word in words.split() if word not in message] == []
    assert len(message) < 500


def test_files_that_cannot_be_read(tmp_path):
    latin, hidden, empty, huge = (tmp_path / n for n in ("latin", "hidden", "empty", "huge"))
    hidden.write_bytes(LAUGHS.encode("utf-16"))  # a document type
    latin.write_bytes(GOOD.replace("base", "bäse").encode("latin-1"))
    empty.write_text(" \n")
    with huge.open("wb") as file:
        file.truncate(51_000_000)  # a hole, not 50 MB of disk
    cases = {latin: "not UTF-8", hidden: "not UTF-8", empty: "is empty", huge: "50 MB"}
    cases |= {tmp_path: "is no file", tmp_path / "missing.urdf": "no such file"}
    if Path("/dev/zero").exists():  # which never ends
        cases[Path("/dev/zero")] = "is no file"
    for path, words in cases.items():
        refused(RobotError, words, load_arm, path)
