"""Files that are written whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ..errors import CalibError

_DENIED = "permission denied; choose another place with -o or change its permissions"
_FULL = "the disk is full; make room or choose another place"
_REASONS = {
    errno.EISDIR: "it is a folder; name a file in it",
    errno.EACCES: _DENIED,
    errno.EPERM: _DENIED,
    errno.ENOSPC: _FULL,
    errno.EDQUOT: _FULL,
    errno.EFBIG: "it is larger than files may be here (ulimit -f); raise the limit",
}


def atomic_write(path: str | os.PathLike[str], data: bytes | Callable[[BinaryIO], object]) -> None:
    """Write a file so that at any moment the old or the new one is whole.

    The data go to a temporary file in the same folder, are synced to the disk and take
    the place of `path` in one step. Whatever goes wrong, Ctrl-C included, the old file
    stays and the temporary one is removed. Of two writers the last to end wins.

    A symbolic link is followed: its target is replaced and the link stays. The
    permissions of an older file are kept, a new one follows the umask. What is no
    regular file (a pipe, a device) is written to directly.

    data : the content, or a function that writes it to the binary file that it is given
    Raises CalibError if the folder is missing, a permission is lacking or the disk is full.
    Raises BrokenPipeError if the reader of a pipe has left.

    Examples
    --------
    >>> atomic_write("numbers.txt", b"1 2 3")
    >>> atomic_write("numbers.txt", lambda file: file.write(b"4 5 6"))
    """
    with _told(path):
        target, mode = _target(path)
        if mode is None or stat.S_ISREG(mode):
            _replace(target, mode, data)
        else:
            with target.open("wb") as file:
                _fill(file, data)


def check_writable(path: str | os.PathLike[str]) -> None:
    """Refuse a place that cannot be written, before the work whose result goes there.

    Raises CalibError if the folder is missing or write-protected, or `path` is a folder or
    write-protected.
    """
    with _told(path):
        _target(path)


@contextmanager
def _told(path: str | os.PathLike[str]) -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:  # no fault of ours: who read has seen enough
        raise
    except OSError as error:
        raise CalibError(f"cannot write {os.fspath(path)!r}: {_reason(path, error)}") from error


def _target(path: str | os.PathLike[str]) -> tuple[Path, int | None]:
    """Return the file behind `path` and its mode, None if there is none yet."""
    if "\0" in os.fspath(path):
        raise OSError(errno.EINVAL, "its name holds a null character")
    try:
        mode = Path(path).stat().st_mode
    except FileNotFoundError:
        mode = None
    if mode is not None and stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, "a folder")
    if mode is not None and not os.access(path, os.W_OK):
        raise OSError(errno.EACCES, "write-protected")
    if mode is not None and not stat.S_ISREG(mode):
        return Path(path), mode  # /dev/stdout may be a pipe, which has no other name
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise OSError(errno.ENOENT, "no such folder")
    if not os.access(target.parent, os.W_OK):
        raise OSError(errno.EACCES, "its folder is write-protected")
    return target, mode


def _replace(target: Path, mode: int | None, data: bytes | Callable[[BinaryIO], object]) -> None:
    # at first for nobody else: what it replaces may be private
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=".calib-", suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            _fill(file, data)
            file.flush()
            os.fsync(handle)
        Path(name).chmod(_new_mode() if mode is None else stat.S_IMODE(mode))
        os.replace(name, target)  # noqa: PTH105
    except BaseException:  # Ctrl-C too must leave nothing behind
        Path(name).unlink(missing_ok=True)
        raise


def _new_mode() -> int:
    umask = os.umask(0)
    os.umask(umask)
    return 0o666 & ~umask


def _fill(file: BinaryIO, data: bytes | Callable[[BinaryIO], object]) -> None:
    if callable(data):
        data(file)
    else:
        file.write(data)


def _reason(path: str | os.PathLike[str], error: OSError) -> str:
    if error.errno == errno.ENOENT:
        folder = Path(os.path.realpath(path) if Path(path).is_symlink() else path).parent
        return f"there is no folder {str(folder)!r}; make it first"
    other = f"{error.strerror or error}; choose another name or place"
    return _REASONS.get(error.errno or 0, other)
