"""What cannot be used as an arm: one line each, naming the value and the remedy."""

from pathlib import Path

import numpy as np
import pytest
from chains import NO_TIP, SLIDE, chain_urdf, joint, robot, turning

from calib import CalibError, RobotError, load_arm
from calib.arm.loading import arm_from_urdf

GOOD = load_arm("two_link").urdf
ELBOW = '<joint name="elbow" type="revolute">'
AXIS = '<axis xyz="0 0 1"/>'
SECOND_PARENT = (
    '<joint name="extra" type="fixed"><parent link="base"/><child link="forearm"/></joint></robot>'
)


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


LAUGHS = changed("<robot", '<!DOCTYPE r [<!ENTITY a "aaa">]>\n<robot')
LOOP = '<joint name="back" type="fixed"><parent link="tip"/><child link="base"/></joint></robot>'
FLOATING = ELBOW.replace("revolute", "floating")
MANY = "".join(
    f'<link name="l{k + 1}"/><joint name="j{k}" type="fixed"><parent link="l{k}"/>'
    f'<child link="l{k + 1}"/></joint>'
    for k in range(1_001)
)
STUCK = chain_urdf(turning(lower="0", upper="0"), turning())
SIDE_BY_SIDE = (
    '<robot name="r"><link name="o"/><link name="l"/><link name="m"/>'
    f'<joint name="a" type="revolute"><parent link="o"/><child link="l"/>{turning()}</joint>'
    f'<joint name="b" type="revolute"><parent link="o"/><child link="m"/>{turning()}</joint>'
    "</robot>"
)
BENT = chain_urdf(turning(), turning(axis="0 1 0"), turning())
FOLLOWED = chain_urdf(turning(), turning(), turning(more='<mimic joint="j2"/>'))
NINE = robot(*[joint(f"j{k}", f"l{k}", f"l{k + 1}", "0.1 0 0.05", "0 1 0") for k in range(9)])
BODY = '<mujoco><worldbody><body name="a">{}</body></worldbody></mujoco>'
UPPER_ARM = '<parent link="upper_arm"/>'

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
    (f'<robot name="r"><link name="l0"/>{MANY}</robot>', {}, "1001 joints 1000"),
    # MuJoCo's
    ('<mujoco><include file="arm.xml"/></mujoco>', {}, "include arm.xml"),
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
    (NO_TIP, {}, "'j2' lies on its axis tip link"),
    (NO_TIP, {"tip": "tip"}, "'tip' lies on its axis tip link"),
    (chain_urdf(turning(), turning()), {"tip": "l2"}, "'l2' lies on its axis another tip"),
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
    with pytest.raises(CalibError) as caught:
        (arm_from_urdf if "<" in robot else load_arm)(robot, **options)
    message = str(caught.value)
    assert [word for word in words.split() if word not in message] == []
    assert "\n" not in message
    assert len(message) < 500


def test_files_that_cannot_be_read(tmp_path):
    latin, hidden, empty, huge = (tmp_path / n for n in ("latin", "hidden", "empty", "huge"))
    hidden.write_bytes(LAUGHS.encode("utf-16"))  # a document type
    latin.write_bytes(GOOD.replace("base", "bäse").encode("latin-1"))
    empty.write_text(" \n")
    with huge.open("wb") as file:
        file.truncate(51_000_000)  # a hole, not 50 MB of disk
    cases = {
        latin: "not UTF-8",
        hidden: "not UTF-8",
        empty: "is empty",
        huge: "50 MB",
        tmp_path: "is no file",
        tmp_path / "missing.urdf": "no such file",
    }
    if Path("/dev/zero").exists():  # which never ends
        cases[Path("/dev/zero")] = "is no file"
    for path, words in cases.items():
        with pytest.raises(RobotError) as caught:
            load_arm(path)
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)
