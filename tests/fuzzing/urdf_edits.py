"""Edits of a URDF: some leave it XML, others make careless readers fetch, grow or fall."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from copy import deepcopy
from pathlib import Path
from random import Random

from .mutate import NAMES, NUMBERS


def _set(rng: Random, _robot: ET.Element, node: ET.Element) -> None:
    key = rng.choice([*node.attrib, "name", "xyz", "type"])
    values = NAMES if key in ("name", "link", "joint") else NUMBERS
    value = rng.choice(values)
    if key in ("xyz", "rpy"):
        parts = node.get(key, "0 0 1").split()
        if parts and rng.random() < 0.8:
            parts[rng.randrange(len(parts))] = value
            value = " ".join(parts)
    if key == "type":
        value = rng.choice(("revolute", "continuous", "prismatic", "fixed", "floating", "x", ""))
    # what XML cannot hold makes the whole text unreadable: seldom, so that more is tried
    if any(ord(c) < 32 and c not in "\t\n\r" for c in value) and rng.random() < 0.9:
        value = "x"
    node.set(key, value)


def _unset(rng: Random, _robot: ET.Element, node: ET.Element) -> None:
    if node.attrib:
        del node.attrib[rng.choice(list(node.attrib))]


def _removed(rng: Random, robot: ET.Element, node: ET.Element) -> None:
    for parent in robot.iter():
        if node in list(parent):
            parent.remove(node)
            return


def _doubled(rng: Random, robot: ET.Element, node: ET.Element) -> None:
    if node is not robot:
        rng.choice([robot, *robot]).insert(0, deepcopy(node))


def _renamed(rng: Random, _robot: ET.Element, node: ET.Element) -> None:
    node.tag = rng.choice(("link", "joint", "robot", "mimic", "axis", "xacro", "origin", "a:b"))


def _exchanged(rng: Random, robot: ET.Element, _node: ET.Element) -> None:
    """Give two joints each other's attributes, or one another's links."""
    joints = robot.findall("joint")
    if len(joints) > 1:
        one, other = rng.sample(joints, 2)
        tag = rng.choice(("parent", "child", "origin", "axis", "limit"))
        a, b = one.find(tag), other.find(tag)
        if a is not None and b is not None:
            a.attrib, b.attrib = b.attrib, a.attrib


def _mimicked(rng: Random, robot: ET.Element, _node: ET.Element) -> None:
    joints = robot.findall("joint")
    if joints:
        leader = rng.choice(joints).get("name", "")
        ET.SubElement(rng.choice(joints), "mimic", joint=leader, multiplier=rng.choice(NUMBERS))


EDITS = (_set, _set, _set, _set, _unset, _removed, _doubled, _renamed, _exchanged, _mimicked)


def hostile(rng: Random, data: bytes, secret: Path, port: int) -> bytes:
    """Add what makes careless readers fetch, grow or fall."""
    outside = rng.choice((
        f"file://{secret}", str(secret), "package://../secret.stl", "../secret.stl",
        f"http://127.0.0.1:{port}/a.stl", f"https://127.0.0.1:{port}/a.stl",
        f"ftp://127.0.0.1:{port}/a", f"//127.0.0.1:{port}/a.stl", "package://meshes/../../secret.stl",
        "file:///etc/passwd", "..%2fsecret.stl", "model://..%2f/secret.stl",
    ))  # fmt: skip
    text = data.decode("utf-8", "replace")
    mesh = f'<visual><geometry><mesh filename="{outside}"/></geometry></visual>'
    laughs = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10 if k else "lol"}">' for k in range(10))
    before, after = rng.choice((
        ("", mesh),
        (f'<!DOCTYPE r SYSTEM "{outside}">', ""),
        (f'<!DOCTYPE r [<!ENTITY e SYSTEM "{outside}">]>', "&e;"),
        (f'<!DOCTYPE r [<!ENTITY % e SYSTEM "{outside}"> %e;]>', ""),
        (f"<!DOCTYPE r [{laughs}]>", "&l9;"),
        (f'<?xml-stylesheet href="{outside}"?>', ""),
        ("", f'<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="{outside}"/>'),
        ("", f'<link name="s" xsi:schemaLocation="{outside}" xmlns:xsi="http://www.w3.org/2001/'
             'XMLSchema-instance"/>'),
        ("", "<a>" * 3000 + "</a>" * 3000),
        ("", "<a>" * 200_000),
        ("", "".join(f'<link name="k{k}"/>' for k in range(3000))),
        ("", "<a " + " ".join(f'b{k}="{k}"' for k in range(10_000)) + "/>"),
        ("", f"<!--{'-x' * 100_000}-->"),
        ("", f"<a>{'x' * 1_000_000}</a>"),
        ("", f"<![CDATA[{mesh}]]>"),
        ('<?xml version="1.1" encoding="utf-16"?>', ""),
        ('<?xml version="1.0" encoding="no-such"?>', ""),
        (f'<?xml version="1.0" encoding="{"x" * 3000}"?>', ""),
    ))  # fmt: skip
    place = text.find("<link") if rng.random() < 0.5 else text.rfind("</robot>")
    if after == mesh and "<link" in text:
        place = text.index(">", text.index("<link")) + 1
        text = (
            text[:place].replace("/>", ">")
            + after
            + ("</link>" if text[place - 2] == "/" else "")
            + text[place:]
        )
    elif place >= 0:
        text = text[:place] + after + text[place:]
    start = text.find("<robot")
    return (before + text[max(start, 0) :]).encode("utf-8", "replace")
