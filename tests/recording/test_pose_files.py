"""Files of flange poses and of lenses, as controllers, programs and repositories write them."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from boards import CONVENTIONS, World
from conftest import refused
from scipy.spatial.transform import Rotation

import calib
from calib.recording.lens import load_lens
from calib.recording.pose_files import read_flange_poses

DATA = Path(__file__).parents[1] / "data"


HEADERS = """picture,x,y,z,A,B,C
Bild;X [mm];Y [mm];Z [mm];A [Grad];B [Grad];C [Grad]
image,x_mm,y_mm,z_mm,A_deg,B_deg,C_deg"""


@pytest.mark.parametrize("header", HEADERS.splitlines())
def test_tables_have_the_names_that_controllers_write(tmp_path, header):
    path, world = tmp_path / "flange.csv", World(5, count=12)
    angles = CONVENTIONS["kuka"](Rotation.from_matrix(world.flange[:, :3, :3]))
    rows = np.column_stack([1e3 * world.flange[:, :3, 3], angles])
    cells = [[f"shots/{k:02d}.png", *map(str, row)] for k, row in enumerate(rows)]
    separator = ";" if ";" in header else ","
    lines = [separator.join(row) for row in [*cells, ["", *"12345", "nan"]]]
    path.write_text("\n".join([header, *lines]))
    rig = world.solve(path)
    assert (rig.convention["rotation"], rig.names[3]) == ("kuka", "03.png")


def _save_apart(path, poses):
    path.mkdir()
    np.save(path / "R.npy", poses[:, :3, :3])
    np.save(path / "t.npy", poses[:, :3, 3])


def _save_storage(path, poses):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for number, pose in enumerate(poses):
        storage.write(f"R_{number}", pose[:3, :3])
        storage.write(f"t_{number}", pose[:3, 3:])
    storage.release()


def _save_folder(path, poses):
    path.mkdir()
    (path / "notes.md").write_text("0.1 0.2 0.3")
    for number, pose in enumerate(poses):
        np.savetxt(path / f"pose{number}.txt", pose)


MATRICES = {
    "poses.npy": np.save,
    "poses.json": lambda path, poses: path.write_text(json.dumps(poses.tolist())),
    "printed.txt": lambda path, poses: path.write_text("\n".join(map(str, poses))),
    "columns.csv": lambda path, poses: np.savetxt(path, poses.mT.reshape(-1, 16), delimiter=","),
    "apart.npz": lambda path, poses: np.savez(path, R=poses[:, :3, :3], t=poses[:, :3, 3:]),
    "apart.json": lambda path, poses: path.write_text(
        json.dumps([{"rotation": p[:3, :3].tolist(), "translation": [*p[:3, 3]]} for p in poses])
    ),
    "beside.csv": lambda path, poses: np.savetxt(path, np.hstack(poses), delimiter=","),
    "folder": _save_folder,
    "apart": _save_apart,
    "storage.yml": _save_storage,
    "folder/pose*": lambda path, poses: _save_folder(path.parent, poses),
}


@pytest.mark.parametrize("name", MATRICES)
def test_matrices_are_read_as_programs_save_them(tmp_path, name):
    world = World(5, count=12)
    MATRICES[name](tmp_path / name, world.flange)
    numbers = read_flange_poses(tmp_path / name).numbers
    turns = world.flange[:, :3, :3].reshape(-1, 9)
    np.testing.assert_allclose(numbers, np.column_stack([world.flange[:, :3, 3], turns]), atol=1e-8)


POSES = [[0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8], [0.2, 0.1, 0.3, 0.6, 0.0, 0.8, 0.0]]
FILES = sorted((DATA / "flange_poses").iterdir())
"""Both poses as public repositories keep theirs."""


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_poses_are_read_as_public_repositories_keep_them(path):
    table = read_flange_poses(path)
    np.testing.assert_allclose(table.numbers, POSES)
    assert table.pictures == (["0.png", "1.png"] if "a/" in path.read_text() else None)


def test_tables_of_other_columns_and_of_other_numbers_are_refused_in_one_line(tmp_path):
    path, world = tmp_path / "flange.csv", World(5, count=12)
    for header, row, words in (
        ("tx,ty,z,a,b,c", "1,2,3,4,5,6", r"roll\.\.yaw.*; rename or drop tx, ty$"),
        ("x;y;z;A;B;C", "1,5;2.5;3,5;4;5;6", "decimals with a point"),
        ("h_x,h_y,h_z,h_rx,h_ry,h_rz,e_x,e_y,e_z", "1,2,3,4,5,6,7,8,9", "of one pose.*drop h_x"),
        ("[1, [2]]", "", "flange.csv holds no poses"),
        ("", "", "flange.csv is empty"),
        ("[[]]", "", "flange.csv holds no poses"),
        ("hand,1,2,3,4,5,6", "eye,1,2,3,4,5,6", "by the words eye, hand"),
        ("tcp: [1,2,3,4,5,6]", "tool: [1,2,3,4,5,6]", "several poses, tcp, tool: keep one"),
        ("1.5,2,3,4,5,6,7", "1.7,2,3,4,5,6,7", "no poses"),  # a time, or no quaternion
    ):
        path.write_text(f"{header}\n{row}\n")
        refused(calib.LogError, words, world.solve, path)
    cut = tmp_path / "cut.npz"
    cut.write_bytes(b"PK\x03\x04 cut off")
    refused(calib.LogError, "cut.npz cannot be read: expected numbers", world.solve, cut)
    for unit, words in (("um", "expected one of"), ("mm", "from its base")):
        refused(calib.OptionError, words, world.solve, unit=unit)
    refused(calib.OptionError, "either an arm", calib.handeye, pictures=world.shots())
    refused(calib.OptionError, r"expected \(n, 4, 4\)", world.solve, np.zeros((3, 7)))


@pytest.mark.parametrize("name", ["opencv.yml", "ros.yaml", "lens.json"])
def test_lenses_of_others_are_read(tmp_path, name):
    lens, _ = load_lens(DATA / "lenses" / name)
    assert lens.parameters.tolist() == [500.0, 501.0, 320.0, 240.0, -0.1, 0.02, 0.0, 0.0, 0.0]
    assert lens.size == (640, 480)
    nan = "NaN" if "json" in name else ".nan"
    (tmp_path / name).write_text(re.sub(r"501\.?", nan, (DATA / "lenses" / name).read_text()))
    refused(calib.LogError, "finite", load_lens, tmp_path / name)
    (tmp_path / name).write_text("&all [*all]")
    refused(calib.LogError, "no lens .no YAML without aliases", load_lens, tmp_path / name)
