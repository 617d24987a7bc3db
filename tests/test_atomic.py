"""A file is written whole or not at all."""

import os
import stat
import threading
from pathlib import Path

import pytest

from calib.atomic import atomic_write
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


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
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


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere")
def test_no_permission(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"old")
    path.chmod(0o444)
    with pytest.raises(CalibError, match="permission"):
        atomic_write(path, b"new")
    tmp_path.chmod(0o555)
    with pytest.raises(CalibError, match="permission"):
        atomic_write(tmp_path / "b", b"new")
    tmp_path.chmod(0o755)


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
