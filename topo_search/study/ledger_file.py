"""The ledger's SQLite file: its tables, and the checks of its integrity.

A file of another program, of another version, or with damage that SQLite finds is refused and left unchanged. The
texts of results and audits, nearly all of the file, are checked when they are read: the row of their candidate has
their checksums (CRC-32). The file is created complete, with its run, so an empty file is damaged.
"""

import sqlite3
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

from topo_search.model import BadInput
from topo_search.model.value import faults_of

if TYPE_CHECKING:
    from topo_search.model import Design
    from topo_search.study.answer import Answer

KEPT = "all results are kept; run the same command to continue"
"""Note (PEP 678) on the exception that ends a run early, once its results are safe."""
APPLICATION_ID = 0x746F706F
"""`topo`, in the header of the file."""
VERSION = 10
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
    force_reserve_N REAL, torque_reserve_Nm REAL, rotors_out_hover INTEGER, load_factor REAL, joint_moment_Nm REAL,
    hinge_tolerance_deg REAL, rod_length_m REAL, value REAL, value_bound REAL, reach REAL,
    standing INTEGER NOT NULL, result_checksum INTEGER, audit_checksum INTEGER, PRIMARY KEY (context, key)
) WITHOUT ROWID;
CREATE TABLE texts (context TEXT NOT NULL, key TEXT NOT NULL, result BLOB, audit BLOB, PRIMARY KEY (context, key));
CREATE TABLE solves (
    number INTEGER PRIMARY KEY, at REAL NOT NULL, context TEXT NOT NULL, key TEXT NOT NULL, asked INTEGER NOT NULL,
    status TEXT NOT NULL, objective REAL, violation REAL, value REAL
);
CREATE TABLE files (name TEXT NOT NULL, digest BLOB NOT NULL, PRIMARY KEY (name, digest)) WITHOUT ROWID;
CREATE INDEX ranking ON candidates (context, value DESC, objective, key);
COMMIT;
"""
"""`run`: the identity and the latest request. `standing`: whether this row represents its candidate, rather than
one with another margin. `texts`: results and audits in JSON; their checksums are in `candidates`, null without a
text. `solves`: one row per solve, in order of completion, with the candidate's result after `asked` starts;
strategies are replayed from them. `ended_...`: the request for which the strategy last finished. `files`: digests
of all contents that the run wrote into files of its folder (`directory`)."""
OLDER = 9
UPGRADE = f"""
BEGIN; ALTER TABLE candidates ADD COLUMN value REAL; ALTER TABLE candidates ADD COLUMN value_bound REAL;
ALTER TABLE candidates ADD COLUMN reach REAL; ALTER TABLE solves ADD COLUMN value REAL;
DROP INDEX ranking; CREATE INDEX ranking ON candidates (context, value DESC, objective, key);
PRAGMA user_version = {VERSION}; COMMIT;
"""
"""Columns that an `OLDER` ledger lacks; one that is only read is upgraded in memory."""
Model = TypeVar("Model", bound=BaseModel)


class LedgerLost(Exception):
    """The ledger, or its folder, was removed, moved or replaced while a run worked in it."""

    def __init__(self, path: Path) -> None:
        self.answer: Answer | None = None
        """The run's answer, as far as it can still be read."""
        self.design: Design | None = None
        """The best design, audited if possible: this may be its only copy."""
        super().__init__(
            f"{path}: was removed, moved or replaced during the run; the run stopped, and later results are only "
            "in the output printed here"
        )


def blank(identity: str) -> bytes:
    """Return the content of a new ledger file with the identity of its run."""
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as database:
        database.executescript(SCHEMA)
        database.execute("INSERT INTO run VALUES (?, 0, NULL)", (identity,))
        return database.serialize()


@contextmanager
def open_database(path: Path, *, read_only: bool) -> Iterator[sqlite3.Connection]:
    """Open a ledger's file; same arguments and errors as `Ledger.open`.

    Damage that is found later raises BadInput too.
    """
    if not path.is_file():
        raise refusal(path, "is not a regular file")
    if not path.stat().st_size:  # only `stat`: opening and closing the file would drop SQLite's locks
        raise damage(path, "it is empty")
    options = "?mode=rw"
    if read_only:  # without a log or journal the file can be read on its own, and SQLite creates no files
        has_log = any(path.with_name(f"{path.name}-{kind}").exists() for kind in ("wal", "journal"))
        options = "?mode=ro" if has_log else "?mode=ro&immutable=1"
    uri = path.absolute().as_uri() + options
    try:
        try:
            database = _open(uri, path, read_only=read_only)
        except sqlite3.OperationalError as error:
            if getattr(error, "sqlite_errorcode", 0) & 0xFF not in (sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CANTOPEN):
                raise
            database = _open(uri, path, read_only=read_only, maps=False)
        with closing(database):
            yield database
    except sqlite3.DatabaseError as error:  # text that is not UTF-8 has no code of SQLite
        code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF
        if code not in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
            raise  # such as a full disk
        raise damage(path, str(error)) from None


def _open(uri: str, path: Path, *, read_only: bool, maps: bool = True) -> sqlite3.Connection:
    """Return a connection that writes a log ahead or, on a disk without shared memory maps, keeps a journal."""
    database = sqlite3.connect(uri, isolation_level=None, uri=True)
    try:
        if not maps:
            database.execute("PRAGMA locking_mode = EXCLUSIVE")  # for a log that is left, which then needs no map
        _check(database, path)
        if not read_only:  # a truncated journal stays, by which readers know that a run writes
            database.execute(f"PRAGMA journal_mode = {'WAL' if maps else 'TRUNCATE'}")
            database.execute("PRAGMA locking_mode = NORMAL")
            database.execute("PRAGMA synchronous = FULL")
            database.execute("BEGIN IMMEDIATE")  # creates the log, whose loss is noticed from then on
            database.execute("ROLLBACK")
        if _pragma(database, "user_version") == OLDER:
            if read_only:
                file, database = database, sqlite3.connect(":memory:", isolation_level=None)
                with closing(file):
                    file.backup(database)
            database.executescript(UPGRADE)
    except BaseException:
        database.close()
        raise
    return database


def _check(database: sqlite3.Connection, path: Path) -> None:
    """Refuse a file that is not a ledger, or is damaged, before anything is written to it."""
    if _pragma(database, "application_id") != APPLICATION_ID:
        raise refusal(path, "is an SQLite file of another program")
    if (version := _pragma(database, "user_version")) not in (OLDER, VERSION):
        raise refusal(path, f"has version {version}, but this program reads version {VERSION}")
    # all but `texts`, which have checksums
    for table in ("sqlite_schema", "run", "contexts", "candidates", "solves", "files"):
        if (report := _pragma(database, f"integrity_check({table})")) != "ok":
            raise damage(path, report)


def _pragma(database: sqlite3.Connection, name: str) -> Any:
    return database.execute(f"PRAGMA {name}").fetchone()[0]


def checked_text(path: Path, key: str, text: bytes | None, checksum: int) -> str:
    """Return the text of a candidate's result or audit.

    Raises:
        BadInput: it has changed since it was written, or is missing.
    """
    if text is None or zlib.crc32(text) != checksum:
        raise damage(path, f"its entry {key} has changed since it was written")
    return text.decode()


def parse(path: Path, model: type[Model], table: str, text: str) -> Model:
    """Return the value of a JSON text from a table.

    Raises:
        BadInput: the text is invalid.
    """
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        raise damage(path, f"its table {table}: {faults_of(error, model)[0]}") from None


def damage(path: Path, what: str) -> BadInput:
    """Return the error for a damaged file, which is left unchanged."""
    return refusal(path, f"is damaged ({what})")


def refusal(path: Path, what: str) -> BadInput:
    """Return the error for a file that is not used, and left unchanged."""
    return BadInput(str(path), f"{what}; it is left unchanged: choose another folder with --out, or move it away")
