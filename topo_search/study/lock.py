"""One coordinator a folder."""

from __future__ import annotations

import fcntl
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from topo_search.model import BadInput, Fault


class ReadOnlyFolder(BadInput):
    """A folder in which this process can write nothing."""

    def __init__(self, folder: Path, reason: str | None) -> None:
        rule = f"cannot be written to: {reason}; choose another folder with --out"
        super().__init__(str(folder), [Fault("", rule)])


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; the system frees it when the process ends, however it ends.

    Raises:
        ReadOnlyFolder: nothing can be written there, or its disk knows no locks.
        BadInput: another process holds it.
    """
    try:
        handle = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise ReadOnlyFolder(folder, error.strerror) from None
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(handle, 256).decode(errors="replace").strip() or "unknown"
            raise BadInput(
                str(folder), [Fault("", f"another run works in this folder (process {holder})")]
            ) from None
        except OSError as error:
            raise ReadOnlyFolder(folder, f"{error.strerror} on its disk") from None
        os.truncate(handle, 0)
        os.write(handle, f"{os.getpid()} on {platform.node()}\n".encode())
        yield
    finally:
        os.close(handle)
