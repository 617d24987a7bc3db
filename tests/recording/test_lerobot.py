"""LeRobot data sets of versions 2.1 and 3, with the codec that LeRobot records by default."""

import json

import numpy as np
import polars
import pytest
from conftest import refused

from calib import LogError
from calib.recording.lerobot import Motors, is_dataset, read_dataset

av = pytest.importorskip("av")

RATE, REST, POSES = 30, 9, 14  # frames a second, frames at each pose, poses
JOINTS = ("shoulder_pan", "elbow_flex")
CAMERA = "observation.images.wrist"
MOTORS = {
    "shoulder_pan": {"homing_offset": 5, "range_min": 1000, "range_max": 3000, "drive_mode": 0},
    "elbow_flex": {"homing_offset": 5, "range_min": 1500, "range_max": 2500, "drive_mode": 1},
}


def write_video(path, frames, codec):
    """A video of grey frames (n, height, width)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=RATE)
        stream.height, stream.width = frames[0].shape
        stream.pix_fmt = "yuv420p"
        for grey in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="gray")))
        container.mux(stream.encode())


def write_dataset(root, version, state, codec="libsvtav1", pictures=None, names=JOINTS):
    """Two episodes; without pictures grey frames tell their poses, from 10 on in tens."""
    if pictures is None:
        pictures = [np.full((64, 64), 10 * k, np.uint8) for k in range(1, POSES + 1)]
    frames = [picture for picture in pictures for _ in range(REST)]
    half = len(state) // 2
    motors = [f"{name}.pos" for name in (*names, "gripper")]
    features = {"observation.state": {"dtype": "float32", "names": motors}}
    features[CAMERA] = {"dtype": "video"}
    info = {"codebase_version": version, "fps": RATE, "chunks_size": 1000, "features": features}
    time, episode = np.tile(np.arange(half) / RATE, 2), np.repeat([0, 1], half)
    state = np.column_stack([state, np.zeros(len(state))]).tolist()
    columns = {"observation.state": state, "timestamp": time, "episode_index": episode}
    table = polars.DataFrame(columns)
    if version.startswith("v2"):
        name = "episode_{episode_index:06d}"
        info["video_path"] = "videos/chunk-{episode_chunk:03d}/{video_key}/" + name + ".mp4"
        for number in (0, 1):
            rows, name = slice(number * half, (number + 1) * half), f"episode_{number:06d}"
            write_table(root / f"data/chunk-000/{name}.parquet", table[rows])
            write_video(root / f"videos/chunk-000/{CAMERA}/{name}.mp4", frames[rows], codec)
    else:
        info["video_path"] = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
        write_table(root / "data/chunk-000/file-000.parquet", table)
        write_video(root / f"videos/{CAMERA}/chunk-000/file-000.mp4", frames, codec)
        places = {"chunk_index": [0, 0], "file_index": [0, 0], "from_timestamp": [0.0, half / RATE]}
        places = {f"videos/{CAMERA}/{name}": values for name, values in places.items()}
        places = polars.DataFrame({"episode_index": [0, 1], **places})
        write_table(root / "meta/episodes/chunk-000/file-000.parquet", places)
    (root / "meta").mkdir(exist_ok=True)
    (root / "meta/info.json").write_text(json.dumps(info))


def write_table(path, table):
    path.parent.mkdir(parents=True, exist_ok=True)
    table.write_parquet(path)


@pytest.fixture(scope="module")
def joints():
    """Joint values (poses, 2) [rad], two of them at the ends of the motors' ranges."""
    q = np.random.default_rng(0).uniform(-0.7, 0.7, (POSES, 2))
    q[0] = q[1] = np.array([2000, -1000]) * np.pi / 4095
    q[1] *= -1
    return q


def poses_of(pictures):
    """The pose that each picture's grey tells."""
    return np.rint(np.array([picture.mean() for picture in pictures]) / 10).astype(int) - 1


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_each_frame_has_the_joints_of_its_moment(tmp_path, joints, version):
    """AV1, which OpenCV's wheels do not decode."""
    write_dataset(tmp_path, version, np.degrees(np.repeat(joints, REST, axis=0)))
    assert is_dataset(tmp_path)
    tables, pictures, _ = read_dataset(tmp_path)
    table, pose = tables["degrees"], poses_of(pictures)
    assert table.names == JOINTS
    assert sorted(pose) == list(range(POSES))
    assert np.allclose(table.q, joints[pose], atol=1e-6)


def test_shares_of_ranges_need_the_motors_calibration(tmp_path, joints):
    shares = np.repeat(joints, REST, axis=0) * 4095 / np.pi * 100 / [2000, -1000]
    write_dataset(tmp_path, "v3.0", shares, codec="mpeg4")
    refused(LogError, "shares of each motor's range", read_dataset, tmp_path)
    (tmp_path / "calibration.json").write_text(json.dumps(MOTORS))
    tables, pictures, _ = read_dataset(tmp_path, motors=Motors.read(tmp_path / "calibration.json"))
    (table,) = tables.values()
    assert np.allclose(table.q, joints[poses_of(pictures)], atol=1e-6)


def test_rows_without_joints_are_left_out_and_odd_layouts_refused(tmp_path, joints):
    state = np.degrees(np.repeat(joints, REST, axis=0))
    state[4::REST] = np.nan
    write_dataset(tmp_path, "v3.0", state, codec="mpeg4")
    tables, pictures, _ = read_dataset(tmp_path)
    assert np.allclose(tables["degrees"].q, joints[poses_of(pictures)], atol=1e-6)
    table = tmp_path / "data/chunk-000/file-000.parquet"
    polars.read_parquet(table).drop("timestamp").write_parquet(table)
    refused(LogError, "not a LeRobotDataset's.*timestamp", read_dataset, tmp_path)
    table.unlink()
    refused(LogError, "not a LeRobotDataset's", read_dataset, tmp_path)


def test_what_is_missing_is_named(tmp_path, joints):
    write_dataset(tmp_path, "v2.1", np.repeat(joints, REST, axis=0), codec="mpeg4")
    video = tmp_path / f"videos/chunk-000/{CAMERA}/episode_000001.mp4"
    video.unlink()
    refused(LogError, r"episode_000001.mp4.*cannot be read", read_dataset, tmp_path)
    video.write_bytes(b"no video at all")
    refused(LogError, "cannot be read", read_dataset, tmp_path)
    refused(LogError, "expected gripper_roll too", read_dataset, tmp_path, ["gripper_roll"])
    refused(LogError, "as `camera`, not 'top'", read_dataset, tmp_path, camera="top")
    info = tmp_path / "meta/info.json"
    info.write_text(info.read_text().replace("v2.1", "v9.0"))
    refused(LogError, r"expected v2.0, v2.1 or v3.0", read_dataset, tmp_path)
