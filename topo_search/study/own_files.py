"""Files that a run wrote into its folder: it replaces and removes these alone, and knows them by its ledger.

| column | meaning |
|---|---|
| `digest` | of the content that the run wrote last, or is about to write; null: none, the file is to go |
| `before` | of the content before that, which is there until the write has happened; null: no file |
| `changing` | 1: some other library appends to the file, so that its content says nothing |

What is to be written is recorded first: a run that is killed in between finds either content, and knows both. An
empty file of a known name is the run's too: a power cut may leave one of a file that is not made to last.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

from topo_search.model import BadInput, Fault
from topo_search.study.place import Place, is_within_folder
from topo_search.study.seals import checksum

BATCH = 1000
"""Files that are recorded in one transaction."""
_KEEP = "INSERT OR REPLACE INTO files VALUES (?, ?, ?, ?, ?)"


def digest_of(content: bytes) -> bytes:
    """Return what a file's content is known by."""
    return hashlib.blake2b(content, digest_size=16).digest()


class OwnFiles:
    """The files of one ledger; only who holds the folder's lock may change them."""

    def __init__(self, database: sqlite3.Connection, ledger: Path) -> None:
        self._database = database
        self._ledger = ledger

    def keep(self, place: Place, contents: Iterable[tuple[str, bytes]], *, lasting: bool = True) -> None:
        """Bring files up to their contents.

        Args:
            place: the run's folder.
            contents: names and contents.
            lasting: as of `Place.write`.

        Raises:
            BadInput: a file of this name is there that the run did not write; all others are written.
            OSError: the disk is full, or fails.
        """
        source, foreign = iter(contents), list[str]()
        while batch := list(islice(source, BATCH)):
            due: list[tuple[str, bytes]] = []
            records: list[tuple[str, bytes, bytes | None]] = []
            for name, content in batch:
                digest, there = digest_of(content), place.read(name)
                found = None if there is None else digest_of(there)
                known = self._entry(name)
                if there is not None and not self._owns(known, there, found):
                    if found != digest:  # the very same is in nobody's way
                        foreign.append(name)
                    continue
                if found != digest:
                    due.append((name, content))
                if found != digest or known is None or known[0] != digest:
                    records.append((name, digest, found))
            self.record(records)
            for name, content in due:
                place.write(name, content, lasting=lasting)
        if foreign:
            raise self.refusal(place, foreign)

    def read(self, place: Place, name: str) -> bytes | None:
        """Return the content of a file as the run wrote it; None if the file is not there.

        Raises:
            BadInput: its content is another one: damaged, edited, or somebody else's.
        """
        content = place.read(name)
        if content is not None and self.is_changed(name, content):
            rule = "is not the file that this run wrote: remove it, and run the same command again to make it anew"
            raise BadInput(str(place.path / name), [Fault("", rule)])
        return content

    def is_changed(self, name: str, content: bytes) -> bool:
        """Return whether a content is none that the run gave the file of this name."""
        digest, before, changing = self._entry(name) or (None, None, 0)
        return not changing and digest_of(content) not in (digest, before)

    def find_changed(self, place: Place) -> list[str]:
        """Return the names of all files that are there with another content than the run gave them."""
        names = (name for (name,) in self._database.execute("SELECT name FROM files ORDER BY name").fetchall())
        contents = ((name, place.read(name)) for name in names if is_within_folder(name))
        return [name for name, content in contents if content is not None and self.is_changed(name, content)]

    def remove(self, place: Place, names: Iterable[str]) -> None:
        """Remove those of some files that the run wrote; what somebody else has changed since stays."""
        for name in names:
            known = self._entry(name)
            if known is None:
                continue
            if (there := place.read(name)) is not None and self._owns(known, there, digest_of(there)):
                place.remove(name)
            with self._database:
                self._database.execute("BEGIN IMMEDIATE")
                self._database.execute("DELETE FROM files WHERE name = ?", (name,))

    def adopt(self, place: Place, *names: str) -> None:
        """Take files over that another library makes anew and appends to.

        Raises:
            BadInput: one is there that the run did not make.
        """
        self.require(place, names)
        values = [(name, None, None, 1) for name in names]
        with self._database:
            self._database.execute("BEGIN IMMEDIATE")
            self._database.executemany(_KEEP, [(*row, checksum(row)) for row in values])

    def require(self, place: Place, names: Iterable[str]) -> None:
        """Make sure that files of some names are the run's own, or not there.

        Raises:
            BadInput: some are somebody else's.
        """
        foreign = []
        for name in names:
            known, there = self._entry(name), None
            if known is None or not known[2]:
                there = place.read(name)
            if there is not None and not self._owns(known, there, digest_of(there)):
                foreign.append(name)
        if foreign:
            raise self.refusal(place, foreign)

    def names_in(self, folder: str) -> list[str]:
        """Return the names of the files that the run wrote into one of its folders, `designs` for instance."""
        query = "SELECT name FROM files WHERE name >= ? AND name < ?"
        names = [name for (name,) in self._database.execute(query, (f"{folder}/", f"{folder}0"))]  # 0 follows /
        if odd := next((name for name in names if not is_within_folder(name)), None):
            raise self._damage(odd)
        return names

    @staticmethod
    def refusal(place: Place, names: list[str]) -> BadInput:
        """Return the error that names files that stand where the run would write its own."""
        rule = (
            "is not the file that this run wrote, and is left unchanged: move it away and run the same command "
            "again, or choose another folder with --out"
        )
        return BadInput(str(place.path), [Fault(name, rule) for name in names])

    def _entry(self, name: str) -> tuple[bytes | None, bytes | None, int] | None:
        """Return digest, the one before and whether it changes, of a file that the run wrote."""
        found = self._database.execute("SELECT * FROM files WHERE name = ?", (name,)).fetchone()
        if found is None:
            return None
        if checksum(found[:-1]) != found[-1]:
            raise self._damage(name)
        _, digest, before, changing, _ = found
        return digest, before, changing

    def _damage(self, name: str) -> BadInput:
        rule = f"is damaged (its entry of the file {name} has changed since it was written)"
        return BadInput(str(self._ledger), [Fault("", rule)])

    @staticmethod
    def _owns(known: tuple[bytes | None, bytes | None, int] | None, there: bytes, found: bytes | None) -> bool:
        """Whether a file that is there is the run's own."""
        if known is None:
            return False
        digest, before, changing = known
        return bool(changing) or not there or found in (digest, before)

    def record(self, records: list[tuple[str, bytes, bytes | None]]) -> None:
        """Record what is about to be written, and what is there before."""
        if not records:
            return
        rows = [(*record, 0) for record in records]
        with self._database:
            self._database.execute("BEGIN IMMEDIATE")
            self._database.executemany(_KEEP, [(*row, checksum(row)) for row in rows])


def contents(texts: Iterable[tuple[str, str]]) -> Iterator[tuple[str, bytes]]:
    """Yield names and contents of files from their texts."""
    for name, text in texts:
        yield name, text.encode()
