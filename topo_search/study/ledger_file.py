"""The ledger's file: its tables, and whether it is whole.

A file is checked when it is opened, but for the texts of results and audits, which are nearly all of it: each has
its checksum in the row of its candidate, and is compared with it whenever it is read.
"""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from topo_search.model import BadInput, Fault
from topo_search.model.bad_input import faults_of

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

Model = TypeVar("Model", bound=BaseModel)


@contextmanager
def opened(path: Path, *, read_only: bool) -> Iterator[sqlite3.Connection]:
    """Open a ledger's file, or begin one where there is none; arguments and errors as `Ledger.opened`.

    Damage that is found later is named as well.
    """
    if path.exists() and not path.is_file():
        raise refused(path, "is no file")
    options = ""
    if read_only:  # without a log that a killed process left there is nothing to share with other processes
        logged = path.with_name(f"{path.name}-wal").exists()
        options = "?mode=ro" if logged else "?mode=ro&immutable=1"
    with (
        closing(sqlite3.connect(path.absolute().as_uri() + options, isolation_level=None, uri=True)) as database,
        _damage_named(path),
    ):
        empty = _check(database, path)
        if empty and read_only:
            raise refused(path, "is empty")
        if not read_only:
            _begin(database, fill=empty)
        yield database


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """Turn what SQLite says of a damaged file into BadInput; a disk that is full or fails is another matter."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        # what is no text comes as an OperationalError, but not from SQLite itself, and so without a code
        no_text = isinstance(error, sqlite3.OperationalError) and not hasattr(error, "sqlite_errorcode")
        if type(error) is not sqlite3.DatabaseError and not no_text:
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


def parsed(path: Path, model: type[Model], table: str, text: str) -> Model:
    """Return what a table holds as JSON text.

    Raises:
        BadInput: it is no such thing.
    """
    try:
        return model.model_validate_json(text, strict=True)
    except ValidationError as error:
        raise damaged(path, f"its table {table}: {faults_of(error, model)[0]}") from None


def _check(database: sqlite3.Connection, path: Path) -> bool:
    """Return whether a file is empty; refuse what is no ledger before anything is written to it."""
    application: int = database.execute("PRAGMA application_id").fetchone()[0]
    version = database.execute("PRAGMA user_version").fetchone()[0]
    tables: int = database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if tables == application == version == 0:
        return True
    if application != APPLICATION_ID:
        raise refused(path, "is an SQLite file of another program")
    if version != VERSION:
        raise refused(path, f"has version {version}, but this program reads version {VERSION}")
    _check_tables(database, path)
    for table in CHECKED:
        if (fault := database.execute(f"PRAGMA quick_check({table})").fetchone()[0]) != "ok":
            raise damaged(path, fault)
    return False


def _check_tables(database: sqlite3.Connection, path: Path) -> None:
    """Refuse a ledger that has lost a table or a column."""
    held = _columns(database)
    with closing(sqlite3.connect(":memory:")) as pattern:
        pattern.executescript(SCHEMA)
        for table, columns in _columns(pattern).items():
            if table not in held:
                raise damaged(path, f"it has no table {table}")
            if lacking := columns - held[table]:
                raise damaged(path, f"its table {table} has no column {min(lacking)}")


def _columns(database: sqlite3.Connection) -> dict[str, set[str]]:
    """Return the columns of every table."""
    tables: dict[str, set[str]] = {}
    query = (
        "SELECT tables.name, columns.name FROM sqlite_master AS tables, pragma_table_info(tables.name) AS columns"
    )
    for table, column in database.execute(query):
        tables.setdefault(table, set()).add(column)
    return tables


def _begin(database: sqlite3.Connection, *, fill: bool) -> None:
    """Make every transaction last once it has ended, and fill a new file."""
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")
    if fill:
        database.executescript(SCHEMA)


def damaged(path: Path, what: str) -> BadInput:
    """Return the error that names the damage of a file that was only looked at."""
    return refused(path, f"is damaged ({what})")


def refused(path: Path, what: str) -> BadInput:
    """Return the error that says why a file is not used."""
    return _bad(path, f"{what}; it is left as it is: {ADVICE}")


def _bad(path: Path, text: str) -> BadInput:
    return BadInput(str(path), [Fault("", text)])
