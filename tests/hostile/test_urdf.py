"""URDFs: random arms, which have to be right, and damaged ones, which may be refused."""

import xml.etree.ElementTree as ET
from collections import Counter
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference import pinocchio_pose, random_joints

import calib
from hostile.guard import NAMES, NUMBERS, answer, damaged, inputs, one_line

FAR = 1e4
"""Placements beyond this [m] are compared in parts of their size."""


@pytest.fixture
def load(tmp_path):
    """Load the content of a URDF file under guard: an arm, or a refusal in one line."""

    def one(content):
        arm = answer(tmp_path / "robot.urdf", content, calib.load_arm)
        for note in () if isinstance(arm, str) else arm.notes:
            one_line(note)
        return arm

    return one


def agrees_with_pinocchio(arm, q, truth):
    """Compare an arm with Pinocchio's positions (n, 3) [m] at joint values (n, dof)."""
    # an axis may be askew by 1e-4 rad: what leaves the plane is projected onto it
    planar = arm.outputs == 2
    seen = arm.plane.project(truth) if planar else truth
    far = np.abs(arm.chain.state(q).places).max()
    size = max(1.0, np.abs(truth).max() / FAR, far / FAR)
    assert np.abs(arm.forward(q) - seen).max() <= 1e-9 * size
    if planar:
        from_origin = truth - arm.plane.origin
        reach = np.abs(from_origin).max() + far
        assert np.abs(from_origin @ arm.plane.normal).max() <= 1e-9 * size + 1e-3 * reach


@st.composite
def edited(draw, data):
    """A URDF of which elements and attributes were changed; the result is XML again."""
    robot = ET.fromstring(data)
    for _ in range(draw(st.integers(1, 4))):
        node = draw(st.sampled_from([*robot.iter(), *robot.findall(".//joint//")]))
        parents = [parent for parent in robot.iter() if node in list(parent)]
        way = draw(st.sampled_from(("set", "set", "set", "remove", "double")))
        if way == "set":
            node.set(*draw(attributes(node)))
        elif parents and way == "remove":
            parents[0].remove(node)
        elif parents:
            draw(st.sampled_from([robot, *robot])).insert(0, deepcopy(node))
    return ET.tostring(robot, encoding="utf-8")


@st.composite
def attributes(draw, node):
    """An attribute of an element, and what may be written there."""
    key = draw(st.sampled_from([*node.attrib, "name", "xyz", "type"]))
    if key == "type":
        return key, draw(st.sampled_from(("revolute", "continuous", "prismatic", "floating", "")))
    value = draw(NAMES if key in ("name", "link", "joint") else NUMBERS)
    if not all(c.isprintable() for c in value):
        value = "x"  # what XML cannot hold makes the whole text unreadable
    if key in ("xyz", "rpy"):
        parts = node.get(key, "0 0 1").split()
        value = " ".join([*parts[:1], value, *parts[2:]])
    return key, value


def traps(secret):
    """What stands before and within a robot to make careless readers fetch, grow or fall."""
    laughs = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10 if k else "lol"}">' for k in range(10))
    found = [
        (f"<!DOCTYPE r [{laughs}]>", "&l9;"),
        ("", "<a>" * 200_000),
        ("", "".join(f'<link name="k{k}"/>' for k in range(3000))),
        ("", f"<a>{'x' * 1_000_000}</a>"),
        ('<?xml version="1.1" encoding="utf-16"?>', ""),
    ]
    for outside in (f"file://{secret}", str(secret), "package://../secret.stl",
                    "http://127.0.0.1:9/a.stl", "..%2fsecret.stl"):  # fmt: skip
        mesh = f'<visual><geometry><mesh filename="{outside}"/></geometry></visual>'
        include = "http://www.w3.org/2001/XInclude"
        found += [
            ("", f'<link name="m">{mesh}</link>'),
            (f'<!DOCTYPE r SYSTEM "{outside}">', ""),
            (f'<!DOCTYPE r [<!ENTITY e SYSTEM "{outside}">]>', "&e;"),
            ("", f'<xi:include xmlns:xi="{include}" href="{outside}"/>'),
        ]
    return found


def trapped(data, trap):
    before, inside = trap
    text = data.decode("utf-8", "replace").replace("</robot>", f"{inside}</robot>")
    return (before + text[max(text.find("<robot"), 0) :]).encode("utf-8", "replace")


def is_xml(data):
    try:
        ET.fromstring(data.decode("utf-8-sig"))
    except (ET.ParseError, ValueError):
        return False
    return True


def test_damaged_files_are_right_or_refused(load, tmp_path_factory):
    """What loads agrees with Pinocchio, where that reads it too; nothing else is opened."""
    secret = tmp_path_factory.mktemp("outside") / "secret.stl"
    secret.write_text("solid secret\n")
    bundled = st.sampled_from([Path(e.path).read_bytes() for e in calib.list_robots()])
    ways = (damaged, edited, edited, lambda data: st.builds(trapped, st.just(data), snares))
    snares = st.sampled_from(traps(secret))
    found = Counter()

    @inputs(120)
    @given(bundled.flatmap(lambda data: st.one_of(*(way(data) for way in ways))))
    def judge(data):
        arm = load(data)
        if isinstance(arm, str):
            assert not ("well-formed" in arm and is_xml(data)), arm
            found["refused"] += 1
            return
        assert np.isfinite(arm.forward((arm.lower + arm.upper) / 2)).all()
        if "<mimic" in arm.urdf or any("no <axis>" in note for note in arm.notes):
            return  # Pinocchio may read it otherwise
        q = random_joints(arm, 5)
        try:
            truth = pinocchio_pose(arm, q)[0]
        except Exception:  # what Pinocchio refuses and calib mends has nothing to compare with
            return
        agrees_with_pinocchio(arm, q, truth)
        found["right"] += 1

    judge()
    assert min(found["right"], found["refused"]) > 10
