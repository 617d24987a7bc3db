"""A file is written whole or not at all, whatever ends the writing."""

import errno
import os
from pathlib import Path
from unittest.mock import Mock

import pytest
from conftest import refused

import calib

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals and permissions of POSIX")
LOG = calib.babble(calib.load_arm("two_link"), 5)
FAILURES = [
    (KeyboardInterrupt(), None),
    (ValueError(), None),
    (OSError(errno.ENOSPC, "No space left on device"), "the disk is full"),
    (OSError(errno.EDQUOT, "Quota"), "the disk is full"),
    (OSError(errno.EIO, "Input/output error"), "Input/output error"),
]


@pytest.mark.parametrize(("error", "words"), FAILURES)
def test_a_failure_half_way_keeps_the_old_file(tmp_path, monkeypatch, error, words):
    path = tmp_path / "a.csv"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, "fsync", Mock(side_effect=error))
    refused(calib.CalibError if words else type(error), words, calib.write_log, LOG, path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_symbolic_link_stays_and_its_target_is_replaced(tmp_path, monkeypatch):
    (tmp_path / "sub").mkdir()
    target, link = tmp_path / "sub" / "target.csv", tmp_path / "link.csv"
    link.symlink_to(target)
    calib.write_log(LOG, link)  # through a dangling link
    assert link.is_symlink()
    assert target.read_bytes().startswith(b"shoulder")
    assert list(target.parent.iterdir()) == [target]
    # what replaces a private file is never public
    modes = []
    target.chmod(0o600)
    monkeypatch.setattr(os, "fsync", lambda number: modes.append(os.fstat(number).st_mode & 0o777))
    calib.write_log(LOG, target)
    assert set(modes) == {0o600}
    assert target.stat().st_mode & 0o777 == 0o600


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("link", [False, True])
def test_a_full_device_is_told(run, tmp_path, link):
    target = tmp_path / "out.parquet" if link else Path("/dev/full")
    if link:
        target.symlink_to("/dev/full")
    done = run("babble", "two_link", "-n", "100", "-o", target)
    assert (done.code, done.out) == (1, "")
    assert done.err.splitlines()[-1].endswith("the disk is full; make room or choose another place")


@pytest.mark.parametrize(
    ("name", "words"),
    [("x" * 300, "File name too long"), (".", "it is a folder"), ("no/m.calib", "no folder")],
)
def test_a_place_that_cannot_be_is_refused_before_the_work(run, tmp_path, name, words):
    args = ("train", "two_link", "--samples", "2000000", "-o", f"{tmp_path}/{name}")
    assert run.refused(1, words, *args).err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
