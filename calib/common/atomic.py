"""Files that are written whole or not at all."""

import errno
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ..errors import CalibError

FilePath = str | os.PathLike[str]

_FULL = "the disk is full; make room or choose another place"
_REASONS = {errno.ENOSPC: _FULL, errno.EDQUOT: _FULL}


def atomic_write(
    path: FilePath, data: bytes | Callable[[BinaryIO], object]
) -> None:
    """Write a file so that at any moment, Ctrl-C included, the old or the new one is whole.

    A symbolic link stays a link, permissions are kept, and what is no regular file (a pipe) is
    written to.

    data : the content, or a function that writes it to the binary file that it is given
    Raises CalibError if the folder is missing, a permission is lacking or the disk is full.
    Raises BrokenPipeError if the reader of a pipe has left.
    """
    fill = data if callable(data) else lambda file: file.write(data)
    with _explain_errors(path):
        target, mode = _target(path)
        if mode is not None and not stat.S_ISREG(mode):
            with target.open("wb") as file:
                fill(file)
            return
        # at first for nobody else: what it replaces may be private
        handle, name = tempfile.mkstemp(
            dir=target.parent, prefix=".calib-", suffix=".tmp"
        )
        try:
            with os.fdopen(handle, "wb") as file:
                fill(file)
                file.flush()
                os.fsync(handle)
            umask = os.umask(0)
            os.umask(umask)
            Path(name).chmod(
                0o666 & ~umask if mode is None else stat.S_IMODE(mode)
            )
            os.replace(name, target)  # noqa: PTH105
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise


def check_writable(path: FilePath) -> None:
    """Refuse a place that cannot be written, before the work whose result goes there."""
    with _explain_errors(path):
        _target(path)


@contextmanager
def _explain_errors(path: FilePath) -> Iterator[None]:
    """Raise CalibError with the reason where a block cannot write a file."""
    try:
        yield
    except BrokenPipeError:
        raise  # the reader has closed its end, which is no fault
    except OSError as error:
        reason = f"{error.strerror or error}; choose another name or place"
        reason = _REASONS.get(error.errno or 0, reason)
        raise CalibError(
            f"cannot write {os.fspath(path)!r}: {reason}"
        ) from error


def _target(path: FilePath) -> tuple[Path, int | None]:
    """Return the file behind `path` and its mode, None if there is none yet."""
    if "\0" in os.fspath(path):
        raise OSError(errno.EINVAL, "its name holds a null character")
    try:
        mode = Path(path).stat().st_mode
    except FileNotFoundError:
        mode = None
    if mode is not None and stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, "it is a folder, no file")
    # /dev/stdout may be a pipe, which has no other name
    regular = mode is None or stat.S_ISREG(mode)
    target = Path(os.path.realpath(path)) if regular else Path(path)
    if not target.parent.is_dir():
        raise OSError(
            errno.ENOENT, f"there is no folder {str(target.parent)!r}"
        )
    places = [target.parent] if regular else []
    if mode is not None:
        places.append(Path(path))
    if not all(os.access(place, os.W_OK) for place in places):
        raise OSError(errno.EACCES, "it or its folder is write-protected")
    return target, mode
