"""One coordinator a folder."""

from __future__ import annotations

import errno
import fcntl
import os
import platform
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from topo_search.model import BadInput, Fault

LOCK = ".lock"
HOLDER = re.compile(rb"(\d+ on [^\n]*\n)?")
"""The content of the lock's file: who holds it, or held it last."""
_NO_LOCKS_ON_FOLDERS = (errno.EBADF, errno.ENOLCK, errno.EINVAL, errno.ENOTSUP, errno.EISDIR)
"""What network disks say."""


class ReadOnlyFolder(BadInput):
    """A folder in which this process can write nothing."""

    def __init__(self, folder: Path, reason: str | None) -> None:
        rule = f"cannot be written to: {reason}; choose another folder with --out"
        super().__init__(str(folder), [Fault("", rule)])


@contextmanager
def hold_lock(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; the system frees it when the process ends, however it ends.

    The folder itself is locked too where its disk can do that, so that removing the file lets nobody in.

    Raises:
        ReadOnlyFolder: nothing can be written there, or its disk knows no locks.
        BadInput: another process holds it, or the lock's file is none of ours.
    """
    try:
        itself = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise ReadOnlyFolder(folder, error.strerror) from None
    try:
        _lock(folder, itself, itself, optional=True)
        handle = _lock_file(folder, itself)
        try:
            _lock(folder, itself, handle)
            os.ftruncate(handle, 0)
            os.write(handle, f"{os.getpid()} on {platform.node()}\n".encode())
            yield
        finally:
            os.close(handle)
    finally:
        os.close(itself)


def _lock_file(folder: Path, itself: int) -> int:
    """Open the lock's file, or make it; it must be one that `hold_lock` made."""
    try:
        handle = os.open(LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644, dir_fd=itself)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR):
            raise _not_ours(folder) from None
        raise ReadOnlyFolder(folder, error.strerror) from None
    status = os.fstat(handle)
    if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1 or not HOLDER.fullmatch(os.pread(handle, 512, 0)):
        os.close(handle)
        raise _not_ours(folder)
    return handle


def _lock(folder: Path, itself: int, handle: int, *, optional: bool = False) -> None:
    """Lock a descriptor, or say who holds it."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        rule = f"another run is using this folder (process {_holder(itself)})"
        raise BadInput(str(folder), [Fault("", rule)]) from None
    except OSError as error:
        if optional and error.errno in _NO_LOCKS_ON_FOLDERS:
            return
        raise ReadOnlyFolder(folder, f"{error.strerror} on its disk") from None


def _holder(itself: int) -> str:
    """Return what the lock's file says of who holds it."""
    try:
        handle = os.open(LOCK, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=itself)
    except OSError:
        return "unknown"
    try:
        return os.read(handle, 256).decode(errors="replace").strip() or "unknown"
    finally:
        os.close(handle)


def _not_ours(folder: Path) -> BadInput:
    rule = "is not the lock file of a run, and is left unchanged: move it away, or choose another folder"
    return BadInput(str(folder / LOCK), [Fault("", rule)])
