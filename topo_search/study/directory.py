"""The directory of a run: one process writes in it, names never lead outside, and only the run's files are changed.

Its lock admits one process. Files are looked up by the directory's descriptor, and no symbolic link is followed.
The ledger's table `files` says which of them the run wrote: it replaces and removes these alone.

| column | meaning |
|---|---|
| `digest` | of the content that the run wrote last, or is about to write; null: none, the file is to go |
| `before` | of the content before that, which is there until the write has happened; null: no file |
| `changing` | 1: some other library appends to the file, so that its content says nothing |

What is to be written is recorded first: a run that is killed in between finds either content, and knows both. An
empty file of a known name is the run's too: a power cut may leave one of a file that is not made to last.
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
    """A file that is being written. There is one at a time, so that the next run removes what a killed one left."""
    LEDGER = "ledger.sqlite"
    TASK = "task.toml"
    FRONT = "front.csv"
    REPORT = "report.html"
    RESULTS = ("best.json", "candidates.csv", FRONT, REPORT, TASK)
    """Files that tell of a run; with a range of sizes there is a `best-nN.json` of each besides."""
    PARTS = ("designs", "audits")
    """Folders with a file per candidate."""
    PROOFS = "proof"
    """The folder of the proofs, one file per candidate that was looked at."""
    OPTIMA = "optima"
    """The folder of local optima."""
    OPTIMA_RECORD = "optima.json"
    RELAXED = "relaxed"
    """The folder of what gives the closest trees a design, one file per size without any."""


CHANGED = "is not the file that this run wrote"
"""Fault of a file that somebody else changed or put there."""
_Entry = tuple[bytes | None, bytes | None, int]
"""Digest, the one before, and whether the file changes."""


class ReadOnlyFolder(BadInput):
    """A folder in which this process can write nothing."""

    def __init__(self, folder: Path, reason: str | None) -> None:
        rule = f"cannot be written to: {reason}; choose another folder with --out"
        super().__init__(str(folder), rule)


class Directory:
    """A folder; the names of its files are relative, with `/` between folder and file."""

    def __init__(self, path: Path, handle: int) -> None:
        self.path = path
        self._handle = handle

    @classmethod
    @contextmanager
    def open(cls, path: Path) -> Iterator[Self]:
        """Hold a folder that is there. Its own path may have links in it.

        Raises:
            BadInput: it is a file.
            OSError: it cannot be held.
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
        """Hold the folder's lock; the system frees it when the process ends, however it ends.

        The folder itself is locked too where its disk can do that, so that removing the file lets nobody in.

        Raises:
            ReadOnlyFolder: nothing can be written there, or its disk knows no locks.
            BadInput: another process holds it, or the lock file is not ours.
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
            # who holds the lock, or held it last
            if not re.fullmatch(rb"(\d+ on [^\n]*\n)?", holder := os.pread(handle, 512, 0)):
                raise self._foreign_lock()
            # what network disks say that cannot lock folders
            no_locks_on_folders = (errno.EBADF, errno.ENOLCK, errno.EINVAL, errno.ENOTSUP, errno.EISDIR)
            for each in (self._handle, handle):
                try:
                    fcntl.flock(each, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    name = holder.decode(errors="replace").strip() or "unknown"
                    raise BadInput(str(self.path), f"another run is using this folder (process {name})") from None
                except OSError as error:
                    if each == handle or error.errno not in no_locks_on_folders:
                        raise ReadOnlyFolder(self.path, f"{error.strerror} on its disk") from None
            os.ftruncate(handle, 0)
            os.write(handle, f"{os.getpid()} on {platform.node()}\n".encode())
            yield

    def _foreign_lock(self) -> BadInput:
        rule = "is not the lock file of a run, and is left unchanged: move it away, or choose another folder"
        return BadInput(str(self.path / RunFile.LOCK), rule)

    def names(self) -> list[str]:
        """Return the names of all that is in the folder itself."""
        return sorted(os.listdir(self._handle))

    def read(self, name: str, *, most_bytes: int = LIMITS.run_bytes) -> bytes | None:
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
                raise BadInput(str(self.path / name), rule)
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
                flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
                handle = os.open(RunFile.PARTIAL, flags, 0o666, dir_fd=self._handle)
                try:
                    with os.fdopen(handle, "wb", buffering=0) as stream:
                        rest = memoryview(content)
                        while rest:
                            rest = rest[os.write(handle, rest) :]
                        if lasting:
                            os.fsync(stream.fileno())
                    os.rename(RunFile.PARTIAL, last, src_dir_fd=self._handle, dst_dir_fd=folder)
                except BaseException:
                    with suppress(OSError):
                        os.unlink(RunFile.PARTIAL, dir_fd=self._handle)
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
            os.unlink(RunFile.PARTIAL, dir_fd=self._handle)

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
                inner = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=handle)
                os.close(handle)
                handle = inner
            yield handle, last
        finally:
            os.close(handle)

    def _refusal(self, name: str, error: OSError | None) -> BadInput:
        why = "is no regular file" if error is None else f"cannot be used ({error.strerror})"
        rule = f"{why}: a run uses regular files only, no symbolic links; it is left unchanged"
        return BadInput(str(self.path / name), rule)


def digest_of(content: bytes) -> bytes:
    """Return what a file's content is known by."""
    return hashlib.blake2b(content, digest_size=16).digest()


class RunFiles:
    """The files that a run wrote into its directory; only who holds its lock may change them."""

    def __init__(self, database: sqlite3.Connection, directory: Directory) -> None:
        self._database = database
        self._directory = directory

    def keep(self, contents: Iterable[tuple[str, bytes]], *, lasting: bool = True) -> None:
        """Bring files up to their contents.

        Args:
            contents: names and contents.
            lasting: as of `Directory.write`.

        Raises:
            BadInput: a file of this name is there that the run did not write; all others are written.
            OSError: the disk is full, or fails.
        """
        source, foreign = iter(contents), list[str]()
        while batch := list(islice(source, 1000)):  # recorded in one transaction
            due: list[tuple[str, bytes, bytes, bytes | None]] = []
            for name, content in batch:
                old, digest, entry = self._directory.read(name), digest_of(content), self._entry(name)
                before = None if old is None else digest_of(old)
                if old is not None and not _is_ours(entry, old):
                    if before != digest:  # the very same is in nobody's way
                        foreign.append(name)
                elif before != digest or entry is None or entry[0] != digest:
                    due.append((name, content, digest, before))
            self.record([(name, digest, before) for name, _, digest, before in due])
            for name, content, *_ in due:
                self._directory.write(name, content, lasting=lasting)
        self._refuse(foreign)

    def read(self, name: str) -> bytes | None:
        """Return the content of a file as the run wrote it; None if the file is not there.

        Raises:
            BadInput: its content is another one: damaged, edited, or somebody else's.
        """
        content = self._directory.read(name)
        if content is not None and self.is_changed(name, content):
            rule = f"{CHANGED}: remove it, and run the same command again to make it again"
            raise BadInput(str(self._directory.path / name), rule)
        return content

    def is_changed(self, name: str, content: bytes) -> bool:
        """Return whether a content is none that the run gave the file of this name."""
        digest, before, changing = self._entry(name) or (None, None, 0)
        return not changing and digest_of(content) not in (digest, before)

    def find_changed(self) -> list[str]:
        """Return the names of all files that are there with another content than the run gave them."""
        names = self._database.execute("SELECT name FROM files ORDER BY name").fetchall()
        contents = ((name, self._directory.read(name)) for (name,) in names)
        return [name for name, content in contents if content is not None and self.is_changed(name, content)]

    def remove(self, names: Iterable[str]) -> None:
        """Remove those of some files that the run wrote; what somebody else has changed since stays."""
        for name in names:
            if (entry := self._entry(name)) is None:
                continue
            if (content := self._directory.read(name)) is not None and _is_ours(entry, content):
                self._directory.remove(name)
            with self._database:
                self._database.execute("BEGIN IMMEDIATE")
                self._database.execute("DELETE FROM files WHERE name = ?", (name,))

    def adopt(self, *names: str) -> None:
        """Take files over that another library makes anew and appends to.

        Raises:
            BadInput: one is there that the run did not make.
        """
        self.require(names)
        self.record([(name, None, None) for name in names], changing=True)

    def require(self, names: Iterable[str]) -> None:
        """Make sure that files of some names are the run's own, or not there.

        Raises:
            BadInput: some are somebody else's.
        """
        foreign = []
        for name in names:
            entry = self._entry(name)
            if entry is not None and entry[2]:  # another library's, which need not be read
                continue
            if (content := self._directory.read(name)) is not None and not _is_ours(entry, content):
                foreign.append(name)
        self._refuse(foreign)

    def names_in(self, folder: str) -> list[str]:
        """Return the names of the files that the run wrote into one of its folders, `designs` for instance."""
        query = "SELECT name FROM files WHERE name >= ? AND name < ?"
        return [name for (name,) in self._database.execute(query, (f"{folder}/", f"{folder}0"))]  # 0 follows /

    def record(self, records: Sequence[tuple[str, bytes | None, bytes | None]], *, changing: bool = False) -> None:
        """Record what is about to be written: name, digest, and that of what is there before."""
        if records:
            rows = [(*record, int(changing)) for record in records]
            sealed = [(*row, checksum(row)) for row in rows]
            with self._database:
                self._database.execute("BEGIN IMMEDIATE")
                self._database.executemany("INSERT OR REPLACE INTO files VALUES (?, ?, ?, ?, ?)", sealed)

    def _refuse(self, names: list[str]) -> None:
        """Name the files that stand where the run would write its own, if there are any."""
        rule = (
            f"{CHANGED}, and is left unchanged: move it away and run the same command again, or choose another "
            "folder with --out"
        )
        if names:
            raise BadInput(str(self._directory.path), [Fault(name, rule) for name in names])

    def _entry(self, name: str) -> _Entry | None:
        """Return what is recorded of a file that the run wrote."""
        query = "SELECT digest, before, changing FROM files WHERE name = ?"
        entry: _Entry | None = self._database.execute(query, (name,)).fetchone()
        return entry


def _is_ours(entry: _Entry | None, content: bytes) -> bool:
    """True if a file that is there is the run's own."""
    if entry is None:
        return False
    digest, before, changing = entry
    return bool(changing) or not content or digest_of(content) in (digest, before)
