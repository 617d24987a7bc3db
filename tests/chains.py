"""URDF texts of small chains, for the tests of arms."""

import re
from pathlib import Path

DATA = Path(__file__).parent / "data"
SLIDE, ENDLESS = "<!--slide-->", "<!--endless-->"
KINDS = {SLIDE: "prismatic", ENDLESS: "continuous"}
LIMIT = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'


def element(name, parent, child, inside, kind):
    links = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{links}{inside}</joint>'


def joint(name, parent, child, xyz, axis, kind="revolute", extra=""):
    inside = f'<origin xyz="{xyz}" rpy="0.1 -0.2 0.3"/><axis xyz="{axis}"/>{LIMIT}{extra}'
    return element(name, parent, child, inside, kind)


def robot(*joints):
    """A URDF of joints, with a link for each name in them."""
    names = dict.fromkeys(name for text in joints for name in re.findall('link="(.*?)"', text))
    links = "".join(f'<link name="{name}"/>' for name in names)
    return f'<robot name="chain">{links}{"".join(joints)}</robot>'


def chain_urdf(*joints: str, tip: str = "0.2 0 0") -> str:
    """A serial robot: joints j1, j2, ... given by the inside of their elements, and a tip."""
    parts = []
    for k, inside in enumerate(joints, 1):
        kind = next((KINDS[mark] for mark in KINDS if mark in inside), "revolute")
        parts.append(element(f"j{k}", f"l{k - 1}", f"l{k}", inside, kind))
    end = f'<origin xyz="{tip}"/>'
    return robot(*parts, element("mount", f"l{len(joints)}", "tip", end, "fixed"))


def turning(axis="0 0 1", xyz="0.3 0 0", lower="-1", upper="1", more="") -> str:
    limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
    return f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{limit}{more}'


def planar_chain(joints: int, slide: int | None = None, reach: float = 0.6) -> str:
    """A planar chain of equal links; one joint may slide."""
    length = reach / joints
    parts = [turning("0 0 1", f"{length * (k > 0)} 0 0", "-1.4", "1.4") for k in range(joints)]
    if slide is not None:
        parts[slide] = turning("1 0 0", f"{length * (slide > 0)} 0 0", "0", "0.1") + SLIDE
    return chain_urdf(*parts, tip=f"{length} 0 0")


NO_TIP = chain_urdf(turning(), turning(), tip="0 0 0")
MIXED = (DATA / "mixed.xml").read_text()
FOLLOWED = (DATA / "followed.xml").read_text()
