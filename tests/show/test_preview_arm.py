"""Preview: poses, shapes and meshes of the drawn arm."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from models import trained
from scenes import paths

import calib
from calib.show.preview.arm import DrawnArm, visuals
from calib.show.preview.meshes import read_mesh, resolve_mesh
from calib.show.preview.scene import draw

ROBOTS = ("two_link", "two_link_full", "three_link", "tilted", "scara", "polar")


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_drawn_tip_is_pinocchios(robot: str):
    arm = calib.load_arm(robot)
    body = DrawnArm.of(trained(robot, n=400, size=8).about)
    assert body is not None
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (20, arm.dof))
    np.testing.assert_allclose(body.tips(q), arm.points(q)[:, -1], atol=1e-12)


def test_shapes_of_a_urdf_with_gaps():
    text = """<robot name="r"><material name="red"><color rgba="1 0 0 0.5"/></material>
    <link name="a">
      <visual><geometry><box size="1 2 3"/></geometry><material name="red"/></visual>
      <visual><origin xyz="1 0 0"/><geometry><sphere radius="0.1"/></geometry></visual>
      <visual><geometry><cylinder radius="nan" length="1"/></geometry></visual>
      <visual><geometry><box size="1 2"/></geometry></visual>
      <visual><geometry><torus/></geometry></visual>
      <visual/>
      <visual><geometry><mesh filename="m.stl" scale="2 2 2"/></geometry></visual>
    </link></robot>"""
    box, ball, mesh = visuals(text)
    assert (box.kind, box.size, box.colour, box.opacity) == ("box", (1, 2, 3), "#ff0000", 0.5)
    assert ball.origin[0, 3] == 1.0
    assert mesh.mesh == "m.stl"
    assert mesh.scale.tolist() == [2, 2, 2]


CUBE = "solid s\nfacet normal 0 0 1\nouter loop\n" + (
    "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid s\n"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    inner = tmp_path / "robot"
    (inner / "pkg" / "meshes").mkdir(parents=True)
    (inner / "pkg" / "meshes" / "a.stl").write_text(CUBE)
    (inner / "meshes").mkdir()
    (inner / "meshes" / "b c.stl").write_text(CUBE)
    (tmp_path / "secret.stl").write_text(CUBE)
    (inner / "link.stl").symlink_to(tmp_path / "secret.stl")
    return inner


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("package://pkg/meshes/a.stl", "pkg/meshes/a.stl"),
        ("package://other/meshes/b%20c.stl", "meshes/b c.stl"),
        ("meshes/../meshes/b c.stl", "meshes/b c.stl"),
    ],
)
def test_meshes_inside_of_the_folder(folder: Path, name: str, found: str):
    assert resolve_mesh(name, folder) == (folder / found).resolve()


@pytest.mark.parametrize(
    "name",
    [
        "../secret.stl",
        "package://pkg/../../secret.stl",
        "package://..//secret.stl",
        "link.stl",
        "file:///etc/passwd",
        "/etc/passwd",
        "http://127.0.0.1/a.stl",
        "https://example.org/a.stl",
        "ftp://example.org/a.stl",
        "",
        "a\0.stl",
        "missing.stl",
    ],
)
def test_meshes_elsewhere_are_refused(folder: Path, name: str):
    with pytest.raises(calib.RobotError, match="mesh"):
        resolve_mesh(name, folder)


def test_mesh_files(folder: Path):
    mesh = read_mesh(folder / "pkg" / "meshes" / "a.stl")
    assert mesh.vertices[mesh.faces].shape == (1, 3, 3)
    (folder / "bad.stl").write_bytes(b"solid")
    (folder / "bad.dae").write_text('<!DOCTYPE x [<!ENTITY a "b">]><COLLADA/>')
    (folder / "bad.exe").write_text("")
    for name in ("bad.stl", "bad.dae", "bad.exe"):
        with pytest.raises(calib.RobotError, match=name):
            read_mesh(folder / name)


def test_meshes_are_drawn_or_a_skeleton_in_their_place(tmp_path: Path):
    (tmp_path / "m.stl").write_text(CUBE)
    model = trained("two_link", n=400, size=8)
    text = re.sub(
        r"<geometry>.*?</geometry>",
        '<geometry><mesh filename="m.stl"/></geometry>',
        model.about.urdf,
    )
    meshed = replace(model, about=replace(model.about, urdf=text))
    bare = draw(meshed)
    assert any("`meshes`" in note for note in bare.notes)
    assert any(path.endswith("/bone") for path in paths(bare))
    full = draw(meshed, meshes=tmp_path)
    assert full.notes == ()
    assert not any(path.endswith("/bone") for path in paths(full))
    missing = draw(meshed, meshes=tmp_path / "..")
    assert any("no such file" in note for note in missing.notes)
