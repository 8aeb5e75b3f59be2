"""The ledger's file: its tables, and whether it is whole.

A file is checked when it is opened, but for the texts of results and audits, which are nearly all of it: each has
its checksum in the row of its candidate, and is compared with it whenever it is read.
"""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from topo_search.model import BadInput, Fault

APPLICATION_ID = 0x746F706F
"""`topo`, in the header of the file."""
VERSION = 4

SCHEMA = f"""
BEGIN;
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {VERSION};
CREATE TABLE run (identity TEXT NOT NULL, starts INTEGER NOT NULL, trials INTEGER);
CREATE TABLE contexts (
    context TEXT PRIMARY KEY, modules INTEGER NOT NULL, step INTEGER NOT NULL, margin REAL NOT NULL,
    fixed_by TEXT NOT NULL, lower_bound REAL NOT NULL, proof TEXT, ended_starts INTEGER, ended_trials INTEGER
) WITHOUT ROWID;
CREATE TABLE candidates (
    context TEXT NOT NULL, key TEXT NOT NULL, modules INTEGER NOT NULL, orbit INTEGER NOT NULL,
    status TEXT NOT NULL,
    objective REAL, lower_bound REAL, gap REAL, worst_constraint TEXT, violation REAL, unit TEXT,
    starts INTEGER NOT NULL, starts_feasible INTEGER NOT NULL, starts_at_best INTEGER NOT NULL,
    seconds REAL NOT NULL,
    audit TEXT, asked INTEGER NOT NULL, audit_failure TEXT, margin REAL NOT NULL, step INTEGER NOT NULL,
    standing INTEGER NOT NULL, result_checksum INTEGER, audit_checksum INTEGER,
    PRIMARY KEY (context, key)
) WITHOUT ROWID;
CREATE TABLE texts (context TEXT NOT NULL, key TEXT NOT NULL, result BLOB, audit BLOB, PRIMARY KEY (context, key));
CREATE TABLE solves (
    number INTEGER PRIMARY KEY, at REAL NOT NULL, context TEXT NOT NULL, key TEXT NOT NULL, asked INTEGER NOT NULL,
    status TEXT NOT NULL, objective REAL, violation REAL
);
CREATE INDEX ranking ON candidates (context, objective, key);
COMMIT;
"""
"""`starts`: asked for last. `standing`: this row speaks for its candidate, not one with another margin. `texts`: of
results and audits, in JSON; `..._checksum` of a candidate is that of its text, null where there is none. `solves`:
one row a solve, in the order of their ends, with what the candidate had reached after `asked` starts; a strategy is
replayed from them. `ended_...`: what the strategy was asked for when it last came to its end."""

CHECKED = ("sqlite_schema", "run", "contexts", "candidates", "solves")
"""The tables that are checked when the file is opened; SQLite before 3.33 checks all."""

ADVICE = "choose another folder with --out, or move it away"


@contextmanager
def opened(path: Path, *, read_only: bool) -> Iterator[sqlite3.Connection]:
    """Open a ledger's file, or begin one where there is none; arguments and errors as `Ledger.opened`."""
    options = ""
    if read_only:  # without a log that a killed process left there is nothing to share with other processes
        logged = path.with_name(f"{path.name}-wal").exists()
        options = "?mode=ro" if logged else "?mode=ro&immutable=1"
    database = sqlite3.connect(path.absolute().as_uri() + options, isolation_level=None, uri=True)
    try:
        with damage_named(path):
            empty = _check(database, path)
        if empty and read_only:
            raise _refused(path, "is empty")
        if not read_only:
            _begin(database, fill=empty)
        yield database
    finally:
        database.close()


@contextmanager
def damage_named(path: Path) -> Iterator[None]:
    """Turn what SQLite says of a damaged file into BadInput; a disk that is full or fails is another matter."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        if type(error) is not sqlite3.DatabaseError:
            raise
        raise _bad(path, f"is damaged or no ledger ({error}); {ADVICE}") from None


def whole(path: Path, key: str, text: bytes | None, checksum: int) -> str:
    """Return the text of a candidate's result or audit.

    Raises:
        BadInput: it is not the one that was written, or is gone.
    """
    if text is None or zlib.crc32(text) != checksum:
        raise _bad(path, f"is damaged (what it holds of {key} is not what was written); {ADVICE}")
    return text.decode()


def _check(database: sqlite3.Connection, path: Path) -> bool:
    """Return whether a file is empty; refuse what is no ledger before anything is written to it."""
    application: int = database.execute("PRAGMA application_id").fetchone()[0]
    version = database.execute("PRAGMA user_version").fetchone()[0]
    tables: int = database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if tables == 0 and application == 0:
        return True
    if application != APPLICATION_ID:
        raise _refused(path, "is an SQLite file of another program")
    if version != VERSION:
        raise _refused(path, f"has version {version}, but this program reads version {VERSION}")
    for table in CHECKED:
        if (fault := database.execute(f"PRAGMA quick_check({table})").fetchone()[0]) != "ok":
            raise _refused(path, f"is damaged ({fault})")
    return False


def _begin(database: sqlite3.Connection, *, fill: bool) -> None:
    """Make every transaction last once it has ended, and fill a new file."""
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")
    if fill:
        database.executescript(SCHEMA)


def _refused(path: Path, what: str) -> BadInput:
    return _bad(path, f"{what}; it is left as it is: {ADVICE}")


def _bad(path: Path, text: str) -> BadInput:
    return BadInput(str(path), [Fault("", text)])
