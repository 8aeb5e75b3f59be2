"""The folder of a run: one process writes, and only files that the run itself wrote are replaced or removed.

The ledger's table `files` has the digests of all contents that the run wrote, recorded before they are written: if
a run is killed in between, the old content is still known. An empty file may be replaced, too: a power cut leaves
one if a write was not durable.
"""

import fcntl
import hashlib
import os
import platform
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

from topo_search.limits import LIMITS
from topo_search.model import BadInput, Fault, as_bad_input
from topo_search.model.files import write_atomically
from topo_search.model.text import read_regular


class RunFile:
    """Names of files and folders of a run."""

    LOCK = ".lock"
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
    CLOSEST, CLOSEST_AUDIT = "closest.json", "closest-audit.json"
    """The platform that came closest, and its audit, if there is no design."""


CHANGED = "is not the file that this run wrote"
"""Fault of a file that was modified or created by something else."""


class ReadOnlyFolder(BadInput):
    """A folder in which this process cannot write."""

    def __init__(self, folder: Path, reason: str | None) -> None:
        rule = f"cannot be written to: {reason}; choose another folder with --out"
        super().__init__(str(folder), rule)


@contextmanager
def lock(folder: Path) -> Iterator[None]:
    """Hold a folder's lock; the system releases it when the process ends, for whatever reason.

    Raises:
        ReadOnlyFolder: the lock file cannot be written, or the disk does not support locks.
        BadInput: another process holds the lock.
    """
    try:
        stream = (folder / RunFile.LOCK).open("a+b", buffering=0)
    except OSError as error:
        raise ReadOnlyFolder(folder, error.strerror) from None
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            stream.seek(0)
            holder = stream.read().decode(errors="replace").strip() or "unknown"
            raise BadInput(str(folder), f"another run is using this folder (process {holder})") from None
        except OSError as error:
            raise ReadOnlyFolder(folder, f"{error.strerror} on its disk") from None
        stream.truncate(0)
        stream.write(f"{os.getpid()} on {platform.node()}\n".encode())
        yield


def digest_of(content: bytes) -> bytes:
    """Return the digest of a file's content."""
    return hashlib.blake2b(content, digest_size=16).digest()


class RunFiles:
    """The files that a run wrote into its folder; changing them requires the lock.

    Names are relative to the folder, with `/` between folder and file.
    """

    def __init__(self, database: sqlite3.Connection, folder: Path) -> None:
        self._database = database
        self._folder = folder

    def write(self, contents: Iterable[tuple[str, bytes]], *, durable: bool = True) -> None:
        """Write the files that are not up to date.

        Args:
            contents: names and contents.
            durable: whether they are on disk when this returns; otherwise a power cut may leave them empty.

        Raises:
            BadInput: a file of one of these names exists that the run did not write; all others are written.
            OSError: the disk is full, or fails.
        """
        source, foreign = iter(contents), list[str]()
        while batch := list(islice(source, 1000)):  # recorded in one transaction
            pending = list[tuple[str, bytes]]()
            for name, content in batch:
                old = self._content(name)
                if old and old != content and not self.wrote(name, old):
                    foreign.append(name)
                elif old != content or not self.wrote(name, content):
                    pending.append((name, content))
            self.record([(name, digest_of(content)) for name, content in pending])
            for name, content in pending:
                write_atomically(self._folder / name, content, durable=durable)
        self._refuse(foreign)

    def read(self, name: str) -> bytes | None:
        """Return the content of a file as the run wrote it; None if the file does not exist.

        Raises:
            BadInput: the file was damaged, edited, or written by something else.
        """
        content = self._content(name)
        if content is not None and not self.wrote(name, content):
            rule = f"{CHANGED}: remove it, and run the same command again to recreate it"
            raise BadInput(str(self._folder / name), rule)
        return content

    def wrote(self, name: str, content: bytes) -> bool:
        """Return whether the run wrote this content into the file of this name."""
        query = "SELECT count(*) FROM files WHERE name = ? AND digest = ?"
        return bool(self._database.execute(query, (name, digest_of(content))).fetchone()[0])

    def find_changed(self) -> list[str]:
        """Return the names of all existing files whose content the run did not write."""
        names = self._database.execute("SELECT DISTINCT name FROM files ORDER BY name")
        contents = [(name, self._content(name)) for (name,) in names]
        return [name for name, content in contents if content is not None and not self.wrote(name, content)]

    def remove(self, names: Iterable[str]) -> None:
        """Remove files that the run wrote, unless their content was changed since."""
        for name in names:
            content = self._content(name)
            if content is not None and (not content or self.wrote(name, content)):
                (self._folder / name).unlink()
            self._database.execute("DELETE FROM files WHERE name = ?", (name,))

    def require(self, names: Iterable[str]) -> None:
        """Make sure that files of these names do not exist, or are the run's own.

        Raises:
            BadInput: the run did not write some of them.
        """
        contents = [(name, self._content(name)) for name in names]
        self._refuse([name for name, content in contents if content and not self.wrote(name, content)])

    def names_in(self, folder: str) -> list[str]:
        """Return the names of the run's files in a folder such as `designs`."""
        query = "SELECT DISTINCT name FROM files WHERE name >= ? AND name < ?"
        prefix_range = f"{folder}/", f"{folder}0"  # "0" is the character after "/"
        return [name for (name,) in self._database.execute(query, prefix_range)]

    def record(self, digests: Sequence[tuple[str, bytes]]) -> None:
        """Record names and digests of files about to be written."""
        with self._database:
            self._database.execute("BEGIN")
            self._database.executemany("INSERT OR IGNORE INTO files VALUES (?, ?)", digests)

    def _refuse(self, names: list[str]) -> None:
        """Raise BadInput if there are names of files that the run must not replace."""
        rule = (
            f"{CHANGED}, and is left unchanged: move it away and run the same command again, or choose another "
            "folder with --out"
        )
        if names:
            raise BadInput(str(self._folder), [Fault(name, rule) for name in names])

    def _content(self, name: str) -> bytes | None:
        """Return the content of a file; None if it does not exist."""
        try:
            with as_bad_input(str(self._folder / name)):
                return read_regular(self._folder / name, most_bytes=LIMITS.run_bytes)
        except FileNotFoundError:
            return None
