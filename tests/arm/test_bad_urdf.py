"""URDF input that cannot be used: one line each, naming the value and the remedy."""

from pathlib import Path

import pytest

from calib.arm.description import parse_robot
from calib.arm.loading import arm_from_urdf, load_arm
from calib.arm.robots import resolve_robot
from calib.arm.urdf import LIMITS, read_urdf
from calib.errors import RobotError

GOOD = read_urdf(resolve_robot("two_link"))
ELBOW = '<joint name="elbow" type="revolute">'
AXIS = '<axis xyz="0 0 1"/>'
REMEDY = "joints are supported; make it fixed"
SECOND_PARENT = (
    '<joint name="extra" type="fixed"><parent link="base"/><child link="forearm"/></joint></robot>'
)


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


BAD = {
    "truncated": (GOOD[:-40], ["well-formed", "truncated", "line"]),
    "entity": (
        changed("<robot", '<!DOCTYPE r [<!ENTITY a "aaa">]>\n<robot'),
        ["<!DOCTYPE", "remove"],
    ),
    "xacro element": (
        changed("</robot>", '<xacro:include filename="x"/></robot>'),
        ["xacro", "expand"],
    ),
    "xacro value": (changed("0.25 0 0", "${length} 0 0"), ["${length}", "expand"]),
    "sdf": ('<sdf version="1.7"><model name="m"/></sdf>', ["<sdf>", "<robot>", "convert"]),
    "floating": (
        changed(ELBOW, ELBOW.replace("revolute", "floating")),
        ["'elbow'", "floating", REMEDY],
    ),
    "two parents": (
        changed("</robot>", SECOND_PARENT),
        ["no tree", "another parent", "elbow", "remove one"],
    ),
    "a loop and no root": (
        changed(
            "</robot>",
            '<joint name="back" type="fixed"><parent link="tip"/><child link="base"/></joint>'
            "</robot>",
        ),
        ["no tree", "loop", "back", "remove one"],
    ),
    "unknown parent": (
        changed('<parent link="upper_arm"/>', '<parent link="uper_arm"/>'),
        ["'elbow'", "'uper_arm'", "did you mean upper_arm?"],
    ),
    "axis 0 0 0": (changed(AXIS, '<axis xyz="0 0 0"/>'), ["'shoulder'", "0 0 0", "direction"]),
    "origin nan": (changed("0.3 0 0", "nan 0 0"), ["'elbow'", "origin xyz", "'nan 0 0'"]),
    "origin beyond the Earth": (changed("0.3 0 0", "1e308 0 0"), ["'elbow'", "1e+308 m", "metres"]),
    "too many joints": (
        '<robot name="r"><link name="l0"/>'
        + "".join(
            f'<link name="l{k + 1}"/><joint name="j{k}" type="fixed"><parent link="l{k}"/>'
            f'<child link="l{k + 1}"/></joint>'
            for k in range(1_001)
        )
        + "</robot>",
        ["1001 joints", "at most 1000"],
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_each_bad_urdf_gets_one_line(case):
    text, words = BAD[case]
    with pytest.raises(RobotError) as caught:
        arm_from_urdf(text)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 500
    for word in words:
        assert word in message


def test_the_file_is_named_in_the_line(tmp_path):
    path = tmp_path / "broken.urdf"
    path.write_text(GOOD[:-40])
    with pytest.raises(RobotError, match=r"^broken\.urdf: "):
        load_arm(path)


def test_files_that_cannot_be_read(tmp_path):
    latin, hidden, empty, huge = (tmp_path / n for n in ("latin", "hidden", "empty", "huge"))
    hidden.write_bytes(BAD["entity"][0].encode("utf-16"))  # a document type
    latin.write_bytes(GOOD.replace("base", "bäse").encode("latin-1"))
    empty.write_text(" \n")
    with huge.open("wb") as file:
        file.truncate(LIMITS.size + 1)  # a hole, not 50 MB of disk
    cases = {
        latin: "not UTF-8",
        hidden: "not UTF-8",
        empty: "is empty",
        huge: "50 MB",
        tmp_path: "is no file",
        tmp_path / "missing.urdf": "is no file",
    }
    if Path("/dev/zero").exists():  # which never ends
        cases[Path("/dev/zero")] = "is no file"
    for path, words in cases.items():
        with pytest.raises(RobotError) as caught:
            read_urdf(path)
        assert str(path) in str(caught.value)
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_billion_laughs_are_refused_before_parsing(monkeypatch):
    def parsed(_text):
        raise AssertionError("the XML parser was called")

    monkeypatch.setattr("xml.etree.ElementTree.fromstring", parsed)
    with pytest.raises(RobotError, match="<!DOCTYPE"):
        parse_robot(BAD["entity"][0])


def test_deeply_nested_text_is_no_danger():
    text = '<robot name="r">' + "<a>" * 200_000 + "</a>" * 200_000 + "</robot>"
    with pytest.raises(RobotError, match="no links"):
        parse_robot(text)
