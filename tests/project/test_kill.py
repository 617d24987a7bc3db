"""Writing is killed, or fails, at each of its steps: the older file or the new one is whole."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from faulty import STEPS, Faulty
from models import trained

import calib
from calib.common import atomic
from calib.common.atomic import atomic_write
from calib.errors import CalibError
from calib.model_file.storage import to_bytes

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals and locks of POSIX")

REPLACED = STEPS.index("replace") + 1
"""From this step on the new file is there."""


OLD = Path(tempfile.mkdtemp()) / "old.calib"
OLD.write_bytes(to_bytes(trained("two_link", 300, 5)))

KILLED = f"""
import os, signal, sys
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
from calib.common import atomic
from faulty import Faulty
atomic.os = Faulty(int(sys.argv[3]), lambda: os.kill(os.getpid(), signal.SIGKILL))
with open(sys.argv[2], "rb") as file:
    atomic.atomic_write(sys.argv[1], file.read())
"""


@pytest.fixture
def target(tmp_path):
    """A good older file, alone in its folder."""
    path = tmp_path / "folder" / "m.calib"
    path.parent.mkdir()
    path.write_bytes(OLD.read_bytes())
    return path


@pytest.fixture(scope="module")
def new():
    return to_bytes(trained("two_link", 300, 5))


def beside(path):
    return sorted(p.name for p in path.parent.iterdir() if p != path)


def test_the_steps_are_these(target, new, monkeypatch):
    faulty = Faulty(-1, None)
    monkeypatch.setattr(atomic, "os", faulty)
    atomic_write(target, new)
    assert faulty.steps == STEPS
    assert target.read_bytes() == new


@pytest.mark.parametrize("step", range(len(STEPS)), ids=lambda k: f"{k}-{STEPS[k]}")
def test_killed_before_any_step_the_file_is_whole_and_the_next_write_tidies_up(
    step, target, new, tmp_path
):
    other = tmp_path / "new"
    other.write_bytes(new)
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(target), str(other), str(step)], timeout=120, check=False
    )
    assert done.returncode == -signal.SIGKILL
    assert target.read_bytes() == (OLD.read_bytes() if step < REPLACED else new)
    calib.load(target)
    assert len(beside(target)) == (0 < step < REPLACED)
    atomic_write(target.with_name("next"), b"")
    assert beside(target) == ["next"]


ERRORS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk is full",
    errno.EFBIG: "larger than files may be here",
    errno.EACCES: "permission denied",
    errno.EROFS: "Read-only file system",
    errno.EIO: "Input/output error",
}


@pytest.mark.parametrize("step", range(REPLACED), ids=lambda k: f"{k}-{STEPS[k]}")
@pytest.mark.parametrize("code", ERRORS, ids=errno.errorcode.get)
def test_an_error_at_any_step_is_one_line_and_leaves_nothing(step, code, target, new, monkeypatch):
    def stroke():
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(atomic, "os", Faulty(step, stroke))
    with pytest.raises(CalibError, match=ERRORS[code]) as caught:
        atomic_write(target, new)
    assert "\n" not in str(caught.value)
    assert str(target) in str(caught.value)
    assert target.read_bytes() == OLD.read_bytes()
    assert beside(target) == []


@pytest.mark.parametrize(
    "step",
    [k for k in range(REPLACED, len(STEPS)) if STEPS[k] != "close"],
    ids=lambda k: f"{k}-{STEPS[k]}",
)
def test_without_folders_that_sync_or_list_nothing_is_lost(step, target, new, monkeypatch):
    def stroke():
        raise OSError(errno.EINVAL, "not here")

    monkeypatch.setattr(atomic, "os", Faulty(step, stroke))
    atomic_write(target, new)
    assert target.read_bytes() == new
    assert beside(target) == []


def test_the_file_of_a_live_writer_stays(tmp_path):
    seen = []

    def slow(file):
        file.write(b"half")
        before = sorted(tmp_path.glob(".calib-*.tmp"))
        atomic_write(tmp_path / "b", b"done meanwhile")
        seen.append((before, sorted(tmp_path.glob(".calib-*.tmp"))))

    atomic_write(tmp_path / "a", slow)
    ((before, after),) = seen
    assert len(before) == 1
    assert before == after
    assert (tmp_path / "a").read_bytes() == b"half"


def test_only_leftovers_are_removed(tmp_path):
    others = ["calib-0123456789abcdef.tmp", ".calib-mine.tmp", ".calib-0123456789abcdef.tmp2", "x"]
    for name in others:
        (tmp_path / name).write_bytes(b"mine")
    (tmp_path / ".calib-0000000000000000.tmp").mkdir()
    (tmp_path / ".calib-1111111111111111.tmp").symlink_to(tmp_path / "x")
    leftover = tmp_path / ".calib-0123456789abcdef.tmp"
    leftover.write_bytes(b"half")
    before = {p.name for p in tmp_path.iterdir()}
    atomic_write(tmp_path / "new", b"")
    assert {p.name for p in tmp_path.iterdir()} == before - {leftover.name} | {"new"}


WRITER = """
import sys
from calib.common.atomic import atomic_write
target, own, other = sys.argv[1:]
contents = [open(name, "rb").read() for name in (own, other)]
for _ in range(20):
    atomic_write(target, contents[0])
    assert open(target, "rb").read() in contents
"""


def test_two_processes_that_write_one_model_do_not_mix(target, new, tmp_path):
    files = [str(OLD), str(tmp_path / "new")]
    Path(files[1]).write_bytes(new)
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, str(target), *order])
        for order in (files, files[::-1])
    ]
    assert [writer.wait(120) for writer in writers] == [0, 0]
    assert target.read_bytes() in (OLD.read_bytes(), new)
    calib.load(target)
    assert beside(target) == []


def limited():
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))


COMMANDS = [
    "train two_link --size 5 -n 100 -o {}",
    "babble two_link -n 100 -o {}",
    "babble two_link -n 1000 -o {}.parquet",
    "preview {old} --html {}",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_that_may_not_grow_is_one_line_and_exit_code_1(command, tmp_path):
    target = tmp_path / ("out.parquet" if command.endswith(".parquet") else "out")
    target.write_bytes(b"old")
    words = [w.format(str(tmp_path / "out"), old=OLD) for w in command.split()]
    done = subprocess.run(
        [sys.executable, "-m", "calib_cli", *words],
        preexec_fn=limited,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.splitlines()[-1] == (
        f"error: cannot write {str(target)!r}: it is larger than files may be here (ulimit -f); "
        "raise the limit"
    )
    assert [p.name for p in tmp_path.iterdir()] == [target.name]
    assert target.read_bytes() == b"old"


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


def test_a_reader_of_a_pipe_who_leaves_is_no_error(tmp_path):
    command = "babble two_link -n 100000 -o /dev/stdout"
    with subprocess.Popen(
        [sys.executable, "-m", "calib_cli", *command.split()],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(120) == 0


UNPRIVILEGED = """
import os, sys
from calib.common.atomic import atomic_write, check_writable
from calib.errors import CalibError
os.setgid(65534)
os.setuid(65534)
for write in (lambda path: atomic_write(path, b"new"), check_writable):
    for path in sys.argv[1:]:
        try:
            write(path)
        except CalibError as error:
            print(error)
"""


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can be less")
def test_without_permission_it_is_told_and_nothing_changes(tmp_path):
    for folder in (tmp_path, *tmp_path.parents[:2]):
        folder.chmod(0o755)
    mine, locked = tmp_path / "open" / "mine", tmp_path / "closed" / "new"
    for path in (mine, locked):
        path.parent.mkdir()
    mine.write_bytes(b"old")
    mine.parent.chmod(0o777)
    mine.chmod(0o644)  # the folder would allow it, the file does not
    done = subprocess.run(
        [sys.executable, "-c", UNPRIVILEGED, str(mine), str(locked)],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    wanted = [
        f"cannot write {str(path)!r}: permission denied; choose another place with -o or change "
        "its permissions"
        for path in (mine, locked)
    ]
    assert done.stdout.splitlines() == wanted * 2
    assert mine.read_bytes() == b"old"
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["closed", "mine", "open"]


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
