"""URDFs: random arms, which have to be right, and damaged ones, which may be refused."""

import xml.etree.ElementTree as ET
from copy import deepcopy
from pathlib import Path

import numpy as np
import pinocchio
import pytest

import calib
from hostile.damage import NAMES, NUMBERS, damaged
from hostile.guard import each_seed, guarded, one_line

FAR = 1e4
"""Placements beyond this [m] are compared in parts of their size."""

BUNDLED = ("two_link", "two_link_full", "three_link", "polar", "scara", "six_axis")
ROBOTS = Path(__file__).parents[2] / "robots"


@pytest.fixture
def load(tmp_path):
    """Load the content of a URDF file under guard: an arm, or a refusal in one line."""

    def one(content):
        path = tmp_path / "robot.urdf"
        path.write_bytes(content)
        try:
            with guarded(tmp_path):
                arm = calib.load_arm(path)
        except calib.CalibError as error:
            return one_line(str(error))
        for note in arm.notes:
            one_line(note)
        return arm

    return one


def tips(text, link, values):
    """Pinocchio's own positions of a link, (n, 3) [m], for joint values by name [rad or m]."""
    model = pinocchio.buildModelFromXML(text)
    data, frame = model.createData(), model.getFrameId(link, pinocchio.FrameType.BODY)
    found = []
    for row in values:
        q = pinocchio.neutral(model)
        for number, name in enumerate(model.names):
            if number and name in row:
                joint = model.joints[number]
                turn = (np.cos(row[name]), np.sin(row[name]))
                q[joint.idx_q : joint.idx_q + joint.nq] = turn if joint.nq == 2 else row[name]
        pinocchio.framesForwardKinematics(model, data, q)
        found.append(data.oMf[frame].translation.copy())
    return np.array(found)


def agrees_with_pinocchio(arm, text):
    """Compare an arm with Pinocchio at random joint values."""
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (5, arm.dof))
    rows = [{**arm.locked, **dict(zip(arm.joint_names, row, strict=True))} for row in q]
    truth, said = tips(text, arm.tip, rows), arm.forward(q)
    # an axis may be askew by 1e-4 rad: what leaves the plane is projected onto it
    planar = said.shape[1] == 2
    seen = arm.plane.project(truth) if planar else truth
    far = np.abs(arm.chain.motion(q).places).max()
    size = max(1.0, np.abs(truth).max() / FAR, far / FAR)
    assert np.abs(said - seen).max() <= 1e-9 * size
    if planar:
        away = (truth - arm.plane.origin) @ arm.plane.normal
        reach = np.abs(truth - arm.plane.origin).max() + far
        assert np.abs(away).max() <= 1e-9 * size + 1e-3 * reach


def _set(rng, _robot, node):
    key = rng.choice([*node.attrib, "name", "xyz", "type"])
    value = rng.choice(NAMES if key in ("name", "link", "joint") else NUMBERS)
    if key in ("xyz", "rpy"):
        parts = node.get(key, "0 0 1").split()
        if parts and rng.random() < 0.8:
            parts[rng.randrange(len(parts))] = value
            value = " ".join(parts)
    if key == "type":
        value = rng.choice(("revolute", "continuous", "prismatic", "fixed", "floating", "x", ""))
    # what XML cannot hold makes the whole text unreadable: seldom, so that more is tried
    unreadable = any(ord(c) < 32 and c not in "\t\n\r" for c in value)
    node.set(key, "x" if unreadable and rng.random() < 0.9 else value)


def _remove(rng, robot, node):
    for parent in robot.iter():
        if node in list(parent):
            parent.remove(node)
            return


def _double(rng, robot, node):
    if node is not robot:
        rng.choice([robot, *robot]).insert(0, deepcopy(node))


EDITS = (_set, _set, _set, _remove, _double)


def edited(rng, data):
    """Change elements and attributes; the result is XML again."""
    robot = ET.fromstring(data)
    for _ in range(rng.randint(1, 4)):
        joints = robot.findall("joint")
        nodes = list(rng.choice(joints).iter() if joints and rng.random() < 0.5 else robot.iter())
        rng.choice(EDITS)(rng, robot, rng.choice(nodes))
    return ET.tostring(robot, encoding="utf-8")


def hostile(rng, data, secret):
    """Add what makes careless readers fetch, grow or fall."""
    outside = rng.choice((f"file://{secret}", str(secret), "package://../secret.stl",
                          "http://127.0.0.1:9/a.stl", "//127.0.0.1:9/a",
                          "..%2fsecret.stl"))  # fmt: skip
    text = data.decode("utf-8", "replace")
    laughs = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10 if k else "lol"}">' for k in range(10))
    before, inside = rng.choice((
        ("", f'<link name="m"><visual><geometry><mesh filename="{outside}"/></geometry></visual>'
             "</link>"),
        (f'<!DOCTYPE r SYSTEM "{outside}">', ""),
        (f'<!DOCTYPE r [<!ENTITY e SYSTEM "{outside}">]>', "&e;"),
        (f"<!DOCTYPE r [{laughs}]>", "&l9;"),
        ("", f'<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="{outside}"/>'),
        ("", "<a>" * 200_000),
        ("", "".join(f'<link name="k{k}"/>' for k in range(3000))),
        ("", f"<a>{'x' * 1_000_000}</a>"),
        ('<?xml version="1.1" encoding="utf-16"?>', ""),
    ))  # fmt: skip
    place = max(text.rfind("</robot>"), 0)
    text = text[:place] + inside + text[place:]
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
    bundled = [(ROBOTS / f"{name}.urdf").read_bytes() for name in BUNDLED]

    def judge(rng):
        data = rng.choice(bundled)
        change = rng.choice((damaged, edited, edited, lambda r, d: hostile(r, d, secret)))
        data = change(rng, data)
        arm = load(data)
        if isinstance(arm, str):
            assert not ("well-formed" in arm and is_xml(data)), arm
            return "refused"
        assert np.isfinite(arm.forward((arm.lower + arm.upper) / 2)).all()
        if "<mimic" in arm.urdf:
            return "with a joint that follows"
        try:
            tips(arm.urdf, arm.tip, [])
        except Exception:  # what Pinocchio refuses and calib mends has nothing to compare with
            return "not read by Pinocchio"
        if any("no <axis>" in note for note in arm.notes):  # Pinocchio may read it otherwise
            return "with a word about an axis"
        agrees_with_pinocchio(arm, arm.urdf)
        return "right"

    found = each_seed(100, judge)
    assert min(found["right"], found["refused"]) > 10
