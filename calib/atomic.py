"""Files that are written whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from .errors import CalibError


def atomic_write(path: str | os.PathLike[str], data: bytes | Callable[[BinaryIO], object]) -> None:
    """Write a file so that at any moment the old or the new one is whole.

    The data go to a temporary file in the same folder, are synced to the disk and take
    the place of `path` in one step. Whatever goes wrong, Ctrl-C included, the old file
    stays and the temporary one is removed. Of two writers the last to end wins.

    A symbolic link is followed: its target is replaced and the link stays. The
    permissions of an older file are kept, a new one follows the umask. What is no
    regular file (a pipe, a device) is written to directly.

    Parameters
    ----------
    path : path-like
        Where the file shall be.
    data : bytes or callable
        The content, or a function that writes it to the binary file that it is given.

    Raises
    ------
    CalibError
        If the folder is missing, a permission is lacking or the disk is full.

    Examples
    --------
    >>> atomic_write("numbers.txt", b"1 2 3")
    >>> atomic_write("numbers.txt", lambda file: file.write(b"4 5 6"))
    """
    try:
        if "\0" in os.fspath(path):
            raise OSError(errno.EINVAL, "its name holds a null character")
        target = Path(os.path.realpath(path))
        mode = _mode(target)
        if mode is not None and not stat.S_ISREG(mode):
            if stat.S_ISDIR(mode):
                raise IsADirectoryError(errno.EISDIR, "a folder")
            with target.open("wb") as file:
                _fill(file, data)
            return
        if mode is not None and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, "write-protected")
        _replace(target, mode, data)
    except OSError as error:
        raise CalibError(f"cannot write {os.fspath(path)!r}: {_reason(path, error)}") from error


def _replace(target: Path, mode: int | None, data: bytes | Callable[[BinaryIO], object]) -> None:
    temporary = target.with_name(f".calib-{secrets.token_hex(8)}.tmp")
    flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_BINARY", 0)
    handle = os.open(temporary, flags, 0o666)  # the kernel applies the umask
    try:
        with os.fdopen(handle, "wb") as file:
            if mode is not None:
                temporary.chmod(stat.S_IMODE(mode))
            _fill(file, data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    except BaseException:  # Ctrl-C too must leave nothing behind
        with suppress(OSError):
            temporary.unlink()
        raise
    _sync_folder(target.parent)


def _fill(file: BinaryIO, data: bytes | Callable[[BinaryIO], object]) -> None:
    if callable(data):
        data(file)
    else:
        file.write(data)


def _mode(target: Path) -> int | None:
    try:
        return target.stat().st_mode
    except FileNotFoundError:
        return None


def _sync_folder(folder: Path) -> None:
    """Make the new name survive a power cut, where the system can do so."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _reason(path: str | os.PathLike[str], error: OSError) -> str:
    if isinstance(error, IsADirectoryError):
        return "it is a folder; name a file in it"
    if isinstance(error, FileNotFoundError):
        return f"there is no folder {str(Path(path).parent)!r}; make it first"
    if isinstance(error, PermissionError):
        return "permission denied; choose another place with -o or change its permissions"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "the disk is full; make room or choose another place"
    return f"{error.strerror or error}; choose another name or place"
