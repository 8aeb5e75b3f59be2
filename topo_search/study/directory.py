"""The directory of a run: one process writes, no name leads outside, and only the run's own files are changed.

A lock admits one process. Files are looked up by the directory's descriptor, and symbolic links are not followed.
The ledger's table `files` records the files that the run wrote; only these are replaced or removed.

| column | meaning |
|---|---|
| `digest` | digest of the content that the run wrote last, or is about to write; null: none |
| `before` | digest of the previous content, which stays until the write has happened; null: no file |
| `changing` | 1: another library appends to the file, so that its content is not checked |

A write is recorded before it happens: if a run is killed in between, both contents are known. An empty file of a
recorded name also counts as the run's, since a power cut may leave one if a write was not durable.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import platform
import re
import sqlite3
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Self

from topo_search.limits import LIMITS
from topo_search.model import BadInput, Fault
from topo_search.study.ledger_file import checksum, is_within_folder


class RunFile:
    """Names of files and folders of a run."""

    LOCK = ".lock"
    PARTIAL = ".topo-search-partial"
    """The file being written. Its single name lets the next run remove what a killed run left."""
    LEDGER = "ledger.sqlite"
    TASK = "task.toml"
    FRONT = "front.csv"
    REPORT = "report.html"
    RESULTS = ("best.json", "candidates.csv", FRONT, REPORT, TASK)
    """Files with the results of a run; a range of sizes adds a `best-nN.json` for each."""
    PARTS = ("designs", "audits")
    """Folders with a file per candidate."""
    PROOFS = "proof"
    """The folder of the proofs, one file per candidate."""
    UNFINISHED = "proof-unfinished"
    """The folder of incomplete proofs that would show more than the complete one of their candidate."""
    OPTIMA = "optima"
    """The folder of local optima."""
    OPTIMA_RECORD = "optima.json"
    RELAXED = "relaxed"
    """The folder of the limits that prevent a design, one file per size without a design."""


CHANGED = "is not the file that this run wrote"
"""Fault of a file that was modified or created by something else."""
_Entry = tuple[bytes | None, bytes | None, int]
"""Columns `digest`, `before` and `changing`."""


class ReadOnlyFolder(BadInput):
    """A folder in which this process cannot write."""

    def __init__(self, folder: Path, reason: str | None) -> None:
        rule = f"cannot be written to: {reason}; choose another folder with --out"
        super().__init__(str(folder), rule)


class Directory:
    """An open folder. File names are relative to it, with `/` between folder and file."""

    def __init__(self, path: Path, handle: int) -> None:
        self.path = path
        self._handle = handle

    @classmethod
    @contextmanager
    def open(cls, path: Path) -> Iterator[Self]:
        """Open an existing folder, whose own path may contain links.

        Raises:
            BadInput: it is a file.
            OSError: it cannot be opened.
        """
        try:
            handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        except NotADirectoryError:
            raise BadInput(str(path), "is a file; choose another folder with --out") from None
        try:
            yield cls(path, handle)
        finally:
            os.close(handle)

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Hold the folder's lock; the system releases it when the process ends, for whatever reason.

        Where the disk supports it the folder itself is locked too, so that deleting the lock file admits nobody.

        Raises:
            ReadOnlyFolder: the lock file cannot be written, or the disk does not support locks.
            BadInput: another process holds the lock, or the file is not a run's lock file.
        """
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
        try:
            handle = os.open(RunFile.LOCK, flags, 0o644, dir_fd=self._handle)
        except OSError as error:
            if error.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR):
                raise self._foreign_lock() from None
            raise ReadOnlyFolder(self.path, error.strerror) from None
        with os.fdopen(handle, "r+b", buffering=0):
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1:
                raise self._foreign_lock()
            # the process that holds the lock, or held it last
            if not re.fullmatch(rb"(\d+ on [^\n]*\n)?", holder := os.pread(handle, 512, 0)):
                raise self._foreign_lock()
            # errors of network disks that cannot lock folders
            no_locks_on_folders = (errno.EBADF, errno.ENOLCK, errno.EINVAL, errno.ENOTSUP, errno.EISDIR)
            for target in (self._handle, handle):
                try:
                    fcntl.flock(target, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    name = holder.decode(errors="replace").strip() or "unknown"
                    raise BadInput(str(self.path), f"another run is using this folder (process {name})") from None
                except OSError as error:
                    if target == handle or error.errno not in no_locks_on_folders:
                        raise ReadOnlyFolder(self.path, f"{error.strerror} on its disk") from None
            os.ftruncate(handle, 0)
            os.write(handle, f"{os.getpid()} on {platform.node()}\n".encode())
            yield

    def _foreign_lock(self) -> BadInput:
        rule = "is not the lock file of a run, and is left unchanged: move it away, or choose another folder"
        return BadInput(str(self.path / RunFile.LOCK), rule)

    def names(self) -> list[str]:
        """Return the names of all files and folders directly in the folder."""
        return sorted(os.listdir(self._handle))

    def read(self, name: str, *, max_bytes: int = LIMITS.run_bytes) -> bytes | None:
        """Return the content of a file; None if it does not exist.

        Raises:
            BadInput: it is not a regular file, one of its folders is not a folder, or it exceeds `max_bytes`.
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
            if status.st_size > max_bytes:
                rule = f"must have at most {max_bytes:,} bytes, but has {status.st_size:,}; it is left unchanged"
                raise BadInput(str(self.path / name), rule)
            return stream.read(max_bytes)

    def write(self, name: str, content: bytes, *, durable: bool = True) -> None:
        """Write a file atomically: a reader sees either the old or the complete new content.

        Args:
            name: name of the file; its folders are created.
            content: content of the file.
            durable: whether it is on disk when this returns; otherwise a power cut may leave it empty.

        Raises:
            BadInput: one of its folders is not a folder.
            OSError: it cannot be written; names the file.
        """
        try:
            with self._open_parent(name, make=True) as (folder, last):
                self.remove_partial()
                flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
                handle = os.open(RunFile.PARTIAL, flags, 0o666, dir_fd=self._handle)
                try:
                    with os.fdopen(handle, "wb", buffering=0) as stream:
                        unwritten = memoryview(content)
                        while unwritten:
                            unwritten = unwritten[os.write(handle, unwritten) :]
                        if durable:
                            os.fsync(stream.fileno())
                    os.rename(RunFile.PARTIAL, last, src_dir_fd=self._handle, dst_dir_fd=folder)
                except BaseException:
                    with suppress(OSError):
                        os.unlink(RunFile.PARTIAL, dir_fd=self._handle)
                    raise
                if durable:
                    os.fsync(folder)
        except NotADirectoryError as error:
            raise self._refusal(name, error) from None
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path / name)) from error

    def remove(self, name: str) -> None:
        """Remove a file if it exists."""
        try:
            with self._open_parent(name) as (folder, last):
                os.unlink(last, dir_fd=folder)
        except FileNotFoundError:
            return
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path / name)) from error

    def make_folder(self, name: str) -> None:
        """Create a folder if it does not exist."""
        try:
            with self._open_parent(f"{name}/.", make=True):
                return
        except NotADirectoryError as error:
            raise self._refusal(name, error) from None

    def remove_partial(self) -> None:
        """Remove the partial file that a killed run may have left; requires the lock."""
        with suppress(FileNotFoundError):
            os.unlink(RunFile.PARTIAL, dir_fd=self._handle)

    @contextmanager
    def _open_parent(self, name: str, *, make: bool = False) -> Iterator[tuple[int, str]]:
        """Yield the descriptor of a file's folder, and the file's name in it."""
        *folders, last = name.split("/")
        if not is_within_folder(name):
            raise ValueError(f"a file's name must be within the folder, but got {name!r}")
        handle = os.dup(self._handle)
        try:
            for folder in folders:
                if make:
                    with suppress(FileExistsError):
                        os.mkdir(folder, 0o777, dir_fd=handle)
                inner = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=handle)
                os.close(handle)
                handle = inner
            yield handle, last
        finally:
            os.close(handle)

    def _refusal(self, name: str, error: OSError | None) -> BadInput:
        fault = "is not a regular file" if error is None else f"cannot be used ({error.strerror})"
        rule = f"{fault}: a run uses regular files only, no symbolic links; it is left unchanged"
        return BadInput(str(self.path / name), rule)


def digest_of(content: bytes) -> bytes:
    """Return the digest of a file's content."""
    return hashlib.blake2b(content, digest_size=16).digest()


class RunFiles:
    """The files that a run wrote into its directory; changing them requires the lock."""

    def __init__(self, database: sqlite3.Connection, directory: Directory) -> None:
        self._database = database
        self._directory = directory

    def write(self, contents: Iterable[tuple[str, bytes]], *, durable: bool = True) -> None:
        """Write the files that are not up to date.

        Args:
            contents: names and contents.
            durable: same as in `Directory.write`.

        Raises:
            BadInput: a file of one of these names exists that the run did not write; all others are written.
            OSError: the disk is full, or fails.
        """
        source, foreign = iter(contents), list[str]()
        while batch := list(islice(source, 1000)):  # recorded in one transaction
            pending: list[tuple[str, bytes, bytes, bytes | None]] = []
            for name, content in batch:
                old, digest, entry = self._directory.read(name), digest_of(content), self._entry(name)
                before = None if old is None else digest_of(old)
                if old is not None and not _is_ours(entry, old):
                    if before != digest:  # an identical file does no harm
                        foreign.append(name)
                elif before != digest or entry is None or entry[0] != digest:
                    pending.append((name, content, digest, before))
            self.record([(name, digest, before) for name, _, digest, before in pending])
            for name, content, *_ in pending:
                self._directory.write(name, content, durable=durable)
        self._refuse(foreign)

    def read(self, name: str) -> bytes | None:
        """Return the content of a file as the run wrote it; None if the file does not exist.

        Raises:
            BadInput: the file was damaged, edited, or written by something else.
        """
        content = self._directory.read(name)
        if content is not None and self.is_changed(name, content):
            rule = f"{CHANGED}: remove it, and run the same command again to recreate it"
            raise BadInput(str(self._directory.path / name), rule)
        return content

    def is_changed(self, name: str, content: bytes) -> bool:
        """Return whether the run did not write this content to the file of this name."""
        digest, before, changing = self._entry(name) or (None, None, 0)
        return not changing and digest_of(content) not in (digest, before)

    def find_changed(self) -> list[str]:
        """Return the names of all existing files whose content the run did not write."""
        names = self._database.execute("SELECT name FROM files ORDER BY name").fetchall()
        contents = ((name, self._directory.read(name)) for (name,) in names)
        return [name for name, content in contents if content is not None and self.is_changed(name, content)]

    def remove(self, names: Iterable[str]) -> None:
        """Remove files that the run wrote, unless their content was changed since."""
        for name in names:
            if (entry := self._entry(name)) is None:
                continue
            if (content := self._directory.read(name)) is not None and _is_ours(entry, content):
                self._directory.remove(name)
            with self._database:
                self._database.execute("BEGIN IMMEDIATE")
                self._database.execute("DELETE FROM files WHERE name = ?", (name,))

    def adopt(self, *names: str) -> None:
        """Record files that another library recreates and appends to.

        Raises:
            BadInput: one of them exists that the run did not create.
        """
        self.require(names)
        self.record([(name, None, None) for name in names], changing=True)

    def require(self, names: Iterable[str]) -> None:
        """Make sure that files of these names do not exist, or are the run's own.

        Raises:
            BadInput: the run did not write some of them.
        """
        foreign = []
        for name in names:
            entry = self._entry(name)
            if entry is not None and entry[2]:  # another library's file: its content is not checked
                continue
            if (content := self._directory.read(name)) is not None and not _is_ours(entry, content):
                foreign.append(name)
        self._refuse(foreign)

    def names_in(self, folder: str) -> list[str]:
        """Return the names of the run's files in a folder such as `designs`."""
        query = "SELECT name FROM files WHERE name >= ? AND name < ?"
        prefix_range = f"{folder}/", f"{folder}0"  # "0" is the character after "/"
        return [name for (name,) in self._database.execute(query, prefix_range)]

    def record(self, records: Sequence[tuple[str, bytes | None, bytes | None]], *, changing: bool = False) -> None:
        """Record files about to be written: name, digest, and digest of the previous content."""
        if records:
            rows = [(*record, int(changing)) for record in records]
            sealed = [(*row, checksum(row)) for row in rows]
            with self._database:
                self._database.execute("BEGIN IMMEDIATE")
                self._database.executemany("INSERT OR REPLACE INTO files VALUES (?, ?, ?, ?, ?)", sealed)

    def _refuse(self, names: list[str]) -> None:
        """Raise BadInput if there are names of files that the run must not replace."""
        rule = (
            f"{CHANGED}, and is left unchanged: move it away and run the same command again, or choose another "
            "folder with --out"
        )
        if names:
            raise BadInput(str(self._directory.path), [Fault(name, rule) for name in names])

    def _entry(self, name: str) -> _Entry | None:
        """Return the record of a file, if the run wrote it."""
        query = "SELECT digest, before, changing FROM files WHERE name = ?"
        entry: _Entry | None = self._database.execute(query, (name,)).fetchone()
        return entry


def _is_ours(entry: _Entry | None, content: bytes) -> bool:
    """True if an existing file is the run's own."""
    if entry is None:
        return False
    digest, before, changing = entry
    return bool(changing) or not content or digest_of(content) in (digest, before)
