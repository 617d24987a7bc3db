"""A file is written whole or not at all, whatever ends the writing."""

import errno
import os
from pathlib import Path

import pytest

from calib import CalibError
from calib.common.atomic import atomic_write

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals and permissions of POSIX")


def beside(path: Path) -> list[str]:
    return sorted(p.name for p in path.parent.iterdir() if p != path)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (KeyboardInterrupt(), None),
        (ValueError(), None),
        (OSError(errno.ENOSPC, "No space left on device"), "the disk is full"),
        (OSError(errno.EDQUOT, "Quota"), "the disk is full"),
        (OSError(errno.EIO, "Input/output error"), "Input/output error"),
    ],
)
def test_a_failure_half_way_keeps_the_old_file(tmp_path, error, words):
    path = tmp_path / "a"
    path.write_bytes(b"old")

    def fail(file):
        file.write(b"half")
        file.flush()
        raise error

    with pytest.raises(CalibError if words else type(error), match=words) as caught:
        atomic_write(path, fail)
    assert path.read_bytes() == b"old"
    assert beside(path) == []
    assert not words or "\n" not in str(caught.value)


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


def test_a_symbolic_link_stays_and_its_target_is_replaced(tmp_path):
    (tmp_path / "sub").mkdir()
    target = tmp_path / "sub" / "target"
    link = tmp_path / "link"
    link.symlink_to(target)
    atomic_write(link, b"made through a dangling link")
    assert link.is_symlink()
    assert target.read_bytes() == b"made through a dangling link"
    assert beside(target) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("link", [False, True])
def test_a_full_device_is_told(run, tmp_path, link):
    target = Path("/dev/full")
    if link:
        target = tmp_path / "out.parquet"
        target.symlink_to("/dev/full")
    done = run("babble", "two_link", "-n", "100", "-o", target)
    assert (done.code, done.out) == (1, "")
    assert done.err.splitlines()[-1].endswith("the disk is full; make room or choose another place")


@pytest.mark.parametrize(
    ("name", "words"),
    [("x" * 300, "File name too long"), (".", "it is a folder"), ("no/m.calib", "no folder")],
)
def test_a_place_that_cannot_be_is_refused_before_the_work(run, tmp_path, name, words):
    done = run("train", "two_link", "--samples", "2000000", "-o", f"{tmp_path}/{name}")
    assert done.code == 1
    assert words in done.err
    assert done.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_what_replaces_a_private_file_is_never_public(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"old")
    path.chmod(0o600)
    modes = []

    def fill(file):
        (temporary,) = tmp_path.glob(".calib-*.tmp")
        modes.append(temporary.stat().st_mode & 0o777)
        file.write(b"new")

    atomic_write(path, fill)
    assert modes == [0o600]
