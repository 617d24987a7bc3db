"""A file is written whole or not at all."""

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from calib.common.atomic import atomic_write
from calib.errors import CalibError


def leftovers(folder: Path) -> list[str]:
    return [p.name for p in folder.iterdir() if p.name.endswith(".tmp")]


def test_bytes_and_callable_reach_the_file(tmp_path):
    path = tmp_path / "a"
    atomic_write(path, b"one")
    assert path.read_bytes() == b"one"
    atomic_write(str(path), lambda file: file.write(b"two"))
    assert path.read_bytes() == b"two"
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError, ValueError])
def test_a_failure_half_way_keeps_the_old_file(tmp_path, error):
    path = tmp_path / "a"
    path.write_bytes(b"old")

    def fail(file):
        file.write(b"half")
        file.flush()
        raise error

    with pytest.raises(error):
        atomic_write(path, fail)
    assert path.read_bytes() == b"old"
    assert leftovers(tmp_path) == []


def test_a_full_disk_is_told_in_one_line(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"old")

    def full(file):
        raise OSError(28, "No space left on device")

    with pytest.raises(CalibError, match="disk is full") as caught:
        atomic_write(path, full)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == b"old"
    assert leftovers(tmp_path) == []


def test_missing_folder_and_folder_as_file(tmp_path):
    with pytest.raises(CalibError, match="no folder"):
        atomic_write(tmp_path / "no" / "a", b"")
    with pytest.raises(CalibError, match="folder"):
        atomic_write(tmp_path, b"")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(CalibError, match="file"):
        atomic_write(tmp_path / "file" / "a", b"")
    with pytest.raises(CalibError, match="null"):
        atomic_write("a\0b", b"")


def test_a_write_protected_file_is_left_alone(tmp_path, monkeypatch):
    path = tmp_path / "a"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, "access", lambda target, mode: mode != os.W_OK)  # root may do all
    with pytest.raises(CalibError, match="permission"):
        atomic_write(path, b"new")
    assert path.read_bytes() == b"old"


def test_a_folder_without_permission_is_told(tmp_path, monkeypatch):
    def denied(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", denied)
    with pytest.raises(CalibError, match="permission denied"):
        atomic_write(tmp_path / "a", b"new")


def test_killed_while_writing_the_old_file_is_whole(tmp_path):
    path = tmp_path / "a"
    program = (
        "import sys; from calib.common.atomic import atomic_write\n"
        "def forever(file):\n"
        "    while True:\n"
        "        file.write(b'new' * 1000); file.flush(); print(flush=True)\n"
        "atomic_write(sys.argv[1], b'old'); atomic_write(sys.argv[1], forever)\n"
    )
    command = [sys.executable, "-c", program, str(path)]
    root = Path(__file__).parents[2]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=root) as process:
        for _ in range(20):
            process.stdout.readline()
        process.kill()
    assert path.read_bytes() == b"old"


@pytest.mark.skipif(os.name == "nt", reason="POSIX permissions")
def test_permissions_are_kept_and_new_files_follow_the_umask(tmp_path):
    path = tmp_path / "a"
    old = os.umask(0o027)
    try:
        atomic_write(path, b"")
        assert stat.S_IMODE(path.stat().st_mode) == 0o640
        path.chmod(0o604)
        atomic_write(path, b"new")
        assert stat.S_IMODE(path.stat().st_mode) == 0o604
    finally:
        os.umask(old)


@pytest.mark.skipif(os.name == "nt", reason="symbolic links")
def test_a_symbolic_link_stays_and_its_target_is_replaced(tmp_path):
    (tmp_path / "sub").mkdir()
    target = tmp_path / "sub" / "target"
    link = tmp_path / "link"
    link.symlink_to(target)
    atomic_write(link, b"made through a dangling link")
    assert link.is_symlink()
    assert target.read_bytes() == b"made through a dangling link"
    assert leftovers(tmp_path / "sub") == []


@pytest.mark.skipif(os.name == "nt", reason="devices")
def test_a_device_is_written_to_and_stays_a_device():
    atomic_write(os.devnull, b"gone")
    assert stat.S_ISCHR(Path(os.devnull).stat().st_mode)


def test_two_writers_never_mix(tmp_path):
    path = tmp_path / "a"
    contents = [bytes([k]) * 200_000 for k in range(4)]
    atomic_write(path, contents[0])
    seen = []

    def write(content):
        for _ in range(20):
            atomic_write(path, content)
            seen.append(path.read_bytes())

    threads = [threading.Thread(target=write, args=(c,)) for c in contents]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(seen) == 80
    assert set(seen) <= set(contents)
    assert leftovers(tmp_path) == []
