"""A run's folder by its descriptor: names are looked up within it, and no symbolic link is followed."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Self

from topo_search.limits import RUN_BYTES
from topo_search.model import BadInput, Fault

PARTIAL = ".topo-search-partial"
"""A file that is being written. There is one at a time, so that the next run removes what a killed one left."""
_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW


def is_within_folder(name: str) -> bool:
    """Return whether a relative name leads nowhere else."""
    return all(part not in ("", "..") for part in name.split("/"))


class Place:
    """A folder; the names of its files are relative, with `/` between folder and file."""

    def __init__(self, path: Path, handle: int) -> None:
        self.path = path
        self._handle = handle

    @classmethod
    @contextmanager
    def open(cls, path: Path) -> Iterator[Self]:
        """Hold a folder that is there; OSError says why it cannot be held. Its own path may have links in it."""
        handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        try:
            yield cls(path, handle)
        finally:
            os.close(handle)

    def names(self) -> list[str]:
        """Return the names of all that is in the folder itself."""
        return sorted(os.listdir(self._handle))

    def read(self, name: str, *, most_bytes: int = RUN_BYTES) -> bytes | None:
        """Return the content of a file; None if there is none of this name.

        Raises:
            BadInput: it is no regular file, or one of its folders is none; nothing is opened then. Or it is larger
                than `most_bytes`.
        """
        try:
            with self._open_parent(name) as (folder, last):
                handle = os.open(last, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=folder)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise self._refusal(name, error) from None
        with os.fdopen(handle, "rb") as stream:
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode):
                raise self._refusal(name, None)
            if status.st_size > most_bytes:
                rule = f"must have at most {most_bytes:,} bytes, but has {status.st_size:,}; it is left unchanged"
                raise BadInput(str(self.path / name), [Fault("", rule)])
            return stream.read(most_bytes)

    def write(self, name: str, content: bytes, *, lasting: bool = True) -> None:
        """Write a file so that a reader sees the old one or the whole new one, whatever happens in between.

        Args:
            name: of the file; its folders are made.
            content: of the file.
            lasting: whether it is on the disk when this returns; else a power cut may leave it empty.

        Raises:
            BadInput: one of its folders is none.
            OSError: it cannot be written; names it.
        """
        try:
            with self._open_parent(name, make=True) as (folder, last):
                self.tidy()
                handle = os.open(
                    PARTIAL, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666, dir_fd=self._handle
                )
                try:
                    with os.fdopen(handle, "wb", buffering=0) as stream:
                        rest = memoryview(content)
                        while rest:
                            rest = rest[os.write(handle, rest) :]
                        if lasting:
                            os.fsync(stream.fileno())
                    os.rename(PARTIAL, last, src_dir_fd=self._handle, dst_dir_fd=folder)
                except BaseException:
                    with suppress(OSError):
                        os.unlink(PARTIAL, dir_fd=self._handle)
                    raise
                if lasting:
                    os.fsync(folder)
        except NotADirectoryError as error:
            raise self._refusal(name, error) from None
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path / name)) from error

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""
        try:
            with self._open_parent(name) as (folder, last):
                os.unlink(last, dir_fd=folder)
        except FileNotFoundError:
            return
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path / name)) from error

    def make(self, name: str) -> None:
        """Make a folder, if it is not there."""
        try:
            with self._open_parent(f"{name}/.", make=True):
                return
        except NotADirectoryError as error:
            raise self._refusal(name, error) from None

    def tidy(self) -> None:
        """Remove what a run that was killed left of a file that it was writing; only who holds the lock may."""
        with suppress(FileNotFoundError):
            os.unlink(PARTIAL, dir_fd=self._handle)

    @contextmanager
    def _open_parent(self, name: str, *, make: bool = False) -> Iterator[tuple[int, str]]:
        """Return the descriptor of the folder that a file is in, and its name there."""
        *folders, last = name.split("/")
        if not is_within_folder(name):
            raise ValueError(f"a file's name must be within the folder, but got {name!r}")
        handle = os.dup(self._handle)
        try:
            for folder in folders:
                if make:
                    with suppress(FileExistsError):
                        os.mkdir(folder, 0o777, dir_fd=handle)
                inner = os.open(folder, _FOLDER, dir_fd=handle)
                os.close(handle)
                handle = inner
            yield handle, last
        finally:
            os.close(handle)

    def _refusal(self, name: str, error: OSError | None) -> BadInput:
        why = "is no regular file" if error is None else f"cannot be used ({error.strerror})"
        rule = f"{why}: a run uses regular files only, no symbolic links; it is left unchanged"
        return BadInput(str(self.path / name), [Fault("", rule)])
